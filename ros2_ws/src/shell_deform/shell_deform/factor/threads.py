# SPDX-License-Identifier: Apache-2.0
"""One BLAS thread while fronts are eliminated.

Fronts are small: the threads of OpenBLAS gain nothing there, and on a busy machine they wait for
each other in loops (measured on two loaded cores: 642 vertices take 15 ms with one thread, 180 to
390 ms with two).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock

_lock = Lock()
_inside = 0
_before: list[int] = []

ThreadCount = tuple[Callable[[], int], Callable[[int], None]]


@cache
def _thread_counts() -> tuple[ThreadCount, ...]:
    """How to read and set the number of threads of each OpenBLAS that SciPy may call."""
    import scipy.linalg.cython_blas  # noqa: F401  (loads the library that is looked for)

    try:
        lines = Path('/proc/self/maps').read_text().splitlines()
    except OSError:
        return ()
    paths = sorted({line.split(maxsplit=5)[-1] for line in lines if 'openblas' in line})
    found = []
    for path in paths:
        try:
            library = ctypes.CDLL(path)
        except OSError:
            continue
        # 64-bit integer builds, as numpy's, carry a suffix; SciPy's kernels call the others.
        for prefix in ('scipy_openblas', 'openblas'):
            if hasattr(library, f'{prefix}_set_num_threads'):
                found.append(
                    (
                        getattr(library, f'{prefix}_get_num_threads'),
                        getattr(library, f'{prefix}_set_num_threads'),
                    )
                )
    return tuple(found)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold SciPy's OpenBLAS at one thread; several Python threads may be inside at once."""
    global _inside
    counts = _thread_counts()
    with _lock:
        if _inside == 0:
            _before[:] = [read() for read, _ in counts]
            for _, write in counts:
                write(1)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                for (_, write), number in zip(counts, _before, strict=True):
                    write(number)
