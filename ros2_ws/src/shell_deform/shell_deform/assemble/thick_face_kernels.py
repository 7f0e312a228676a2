# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over points of a thick wall's outer face: where it is, and how it moves.

The face x = phi + (lambda h/2 + kappa h/4) d depends on the position phi of the middle surface and
on 21 numbers of the point: q (five derivatives of phi) and the shear (6,). Lambda and kappa are
those that balance the wall without a load at the point.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.assemble.kernels import gather_derivatives, gather_place
from shell_deform.assemble.thick_kernels import (
    ThickElements,
    ThickPoints,
    gather_shear,
    point_work,
    wall_point,
)
from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bool,
    FixedFloatRows,
    Float,
    FloatRows,
    Floats,
    Longs,
    Void,
    kernel,
)

PROBE = 1e-4
"""Push of the difference quotient for the second derivative, over the shear modulus."""


@kernel(Void, FloatRows, Floats, Floats)
def _set_director(q: Any, shear: Any, director: Any) -> None:
    """Unit vector along n + W^a a_a."""
    a, b = q[0], q[1]
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    area = np.sqrt(x * x + y * y + z * z)
    director[0] = x / area + shear[0] * a[0] + shear[1] * b[0]
    director[1] = y / area + shear[0] * a[1] + shear[1] * b[1]
    director[2] = z / area + shear[0] * a[2] + shear[1] * b[2]
    length = np.sqrt(director[0] ** 2 + director[1] ** 2 + director[2] ** 2)
    for i in range(3):
        director[i] /= length


@kernel(
    Void, ThickElements, ThickPoints, Float, Float, FixedFloatRows, Longs, Longs, Bool, FloatRows,
    FloatRows,
    called_from_python=True,
)  # fmt: skip
def face_points(
    elements: Any, points: Any, modulus: float, bulk: float, positions: Any, chosen: Any,
    element_of: Any, deep: bool, place: Any, change: Any,
) -> None:  # fmt: skip
    """Places (k, 3) of the `chosen` points; if `deep` their derivative by the 21 numbers (k, 63).

    Where the wall has no equilibrium the face lies as far from the middle surface as undeformed,
    and does not follow its stretch.
    """
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    work, x, axis = point_work(), floats(3, 0.0), floats(3, 0.0)
    q, shear, face = float_rows(5, 3), floats(6, 0.0), floats(4, 0.0)
    force, reach, hessian = floats(21, 0.0), floats(21, 0.0), float_rows(21, 24)
    for k in range(len(chosen)):
        p, element = chosen[k], element_of[k]
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears = controls_of[element], shears_of[element]
        row = rows[row_offsets[p] : row_offsets[p + 1]]
        gather_derivatives(own[:controls], row, positions, q)
        gather_place(own[:controls], values[row_offsets[p] : row_offsets[p + 1]], positions, x)
        gather_shear(
            own[controls : controls + shears], shear_rows, shear_offsets[p], positions, shear
        )
        for i in range(3):
            # Height along each axis of space; without derivatives the first call tells lambda.
            for j in range(3):
                axis[j] = 1.0 if i == j else 0.0
            if deep or i == 0:
                energy = wall_point(
                    q, shear, axis, curvature[p], thickness[p], modulus, bulk, 0.0, shears > 0,
                    deep, False, force, hessian, reach, face, work,
                )  # fmt: skip
            if deep:
                for j in range(21):
                    change[k, 21 * i + j] = reach[j] if np.isfinite(energy) else 0.0
        top = thickness[p] * (0.5 * face[0] + 0.25 * face[1])
        if not np.isfinite(energy):
            top = 0.5 * thickness[p]
        _set_director(q, shear, axis)
        for i in range(3):
            place[k, i] = x[i] + top * axis[i]


@kernel(
    Void, ThickElements, ThickPoints, Float, Float, FixedFloatRows, Longs, Longs, FloatRows,
    FloatRows,
    called_from_python=True,
)  # fmt: skip
def face_bends(
    elements: Any, points: Any, modulus: float, bulk: float, positions: Any, chosen: Any,
    element_of: Any, force_on: Any, bent: Any,
) -> None:  # fmt: skip
    """Second derivative (k, 441) of each `force_on` (k, 3) times its point, by the 21 numbers.

    The wall under a small push t along a unit axis stores min over l of W + t y zeta(l): how that
    changes with t is the height of the face, so its Hessian's change is the Hessian of the height.
    """
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    work, axis = point_work(), floats(3, 0.0)
    q, shear, face = float_rows(5, 3), floats(6, 0.0), floats(4, 0.0)
    force, reach, hessian = floats(21, 0.0), floats(21, 0.0), float_rows(21, 24)
    for k in range(len(chosen)):
        p, element = chosen[k], element_of[k]
        size = np.sqrt(force_on[k, 0] ** 2 + force_on[k, 1] ** 2 + force_on[k, 2] ** 2)
        for i in range(441):
            bent[k, i] = 0.0
        if size == 0.0:
            continue
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears = controls_of[element], shears_of[element]
        gather_derivatives(own[:controls], rows[row_offsets[p] : row_offsets[p + 1]], positions, q)
        gather_shear(
            own[controls : controls + shears], shear_rows, shear_offsets[p], positions, shear
        )
        for i in range(3):
            axis[i] = force_on[k, i] / size
        for side in range(2):
            push = PROBE * modulus if side == 0 else -PROBE * modulus
            energy = wall_point(
                q, shear, axis, curvature[p], thickness[p], modulus, bulk, push, shears > 0, True,
                True, force, hessian, reach, face, work,
            )  # fmt: skip
            if not np.isfinite(energy):
                for i in range(441):
                    bent[k, i] = 0.0
                break
            share = 0.5 * size / push
            for i in range(21):
                for j in range(21):
                    bent[k, 21 * i + j] += share * hessian[i, j]
