from setuptools import find_packages, setup

package_name = 'stage_twin'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    # Models of MuJoCo as twin or plant; URDF needs nothing.
    extras_require={'mujoco': ['mujoco<4']},
    zip_safe=False,
    maintainer='The maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-275f4c40.example',
    description='The digital twin: plant, controller, effects, and emulators of the wire protocols.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'stage_twin = stage_twin.node:main',
            'simulate = stage_twin.simulate_command:main',
        ],
    },
)
