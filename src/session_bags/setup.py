from setuptools import find_packages, setup

package_name = 'session_bags'

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
    extras_require={'dask': ['distributed']},  # --scheduler: an archive on a cluster
    zip_safe=False,
    maintainer='The maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-275f4c40.example',
    description='Recording, replaying, reading, checking and repairing mcap sessions.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'session_recorder = session_bags.recorder_node:main',
            'session_player = session_bags.player_node:main',
            'check = session_bags.check:main',
            'repair = session_bags.repair:main',
            'info = session_bags.info:main',
            'convert_xy_circle = session_bags.convert_xy_circle:main',
            'convert_ess_tank = session_bags.convert_ess_tank:main',
            'convert_emps = session_bags.convert_emps:main',
            'convert_odrive_cogging = session_bags.convert_odrive_cogging:main',
        ],
    },
)
