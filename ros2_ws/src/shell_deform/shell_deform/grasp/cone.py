# SPDX-License-Identifier: Apache-2.0
"""Exact programmes over friction cones; `cone_plain` says what is solved and how."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.grasp.cone_plain import solve_plain

if HAVE_NUMBA:
    from shell_deform.grasp import cone_kernel

Array = NDArray[np.float64]

TOLERANCE = 1e-11


class ConeError(RuntimeError):
    """A cone programme that did not end; the text says which."""


def solve_cone(
    cost: Array, matrix: Array, right: Array, cones: int, tolerance: float = TOLERANCE
) -> tuple[Array, Array]:
    """Solution (n,) and multipliers (m,) of min c x, A x = b, x in `cones` cones and plain rows.

    Raises ConeError where it does not converge.
    """
    if not HAVE_NUMBA:
        x, y, done = solve_plain(cost, matrix, right, cones, tolerance)
    else:
        x, y = np.empty(len(cost)), np.empty(len(right))
        done = cone_kernel.solve(cost, matrix, right, cones, tolerance, x, y)
    if not done:
        raise ConeError(f'the programme of {cones} friction cones did not converge')
    return x, y
