# SPDX-License-Identifier: Apache-2.0
"""What the multifrontal kernels pass to each other, by names."""

from __future__ import annotations

from typing import Any, NamedTuple

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
    named,
)


class Matrix(NamedTuple):
    """A symmetric matrix as SciPy stores it, by vertices with `block` unknowns each.

    `targets`: the row of each entry in the front that owns its vertex. `scale`: of each unknown, 0
    pins it. `interleaved`: rows of unknowns are stored one by one, else blocks.
    """

    data: Any
    indptr: Any
    neighbours: Any
    targets: Any
    order: Any
    scale: Any
    block: Any
    interleaved: Any


class Tree(NamedTuple):
    """The forest of fronts; see `symbolic.Fronts`, whose arrays these are."""

    owned: Any
    row_offsets: Any
    rows: Any
    parent: Any
    parity: Any
    run_offsets: Any
    runs: Any
    first_child: Any
    next_child: Any


class Waiting(NamedTuple):
    """Schur complements that wait for their parent: storage, sizes, places, delayed columns."""

    stack: Any
    sizes: Any
    places: Any
    delays: Any


class Complements(NamedTuple):
    """What is known of every front's Schur complement while it waits, for all fronts of the tree.

    Sizes, places on the stack, delayed columns, and where the unknowns of its rows begin.
    """

    sizes: Any
    places: Any
    delays: Any
    rows: Any


class Span(NamedTuple):
    """Fronts `first` up to `last`, and what waits for them already.

    The stack is filled below `bottom` and from `top` on; the first `ids` row numbers are those of
    complements that come from elsewhere.
    """

    first: Any
    last: Any
    bottom: Any
    top: Any
    ids: Any


class Front(NamedTuple):
    """A front being filled: its k columns of height m, then the triangle behind them.

    The columns stand in `panel` from `panel_at`, the triangle in `rest` from `rest_at`; its
    leading dimension is `rest_ld`.
    """

    panel: Any
    panel_at: Any
    m: Any
    k: Any
    rest: Any
    rest_at: Any
    rest_ld: Any


class Lower(NamedTuple):
    """L of a span of fronts: values and rows' unknowns, where each front's begin, its pivots."""

    values: Any
    value_offsets: Any
    ids: Any
    id_offsets: Any
    pivots: Any


class Pivots(NamedTuple):
    """Which fronts went through Cholesky; D and its off-diagonal, not zero at the first of two."""

    definite: Any
    diagonal: Any
    off_diagonal: Any


class Weak(NamedTuple):
    """Weak unknowns, their matrices one after the other, and the sizes of these."""

    ids: Any
    values: Any
    sizes: Any


# What BLAS reads by reference: integers, numbers, letters.
CALL = types.Tuple((Ints, Floats, types.uint8[::1]))
MATRIX = named(
    Matrix,
    data=Floats,
    indptr=Ints,
    neighbours=Ints,
    targets=Ints,
    order=Ints,
    scale=Floats,
    block=Int,
    interleaved=Bool,
)
TREE = named(
    Tree,
    owned=Ints,
    row_offsets=Longs,
    rows=Ints,
    parent=Ints,
    parity=Bytes,
    run_offsets=Longs,
    runs=IntRows,
    first_child=Ints,
    next_child=Ints,
)
WAITING = named(Waiting, stack=Floats, sizes=Longs, places=Longs, delays=Longs)
COMPLEMENTS = named(Complements, sizes=Longs, places=Longs, delays=Longs, rows=Longs)
SPAN = named(Span, first=Int, last=Int, bottom=Int, top=Int, ids=Int)
FRONT = named(
    Front, panel=Floats, panel_at=Int, m=Int, k=Int, rest=Floats, rest_at=Int, rest_ld=Int
)
LOWER = named(Lower, values=Floats, value_offsets=Longs, ids=Ints, id_offsets=Longs, pivots=Longs)
PIVOTS = named(Pivots, definite=Bools, diagonal=Floats, off_diagonal=Floats)
WEAK = named(Weak, ids=Ints, values=Floats, sizes=Longs)
