# SPDX-License-Identifier: Apache-2.0
"""New arrays for kernels: one compiled function per type.

numba compiles `np.empty`, `np.zeros` and `np.full` anew for every type and every written-out shape
they are called with; these are compiled once and kept.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled.kernel_types import (
    Bool,
    Bools,
    Bytes,
    Float,
    FloatRows,
    Floats,
    Int,
    IntRows,
    Ints,
    Longs,
    kernel,
)


@kernel(Floats, Int, Float)
def floats(count: int, value: float) -> Any:
    """(count,) float64, all of them `value`."""
    result = np.empty(count, np.float64)
    for i in range(count):
        result[i] = value
    return result


@kernel(FloatRows, Int, Int)
def float_rows(rows: int, columns: int) -> Any:
    """(rows, columns) zeros, float64."""
    result = np.empty((rows, columns), np.float64)
    for i in range(rows):
        for j in range(columns):
            result[i, j] = 0.0
    return result


@kernel(Ints, Int, Int)
def integers(count: int, value: int) -> Any:
    """(count,) int32, all of them `value`."""
    result = np.empty(count, np.int32)
    for i in range(count):
        result[i] = value
    return result


@kernel(IntRows, Int, Int)
def integer_rows(rows: int, columns: int) -> Any:
    """(rows, columns) zeros, int32."""
    result = np.empty((rows, columns), np.int32)
    for i in range(rows):
        for j in range(columns):
            result[i, j] = 0
    return result


@kernel(Longs, Int, Int)
def longs(count: int, value: int) -> Any:
    """(count,) int64, all of them `value`."""
    result = np.empty(count, np.int64)
    for i in range(count):
        result[i] = value
    return result


@kernel(Bytes, Int, Int)
def small_integers(count: int, value: int) -> Any:
    """(count,) int8, all of them `value`."""
    result = np.empty(count, np.int8)
    for i in range(count):
        result[i] = value
    return result


@kernel(Bools, Int, Bool)
def booleans(count: int, value: bool) -> Any:
    """(count,) bool, all of them `value`."""
    result = np.empty(count, np.bool_)
    for i in range(count):
        result[i] = value
    return result
