"""Build description of grasp_common (ament_python)."""

from setuptools import find_packages, setup

PACKAGE = 'grasp_common'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
    ],
    install_requires=['setuptools', 'numpy>=1.26', 'rich'],
    extras_require={'test': ['pytest', 'hypothesis']},
    zip_safe=False,
    maintainer='Shell grasp maintainers',
    maintainer_email='maintainers@example.org',
    description='What the grasp packages repeat: clouds, parameters, shutdown, terminal text',
    license='Apache-2.0',
)
