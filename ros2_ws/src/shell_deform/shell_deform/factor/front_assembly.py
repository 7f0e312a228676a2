# SPDX-License-Identifier: Apache-2.0
"""Filling a front: entries of the matrix and Schur complements of the children.

Matrix values are read where SciPy keeps them (`Matrix` in `front_types`) and scaled on the
way; scale 0 pins an unknown, which gets a unit diagonal instead.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types

from shell_deform.compiled.kernel_arrays import floats, longs
from shell_deform.compiled.kernel_types import (
    Bool,
    Bools,
    Floats,
    Int,
    IntRows,
    Ints,
    Longs,
    Void,
    kernel,
)
from shell_deform.factor.front_types import FRONT, MATRIX, TREE, WAITING


@kernel(types.UniTuple(Int, 2), Int, Int, Bool)
def _steps(block: int, degree: int, interleaved: bool) -> Any:
    """Distance in `data` between a vertex's rows, and between the blocks of one row."""
    if interleaved:
        return block * degree, block
    return block, block * block


@kernel(Int, Floats, Ints, Ints, Bool, Int, Bools, Floats, called_from_python=True)
def equilibrate(
    data: Any, indptr: Any, neighbours: Any, interleaved: bool, block: int, free: Any, scale: Any
) -> int:
    """Powers of two (n,) that bring every row's largest magnitude near one; 0 where not `free`.

    Returns -1, or the first row with a value that is not
    finite. Source: D. Ruiz (2001), report RAL-TR-2001-034.
    """
    count = len(scale)
    for i in range(count):
        scale[i] = 1.0 if free[i] else 0.0
    largest = floats(count, 0.0)
    for _ in range(6):
        balanced = True
        for v in range(len(indptr) - 1):
            begin, end = indptr[v], indptr[v + 1]
            row_step, block_step = _steps(block, end - begin, interleaved)
            for a in range(block):
                at = np.int64(begin) * block * block + a * row_step
                most = 0.0
                for q in range(begin, end):
                    w = neighbours[q] * block
                    values = data[at : at + block]
                    for e in range(block):
                        size = abs(values[e]) * scale[w + e]
                        if not size <= 1e300:
                            return v * block + a
                        most = max(most, size)
                    at += block_step
                largest[v * block + a] = most * scale[v * block + a]
        for i in range(count):
            if largest[i] > 0.0 and not 0.25 <= largest[i] <= 4.0:
                balanced = False
                scale[i] *= 2.0 ** math.floor(0.5 - 0.5 * math.log2(largest[i]))
        if balanced:
            break
    return -1


@kernel(Void, Floats, Int, Floats, Int, Int)
def _add(target: Any, target_at: int, source: Any, source_at: int, count: int) -> None:
    """target[target_at:+count] += source[source_at:+count]."""
    into = target[target_at : target_at + count]
    out = source[source_at : source_at + count]
    for i in range(count):
        into[i] += out[i]


@kernel(Void, MATRIX, Int, Int, Int, FRONT)
def _add_entries(matrix: Any, low: int, high: int, shift: int, front: Any) -> None:
    """Add the matrix entries of the vertices at positions low:high to the columns of their front.

    Rows behind the owned ones lie `shift` lower.
    """
    data, indptr, neighbours, targets, order, scale, block, interleaved = matrix
    panel, panel_at, m = front.panel, front.panel_at, front.m
    own = high - low
    for c in range(own):
        v = order[low + c]
        begin, end = indptr[v], indptr[v + 1]
        row_step, block_step = _steps(block, end - begin, interleaved)
        for a in range(block):
            column = panel_at + (c * block + a) * m
            scale_column = scale[v * block + a]
            at = np.int64(begin) * block * block + a * row_step
            for q in range(begin, end):
                t = targets[q]
                if t >= 0:
                    here = column + t * block + (shift if t >= own else 0)
                    w = neighbours[q] * block
                    for e in range(block):
                        panel[here + e] += scale_column * scale[w + e] * data[at + e]
                at += block_step
            if scale_column == 0.0:
                panel[column + c * block + a] = 1.0


@kernel(Void, Floats, Int, Int, IntRows, Int, Int, Int, FRONT)
def _add_child(
    stack: Any, child_at: int, size: int, runs: Any, block: int, own: int, shift: int, front: Any
) -> None:
    """Add a child's Schur complement (size, size) without delayed columns, run by run."""
    panel, panel_at, m, k, rest, rest_at, rest_ld = front
    for q in range(len(runs)):
        start, row, length = runs[q, 0] * block, runs[q, 1] * block, runs[q, 2] * block
        if runs[q, 1] >= own:
            row += shift
        for j in range(length):
            c = row + j
            source = child_at + (start + j) * size + start + j
            if c < k:
                base = panel_at + c * m
                _add(panel, base + c, stack, source, length - j)
            else:
                base = rest_at + (c - k) * rest_ld - k
                _add(rest, base + c, stack, source, length - j)
            source = child_at + (start + j) * size
            for r in range(q + 1, len(runs)):
                below = runs[r, 1] * block
                if runs[r, 1] >= own:
                    below += shift
                if c < k:
                    _add(
                        panel, base + below, stack, source + runs[r, 0] * block, runs[r, 2] * block
                    )
                else:
                    _add(
                        rest, base + below, stack, source + runs[r, 0] * block, runs[r, 2] * block
                    )


@kernel(Void, Floats, Int, Int, Longs, FRONT)
def _add_child_with_delays(stack: Any, child_at: int, size: int, rows: Any, front: Any) -> None:
    """Add a child's Schur complement whose row i lands in row rows[i] of the parent."""
    panel, panel_at, m, k, rest, rest_at, rest_ld = front
    for j in range(size):
        for i in range(j, size):
            r, c = max(rows[i], rows[j]), min(rows[i], rows[j])
            value = stack[child_at + j * size + i]
            if c < k:
                panel[panel_at + c * m + r] += value
            else:
                rest[rest_at + (c - k) * rest_ld - k + r] += value


@kernel(Void, Int, MATRIX, TREE, WAITING, Int, FRONT)
def assemble(f: int, matrix: Any, tree: Any, waiting: Any, shift: int, front: Any) -> None:
    """Fill front f, in which `shift` columns of its children were delayed."""
    owned, run_offsets, runs = tree.owned, tree.run_offsets, tree.runs
    first_child, next_child = tree.first_child, tree.next_child
    stack, rest_sizes, rest_places, delays = waiting
    panel, panel_at, m, k, rest, rest_at, rest_ld = front
    block = matrix.block
    panel[panel_at : panel_at + m * k] = 0.0
    for c in range(m - k):
        rest[rest_at + c * rest_ld + c : rest_at + c * rest_ld + m - k] = 0.0
    own = owned[f + 1] - owned[f]
    _add_entries(matrix, owned[f], owned[f + 1], shift, front)
    delayed = own * block
    child = first_child[f]
    while child >= 0:
        size = rest_sizes[child]
        mine = runs[run_offsets[child] : run_offsets[child + 1]]
        if delays[child] == 0:
            _add_child(stack, rest_places[child], size, mine, block, own, shift, front)
        else:
            rows = longs(size, 0)
            for i in range(delays[child]):
                rows[i] = delayed + i
            for q in range(len(mine)):
                row = mine[q, 1] * block
                if mine[q, 1] >= own:
                    row += shift
                for i in range(mine[q, 2] * block):
                    rows[delays[child] + mine[q, 0] * block + i] = row + i
            delayed += delays[child]
            _add_child_with_delays(stack, rest_places[child], size, rows, front)
        child = next_child[child]
