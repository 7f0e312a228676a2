# SPDX-License-Identifier: Apache-2.0
"""Kernels and their cache on disk."""

import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.copies import compile_two

import shell_deform
from shell_deform.assemble import kernels
from shell_deform.compiled import cache, first_use

PACKAGE = Path(shell_deform.__file__).parent


def test_every_module_with_kernels_is_part_of_the_cache_key():
    covered = {source for pattern in cache.KERNEL_SOURCES for source in PACKAGE.glob(pattern)}
    with_kernels = {
        source
        for source in PACKAGE.rglob('*.py')
        if re.search(r'^ *@kernel\(', source.read_text(), re.MULTILINE)
    }
    assert len(with_kernels) > 10
    assert with_kernels <= covered


def test_kernels_are_cached_under_the_digest_of_all_kernel_sources():
    assert kernels.shell_gradient.py_func.__qualname__.endswith(cache.REVISION)


STRESS = (
    'import numpy as np\n'
    'import shell_deform\n'
    'from shell_deform.theory.kernels import point_stress\n'
    'print(shell_deform.__file__)\n'
    'print(point_stress(np.ones(6), np.eye(3), np.eye(3), np.empty(6)))\n'
)


@pytest.fixture
def unwritable(tmp_path):
    """A copy of the package where no cache can be made, not even by root: files bar the way."""
    copy = tmp_path / 'shell_deform'
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns('__pycache__'))
    for folder in [copy, *(path for path in copy.rglob('*') if path.is_dir())]:
        (folder / '__pycache__').write_text('')
    return tmp_path


def stress_of(installed, cache):
    """(stress, warnings) of a process that imports the package from there, without a home."""
    kept = {k: v for k, v in os.environ.items() if k not in ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME')}
    answer = subprocess.run(
        [sys.executable, '-c', STRESS],
        env={**kept, 'HOME': os.devnull, 'PYTHONPATH': str(installed), **cache},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    where, stress = answer.stdout.split()
    assert Path(where).is_relative_to(installed)
    return float(stress), answer.stderr


@pytest.mark.parametrize('module', first_use.KERNELS)
def test_the_first_use_of_this_installation_has_filled_its_cache(module):
    kernels = [
        kernel
        for kernel in vars(importlib.import_module(module)).values()
        if getattr(kernel, '__module__', '') == module and hasattr(kernel, 'stats')
    ]
    cached = [kernel for kernel in kernels if kernel.stats.cache_path is not None]
    assert cached
    for kernel in cached:
        name = f'*.{kernel.py_func.__qualname__}-*.nbi'
        assert list(Path(kernel.stats.cache_path).glob(name)), name


def test_the_first_use_of_an_installation_that_cannot_be_written_fills_the_named_cache(unwritable):
    modules = compile_two(unwritable / 'shell_deform')
    cache = unwritable / 'cache'
    for said in (['Compiling the shell kernels (first time only) ...', '... done'], []):
        stress, lines = stress_of(unwritable, {'NUMBA_CACHE_DIR': str(cache)})
        assert stress == 3.0
        assert [line.split(' in ')[0] for line in lines.splitlines()] == said
        kept = {path.name.split('.')[0] for path in cache.rglob('*.nbi')}
        assert {module.rpartition('.')[2] for module in modules} <= kept


@pytest.mark.parametrize('cache', [{}, {'NUMBA_CACHE_DIR': os.devnull}])
def test_without_any_cache_that_can_be_written_kernels_work_and_a_warning_says_so(
    unwritable, cache
):
    stress, warnings = stress_of(unwritable, cache)
    assert stress == 3.0
    assert warnings.count('set NUMBA_CACHE_DIR to a folder that can') == 1
    assert not any(unwritable.rglob('*.nbi'))


def test_without_the_compiler_everything_is_imported_and_solved_in_plain_numpy():
    script = (
        'from shell_deform.compiled.cache import HAVE_NUMBA\n'
        'from shell_deform.verification.linear_course import scordelis_lo\n'
        'print(HAVE_NUMBA, scordelis_lo(4).value)\n'
    )
    environment = os.environ | {'NUMBA_DISABLE_JIT': '1'}
    done = subprocess.run(
        [sys.executable, '-c', script],
        capture_output=True, text=True, env=environment, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    compiled, value = done.stdout.split()
    assert compiled == 'False'
    assert 0.2 < float(value) < 0.4
    assert 'not installed' not in done.stderr


def test_what_compiles_ends_with_a_parent_that_is_killed():
    code = (
        'import os, signal, time\n'
        'from grasp_common.watchdog import end_with_parent\n'
        'if os.fork() == 0:\n'
        '    end_with_parent()\n'
        '    print("child", flush=True)\n'
        '    time.sleep(60)\n'
        'else:\n'
        '    time.sleep(60)\n'
    )
    parent = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout.readline() == 'child\n'
    parent.kill()
    # The pipe ends with the last process that holds it.
    assert parent.communicate(timeout=600)[0] == ''
