"""Build description of grasp_view (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'grasp_view'

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
    description='Live 3-D page of a grasp in the browser',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'grasp_view = grasp_view.grasp_view_node:main',
        ],
    },
)
