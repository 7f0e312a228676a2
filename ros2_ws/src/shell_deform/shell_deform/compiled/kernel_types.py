# SPDX-License-Identifier: Apache-2.0
"""Types of the kernels' arguments, and how kernels are compiled, free of the interpreter lock.

Signatures are written out: a kernel is compiled when its module is first imported, and not again
for every constant that a caller happens to pass; later starts load it from the cache.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from numba import njit, types

from shell_deform.compiled.cache import REVISION, cache_folder
from shell_deform.compiled.first_use import prepare

FOLDER = cache_folder()
if FOLDER is None:
    warnings.warn(
        'compiled kernels cannot be kept: neither the installation nor the cache of this user can '
        'be written, so every start compiles anew; set NUMBA_CACHE_DIR to a folder that can',
        RuntimeWarning,
        stacklevel=2,
    )
COMPLETE = FOLDER is not None and prepare(FOLDER)

Bool, Int, Float, Void = types.boolean, types.int64, types.float64, types.void
Floats = types.float64[::1]
FloatRows = types.float64[:, ::1]
FloatBlocks = types.float64[:, :, ::1]
Bytes = types.int8[::1]
Ints = types.int32[::1]
IntRows = types.int32[:, ::1]
Longs = types.int64[::1]
# What is only read may also be an array that cannot be written.
FixedFloats = types.Array(types.float64, 1, 'C', readonly=True)
FixedFloatRows = types.Array(types.float64, 2, 'C', readonly=True)
LongRows = types.int64[:, ::1]
Bools = types.boolean[::1]


def named(of: type[tuple[Any, ...]], **kinds: Any) -> Any:
    """The type of a named tuple, given by the names of its fields, whatever their order."""
    return types.BaseTuple.from_types([kinds[name] for name in of._fields], of)  # type: ignore[attr-defined]


def kernel(
    result: Any, *arguments: Any, called_from_python: bool = False, inline: bool = False
) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: compile for these types, under a name that no other version has.

    `inline`: into every caller, for what hands tuples of arrays on.
    """

    options: dict[str, Any] = {
        'cache': FOLDER is not None and called_from_python,
        'nogil': True,
        'error_model': 'numpy',
        'no_cpython_wrapper': not called_from_python,
        'no_cfunc_wrapper': True,
        'inline': 'always' if inline else 'never',
    }

    def decorate(function: Callable[..., Any]) -> Any:
        function.__qualname__ = f'{function.__qualname__}_{REVISION}'
        dispatcher = njit(**options)(function)
        # A cached kernel contains those that it calls: they need not be kept, nor compiled again.
        if called_from_python or not COMPLETE:
            dispatcher.compile(result(*arguments))
            dispatcher.disable_compile()
        return dispatcher

    return decorate
