"""Compilation of kernels with numba, or plain Python with a warning where numba is missing."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar('Function', bound=Callable[..., Any])

HAS_NUMBA = importlib.util.find_spec('numba') is not None

if not HAS_NUMBA:
    warnings.warn(
        'numba is not installed: surface kernels run without compilation and without any promise '
        'of speed; install numba',
        RuntimeWarning,
        stacklevel=2,
    )


def compiled(function: Function) -> Function:
    """Compile `function` without the GIL and cache the result on disk."""
    if not HAS_NUMBA:
        return function
    from numba import njit

    kernel: Any = njit(nogil=True, cache=True, error_model='numpy')(function)
    result: Function = kernel
    return result
