"""How kernels are compiled: once, cached on disk, free of the interpreter lock.

Modules of kernels import `compiled` and so need numba; whoever uses them asks `HAVE_NUMBA` first
and takes the plain numpy twin otherwise. A read-only installation keeps its cache where
NUMBA_CACHE_DIR, or numba's own per-user fallback, says.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable
from typing import Any, TypeVar, cast

Function = TypeVar('Function', bound=Callable[..., Any])

HAVE_NUMBA = importlib.util.find_spec('numba') is not None

if not HAVE_NUMBA:  # pragma: no cover - numba is there in every locked environment
    warnings.warn(
        'numba is not installed: shell_deform works with plain numpy and promises no latency; '
        'install numba for live use',
        RuntimeWarning,
        stacklevel=2,
    )


def compiled(function: Function) -> Function:
    """Compile `function` on first use."""
    import numba

    result: Any = numba.njit(nogil=True, cache=True, error_model='numpy')(function)
    return cast(Function, result)
