from setuptools import find_packages, setup

package_name = 'stage_core'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(),
    package_data={package_name: ['py.typed', 'explore.js', 'ros/fastdds_local.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='The maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-275f4c40.example',
    description='Words that all packages share: quantities, frames, clocks, parameters, twin files, sessions; the rclpy base of every node.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [],
    },
)
