"""Types and compilation of the multifrontal kernels.

Signatures are written out: a kernel is compiled once, when its module is first imported, and not
again for every constant that a caller happens to pass; later starts load it from the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from shell_deform.compiled import cached

Bool, Int, Float, Void = types.boolean, types.int64, types.float64, types.void
Floats = types.float64[::1]
FloatRows = types.float64[:, ::1]
Bytes = types.int8[::1]
Ints = types.int32[::1]
IntRows = types.int32[:, ::1]
Longs = types.int64[::1]
Bools = types.boolean[::1]

# What BLAS reads by reference: integers, numbers, letters.
Call = types.Tuple((Ints, Floats, types.uint8[::1]))
# Values, row pointers, neighbours, their rows in the owner's front, order, scale, block size, and
# whether rows of scalars (not blocks) are stored.
Matrix = types.Tuple((Floats, Ints, Ints, Ints, Ints, Floats, Int, Bool))
# First owned position, row offsets, rows, parent, parity, run offsets, runs, first and next child.
Tree = types.Tuple((Ints, Longs, Ints, Ints, Bytes, Longs, IntRows, Ints, Ints))
# Schur complements that wait for their parent: storage, sizes, places, delayed columns.
Waiting = types.Tuple((Floats, Longs, Longs, Longs))
# A front being filled: its k columns (values, offset, height m, k), then the triangle behind them
# (values, offset, leading dimension).
Front = types.Tuple((Floats, Int, Int, Int, Floats, Int, Int))
# L by fronts: values, offsets, unknowns of the rows, offsets, pivots per front.
Lower = types.Tuple((Floats, Longs, Ints, Longs, Longs))
# Cholesky fronts, D and its off-diagonal (not zero at the first of two coupled pivots).
Pivots = types.Tuple((Bools, Floats, Floats))
# Weak unknowns, their matrices one after the other, and the sizes of these.
Weak = types.Tuple((Ints, Floats, Longs))


def kernel(
    result: Any, *arguments: Any, called_from_python: bool = False
) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: compile for these types, free of the interpreter lock, cached on disk."""
    options: dict[str, Any] = {
        'nogil': True,
        'error_model': 'numpy',
        'no_cpython_wrapper': not called_from_python,
        'no_cfunc_wrapper': True,
    }

    def decorate(function: Callable[..., Any]) -> Any:
        return cached(function, result(*arguments), **options)

    return decorate
