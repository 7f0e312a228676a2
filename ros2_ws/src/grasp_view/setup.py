# SPDX-License-Identifier: Apache-2.0
"""Build description of grasp_view (ament_python): who and which version say package.xml."""

import tempfile
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = 'grasp_view'
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
    package_data={PACKAGE: ['py.typed', '**/*.yaml', '**/*.html', '**/*.css', '**/*.js']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
        ('share/' + PACKAGE + '/launch', glob('launch/*')),
        ('share/' + PACKAGE + '/config', glob('config/*')),
    ],
    python_requires='>=3.10',
    install_requires=[
        ours('grasp_common'),
        'numpy>=1.26',
        'scipy>=1.11',
        'viser',
        'msgspec',
        'websockets',
        'pillow',
        'trimesh',
        'matplotlib',
    ],
    extras_require={'test': ['pytest', 'hypothesis']},
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
            'grasp_view = grasp_view.programs:grasp_view',
        ],
    },
)
