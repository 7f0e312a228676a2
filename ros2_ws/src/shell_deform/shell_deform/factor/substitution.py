# SPDX-License-Identifier: Apache-2.0
"""Triangular solves with a multifrontal factor, for one or many right-hand sides at once.

Right-hand sides are rows of r numbers in elimination numbering, which BLAS sees as the columns of
the transposed matrix.
"""

from __future__ import annotations

from typing import Any

from shell_deform.compiled.kernel_arrays import floats
from shell_deform.compiled.kernel_types import FloatRows, Void, kernel
from shell_deform.factor.blas import (
    NO,
    TRANSPOSE,
    gemm,
    gemv,
    new_call,
    solve_lower_right,
    solve_lower_vector,
)
from shell_deform.factor.front_types import LOWER, PIVOTS


@kernel(Void, LOWER, PIVOTS, FloatRows, called_from_python=True)
def forward(lower: Any, factor_pivots: Any, x: Any) -> None:
    """x (n, r) = D^-1 L^-1 x; weak rows hold L^-1 x."""
    values, value_offsets, ids, id_offsets, pivots = lower
    definite, diagonal, off_diagonal = factor_pivots
    call = new_call()
    columns = x.shape[1]
    largest = 0
    for f in range(len(pivots)):
        largest = max(largest, id_offsets[f + 1] - id_offsets[f])
    y = floats(largest * columns, 0.0)
    done = 0
    for f in range(len(pivots)):
        mine = ids[id_offsets[f] : id_offsets[f + 1]]
        m, k, at = len(mine), pivots[f], value_offsets[f]
        if k == 0:
            continue
        border = m - k
        for i in range(k):
            for c in range(columns):
                y[i * columns + c] = x[mine[i], c]
        below = k * columns
        if columns == 1:
            solve_lower_vector(call, NO, k, values, at, m, y, 0)
            if border > 0:
                gemv(call, NO, border, k, 1.0, values, at + k, m, y, 0, 1, 0.0, y, k)
        else:
            solve_lower_right(call, TRANSPOSE, columns, k, values, at, m, y, 0, columns)
            if border > 0:
                gemm(
                    call,
                    NO,
                    TRANSPOSE,
                    columns,
                    border,
                    k,
                    1.0,
                    y,
                    0,
                    columns,
                    values,
                    at + k,
                    m,
                    0.0,
                    y,
                    below,
                    columns,
                )
        for i in range(border):
            for c in range(columns):
                x[mine[k + i], c] -= y[below + i * columns + c]
        if definite[f]:
            for i in range(k):
                for c in range(columns):
                    x[mine[i], c] = y[i * columns + c]
        else:
            i = 0
            while i < k:
                a, b = diagonal[done + i], off_diagonal[done + i]
                if b != 0.0:
                    d = diagonal[done + i + 1]
                    determinant = a * d - b * b
                    for c in range(columns):
                        p, q = y[i * columns + c], y[(i + 1) * columns + c]
                        x[mine[i], c] = (d * p - b * q) / determinant
                        x[mine[i + 1], c] = (a * q - b * p) / determinant
                    i += 2
                else:
                    for c in range(columns):
                        x[mine[i], c] = y[i * columns + c] / a
                    i += 1
        done += k


@kernel(Void, LOWER, FloatRows, called_from_python=True)
def backward(lower: Any, x: Any) -> None:
    """x (n, r) = L^-T x; weak rows are kept."""
    values, value_offsets, ids, id_offsets, pivots = lower
    call = new_call()
    columns = x.shape[1]
    largest = 0
    for f in range(len(pivots)):
        largest = max(largest, id_offsets[f + 1] - id_offsets[f])
    y = floats(largest * columns, 0.0)
    for f in range(len(pivots) - 1, -1, -1):
        mine = ids[id_offsets[f] : id_offsets[f + 1]]
        m, k, at = len(mine), pivots[f], value_offsets[f]
        if k == 0:
            continue
        border = m - k
        for i in range(m):
            for c in range(columns):
                y[i * columns + c] = x[mine[i], c]
        below = k * columns
        if columns == 1:
            if border > 0:
                gemv(call, TRANSPOSE, border, k, -1.0, values, at + k, m, y, k, 1, 1.0, y, 0)
            solve_lower_vector(call, TRANSPOSE, k, values, at, m, y, 0)
        else:
            if border > 0:
                gemm(
                    call,
                    NO,
                    NO,
                    columns,
                    k,
                    border,
                    -1.0,
                    y,
                    below,
                    columns,
                    values,
                    at + k,
                    m,
                    1.0,
                    y,
                    0,
                    columns,
                )
            solve_lower_right(call, NO, columns, k, values, at, m, y, 0, columns)
        for i in range(k):
            for c in range(columns):
                x[mine[i], c] = y[i * columns + c]
