# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over the points of a thick wall that carries given stresses; see `held.py`.

The stresses work on the eleven metric numbers of `thick_law_kernels`, and under a pin on y.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.assemble.kernels import (
    gather_derivatives,
    mirror,
    scatter_blocks,
    scatter_force,
)
from shell_deform.assemble.thick_kernels import (
    PointWork,
    Stamps,
    ThickElements,
    ThickMaterial,
    ThickPoints,
    add_point_stiffness,
    block_work,
    gather_shear,
    point_work,
    scatter_shear,
    set_hessian,
    set_point_response,
    set_pulled_back,
    wall_point,
)
from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bool,
    FixedFloatRows,
    Float,
    FloatRows,
    Floats,
    Ints,
    Longs,
    kernel,
)
from shell_deform.theory.thick_strain_kernels import director_numbers, metric_numbers


@kernel(
    Float, FloatRows, Floats, Floats, Floats, Bool, Bool, Bool, Floats, FloatRows, PointWork
)  # fmt: skip
def held_point(
    q: Any, shear: Any, axis: Any, held: Any, sheared: bool, pressed: bool, stiff: bool,
    force: Any, hessian: Any, work: Any,
) -> float:  # fmt: skip
    """Work of the stresses `held` (12,) on the metric numbers of a point, per middle area.

    `force` (21,) and, if `stiff`, `hessian` (21, 21 of 24): derivatives by (q, shear).
    """
    m, jac_m, turned, s, jac_s, between, inner, lk, solve, stress, tangent, follow = work[:12]
    director_numbers(q, shear, axis, m, jac_m, turned)
    metric_numbers(m, s, jac_s, between, inner)
    total = 0.0
    for k in range(12):
        stress[k] = held[k]
        if k < 11 or pressed:
            total += held[k] * s[k]
    set_pulled_back(stress, jac_s, jac_m, work[14], force)
    if stiff:
        tangent[:, :] = 0.0
        set_hessian(q, shear, axis, sheared, hessian, work)
    return total


@kernel(
    Float, Bool, ThickElements, ThickPoints, Stamps, FloatRows, FixedFloatRows, FloatRows, Longs,
    Longs, Ints, Longs, Ints, Floats,
    called_from_python=True,
)  # fmt: skip
def thick_held_tangent(
    stiff: bool, elements: Any, points: Any, stamps: Any, held: Any, positions: Any,
    gradient: Any, block_offsets: Any, block_start: Any, block_rows: Any, row_length: Any,
    indices: Any, data: Any,
) -> float:  # fmt: skip
    """Work [J] of the stresses `held` (p, 12) on the metric numbers; adds its gradient.

    If `stiff`, its second derivative goes into the CSR values `data` (zero before).
    """
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    stamp_of, axes = stamps[0], stamps[1]
    largest = 0
    for element in range(len(offsets) - 1):
        largest = max(largest, offsets[element + 1] - offsets[element])
    work, no_axis = point_work(), floats(3, 0.0)
    q, shear = float_rows(5, 3), floats(6, 0.0)
    force, hessian = floats(21, 0.0), float_rows(21, 24)
    stiffness = float_rows(largest if stiff else 0, 9 * largest)
    blocks = block_work(largest)
    total = 0.0
    for element in range(len(offsets) - 1):
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears, size = controls_of[element], shears_of[element], len(own)
        corners, sheared = own[:controls], own[controls : controls + shears]
        if stiff:
            stiffness[:size] = 0.0
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            value = values[row_offsets[p] : row_offsets[p + 1]]
            weight, g, first = weights[p], stamp_of[p], shear_offsets[p]
            gather_derivatives(corners, row, positions, q)
            gather_shear(sheared, shear_rows, first, positions, shear)
            total += weight * held_point(
                q, shear, axes[g] if g >= 0 else no_axis, held[p], shears > 0, g >= 0, stiff,
                force, hessian, work,
            )  # fmt: skip
            for i in range(21):
                force[i] *= weight
            scatter_force(corners, row, force, gradient)
            scatter_shear(sheared, shear_rows, first, 1.0, force, gradient)
            if not stiff:
                continue
            set_point_response(weight, row, hessian, blocks)
            add_point_stiffness(shears, row, value, shear_rows, first, hessian, blocks, stiffness)
        if stiff:
            scatter_blocks(own, stiffness, block_offsets[element], block_start, row_length, data)
    if stiff:
        mirror(block_rows, row_length, indices, data)
    return total


@kernel(
    Bool, ThickElements, ThickPoints, Stamps, ThickMaterial, FixedFloatRows, FloatRows,
    called_from_python=True,
)  # fmt: skip
def thick_stresses(
    elements: Any, points: Any, stamps: Any, material: Any, positions: Any, out: Any
) -> bool:  # fmt: skip
    """Elastic stresses (p, 12) by the metric numbers [N/m and its like]; False where none are."""
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    stamp_of, axes, heights, arms, dofs = stamps
    modulus, bulk, unit, compliance = material
    work, no_axis = point_work(), floats(3, 0.0)
    q, shear, face = float_rows(5, 3), floats(6, 0.0), floats(4, 0.0)
    force, reach, hessian = floats(21, 0.0), floats(21, 0.0), float_rows(21, 24)
    for element in range(len(offsets) - 1):
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears = controls_of[element], shears_of[element]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            g = stamp_of[p]
            gather_derivatives(
                own[:controls], rows[row_offsets[p] : row_offsets[p + 1]], positions, q
            )
            gather_shear(
                own[controls : controls + shears], shear_rows, shear_offsets[p], positions, shear
            )
            push = 0.0
            if g >= 0:
                push = unit * positions[dofs[g] // 3, dofs[g] % 3]
            energy = wall_point(
                q, shear, axes[g] if g >= 0 else no_axis, curvature[p], thickness[p], modulus,
                bulk, push, shears > 0, g >= 0, False, force, hessian, reach, face, work,
            )  # fmt: skip
            if not np.isfinite(energy):
                return False
            for k in range(12):
                out[p, k] = work[9][k]
    return True
