# SPDX-License-Identifier: Apache-2.0
"""Build description of barrett_hand_bridge (ament_python); package.xml says who."""

import tempfile
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = 'barrett_hand_bridge'
HERE = Path(__file__).resolve().parent
ABOUT = ElementTree.parse(HERE / 'package.xml').getroot()
# Not beside the sources: what was once built there would be packed for ever.
BUILT = tempfile.TemporaryDirectory()


def ours(name):
    """That package: from the folder beside this one, where pip takes both from one repository."""
    beside = HERE.parent / name
    # With a host: colcon reads no address without one.
    address = beside.as_uri().replace('file://', 'file://localhost')
    return f'{name} @ {address}' if (beside / 'setup.py').exists() else name


setup(
    name=PACKAGE,
    options={'build': {'build_base': BUILT.name}},
    version=ABOUT.findtext('version'),
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', 'description/meshes/*.stl', 'description/*.xacro']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
        ('share/' + PACKAGE + '/launch', glob('launch/*')),
        ('share/' + PACKAGE + '/config', glob('config/*')),
        ('share/' + PACKAGE + '/meshes', glob(PACKAGE + '/description/meshes/*.stl')),
        ('share/' + PACKAGE + '/urdf', glob(PACKAGE + '/description/*.xacro')),
    ],
    python_requires='>=3.10',
    install_requires=[
        ours('grasp_common'),
        'numpy>=1.26',
        'scipy>=1.11',
        'pyyaml',
        'pyserial',
        'python-can',
        'msgpack',
    ],
    extras_require={'plot': ['matplotlib'], 'test': ['pytest', 'hypothesis']},
    zip_safe=False,
    author=ABOUT.findtext('author'),
    maintainer=ABOUT.findtext('maintainer'),
    maintainer_email=ABOUT.find('maintainer').get('email'),
    description=ABOUT.findtext('description'),
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license=ABOUT.findtext('license'),
    project_urls={
        'Paper': 'http://www.cs.iastate.edu/~jia/papers/abstracts/TRO-submit09-abs.html'
    },
    entry_points={
        'console_scripts': [
            'hand_bridge = barrett_hand_bridge.programs:hand_bridge',
            'hand_emulator = barrett_hand_bridge.programs:hand_emulator',
            'hand_calibrate = barrett_hand_bridge.programs:hand_calibrate',
        ],
    },
)
