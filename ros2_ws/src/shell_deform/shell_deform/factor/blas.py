# SPDX-License-Identifier: Apache-2.0
"""SciPy's dense BLAS and LAPACK called from compiled kernels, on flat column-major arrays.

The addresses come from the capsules of `scipy.linalg.cython_blas` and `cython_lapack` and are
given to LLVM as named symbols, because only named symbols (not pointers) survive numba's cache.
Every routine receives its arrays whole and takes their addresses itself: an array whose address
alone is passed on may be freed after its last visible use.

`call` is the tuple of `new_call()`: integers, numbers and letters that BLAS reads by reference.
Offsets and leading dimensions count doubles.
"""

from __future__ import annotations

import ctypes
from typing import Any

import llvmlite.binding
import numpy as np
from numba import types
from numba.extending import get_cython_function_address

from shell_deform.compiled.kernel_arrays import floats, integers
from shell_deform.compiled.kernel_types import Float, Floats, Int, Void, kernel
from shell_deform.factor.front_types import CALL

NO, TRANSPOSE, LOWER, LEFT, RIGHT = 0, 1, 2, 3, 4


def _integers_are_32_bit(module: str, name: str) -> bool:
    """Whether the routine's capsule declares plain `int *` sizes (LP64)."""
    capsule = __import__(module, fromlist=['__pyx_capi__']).__pyx_capi__[name]
    read_name = ctypes.pythonapi.PyCapsule_GetName
    read_name.restype = ctypes.c_char_p
    read_name.argtypes = [ctypes.py_object]
    return b'(char *, ' in read_name(capsule) and b' int *' in read_name(capsule)


def _routine(module: str, name: str, arguments: int) -> Any:
    """External function `name` of `arguments` addresses.

    Raises ImportError when SciPy was built with 64-bit integers, which these calls do not speak.
    """
    if not _integers_are_32_bit(module, name):
        raise ImportError(f'{module}.{name} does not take 32-bit integers; use the SuperLU factor')
    symbol = f'shell_deform_{name}'
    llvmlite.binding.add_symbol(symbol, get_cython_function_address(module, name))
    return types.ExternalFunction(symbol, types.void(*[types.uintp] * arguments))


_dgemm = _routine('scipy.linalg.cython_blas', 'dgemm', 13)
_dgemv = _routine('scipy.linalg.cython_blas', 'dgemv', 11)
_dsyrk = _routine('scipy.linalg.cython_blas', 'dsyrk', 10)
_dtrsm = _routine('scipy.linalg.cython_blas', 'dtrsm', 11)
_dtrsv = _routine('scipy.linalg.cython_blas', 'dtrsv', 8)
_dpotrf = _routine('scipy.linalg.cython_lapack', 'dpotrf', 5)


@kernel(CALL)
def new_call() -> Any:
    """Room for what BLAS reads by reference: (integers, numbers, letters N T L L R)."""
    letters = np.empty(5, np.uint8)
    letters[NO] = ord('N')
    letters[TRANSPOSE] = ord('T')
    letters[LOWER] = ord('L')
    letters[LEFT] = ord('L')
    letters[RIGHT] = ord('R')
    return integers(8, 0), floats(2, 0.0), letters


@kernel(
    Void, CALL, Int, Int, Int, Int, Int, Float, Floats, Int, Int, Floats, Int, Int, Float, Floats,
    Int, Int,
)  # fmt: skip
def gemm(
    call: Any,
    transpose_a: int,
    transpose_b: int,
    m: int,
    n: int,
    k: int,
    alpha: float,
    a: Any,
    a_at: int,
    a_ld: int,
    b: Any,
    b_at: int,
    b_ld: int,
    beta: float,
    c: Any,
    c_at: int,
    c_ld: int,
) -> None:
    """C (m, n) = alpha op(A) (m, k) op(B) (k, n) + beta C."""
    integers, numbers, letters = call
    integers[0], integers[1], integers[2] = m, n, k
    integers[3], integers[4], integers[5] = a_ld, b_ld, c_ld
    numbers[0], numbers[1] = alpha, beta
    i, x, t = integers.ctypes.data, numbers.ctypes.data, letters.ctypes.data
    _dgemm(
        t + transpose_a,
        t + transpose_b,
        i,
        i + 4,
        i + 8,
        x,
        a.ctypes.data + 8 * a_at,
        i + 12,
        b.ctypes.data + 8 * b_at,
        i + 16,
        x + 8,
        c.ctypes.data + 8 * c_at,
        i + 20,
    )


@kernel(Void, CALL, Int, Int, Int, Float, Floats, Int, Int, Floats, Int, Int, Float, Floats, Int)
def gemv(
    call: Any,
    transpose: int,
    m: int,
    n: int,
    alpha: float,
    a: Any,
    a_at: int,
    a_ld: int,
    x: Any,
    x_at: int,
    x_step: int,
    beta: float,
    y: Any,
    y_at: int,
) -> None:
    """y = alpha op(A) x + beta y with A (m, n)."""
    integers, numbers, letters = call
    integers[0], integers[1], integers[2], integers[3], integers[4] = m, n, a_ld, x_step, 1
    numbers[0], numbers[1] = alpha, beta
    i, v, t = integers.ctypes.data, numbers.ctypes.data, letters.ctypes.data
    _dgemv(
        t + transpose,
        i,
        i + 4,
        v,
        a.ctypes.data + 8 * a_at,
        i + 8,
        x.ctypes.data + 8 * x_at,
        i + 12,
        v + 8,
        y.ctypes.data + 8 * y_at,
        i + 16,
    )


@kernel(Void, CALL, Int, Int, Floats, Int, Int, Floats, Int, Int)
def subtract_gram(
    call: Any, n: int, k: int, a: Any, a_at: int, a_ld: int, c: Any, c_at: int, c_ld: int
) -> None:
    """Lower triangle of C (n, n) -= A A^T with A (n, k)."""
    integers, numbers, letters = call
    integers[0], integers[1], integers[2], integers[3] = n, k, a_ld, c_ld
    numbers[0], numbers[1] = -1.0, 1.0
    i, x, t = integers.ctypes.data, numbers.ctypes.data, letters.ctypes.data
    _dsyrk(
        t + LOWER,
        t + NO,
        i,
        i + 4,
        x,
        a.ctypes.data + 8 * a_at,
        i + 8,
        x + 8,
        c.ctypes.data + 8 * c_at,
        i + 12,
    )


@kernel(Void, CALL, Int, Int, Int, Floats, Int, Int, Floats, Int, Int)
def solve_lower_right(
    call: Any,
    transpose: int,
    m: int,
    n: int,
    a: Any,
    a_at: int,
    a_ld: int,
    b: Any,
    b_at: int,
    b_ld: int,
) -> None:
    """B (m, n) = B op(L)^-1 with the lower triangle L (n, n) of A."""
    integers, numbers, letters = call
    integers[0], integers[1], integers[2], integers[3] = m, n, a_ld, b_ld
    numbers[0] = 1.0
    i, x, t = integers.ctypes.data, numbers.ctypes.data, letters.ctypes.data
    _dtrsm(
        t + RIGHT,
        t + LOWER,
        t + transpose,
        t + NO,
        i,
        i + 4,
        x,
        a.ctypes.data + 8 * a_at,
        i + 8,
        b.ctypes.data + 8 * b_at,
        i + 12,
    )


@kernel(Void, CALL, Int, Int, Floats, Int, Int, Floats, Int)
def solve_lower_vector(
    call: Any, transpose: int, n: int, a: Any, a_at: int, a_ld: int, x: Any, x_at: int
) -> None:
    """x (n,) = op(L)^-1 x with the lower triangle L of A."""
    integers, _, letters = call
    integers[0], integers[1], integers[2] = n, a_ld, 1
    i, t = integers.ctypes.data, letters.ctypes.data
    _dtrsv(
        t + LOWER,
        t + transpose,
        t + NO,
        i,
        a.ctypes.data + 8 * a_at,
        i + 4,
        x.ctypes.data + 8 * x_at,
        i + 8,
    )


@kernel(Int, CALL, Int, Floats, Int, Int)
def cholesky(call: Any, n: int, a: Any, a_at: int, a_ld: int) -> int:
    """Lower Cholesky factor of A (n, n) in place; 0, or the order of the failing minor."""
    integers, _, letters = call
    integers[0], integers[1], integers[2] = n, a_ld, 0
    i, t = integers.ctypes.data, letters.ctypes.data
    _dpotrf(t + LOWER, i, a.ctypes.data + 8 * a_at, i + 4, i + 8)
    return integers[2]
