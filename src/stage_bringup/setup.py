from glob import glob

from setuptools import find_packages, setup

package_name = 'stage_bringup'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(),
    package_data={
        package_name: ['py.typed', 'live_page.html'],
        'stage_reports': ['py.typed'],
        'ros2_standin': ['py.typed'],
    },
    data_files=[
        (
            'share/ament_index/resource_index/packages',
            ['resource/' + package_name, 'resource/stage_reports'],
        ),
        ('lib/stage_reports', ['resource/report']),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/config', glob('../../ros_ws/config/*.yaml')),
        ('share/' + package_name + '/launch', glob('../../ros_ws/launch/*.launch.py')),
    ],
    install_requires=['setuptools'],
    extras_require={'live_view': ['foxglove-sdk'], 'rerun': ['rerun-sdk==0.41.0']},
    zip_safe=False,
    maintainer='The maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-275f4c40.example',
    description='The session command, the launcher, the live view, the reports, and the ros2 verbs where ros2cli is absent.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'control = stage_bringup.control:main',
            'keep_awake = stage_bringup.keep_awake:main',
            'report = stage_reports.command:main',
            'session = stage_bringup.session:main',
            'up = stage_bringup.up:main',
            'live_view = stage_bringup.live_view_node:main',
            'rerun = stage_bringup.rerun_view:main',
        ],
    },
)
