"""Build description of scan_compare (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'scan_compare'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', '**/*.yaml', '**/*.html', '**/*.css', '**/*.js']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
        ('share/' + PACKAGE + '/config', glob('config/*')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='Shell grasp maintainers',
    maintainer_email='maintainers@example.org',
    description='Deformed shells against 3-D scans: registration, distances, statistics',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'scan_compare = scan_compare.scan_compare_node:main',
            'scan_error = scan_compare.commands.scan_error:main',
        ],
    },
)
