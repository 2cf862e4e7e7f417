from setuptools import find_packages, setup

package_name = 'stage_reports'

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
    description='Pictures and standard figures: ISO 230-2, ISO 230-4, error maps, learning curves.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': ['report = stage_reports.command:main'],
    },
)
