"""Build description of grasp_replay (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'grasp_replay'

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
    description=(
        'Recorded grasps: record, check, repair, replay, and run the whole pipeline offline'
    ),
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'replay = grasp_replay.commands.replay:main',
            'record = grasp_replay.commands.record:main',
            'grasp_report = grasp_replay.commands.grasp_report:main',
            'bag_check = grasp_replay.commands.bag_check:main',
        ],
    },
)
