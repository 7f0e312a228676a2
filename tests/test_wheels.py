# SPDX-License-Identifier: Apache-2.0
"""Wheels in an empty environment: what a package declares is all that it needs, without ROS.

The environment holds the wheels under test and, as links, the distributions that they require and
nothing else, so that no network is needed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from tests.copies import SOURCES, copy_sources, take_compiled

PACKAGES = sorted(path.parent.name for path in SOURCES.glob('*/setup.py'))


def required(package: str, extra: str = '') -> set[str]:
    """All distributions that a package of ours or of others requires, by name, not ours."""
    found: set[str] = set()
    waiting = [(package, extra)]
    while waiting:
        name, wanted = waiting.pop()
        for text in distribution(name).requires or ():
            one = Requirement(text)
            if one.marker is not None and not one.marker.evaluate({'extra': wanted}):
                continue
            key = re.sub(r'[-_.]+', '-', one.name).lower()
            if key in found:
                continue
            if key.replace('-', '_') not in PACKAGES:
                found.add(key)
            waiting += [(one.name, part) for part in ('', *one.extras)]
    return found


def link(name: str, site: Path) -> None:
    """Make an installed distribution visible in another folder of packages."""
    for file in distribution(name).files or ():
        top = file.parts[0]
        if top not in ('..', '__pycache__') and not (site / top).exists():
            (site / top).symlink_to(Path(str(file.locate())).parents[len(file.parts) - 2] if
                                    len(file.parts) > 1 else Path(str(file.locate())))  # fmt: skip


@pytest.fixture(scope='module')
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheels of all packages, built as pip builds them."""
    folder = tmp_path_factory.mktemp('wheels')
    sources = tmp_path_factory.mktemp('sources')
    # In a copy: setuptools leaves its build folder beside setup.py.
    copy_sources(sources)
    command = [
        sys.executable, '-m', 'pip', 'wheel', '--quiet', '--no-deps', '--no-index',
        '--no-build-isolation', '--wheel-dir', str(folder),
        *(str(sources / package) for package in PACKAGES),
    ]  # fmt: skip
    subprocess.run(command, check=True, env={**os.environ, 'PYTHONWARNINGS': 'ignore'})
    return folder


@pytest.fixture(scope='module')
def environment(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with `shell_deform`, `grasp_common` and what they require, without ROS."""
    base = tmp_path_factory.mktemp('empty')
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', str(base)], check=True)
    site = next(base.glob('lib/python*/site-packages'))
    for name in sorted(required('grasp_common') | required('shell_deform')):
        link(name, site)
    command = [
        sys.executable, '-m', 'pip', '--python', str(base / 'bin' / 'python'), 'install',
        '--quiet', '--no-index', '--no-deps',
        *(str(next(wheels.glob(f'{name}-*.whl'))) for name in ('grasp_common', 'shell_deform')),
    ]  # fmt: skip
    subprocess.run(command, check=True)
    take_compiled(site / 'shell_deform')
    return base


def ran(environment: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A program of the environment, with nothing of ours on its path."""
    variables = {k: v for k, v in os.environ.items() if not k.startswith(('PYTHON', 'AMENT'))}
    return subprocess.run(
        [str(environment / 'bin' / words[0]), *words[1:]],
        capture_output=True, text=True, check=False, cwd=environment, env=variables,
        timeout=600,
    )  # fmt: skip


@pytest.mark.parametrize('package', PACKAGES)
def test_a_wheel_carries_its_licence_version_and_description(wheels: Path, package: str) -> None:
    found = [path.name for path in wheels.glob(f'{package}-*.whl')]
    version = re.search(
        r'<version>(.*)</version>', (SOURCES / package / 'package.xml').read_text()
    )
    assert version is not None and found == [f'{package}-{version.group(1)}-py3-none-any.whl']


def requirements(folder: Path, into: Path) -> list[Requirement]:
    """What the package of a folder requires, extras included."""
    command = [sys.executable, 'setup.py', '--quiet', 'egg_info', '--egg-base', str(into)]
    subprocess.run(command, check=True, cwd=folder, capture_output=True)
    (listed,) = into.glob('*.egg-info/requires.txt')
    return [
        Requirement(line)
        for line in listed.read_text().splitlines()
        if line and not line.startswith('[')
    ]


@pytest.mark.parametrize('package', ['shell_deform', 'grasp_replay'])
def test_pip_takes_what_a_package_needs_of_ours_from_the_folders_beside_it(
    package: str, tmp_path: Path
) -> None:
    """`pip install ./ros2_ws/src/shell_deform` is one command; elsewhere names are plain ones."""
    alone = tmp_path / 'alone'
    alone.mkdir()
    for name in ('setup.py', 'setup.cfg', 'package.xml', 'README.md'):
        shutil.copy(SOURCES / package / name, alone)
    for folder, beside in ((SOURCES / package, True), (alone, False)):
        into = tmp_path / f'info_{beside}'
        into.mkdir()
        ours = {one.name: one.url for one in requirements(folder, into) if one.name in PACKAGES}
        assert 'grasp_common' in ours
        here = SOURCES.as_uri().replace('file://', 'file://localhost')
        assert ours == {name: f'{here}/{name}' if beside else None for name in ours}
    assert not (SOURCES / package / 'build').exists()


def test_the_ball_is_solved_without_ros(environment: Path) -> None:
    code = (
        'import shell_deform\n'
        "ball = shell_deform.load('tennis_ball')\n"
        'squeezed = ball.squeeze(displacement=2e-3)\n'
        'print(round(float(squeezed.contact_force[0]), 1))'
    )
    done = ran(environment, 'python', '-c', code)
    assert (done.returncode, done.stdout) == (0, '9.1\n'), done.stderr


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (('deformation',), 'geometry_msgs is missing: source a ROS 2 Jazzy'),
        (
            ('shell_solve', '--object', 'tennis_ball', '--force', '1', '--mesh', 'a.ply'),
            'trimesh is missing: pip install trimesh',
        ),
    ],
)
def test_what_is_not_installed_is_told_in_one_sentence(
    environment: Path, words: tuple[str, ...], sentence: str
) -> None:
    done = ran(environment, *words)
    assert done.returncode == 1
    assert f'{words[0]}: ' in done.stderr and sentence in done.stderr
    assert 'Traceback' not in done.stderr
