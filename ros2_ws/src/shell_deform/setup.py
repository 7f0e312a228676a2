# SPDX-License-Identifier: Apache-2.0
"""Build description of shell_deform (ament_python): who and which version say package.xml."""

import subprocess
import sys
import tempfile
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup
from setuptools.command.develop import develop
from setuptools.command.install import install

PACKAGE = 'shell_deform'
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


def compile_kernels(place):
    """Compile the kernels of the package in that folder: its first start then only loads them."""
    command = [sys.executable, '-m', f'{PACKAGE}.compiled.first_use']
    # colcon takes whatever comes on stderr for a warning.
    subprocess.run(command, cwd=place, stderr=subprocess.STDOUT, check=False)


class CompiledInstall(install):
    """`colcon build`."""

    def run(self):
        """Install and compile, but not into the root of a package that is built for others."""
        super().run()
        if self.root is None:
            compile_kernels(self.install_lib)


class CompiledDevelop(develop):
    """`colcon build --symlink-install`."""

    def run(self):
        """Link and compile, but not where the links are taken away again."""
        super().run()
        if not self.uninstall:
            compile_kernels(self.egg_path)


setup(
    name=PACKAGE,
    options={'build': {'build_base': BUILT.name}},
    cmdclass={'install': CompiledInstall, 'develop': CompiledDevelop},
    version=ABOUT.findtext('version'),
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', '**/*.json', '**/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
        ('share/' + PACKAGE + '/launch', glob('launch/*')),
        ('share/' + PACKAGE + '/config', glob('config/*')),
    ],
    python_requires='>=3.10',
    install_requires=[ours('grasp_common'), 'numpy>=1.26', 'scipy>=1.11', 'numba>=0.60', 'pyyaml'],
    extras_require={
        'picture': ['matplotlib'],
        'prepare': ['trimesh', 'fast-simplification', 'matplotlib'],
        'bags': ['rosbags'],
        'scan': [ours('scan_compare')],
        'test': ['pytest', 'hypothesis'],
    },
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
            'deformation = shell_deform.commands.programs:deformation',
            'shell_solve = shell_deform.commands.programs:shell_solve',
            'shell_verify = shell_deform.commands.programs:shell_verify',
            'shell_objects = shell_deform.commands.programs:shell_objects',
            'shell_identify = shell_deform.commands.programs:shell_identify',
            'object_prepare = shell_deform.commands.programs:object_prepare',
            'grasp_map = shell_deform.commands.programs:grasp_map',
        ],
    },
)
