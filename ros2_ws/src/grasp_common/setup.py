# SPDX-License-Identifier: Apache-2.0
"""Build description of grasp_common (ament_python): who and which version say package.xml."""

import tempfile
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = 'grasp_common'
HERE = Path(__file__).resolve().parent
ABOUT = ElementTree.parse(HERE / 'package.xml').getroot()
# Not beside the sources: what was once built there would be packed for ever.
BUILT = tempfile.TemporaryDirectory()

setup(
    name=PACKAGE,
    options={'build': {'build_base': BUILT.name}},
    version=ABOUT.findtext('version'),
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
    ],
    python_requires='>=3.10',
    install_requires=['numpy>=1.26', 'rich'],
    extras_require={'completion': ['argcomplete'], 'test': ['pytest', 'hypothesis']},
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
)
