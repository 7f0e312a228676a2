"""How kernels are compiled: once, cached on disk, free of the interpreter lock.

Modules of kernels import `compiled` and so need numba; whoever uses them asks `HAVE_NUMBA` first
and takes the plain numpy twin otherwise. A read-only installation keeps its cache where
NUMBA_CACHE_DIR, or numba's own per-user fallback, says; without any such place it works uncached.

A cached kernel contains the kernels it calls, but numba looks at its own file only. So the name
under which a kernel is cached carries a digest of all kernel sources: a change in any of them
compiles all anew, and nothing stale is ever run.
"""

from __future__ import annotations

import hashlib
import importlib.util
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Function = TypeVar('Function', bound=Callable[..., Any])

HAVE_NUMBA = importlib.util.find_spec('numba') is not None

if not HAVE_NUMBA:  # pragma: no cover - numba is there in every locked environment
    warnings.warn(
        'numba is not installed: shell_deform works with plain numpy and promises no latency; '
        'install numba for live use',
        RuntimeWarning,
        stacklevel=2,
    )


# The plain closest-point search holds the limits of both.
KERNEL_SOURCES = (
    '**/*kernel*.py',
    'solve/multifrontal*.py',
    'solve/nested_dissection.py',
    'surface/closest_point_plain.py',
)


def _revision() -> str:
    """Digest of all kernel sources of the package."""
    package = Path(__file__).parent
    sources = {source for pattern in KERNEL_SOURCES for source in package.glob(pattern)}
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


REVISION = _revision()


def revised(function: Function) -> Function:
    """The function under the name that its cache entry shall have."""
    function.__qualname__ = f'{function.__qualname__}_{REVISION}'
    return function


def compiled(function: Function) -> Function:
    """Compile `function` on first use."""
    return cast(Function, cached(function, nogil=True, error_model='numpy'))


def cached(function: Callable[..., Any], *signature: Any, **options: Any) -> Any:
    """`function` compiled by numba, for `signature` at once if there is one, and cached on disk.

    Where no place for the cache can be written it is compiled at every start, after a warning.
    """
    import numba

    compiler: Any = numba.njit
    try:
        return compiler(*signature, cache=True, **options)(revised(function))
    except RuntimeError as error:
        if 'no locator available' not in str(error):
            raise
    warnings.warn(
        'compiled kernels cannot be kept: neither the installation nor the cache of this user can '
        'be written, so every start compiles anew; set NUMBA_CACHE_DIR to a folder that can',
        RuntimeWarning,
        stacklevel=2,
    )
    return compiler(*signature, **options)(function)


def writable(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array, copied only if it is read-only: for such ones numba compiles a kernel anew."""
    return np.require(array, requirements=('C', 'W'))
