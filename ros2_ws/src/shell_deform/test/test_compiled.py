"""Kernels and their cache on disk."""

import os
import re
import subprocess
import sys
from pathlib import Path

import shell_deform
from shell_deform import assemble_kernels, compiled

PACKAGE = Path(shell_deform.__file__).parent


def test_every_module_with_kernels_is_part_of_the_cache_key():
    covered = {source for pattern in compiled.KERNEL_SOURCES for source in PACKAGE.glob(pattern)}
    with_kernels = {
        source
        for source in PACKAGE.rglob('*.py')
        if re.search(r'^@(compiled|kernel\()', source.read_text(), re.MULTILINE)
    }
    assert len(with_kernels) > 5
    assert with_kernels <= covered


def test_kernels_are_cached_under_the_digest_of_all_kernel_sources():
    assert assemble_kernels.shell_gradient.py_func.__qualname__.endswith(compiled.REVISION)


def test_an_installation_that_cannot_be_written_compiles_into_the_named_cache(tmp_path):
    script = (
        'import numpy as np\n'
        'from shell_deform.theory.kernels import point_stress\n'
        'print(point_stress(np.ones(6), np.eye(3), np.eye(3), np.empty(6)))\n'
    )
    cache = tmp_path / 'cache'
    answer = subprocess.run(
        [sys.executable, '-c', script],
        env={**os.environ, 'NUMBA_CACHE_DIR': str(cache)},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert float(answer.stdout) == 3.0
    assert any(cache.rglob('*.nbi'))
