# SPDX-License-Identifier: Apache-2.0
"""The workspace as a user finds it: executables, locks, and a colcon build of every package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.copies import SOURCES, compile_two, copy_sources
from tests.executables import EXECUTABLES

ROOT = Path(__file__).resolve().parent.parent
ALL = [(package, name) for package, names in EXECUTABLES.items() for name in names]


@pytest.mark.parametrize(('package', 'name'), ALL)
def test_every_executable_of_the_contract_is_in_the_environment(package, name):
    path = Path(sys.executable).parent / name
    assert os.access(path, os.X_OK)


@pytest.mark.parametrize(('package', 'name'), ALL)
def test_every_executable_refuses_an_option_it_does_not_know(package, name):
    asked = subprocess.run(
        [Path(sys.executable).parent / name, '--no-such-option'],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert asked.returncode == 2, asked.stderr
    assert '--no-such-option' in asked.stderr or 'required' in asked.stderr


@pytest.mark.parametrize('lock', ['lock.txt', 'lock-run.txt', 'lock-cell.txt'])
def test_locks_are_hashed_and_name_no_index(lock):
    text = (ROOT / 'requirements' / lock).read_text()
    assert not re.search(r'^\s*--(index|extra-index|find-links|trusted)', text, re.MULTILINE)
    assert '://' not in text
    pinned = re.findall(r'^([a-z0-9][\w.-]*)==', text, re.MULTILINE)
    blocks = re.split(r'^(?=[a-z0-9][\w.-]*==)', text, flags=re.MULTILINE)[1:]
    assert len(blocks) == len(pinned) > 50
    assert all('--hash=sha256:' in block for block in blocks)


def test_what_the_demo_installs_is_part_of_the_whole():
    """Each of its blocks, hashes included; only what asked for a package may differ."""
    whole, part = (
        {
            '\n'.join(line for line in block.splitlines() if not line.lstrip().startswith('#'))
            for block in re.split(r'^(?=[a-z0-9])', text, flags=re.MULTILINE)
        }
        for text in (
            (ROOT / 'requirements' / name).read_text() for name in ('lock.txt', 'lock-run.txt')
        )
    )
    assert part < whole


def build(base, sources, *options):
    """Build the packages of these sources by colcon, in that folder."""
    command = [
        sys.executable, '-m', 'colcon', '--log-base', str(base / 'log'), 'build', *options,
        '--base-paths', str(sources),
        '--build-base', str(base / 'build'), '--install-base', str(base / 'install'),
    ]  # fmt: skip
    built = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert built.returncode == 0, built.stdout + built.stderr


def colcon(*arguments):
    """What colcon says to these arguments."""
    return subprocess.run(
        [sys.executable, '-m', 'colcon', *map(str, arguments)],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip


@pytest.fixture(scope='module')
def install(tmp_path_factory):
    """The workspace built by colcon, as on a cell, but outside the source tree."""
    base = tmp_path_factory.mktemp('colcon')
    copy_sources(base / 'src')
    compile_two(base / 'src' / 'shell_deform' / 'shell_deform')
    build(base, base / 'src')
    return base / 'install'


def sites(install):
    """Where a built workspace keeps its Python packages."""
    return sorted(install.glob('*/lib/python*/site-packages'))


def from_sites(folders, *arguments):
    """What a Python process prints that finds its packages in these folders first."""
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, folders))}
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=environment,
    )


@pytest.mark.parametrize(('package', 'name'), ALL)
def test_every_executable_starts_from_the_colcon_install(install, package, name):
    command = install / package / 'lib' / package / name
    started = from_sites(sites(install), command, '--help')
    assert started.returncode == 0, started.stderr
    assert 'usage:' in started.stdout
    index = install / package / 'share' / 'ament_index' / 'resource_index' / 'packages' / package
    assert index.is_file()


FIRST_USE = 'import shell_deform.compiled.kernel_types as k; print(k.__file__, k.COMPLETE)'


def test_the_first_use_of_the_colcon_install_finds_its_kernels_compiled(install):
    first = from_sites(sites(install), '-c', FIRST_USE)
    place, complete = first.stdout.split()
    assert Path(place).is_relative_to(install)
    assert (complete, first.stderr) == ('True', '')


def test_the_first_use_of_a_symlinked_workspace_finds_its_kernels_compiled(tmp_path):
    package = SOURCES / 'shell_deform'
    unused = shutil.ignore_patterns('__pycache__', '*.egg-info')
    shutil.copytree(package, tmp_path / 'src' / 'shell_deform', ignore=unused)
    compile_two(tmp_path / 'src' / 'shell_deform' / 'shell_deform')
    build(tmp_path, tmp_path / 'src', '--symlink-install')
    first = from_sites([tmp_path / 'build' / 'shell_deform'], '-c', FIRST_USE)
    place, complete = first.stdout.split()
    assert Path(place).resolve().is_relative_to(tmp_path / 'src')
    assert (complete, first.stderr) == ('True', '')


@pytest.mark.parametrize('package', ['grasp_common', 'grasp_view'])
def test_colcon_test_finds_the_executables_of_the_built_workspace(install, package):
    base = install.parent
    asked = ['--log-base', base / 'log', 'test', '--base-paths', SOURCES]
    asked += ['--build-base', base / 'build', '--install-base', install]
    asked += ['--packages-select', package, '--return-code-on-test-failure']
    chosen = 'test_view_start' if package == 'grasp_view' else 'command_line or main_node'
    tested = colcon(*asked, '--pytest-args', '-k', chosen, '-p', 'no:cacheprovider')
    logged = ('--log-base', base / 'log')
    built = base / 'build' / package
    result = colcon(*logged, 'test-result', '--test-result-base', built, '--verbose')
    assert tested.returncode == 0, tested.stdout + tested.stderr + result.stdout
    assert ' 0 errors, 0 failures' in result.stdout and ' 0 tests' not in result.stdout
