"""Build description of shell_deform (ament_python)."""

import subprocess
import sys
from glob import glob

from setuptools import find_packages, setup
from setuptools.command.develop import develop
from setuptools.command.install import install

PACKAGE = 'shell_deform'


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
    cmdclass={'install': CompiledInstall, 'develop': CompiledDevelop},
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
