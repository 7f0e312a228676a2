# SPDX-License-Identifier: Apache-2.0
"""The compiled form of `cone_plain.solve_plain`: the same method without temporaries."""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bool,
    Float,
    FloatRows,
    Floats,
    Int,
    Void,
    kernel,
)

CONE = 4
MOST_ITERATIONS = 60
REGULAR = 1e-14
BACK_OFF = 0.99
NEAR = 1e5
STALE = 4
MISSING = 1e30


@kernel(Float, Floats, Int)
def _length(x: Any, at: int) -> float:
    """Root of the determinant of the cone vector that starts at `at`."""
    rest = np.sqrt(x[at + 1] ** 2 + x[at + 2] ** 2 + x[at + 3] ** 2)
    return float(np.sqrt((x[at] - rest) * (x[at] + rest)))


@kernel(Float, Floats, Floats, Int)
def _reach(x: Any, step: Any, cones: int) -> float:
    """How much of `step` leads from x to the edge of the cones."""
    reach = np.inf
    for i in range(cones):
        at = CONE * i
        square, cross = step[at] ** 2, x[at] * step[at]
        for c in range(1, CONE):
            square -= step[at + c] ** 2
            cross -= x[at + c] * step[at + c]
        room = _length(x, at) ** 2
        root = cross * cross - square * room
        if square < 0.0 or (cross < 0.0 and root >= 0.0):
            reach = min(reach, room / (np.sqrt(max(root, 0.0)) - cross))
    for j in range(CONE * cones, x.shape[0]):
        if step[j] < 0.0:
            reach = min(reach, -x[j] / step[j])
    return float(reach)


@kernel(Void, Floats, Floats, Int, Float, Floats)
def _apply(scaled: Any, v: Any, cones: int, sign: float, result: Any) -> None:
    """W v for `sign` 1, W^-1 v for -1."""
    for i in range(cones):
        at, to = CONE * i, 5 * i
        beta = scaled[to] if sign > 0.0 else 1.0 / scaled[to]
        along = 0.0
        for c in range(1, CONE):
            along += sign * scaled[to + 1 + c] * v[at + c]
        factor = v[at] + along / (1.0 + scaled[to + 1])
        result[at] = beta * (scaled[to + 1] * v[at] + along)
        for c in range(1, CONE):
            result[at + c] = beta * (v[at + c] + sign * scaled[to + 1 + c] * factor)
    for j in range(CONE * cones, v.shape[0]):
        w = scaled[cones + j]
        result[j] = w * v[j] if sign > 0.0 else v[j] / w


@kernel(Void, Floats, Floats, Int, Floats, Floats)
def _scale(x: Any, s: Any, cones: int, scaled: Any, middle: Any) -> None:
    """Scaling W (per cone: beta, w0, w1..w3; per plain unknown: w), and W s = W^-1 x."""
    for i in range(cones):
        at, to = CONE * i, 5 * i
        length_x, length_s = _length(x, at), _length(s, at)
        inner = 0.0
        for c in range(CONE):
            inner += (x[at + c] / length_x) * (s[at + c] / length_s)
        half = 2.0 * np.sqrt(0.5 * (1.0 + inner))
        scaled[to] = np.sqrt(length_x / length_s)
        scaled[to + 1] = (x[at] / length_x + s[at] / length_s) / half
        for c in range(1, CONE):
            scaled[to + 1 + c] = (x[at + c] / length_x - s[at + c] / length_s) / half
    for j in range(CONE * cones, x.shape[0]):
        scaled[cones + j] = np.sqrt(x[j] / s[j])
    _apply(scaled, s, cones, 1.0, middle)


@kernel(Void, Floats, Floats, Int, Floats)
def _square(scaled: Any, v: Any, cones: int, result: Any) -> None:
    """W^2 v."""
    for i in range(cones):
        at, to = CONE * i, 5 * i
        beta = scaled[to] ** 2
        along = 0.0
        for c in range(CONE):
            along += scaled[to + 1 + c] * v[at + c]
        for c in range(CONE):
            turned = -v[at] if c == 0 else v[at + c]
            result[at + c] = beta * (2.0 * scaled[to + 1 + c] * along + turned)
    for j in range(CONE * cones, v.shape[0]):
        result[j] = scaled[cones + j] ** 2 * v[j]


@kernel(Void, FloatRows, Floats, Int, FloatRows, FloatRows)
def _normal(matrix: Any, scaled: Any, cones: int, weighted: Any, lower: Any) -> None:
    """A W^2 row by row, and the Cholesky factor of A W^2 A^T; dependent rows are left alone."""
    rows, columns = matrix.shape
    for i in range(rows):
        _square(scaled, matrix[i], cones, weighted[i])
    for i in range(rows):
        for j in range(i + 1):
            value = 0.0
            for c in range(columns):
                value += weighted[i, c] * matrix[j, c]
            lower[i, j] = value
    floor = 0.0
    for i in range(rows):
        floor = max(floor, REGULAR * lower[i, i])
    for j in range(rows):
        for k in range(j):
            lower[j, j] -= lower[j, k] ** 2
        lower[j, j] = np.sqrt(lower[j, j]) if lower[j, j] > floor else MISSING
        for i in range(j + 1, rows):
            value = lower[i, j]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = value / lower[j, j]


@kernel(
    Void, FloatRows, FloatRows, FloatRows, Floats, Floats, Float, Floats, Floats, Int,
    Floats, Floats, Floats, Floats,
)  # fmt: skip
def _direction(
    matrix: Any,
    weighted: Any,
    lower: Any,
    lacking: Any,
    slack: Any,
    share: float,
    scaled: Any,
    towards: Any,
    cones: int,
    own: Any,
    dx: Any,
    ds: Any,
    dy: Any,
) -> None:
    """Newton step: A dx = share lacking, A'dy + ds = share slack, W^-1 dx + W ds = towards."""
    rows, columns = matrix.shape
    _apply(scaled, towards, cones, 1.0, own)
    for i in range(rows):
        value = share * lacking[i]
        for c in range(columns):
            value += share * weighted[i, c] * slack[c] - matrix[i, c] * own[c]
        for k in range(i):
            value -= lower[i, k] * dy[k]
        dy[i] = value / lower[i, i]
    for i in range(rows - 1, -1, -1):
        value = dy[i]
        for k in range(i + 1, rows):
            value -= lower[k, i] * dy[k]
        dy[i] = value / lower[i, i]
    for c in range(columns):
        value = share * slack[c]
        for i in range(rows):
            value -= matrix[i, c] * dy[i]
        ds[c] = value
    _square(scaled, ds, cones, dx)
    for c in range(columns):
        dx[c] = own[c] - dx[c]


@kernel(Void, Floats, Floats, Floats, Int, Float, Floats)
def _corrected(middle: Any, a: Any, b: Any, cones: int, target: float, towards: Any) -> None:
    """middle \\ (target e - a o b) - middle, o the Jordan product and \\ its inverse."""
    for i in range(cones):
        at = CONE * i
        goal = target
        for c in range(CONE):
            goal -= a[at + c] * b[at + c]
        u = middle[at]
        size = _length(middle, at) ** 2
        along = 0.0
        for c in range(1, CONE):
            along -= middle[at + c] * (a[at] * b[at + c] + b[at] * a[at + c])
        towards[at] = (u * goal - along) / size - u
        for c in range(1, CONE):
            bend = a[at] * b[at + c] + b[at] * a[at + c]
            towards[at + c] = (
                (along / u - goal) * middle[at + c] / size - bend / u - middle[at + c]
            )
    for j in range(CONE * cones, middle.shape[0]):
        towards[j] = (target - a[j] * b[j]) / middle[j] - middle[j]


@kernel(Bool, Floats, FloatRows, Floats, Int, Float, Floats, Floats, called_from_python=True)
def solve(
    cost: Any, matrix: Any, right: Any, cones: int, tolerance: float, x: Any, y: Any
) -> bool:
    """Fill the solution x (n,) and the multipliers y (m,); whether they are to `tolerance`."""
    rows, n = matrix.shape
    degree = 2.0 * cones + (n - CONE * cones)
    s, dx, ds, own = floats(n, 1.0), floats(n, 0.0), floats(n, 0.0), floats(n, 0.0)
    middle, towards, slack = floats(n, 0.0), floats(n, 0.0), floats(n, 0.0)
    a, b, at = floats(n, 0.0), floats(n, 0.0), floats(n, 0.0)
    lacking, dy, up = floats(rows, 0.0), floats(rows, 0.0), floats(rows, 0.0)
    scaled = floats(n + cones, 0.0)
    weighted, lower = float_rows(rows, n), float_rows(rows, rows)
    size_right, size_cost = 1.0, 1.0
    for i in range(rows):
        y[i] = 0.0
        size_right = max(size_right, 1.0 + abs(right[i]))
    for j in range(n):
        size_cost = max(size_cost, 1.0 + abs(cost[j]))
        s[j] = 0.0 if j < CONE * cones and j % CONE != 0 else 1.0
        x[j] = at[j] = s[j]
    best, stale = np.inf, 0
    for _ in range(MOST_ITERATIONS):
        worst_row, worst_column, gap, value = 0.0, 0.0, 0.0, 0.0
        for i in range(rows):
            left = right[i]
            for j in range(n):
                left -= matrix[i, j] * at[j]
            lacking[i] = left
            worst_row = max(worst_row, abs(left))
        for j in range(n):
            left = cost[j] - s[j]
            for i in range(rows):
                left -= matrix[i, j] * up[i]
            slack[j] = left
            worst_column = max(worst_column, abs(left))
            gap += at[j] * s[j]
            value += cost[j] * at[j]
        gap /= degree
        error = max(worst_row / size_right, worst_column / size_cost, gap / (1.0 + abs(value)))
        if not (np.isfinite(gap) and np.isfinite(worst_row + worst_column) and gap > 0.0):
            break
        if error < best:
            best, stale = error, 0
            for j in range(n):
                x[j] = at[j]
            for i in range(rows):
                y[i] = up[i]
        stale += 1
        if best < tolerance or stale > STALE:
            break
        _scale(at, s, cones, scaled, middle)
        _normal(matrix, scaled, cones, weighted, lower)
        for j in range(n):
            towards[j] = -middle[j]
        _direction(
            matrix, weighted, lower, lacking, slack, 1.0, scaled, towards, cones, own, dx, ds, dy
        )
        reach = min(_reach(at, dx, cones), _reach(s, ds, cones), 1.0)
        left = 0.0
        for j in range(n):
            left += (at[j] + reach * dx[j]) * (s[j] + reach * ds[j])
        centre = (max(left / degree, 0.0) / gap) ** 3
        _apply(scaled, dx, cones, -1.0, a)
        _apply(scaled, ds, cones, 1.0, b)
        _corrected(middle, a, b, cones, centre * gap, towards)
        _direction(
            matrix, weighted, lower, lacking, slack, 1.0 - centre, scaled, towards, cones, own,
            dx, ds, dy,
        )  # fmt: skip
        reach = min(BACK_OFF * min(_reach(at, dx, cones), _reach(s, ds, cones)), 1.0)
        if not reach > 1e-10:
            break
        for j in range(n):
            at[j] += reach * dx[j]
            s[j] += reach * ds[j]
        for i in range(rows):
            up[i] += reach * dy[i]
    return bool(best < NEAR * tolerance)
