"""Build description of shell_deform (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'shell_deform'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', '**/*.json', '**/*.yaml']},
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
    description='Live deformed surface of a thin shell in a robot hand',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'deformation = shell_deform.commands.deformation:main',
            'shell_solve = shell_deform.commands.shell_solve:main',
            'shell_verify = shell_deform.commands.shell_verify:main',
            'shell_objects = shell_deform.commands.shell_objects:main',
            'shell_identify = shell_deform.commands.shell_identify:main',
            'object_prepare = shell_deform.commands.object_prepare:main',
        ],
    },
)
