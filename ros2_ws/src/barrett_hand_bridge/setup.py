"""Build description of barrett_hand_bridge (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'barrett_hand_bridge'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', 'description/meshes/*.stl', 'description/*.xacro']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
        ('share/' + PACKAGE + '/config', glob('config/*')),
        ('share/' + PACKAGE + '/meshes', glob(PACKAGE + '/description/meshes/*.stl')),
        ('share/' + PACKAGE + '/urdf', glob(PACKAGE + '/description/*.xacro')),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='Shell grasp maintainers',
    maintainer_email='maintainers@example.org',
    description='BarrettHand driver: calibrated finger forces, contact points, hand emulators',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'hand_bridge = barrett_hand_bridge.hand_bridge_node:main',
            'hand_emulator = barrett_hand_bridge.commands.hand_emulator:main',
            'hand_calibrate = barrett_hand_bridge.commands.hand_calibrate:main',
        ],
    },
)
