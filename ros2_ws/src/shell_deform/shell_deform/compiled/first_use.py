# SPDX-License-Identifier: Apache-2.0
"""Compile every kernel, several at a time, so that no later start waits.

The first import of a kernel does so where no earlier start has; `make setup` does it by
`python -m shell_deform.compiled.first_use`.
"""

from __future__ import annotations

import fcntl
import gc
import hashlib
import importlib
import multiprocessing
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from grasp_common.watchdog import end_with_parent
from shell_deform.compiled.cache import HAVE_NUMBA, cache_folder, kernel_sources

# What most kernels need, then what one process compiles in one go, the longest first. A module
# of kernels brings those that it imports.
COMMON = ('shell_deform.compiled.kernel_arrays', 'shell_deform.factor.blas')
KERNELS = (
    'shell_deform.assemble.thick_held_kernels',
    'shell_deform.assemble.thick_face_kernels',
    'shell_deform.factor.fronts',
    'shell_deform.assemble.held_kernels',
    'shell_deform.factor.symbolic',
    'shell_deform.surface.closest_point_kernel',
    'shell_deform.live.tick.fusion_kernel',
    'shell_deform.factor.nested_dissection',
    'shell_deform.factor.substitution',
    'shell_deform.live.tick.serve_kernel',
    'shell_deform.grasp.cone_kernel',
)

COMPILING = 'SHELL_DEFORM_COMPILING'
"""Environment variable of the processes that compile."""


def prepare(folder: Path) -> bool:
    """Compile all kernels into the cache if no earlier start has; before the first of them is.

    Returns whether the cache now has them all. In the processes that compile, each is compiled
    where it is imported.
    """
    if COMPILING in os.environ:
        return False
    complete = _complete(folder)
    if not complete.exists():
        subprocess.run([sys.executable, '-m', 'shell_deform.compiled.first_use'], check=False)
    return complete.exists()


def compile_kernels(processes: int) -> None:
    """Import every module of kernels, which compiles it, in so many processes."""
    # Hardly anything that a compiler makes is garbage: looking for it took a sixth of the time.
    gc.disable()
    for module in COMMON:
        importlib.import_module(module)
    forked = multiprocessing.get_context('fork')
    # A child that outlives this process would keep the lock for ever.
    with ProcessPoolExecutor(processes, forked, initializer=end_with_parent) as pool:
        list(pool.map(_compile, KERNELS))


def _compile(module: str) -> None:
    importlib.import_module(module)


def _complete(folder: Path) -> Path:
    """The file in the cache that says: nothing is missing. numba goes by times of sources, too."""
    import llvmlite.binding
    import numba

    key = [sys.version, numba.__version__, llvmlite.binding.get_host_cpu_name()]
    for source in kernel_sources():
        key.append(f'{source.stat().st_mtime_ns} {source.stat().st_size}')
    return folder / f'complete-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}'


def main() -> None:
    """Compile, unless another process just did, saying so and how long it took."""
    os.environ[COMPILING] = '1'
    folder = cache_folder() if HAVE_NUMBA else None
    if folder is None:
        sys.exit('There is no numba, or no place for its cache: nothing to compile')
    folder.mkdir(parents=True, exist_ok=True)
    complete = _complete(folder)
    with open(folder / 'compiling.lock', 'w', encoding='utf-8') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if complete.exists():
            return
        start = time.perf_counter()
        print('Compiling the shell kernels (first time only) ...', file=sys.stderr, flush=True)
        compile_kernels(len(os.sched_getaffinity(0)))
        complete.touch()
        print(f'... done in {time.perf_counter() - start:.0f} s', file=sys.stderr)


if __name__ == '__main__':
    main()
