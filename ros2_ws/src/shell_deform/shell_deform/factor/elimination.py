# SPDX-License-Identifier: Apache-2.0
"""Elimination inside one dense symmetric front, with pivots chosen for stability.

A pivot is taken only if its column of L stays bounded (threshold test of Duff and Reid); a column
without an acceptable pivot is handed to the parent front, so no pivot is ever perturbed and the
inertia is that of the matrix itself.
Sources: J. R. Bunch and L. Kaufman (1977), doi:10.1090/S0025-5718-1977-0428694-0; I. S. Duff and
J. K. Reid (1983), doi:10.1145/356044.356047.
"""

from __future__ import annotations

from typing import Any

from numba import types

from shell_deform.compiled.kernel_arrays import floats
from shell_deform.compiled.kernel_types import Bool, Float, Floats, Int, Ints, Void, kernel
from shell_deform.factor.blas import (
    NO,
    TRANSPOSE,
    cholesky,
    gemm,
    gemv,
    solve_lower_right,
    subtract_gram,
)
from shell_deform.factor.front_types import CALL, FRONT

PANEL = 48
# Largest admissible sum of squares of a row of L below a Cholesky block, for a matrix of norm one:
# the backward error of the factorisation is this times the rounding unit.
GROWTH = 1e3
# Smaller pivots at a root may be rounding of zero: there pivots are chosen, largest first.
SAFE_ROOT_PIVOT = 1e-5
# The last columns of a root, drawn from all over it, are eliminated in the order of their size.
ROOT_TAIL = 60


@kernel(Void, CALL, Floats, Int, Int, Int, Int, Floats, Floats)
def _load_column(
    call: Any, front: Any, m: int, at: int, j: int, panel: int, work: Any, column: Any
) -> None:
    """column[at:m] = column j of the symmetric remainder, with the open panel subtracted.

    The panel's columns panel:at of L lie in `front`, those of L D in `work` (leading dimension m).
    """
    for i in range(at, j):
        column[i] = front[i * m + j]
    for i in range(j, m):
        column[i] = front[j * m + i]
    if at > panel:
        gemv(
            call,
            NO,
            m - at,
            at - panel,
            -1.0,
            front,
            panel * m + at,
            m,
            work,
            j,
            m,
            1.0,
            column,
            at,
        )


@kernel(Void, Floats, Int, Ints, Int, Int, Int, Int, Floats)
def _exchange(
    front: Any, m: int, ids: Any, a: int, b: int, panel: int, at: int, work: Any
) -> None:
    """Exchange rows and columns a < b of the remainder, and these rows of L, L D and `ids`."""
    if a == b:
        return
    ids[a], ids[b] = ids[b], ids[a]
    for c in range(at):
        front[c * m + a], front[c * m + b] = front[c * m + b], front[c * m + a]
    for c in range(at - panel):
        work[c * m + a], work[c * m + b] = work[c * m + b], work[c * m + a]
    for c in range(at, a):
        front[c * m + a], front[c * m + b] = front[c * m + b], front[c * m + a]
    front[a * m + a], front[b * m + b] = front[b * m + b], front[a * m + a]
    for i in range(a + 1, b):
        front[a * m + i], front[i * m + b] = front[i * m + b], front[a * m + i]
    for i in range(b + 1, m):
        front[a * m + i], front[b * m + i] = front[b * m + i], front[a * m + i]


@kernel(types.Tuple((Float, Int)), Floats, Int, Int, Int, Int)
def _largest(column: Any, low: int, high: int, skip: int, skip_too: int) -> Any:
    """Largest magnitude in column[low:high] and where, leaving out two rows."""
    most, where = 0.0, -1
    for i in range(low, high):
        size = abs(column[i])
        if size > most and i != skip and i != skip_too:
            most, where = size, i
    return most, where


@kernel(Void, CALL, Floats, Int, Int, Int, Floats)
def _close_panel(call: Any, front: Any, m: int, panel: int, at: int, work: Any) -> None:
    """Subtract L (L D)^T of columns panel:at from the lower triangle of the remainder."""
    if at == panel:
        return
    c = at
    while c < m:
        width = min(96, m - c)
        gemm(
            call,
            NO,
            TRANSPOSE,
            m - c,
            width,
            at - panel,
            -1.0,
            front,
            panel * m + c,
            m,
            work,
            c,
            m,
            1.0,
            front,
            c * m + c,
            m,
        )
        c += width


@kernel(Int, CALL, Floats, Int, Int, Ints, Floats, Floats, Float, Float)
def eliminate(
    call: Any,
    front: Any,
    m: int,
    k: int,
    ids: Any,
    diagonal: Any,
    off_diagonal: Any,
    threshold: float,
    weak: float,
) -> int:
    """Eliminate what can be of the first k columns of a front (m, m); how many, they come first.

    `front` (m * m,) holds the lower triangle column by column; on return its first columns are L
    (unit diagonal) and its remainder the Schur complement. `ids` (m,) follows the exchanges;
    `diagonal`, `off_diagonal` (k,) receive D, where off_diagonal[j] != 0 marks a two-by-two pivot
    at j, j + 1.
    Pivots not larger than `weak` are never taken. At a root (k == m) the largest pivots of the
    last columns come first: what is left over then holds a rigid body at well separated points
    and stands clear of rounding.

    The panel is left-looking: the remainder is updated by matrix products every PANEL columns.
    """
    work = floats(m * PANEL, 0.0)
    first, second = floats(m, 0.0), floats(m, 0.0)
    at, panel, active, at_reset = 0, 0, k, -1
    tail = max(0, k - ROOT_TAIL) if k == m else k
    if tail < k and tail >= ROOT_TAIL:
        for c in range(ROOT_TAIL):
            _exchange(front, m, ids, c * (tail // ROOT_TAIL), tail + c, 0, 0, work)
    while True:
        if at == active:
            if active == k or at == at_reset:
                break
            # Columns set aside earlier may have become acceptable.
            at_reset, active = at, k
            continue
        if at - panel > PANEL - 2 or at >= tail:
            _close_panel(call, front, m, panel, at, work)
            panel = at
        if at >= tail:
            largest = at
            for c in range(at + 1, active):
                if abs(front[c * m + c]) > abs(front[largest * m + largest]):
                    largest = c
            _exchange(front, m, ids, at, largest, panel, at, work)
        j = at
        _load_column(call, front, m, at, j, panel, work, first)
        inside, t = _largest(first, at, k, j, -1)
        outside, _ = _largest(first, k, m, -1, -1)
        pivot = abs(first[j])
        size = 0
        if pivot > weak and pivot >= threshold * max(inside, outside):
            size = 1
        elif inside > weak:
            _load_column(call, front, m, at, t, panel, work, second)
            a, b, c = first[j], first[t], second[t]
            determinant = a * c - b * b
            most = max(abs(a), abs(b), abs(c))
            first_rest = max(_largest(first, at, k, j, t)[0], outside)
            second_rest = max(_largest(second, at, k, j, t)[0], _largest(second, k, m, -1, -1)[0])
            bound = abs(determinant) / threshold
            if (
                abs(determinant) > weak * most
                and abs(determinant) > 1e-3 * threshold * most * most
                and abs(c) * first_rest + abs(b) * second_rest <= bound
                and abs(b) * first_rest + abs(a) * second_rest <= bound
            ):
                size = 2
            elif abs(c) > weak and abs(c) >= threshold * max(abs(b), second_rest):
                size = 1
                j = t
                for i in range(at, m):
                    first[i] = second[i]
        if size == 0:
            active -= 1
            _exchange(front, m, ids, j, active, panel, at, work)
            continue
        _exchange(front, m, ids, at, j, panel, at, work)
        first[at], first[j] = first[j], first[at]
        filled = (at - panel) * m
        if size == 1:
            d = first[at]
            diagonal[at], off_diagonal[at] = d, 0.0
            front[at * m + at] = 1.0
            for i in range(at + 1, m):
                work[filled + i] = first[i]
                front[at * m + i] = first[i] / d
            at += 1
        else:
            _exchange(front, m, ids, at + 1, t, panel, at, work)
            first[at + 1], first[t] = first[t], first[at + 1]
            second[at + 1], second[t] = second[t], second[at + 1]
            a, b, c = first[at], first[at + 1], second[at + 1]
            determinant = a * c - b * b
            diagonal[at], off_diagonal[at], diagonal[at + 1], off_diagonal[at + 1] = a, b, c, 0.0
            front[at * m + at] = 1.0
            front[at * m + at + 1] = 0.0
            front[(at + 1) * m + at + 1] = 1.0
            for i in range(at + 2, m):
                work[filled + i] = first[i]
                work[filled + m + i] = second[i]
                front[at * m + i] = (c * first[i] - b * second[i]) / determinant
                front[(at + 1) * m + i] = (a * second[i] - b * first[i]) / determinant
            at += 2
        if active < at:
            active = at
    _close_panel(call, front, m, panel, at, work)
    return at


@kernel(Bool, CALL, FRONT, Float)
def eliminate_definite(call: Any, front: Any, weak: float) -> bool:
    """Cholesky of a front in place; False when a pivot is not above `weak` or L grows.

    On success the columns are L and the triangle behind them the Schur complement; otherwise the
    front is spoilt.
    """
    panel, at, m, k, rest, rest_at, rest_ld = front
    if cholesky(call, k, panel, at, m) != 0:
        return False
    for j in range(k):
        pivot = panel[at + j * m + j]
        if not pivot * pivot > (weak if m > k else max(weak, SAFE_ROOT_PIVOT)):
            return False
    border = m - k
    if border > 0:
        solve_lower_right(call, TRANSPOSE, border, k, panel, at, m, panel, at + k, m)
        before = floats(border, 0.0)
        for i in range(border):
            before[i] = rest[rest_at + i * rest_ld + i]
        subtract_gram(call, border, k, panel, at + k, m, rest, rest_at, rest_ld)
        for i in range(border):
            if not before[i] - rest[rest_at + i * rest_ld + i] <= GROWTH:
                return False
    return True
