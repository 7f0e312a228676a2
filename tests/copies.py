# SPDX-License-Identifier: Apache-2.0
"""Copies of our packages; to compile all kernels of one takes a minute of two cores."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import shell_deform
from shell_deform.compiled.cache import REVISION

PACKAGE = Path(shell_deform.__file__).parent
SOURCES = Path(__file__).resolve().parent.parent / 'ros2_ws' / 'src'
TWO = ('shell_deform.live.tick.serve_kernel', 'shell_deform.grasp.cone_kernel')


def copy_sources(into: Path) -> None:
    """Copy what belongs to our packages, and nothing that was built beside it."""
    command = ['git', '-C', str(SOURCES), 'ls-files', '-co', '--exclude-standard']
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for name in listed.splitlines():
        if (SOURCES / name).exists():
            (into / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(SOURCES / name, into / name)


def compile_two(copy: Path) -> tuple[str, ...]:
    """Let the first use of a copy of the package compile two modules, and return their names."""
    source = copy / 'compiled' / 'first_use.py'
    text = source.read_text()
    all_of_them = re.compile(r'^KERNELS = \(.*?^\)', re.MULTILINE | re.DOTALL)
    short, count = all_of_them.subn(f'KERNELS = {TWO}', text)
    assert count == 1
    source.write_text(short)
    return TWO


def take_compiled(copy: Path) -> None:
    """Give a copy the kernels that this installation has: numba goes by the times of sources."""
    for source in PACKAGE.rglob('*.py'):
        shutil.copystat(source, copy / source.relative_to(PACKAGE))
    for pattern in (f'*_{REVISION}-*', 'complete-*'):
        for kept in PACKAGE.rglob(f'__pycache__/{pattern}'):
            place = copy / kept.relative_to(PACKAGE)
            place.parent.mkdir(exist_ok=True)
            shutil.copy2(kept, place)
