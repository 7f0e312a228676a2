# SPDX-License-Identifier: Apache-2.0
"""Multifrontal LDL^T: the numeric factorisation, compiled.

Written here because no permissively licensed wheel factorises indefinite matrices, reports the
inertia, reuses the pattern and releases the interpreter lock at once.

Fronts are visited children first. A front that is safely positive definite goes through Cholesky;
any other through `elimination.eliminate`, which may hand columns to the parent. Columns
that are still without a pivot larger than `weak` at a root stay outside the factor: they are the
*weak* part, a small dense matrix that the caller treats (rigid modes, limit points).

All matrices here are the scaled ones, S A S with S = diag(scale); scale 0 pins an unknown.
Source: I. S. Duff and J. K. Reid (1983), doi:10.1145/356044.356047; J. W. H. Liu (1992),
doi:10.1137/1034004.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from shell_deform.compiled.kernel_arrays import booleans, floats, integers, longs
from shell_deform.compiled.kernel_types import Float, Floats, Int, Ints, Void, kernel
from shell_deform.factor.blas import new_call
from shell_deform.factor.elimination import eliminate, eliminate_definite
from shell_deform.factor.front_assembly import assemble
from shell_deform.factor.front_types import (
    COMPLEMENTS,
    LOWER,
    MATRIX,
    PIVOTS,
    SPAN,
    TREE,
    WEAK,
    Front,
    Lower,
    Pivots,
    Waiting,
    Weak,
)


@kernel(Void, Floats, Int, Floats, Int, Int)
def _copy(target: Any, target_at: int, source: Any, source_at: int, count: int) -> None:
    """target[target_at:+count] = source[source_at:+count]."""
    into = target[target_at : target_at + count]
    out = source[source_at : source_at + count]
    for i in range(count):
        into[i] = out[i]


@kernel(Floats, Floats, Int, Int)
def _room(array: Any, used: int, needed: int) -> Any:
    """`array`, or a larger copy of its first `used` entries when `needed` do not fit."""
    if needed <= len(array):
        return array
    larger = np.empty(needed + needed // 4, np.float64)
    for i in range(used):
        larger[i] = array[i]
    return larger


@kernel(Ints, Ints, Int, Int)
def _integer_room(array: Any, used: int, needed: int) -> Any:
    """`_room` for row numbers."""
    if needed <= len(array):
        return array
    larger = integers(needed + needed // 4, 0)
    for i in range(used):
        larger[i] = array[i]
    return larger


@kernel(
    types.Tuple((LOWER, PIVOTS, WEAK, Floats)), MATRIX, TREE, SPAN, COMPLEMENTS, Floats, Ints,
    Floats, Float, Float,
    called_from_python=True,
)  # fmt: skip
def factorise_fronts(
    matrix: Any, tree: Any, span: Any, complements: Any, values: Any, ids: Any, stack: Any,
    threshold: float, weak: float,
) -> Any:  # fmt: skip
    """Factorise the fronts of `span`; `values`, `ids`, `stack` are room: larger is made if needed.

    Complements whose parents lie behind the span stay on the stack.

    Returns L, D and the weak part (`Lower`, `Pivots`, `Weak` in `front_types`), and the
    stack.
    """
    block = matrix.block
    owned, row_offsets, rows = tree.owned, tree.row_offsets, tree.rows
    parent, parity = tree.parent, tree.parity
    first_child, next_child = tree.first_child, tree.next_child
    first, fronts = span.first, span.last - span.first
    rest_sizes, rest_places, delays, rest_rows = complements
    call = new_call()
    value_offsets = longs(fronts + 1, 0)
    id_offsets = longs(fronts + 1, 0)
    id_offsets[0] = span.ids
    pivots = longs(fronts, 0)
    definite = booleans(fronts, False)
    unknowns = (owned[span.last] - owned[first]) * block
    for f in range(first):
        if first <= parent[f] < span.last:
            unknowns += delays[f]
    diagonal, off_diagonal = floats(unknowns, 1.0), floats(unknowns, 0.0)
    weak_ids = integers(0, 0)
    weak_values = floats(0, 0.0)
    weak_sizes = longs(fronts, 0)
    weak_blocks, weak_count, weak_entries = 0, 0, 0
    square = floats(0, 0.0)
    # Two stacks grow towards each other: fronts of even depth from below, of odd depth from above.
    bottom, top = span.bottom, span.top
    done = 0
    for i in range(fronts):
        f = first + i
        own = (owned[f + 1] - owned[f]) * block
        shift, freed = 0, 0
        child = first_child[f]
        while child >= 0:
            shift += delays[child]
            freed += rest_sizes[child] * rest_sizes[child]
            child = next_child[child]
        m = (row_offsets[f + 1] - row_offsets[f]) * block + shift
        k = own + shift
        at = value_offsets[i]
        values = _room(values, at, at + m * k)
        first_id = id_offsets[i]
        ids = _integer_room(ids, first_id, first_id + m)
        id_offsets[i + 1] = first_id + m
        filled = first_id
        for r in range(own):
            ids[filled] = owned[f] * block + r
            filled += 1
        child = first_child[f]
        while child >= 0:
            start = rest_rows[child]
            for r in range(delays[child]):
                ids[filled] = ids[start + r]
                filled += 1
            child = next_child[child]
        for r in range(row_offsets[f] + owned[f + 1] - owned[f], row_offsets[f + 1]):
            for a in range(block):
                ids[filled] = rows[r] * block + a
                filled += 1
        # A front that delays columns leaves a larger complement: room for the worst case.
        if top - bottom < m * m:
            missing = m * m - (top - bottom)
            larger = np.empty(len(stack) + missing + len(stack) // 4, np.float64)
            _copy(larger, 0, stack, 0, bottom)
            moved = len(larger) - len(stack)
            _copy(larger, top + moved, stack, top, len(stack) - top)
            for c in range(f):
                mine = c >= first or parent[c] < span.last
                if mine and parent[c] >= f and rest_places[c] >= top:
                    rest_places[c] += moved
            top += moved
            stack = larger
        border = m - k
        rest_at = bottom if parity[f] == 0 else top - border * border
        taken = 0
        if shift == 0:
            waiting = Waiting(stack, rest_sizes, rest_places, delays)
            front = Front(values, at, m, k, stack, rest_at, border)
            assemble(f, matrix, tree, waiting, shift, front)
            if eliminate_definite(call, front, weak):
                taken = k
                definite[i] = True
        if not definite[i]:
            square = _room(square, 0, m * m)
            waiting = Waiting(stack, rest_sizes, rest_places, delays)
            whole = Front(square, 0, m, k, square, k * m + k, m)
            assemble(f, matrix, tree, waiting, shift, whole)
            taken = eliminate(
                call,
                square,
                m,
                k,
                ids[first_id : first_id + m],
                diagonal[done : done + k],
                off_diagonal[done : done + k],
                threshold,
                weak,
            )
            _copy(values, at, square, 0, m * taken)
            border = m - taken
            rest_at = bottom if parity[f] == 0 else top - border * border
            for c in range(border):
                source = (taken + c) * (m + 1)
                _copy(stack, rest_at + c * (border + 1), square, source, border - c)
        pivots[i] = taken
        delays[f] = k - taken
        value_offsets[i + 1] = at + m * taken
        done += taken
        # The children's complements are the newest of the other parity.
        if parity[f] == 0:
            top += freed
            bottom += border * border
        else:
            bottom -= freed
            top -= border * border
        rest_sizes[f] = border
        rest_places[f] = rest_at
        rest_rows[f] = first_id + taken
        if parent[f] < 0:
            if parity[f] == 0:
                bottom -= border * border
            if border > 0:
                weak_ids = _integer_room(weak_ids, weak_count, weak_count + border)
                weak_values = _room(weak_values, weak_entries, weak_entries + border * border)
                for c in range(border):
                    weak_ids[weak_count + c] = ids[first_id + taken + c]
                    for r in range(border):
                        weak_values[weak_entries + c * border + r] = stack[
                            rest_at + min(r, c) * border + max(r, c)
                        ]
                weak_sizes[weak_blocks] = border
                weak_blocks += 1
                weak_count += border
                weak_entries += border * border
    return (
        Lower(values, value_offsets, ids, id_offsets, pivots),
        Pivots(definite, diagonal, off_diagonal),
        Weak(weak_ids[:weak_count], weak_values[:weak_entries], weak_sizes[:weak_blocks]),
        stack,
    )


@kernel(types.UniTuple(Int, 2), LOWER, PIVOTS, called_from_python=True)
def count_signs(lower: Any, factor_pivots: Any) -> Any:
    """Positive and negative eigenvalues of D."""
    pivots = lower.pivots
    definite, diagonal, off_diagonal = factor_pivots
    positive, negative, at = 0, 0, 0
    for f in range(len(pivots)):
        if definite[f]:
            positive += pivots[f]
        else:
            j = at
            while j < at + pivots[f]:
                if off_diagonal[j] != 0.0:
                    determinant = diagonal[j] * diagonal[j + 1] - off_diagonal[j] * off_diagonal[j]
                    if determinant < 0.0:
                        positive += 1
                        negative += 1
                    elif diagonal[j] > 0.0:
                        positive += 2
                    else:
                        negative += 2
                    j += 2
                else:
                    if diagonal[j] > 0.0:
                        positive += 1
                    else:
                        negative += 1
                    j += 1
        at += pivots[f]
    return positive, negative
