# SPDX-License-Identifier: Apache-2.0
"""Types of what the multifrontal kernels pass to each other."""

from __future__ import annotations

from numba import types

from shell_deform.compiled.kernel_types import (
    Bool,
    Bools,
    Bytes,
    Floats,
    Int,
    IntRows,
    Ints,
    Longs,
)

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
