from setuptools import find_packages, setup

package_name = 'calibrator'

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
    zip_safe=False,
    maintainer='The maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-275f4c40.example',
    description='Calibration models of the stage and the node that trains and applies them.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'calibrator = calibrator.node:main',
            'retrain_offline = calibrator.retrain_offline:main',
        ],
    },
)
