# SPDX-License-Identifier: Apache-2.0
"""What chosen points of a thick shell say: their states, and the equations of pin pressures."""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.assemble.kernels import gather_derivatives
from shell_deform.assemble.thick_kernels import (
    Stamps,
    ThickElements,
    ThickMaterial,
    ThickPoints,
    gather_shear,
    pin_height,
    point_work,
    set_reach,
    wall_point,
)
from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import Bool, FixedFloatRows, FloatRows, Longs, kernel


@kernel(
    Bool, ThickElements, ThickPoints, Stamps, ThickMaterial, FixedFloatRows, Longs, Longs,
    FloatRows,
    called_from_python=True,
)  # fmt: skip
def point_states(
    elements: Any, points: Any, stamps: Any, material: Any, positions: Any, chosen: Any,
    element_of: Any, out: Any,
) -> bool:  # fmt: skip
    """What the `chosen` points say, a row (17,) of `out` each; False where one has no equilibrium.

    Columns: lambda, kappa, height of the outer face along the pin's axis over where the pin is
    [m], squeeze compliance [m/Pa], pressure [Pa], strain energy per area [J/m^2], then the eleven
    metric numbers of `thick_law_kernels`.
    """
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    stamp_of, axes, heights, arms, dofs = stamps
    modulus, bulk, unit, compliance = material
    work, x, no_axis = point_work(), floats(3, 0.0), floats(3, 0.0)
    q, shear, face = float_rows(5, 3), floats(6, 0.0), floats(4, 0.0)
    force, reach, hessian = floats(21, 0.0), floats(21, 0.0), float_rows(21, 24)
    for k in range(len(chosen)):
        p, element = chosen[k], element_of[k]
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears, size = controls_of[element], shears_of[element], len(own)
        corners = own[:controls]
        row = rows[row_offsets[p] : row_offsets[p + 1]]
        g = stamp_of[p]
        gather_derivatives(corners, row, positions, q)
        gather_shear(
            own[controls : controls + shears], shear_rows, shear_offsets[p], positions, shear
        )
        push = 0.0
        if g >= 0:
            push = unit * positions[dofs[g] // 3, dofs[g] % 3]
        energy = wall_point(
            q, shear, axes[g] if g >= 0 else no_axis, curvature[p], thickness[p], modulus, bulk,
            push, shears > 0, g >= 0, False, force, hessian, reach, face, work,
        )  # fmt: skip
        if not np.isfinite(energy):
            return False
        height = 0.0
        if g >= 0:
            value = values[row_offsets[p] : row_offsets[p + 1]]
            height = face[2] - heights[g]
            height += pin_height(value, corners, positions, axes[g], arms[g], own[size - 1], x)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = face[0], face[1], height, face[3]
        out[k, 4], out[k, 5] = push, energy
        for i in range(11):
            out[k, 6 + i] = work[3][i]
    return True


@kernel(
    Bool, ThickElements, ThickPoints, Stamps, ThickMaterial, FixedFloatRows, Longs, Longs, Longs,
    FloatRows, FloatRows,
    called_from_python=True,
)  # fmt: skip
def cell_equations(
    elements: Any, points: Any, stamps: Any, material: Any, positions: Any, chosen: Any,
    element_of: Any, cell_of: Any, gaps: Any, reaches: Any,
) -> bool:  # fmt: skip
    """Add what the `chosen` pressed points say of pressures; False where one has no equilibrium.

    A row of `gaps` each: gap under the pin [m^3], minus its derivative by the pressure [m^3/Pa];
    `reaches`: its derivative by the unknowns of the element, in the element's order [m^2].
    """
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    stamp_of, axes, heights, arms, dofs = stamps
    modulus, bulk, unit, compliance = material
    work, x = point_work(), floats(3, 0.0)
    q, shear, face = float_rows(5, 3), floats(6, 0.0), floats(4, 0.0)
    force, reach, hessian = floats(21, 0.0), floats(21, 0.0), float_rows(21, 24)
    spread = floats(reaches.shape[1], 0.0)
    for k in range(len(chosen)):
        p, element, cell = chosen[k], element_of[k], cell_of[k]
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears, size = controls_of[element], shears_of[element], len(own)
        corners, g, first = own[:controls], stamp_of[p], shear_offsets[p]
        row = rows[row_offsets[p] : row_offsets[p + 1]]
        value = values[row_offsets[p] : row_offsets[p + 1]]
        gather_derivatives(corners, row, positions, q)
        gather_shear(own[controls : controls + shears], shear_rows, first, positions, shear)
        push = unit * positions[dofs[g] // 3, dofs[g] % 3]
        energy = wall_point(
            q, shear, axes[g], curvature[p], thickness[p], modulus, bulk, push, shears > 0, True,
            False, force, hessian, reach, face, work,
        )  # fmt: skip
        if not np.isfinite(energy):
            return False
        height = pin_height(value, corners, positions, axes[g], arms[g], own[size - 1], x)
        gaps[cell, 0] += weights[p] * (face[2] - heights[g] + height - compliance * push)
        gaps[cell, 1] += weights[p] * (face[3] + compliance)
        set_reach(row, value, shear_rows, first, shears, axes[g], arms[g], reach, spread)
        for i in range(3 * size):
            reaches[cell, i] += weights[p] * spread[i]
    return True
