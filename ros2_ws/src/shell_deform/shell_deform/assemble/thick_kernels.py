# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over the quadrature points of a thick shell: energy, gradient, tangent stiffness.

The unknowns are rows of three: control points [m], then shear nodes (two components in the
tangent plane of a control vertex [m], the third idle), then pins (travel and two tilts [m]), then
contact pressures, three to a row, which no equation of this matrix contains: each is eliminated
from the element that it presses on. An element lists its control points, then its shear nodes,
then the pins on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from shell_deform.assemble.kernels import (
    add_gas_response,
    add_rows,
    gather_derivatives,
    gather_place,
    mirror,
    respond,
    scatter_blocks,
    scatter_force,
)
from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bool,
    FixedFloatRows,
    Float,
    FloatRows,
    Floats,
    Int,
    Ints,
    Longs,
    Void,
    kernel,
)
from shell_deform.theory.thick_law_kernels import (
    WORK_SHAPE,
    eliminate_thickness,
    solve_thickness,
    wall_stress,
)
from shell_deform.theory.thick_strain_kernels import (
    add_director_hessian,
    add_metric_hessian,
    add_transposed_product,
    director_numbers,
    metric_numbers,
)

PointWork = types.Tuple(
    (
        Floats, FloatRows, FloatRows, Floats, FloatRows, FloatRows, FloatRows, Floats, FloatRows,
        Floats, FloatRows, FloatRows, FloatRows, FloatRows, Floats,
    )
)  # fmt: skip

BlockWork = types.Tuple((FloatRows, FloatRows, FloatRows, Floats))

ThickElements = types.Tuple((Longs, Longs, Longs, Longs, Longs, Longs))
"""First node of each element, nodes, control points and shear nodes of each, first point, row."""

ThickPoints = types.Tuple((FloatRows, Floats, Floats, FloatRows, Floats, Longs, FloatRows))
"""Rows, values, weights, rest curvature K, thickness, first shear row, shear rows (., 12)."""

Stamps = types.Tuple((Longs, FloatRows, Floats, FloatRows, Longs))
"""Stamp point of each point (or -1); of each: axis, rest height, arms of tilt, pressure dof."""

ThickMaterial = types.Tuple((Float, Float, Float, Float))
"""Shear modulus [Pa], bulk modulus [Pa], pressure per unknown [Pa/m], compliance added [m/Pa]."""


@kernel(PointWork)
def point_work() -> Any:
    """Work space of `wall_point`."""
    return (
        floats(12, 0.0), float_rows(12, 24), float_rows(10, 3), floats(12, 0.0),
        float_rows(12, 24), float_rows(9, 12), float_rows(9, 24), floats(2, 0.0),
        float_rows(*WORK_SHAPE), floats(12, 0.0), float_rows(14, 14), float_rows(2, 12),
        float_rows(12, 24), float_rows(12, 24), floats(12, 0.0),
    )  # fmt: skip


@kernel(Void, FloatRows, Floats, Floats, Bool, FloatRows, PointWork)
def set_hessian(q: Any, shear: Any, axis: Any, sheared: bool, hessian: Any, work: Any) -> None:
    """The Hessian of `wall_point`: J^T D J and the curvature of the strains themselves."""
    m, jac_m, turned, s, jac_s, between, inner, lk, solve, stress, tangent, follow = work[:12]
    hess_m, mixed, by_m = work[12], work[13], work[14]
    mixed[:, :] = 0.0
    hess_m[:, :] = 0.0
    add_transposed_product(tangent, jac_s, 12, mixed)
    add_transposed_product(jac_s, mixed, 12, hess_m)
    add_metric_hessian(m, stress, between, inner, sheared, hess_m)
    mixed[:, :] = 0.0
    hessian[:, :] = 0.0
    add_transposed_product(hess_m, jac_m, 12, mixed)
    add_transposed_product(jac_m, mixed, 21, hessian)
    add_director_hessian(q, shear, axis, by_m, jac_m, turned, hessian)


@kernel(Void, Floats, FloatRows, FloatRows, Floats, Floats)
def set_pulled_back(by_s: Any, jac_s: Any, jac_m: Any, by_m: Any, by_y: Any) -> None:
    """by_m (12,) and by_y (21,) = by_s jac_s jac_m of a derivative by_s (12,) by the strains."""
    for j in range(12):
        by_m[j] = 0.0
    for k in range(12):
        factor, source = by_s[k], jac_s[k]
        for j in range(12):
            by_m[j] += factor * source[j]
    for j in range(21):
        by_y[j] = 0.0
    for k in range(12):
        factor, source = by_m[k], jac_m[k]
        if factor != 0.0:
            for j in range(21):
                by_y[j] += factor * source[j]


@kernel(
    Float, FloatRows, Floats, Floats, Floats, Float, Float, Float, Float, Bool, Bool, Bool,
    Floats, FloatRows, Floats, Floats, PointWork,
)  # fmt: skip
def wall_point(
    q: Any, shear: Any, axis: Any, curvature: Any, h: float, modulus: float, bulk: float,
    push: float, sheared: bool, pressed: bool, stiff: bool, force: Any, hessian: Any, reach: Any,
    face: Any, work: Any,
) -> float:  # fmt: skip
    """Strain energy of a point per middle area; NaN where its wall has no equilibrium.

    `force` (21,) and, if `stiff`, `hessian` (21, 21 of 24): derivatives by (q, shear). `pressed`:
    under the pressure `push` of a pin along `axis`; `reach` (21,) is then the derivative of the
    outer face's height over the middle surface. `face`: lambda, kappa, that height [m], and the
    squeeze compliance of the point [m/Pa].
    """
    m, jac_m, turned, s, jac_s, between, inner, lk, solve, stress, tangent, follow = work[:12]
    mixed, by_m = work[13], work[14]
    director_numbers(q, shear, axis, m, jac_m, turned)
    metric_numbers(m, s, jac_s, between, inner)
    if not solve_thickness(s, curvature, h, modulus, bulk, push, s[11], lk, solve):
        return np.nan
    curved = pressed or stiff
    energy = wall_stress(sheared, curved, s, h, push, s[11], lk, stress, tangent, solve)
    top = h * (0.5 * lk[0] + 0.25 * lk[1])
    face[0], face[1], face[2], face[3] = lk[0], lk[1], s[11] * top, 0.0
    set_pulled_back(stress, jac_s, jac_m, by_m, force)
    if curved:
        eliminate_thickness(12, tangent, follow)
    if pressed:
        p, c, r = tangent[12, 12], tangent[12, 13], tangent[13, 13]
        half, quarter = 0.5 * h, 0.25 * h
        face[3] = s[11] ** 2 * (
            (r * half * half - 2.0 * c * half * quarter + p * quarter * quarter) / (p * r - c * c)
        )
        by_s = mixed[0]
        for k in range(12):
            by_s[k] = -s[11] * (half * follow[0, k] + quarter * follow[1, k])
        by_s[11] += top
        set_pulled_back(by_s, jac_s, jac_m, mixed[1], reach)
    if stiff:
        set_hessian(q, shear, axis, sheared, hessian, work)
    return energy - push * s[11] * top


@kernel(Void, Longs, FloatRows, Int, FixedFloatRows, Floats)
def gather_shear(nodes: Any, shear_rows: Any, first: int, positions: Any, shear: Any) -> None:
    """Shear and its derivatives (6,) at a point from the shear nodes `nodes`."""
    for i in range(6):
        shear[i] = 0.0
    for k in range(len(nodes)):
        row = shear_rows[first + k]
        w_1, w_2 = positions[nodes[k], 0], positions[nodes[k], 1]
        for i in range(6):
            shear[i] += row[2 * i] * w_1 + row[2 * i + 1] * w_2


@kernel(Void, Longs, FloatRows, Int, Float, Floats, FloatRows)
def scatter_shear(
    nodes: Any, shear_rows: Any, first: int, weight: float, force: Any, gradient: Any
) -> None:
    """Add the force (21,) on the shear of a point, its last six entries, to `gradient`."""
    for k in range(len(nodes)):
        row = shear_rows[first + k]
        for a in range(2):
            value = 0.0
            for i in range(6):
                value += row[2 * i + a] * force[15 + i]
            gradient[nodes[k], a] += weight * value


@kernel(Void, Int, Int, FloatRows, Int, FloatRows, FloatRows, FloatRows)
def respond_to_shear(
    controls: int, shears: int, shear_rows: Any, first: int, hessian: Any, forces: Any,
    response: Any,
) -> None:  # fmt: skip
    """Forces per component of every shear node, after those of `respond` in the same order.

    Row 2 k + a of `forces` (., 24): all forces (21,) of a point per component a of node k.
    """
    h_0, h_1, h_2 = hessian[15], hessian[16], hessian[17]
    h_3, h_4, h_5 = hessian[18], hessian[19], hessian[20]
    for k in range(shears):
        row, at = shear_rows[first + k], 9 * (controls + k)
        for a in range(2):
            r_0, r_1, r_2, r_3 = row[a], row[2 + a], row[4 + a], row[6 + a]
            r_4, r_5 = row[8 + a], row[10 + a]
            force = forces[2 * k + a]
            for j in range(24):
                force[j] = (
                    r_0 * h_0[j] + r_1 * h_1[j] + r_2 * h_2[j]
                    + r_3 * h_3[j] + r_4 * h_4[j] + r_5 * h_5[j]
                )  # fmt: skip
            for d in range(5):
                for i in range(3):
                    response[d, at + 3 * i + a] = force[3 * d + i]
        for d in range(5):
            for i in range(3):
                response[d, at + 3 * i + 2] = 0.0
        # Nothing of the gas, and nothing of an element that had more control points.
        response[5, at : at + 9] = 0.0


@kernel(Void, Int, Int, FloatRows, Int, FloatRows, FloatRows)
def add_shear_stiffness(
    controls: int, shears: int, shear_rows: Any, first: int, forces: Any, stiffness: Any
) -> None:
    """Add a point's blocks of shear nodes with each other, on and above the diagonal."""
    for k in range(shears):
        row, out = shear_rows[first + k], stiffness[controls + k]
        for m in range(k, shears):
            f, g, at = forces[2 * m], forces[2 * m + 1], 9 * (controls + m)
            for i in range(2):
                value_0, value_1 = 0.0, 0.0
                for j in range(6):
                    value_0 += row[2 * j + i] * f[15 + j]
                    value_1 += row[2 * j + i] * g[15 + j]
                out[at + 3 * i] += value_0
                out[at + 3 * i + 1] += value_1


@kernel(BlockWork, Int)
def block_work(largest: int) -> Any:
    """Work space of `set_point_response` and `add_point_stiffness` for so many nodes."""
    return (
        float_rows(6, 9 * largest), float_rows(2 * largest, 24), float_rows(5, 45),
        floats(45, 0.0),
    )  # fmt: skip


@kernel(Void, Float, FloatRows, FloatRows, BlockWork)
def set_point_response(weight: float, row: Any, hessian: Any, blocks: Any) -> None:
    """Forces on a point of area `weight` per motion of its control points; scales `hessian`."""
    response, forces, ordered, mixed = blocks
    for i in range(21):
        for j in range(21):
            hessian[i, j] *= weight
    respond(row, hessian, ordered, mixed, response)


@kernel(
    Void, Int, FloatRows, Floats, FloatRows, Int, FloatRows, BlockWork, FloatRows
)  # fmt: skip
def add_point_stiffness(
    shears: int, row: Any, value: Any, shear_rows: Any, first: int, hessian: Any, blocks: Any,
    stiffness: Any,
) -> None:  # fmt: skip
    """Add a point's blocks of control points and shear nodes, after `set_point_response`."""
    response, forces, ordered, mixed = blocks
    controls = len(row)
    if shears > 0:
        respond_to_shear(controls, shears, shear_rows, first, hessian, forces, response)
        add_shear_stiffness(controls, shears, shear_rows, first, forces, stiffness)
    for k in range(controls):
        add_rows(row[k], value[k], response, 9 * k, 9 * (controls + shears), stiffness[k])


@kernel(Float, Floats, Longs, FixedFloatRows, Floats, Floats, Int, Floats)
def pin_height(
    value: Any, corners: Any, positions: Any, axis: Any, arm: Any, pin: int, x: Any
) -> float:
    """Height of a pressed point of the middle surface along the pin's axis, over the pin [m]."""
    gather_place(corners, value, positions, x)
    height = positions[pin, 0]
    for i in range(3):
        height += axis[i] * x[i]
    for i in range(2):
        height += arm[i] * positions[pin, 1 + i]
    return height


@kernel(Void, FloatRows, Floats, FloatRows, Int, Int, Floats, Floats, Floats, Floats)
def set_reach(
    rows: Any, values: Any, shear_rows: Any, first: int, shears: int, axis: Any, arms: Any,
    reach: Any, spread: Any,
) -> None:  # fmt: skip
    """Derivative of the height of a pressed point by the unknowns of its element: `spread`."""
    controls = len(rows)
    for k in range(controls):
        for i in range(3):
            spread[3 * k + i] = (
                values[k] * axis[i]
                + rows[k, 0] * reach[i]
                + rows[k, 1] * reach[3 + i]
                + rows[k, 2] * reach[6 + i]
                + rows[k, 3] * reach[9 + i]
                + rows[k, 4] * reach[12 + i]
            )
    for k in range(shears):
        row, at = shear_rows[first + k], 3 * (controls + k)
        for a in range(2):
            value = 0.0
            for i in range(6):
                value += row[2 * i + a] * reach[15 + i]
            spread[at + a] = value
        spread[at + 2] = 0.0
    at = 3 * (controls + shears)
    spread[at], spread[at + 1], spread[at + 2] = 1.0, arms[0], arms[1]


@kernel(Void, Floats, Int, Float, FloatRows)
def _add_reach_stiffness(spread: Any, nodes: int, factor: float, stiffness: Any) -> None:
    """Add factor times spread spread^T to the blocks on and above the diagonal."""
    for k in range(nodes):
        out = stiffness[k]
        for i in range(3):
            f = factor * spread[3 * k + i]
            for m in range(k, nodes):
                for j in range(3):
                    out[9 * m + 3 * i + j] += f * spread[3 * m + j]


@kernel(
    Float, Bool, Float, ThickElements, ThickPoints, Stamps, ThickMaterial, FixedFloatRows,
    FloatRows, Longs, Longs, Ints, Longs, Ints, Floats,
    called_from_python=True,
)  # fmt: skip
def thick_tangent(
    stiff: bool, pressure: float, elements: Any, points: Any, stamps: Any, material: Any,
    positions: Any, gradient: Any, block_offsets: Any, block_start: Any, block_rows: Any,
    row_length: Any, indices: Any, data: Any,
) -> float:  # fmt: skip
    """Strain energy [J] of the unknowns `positions`; adds its gradient to `gradient`.

    Where a pin presses, the residual of the pressure's own equation is eliminated into both. If
    `stiff`, the tangent stiffness goes into the CSR values `data` (zero before), with minus
    `pressure` times the second derivative of the volume. NaN where a point has no equilibrium.
    """
    offsets, nodes, controls_of, shears_of, point_offsets, row_offsets = elements
    rows, values, weights, curvature, thickness, shear_offsets, shear_rows = points
    stamp_of, axes, heights, arms, dofs = stamps
    modulus, bulk, unit, compliance = material
    largest = 0
    for element in range(len(offsets) - 1):
        largest = max(largest, offsets[element + 1] - offsets[element])
    work, x, no_axis = point_work(), floats(3, 0.0), floats(3, 0.0)
    q, shear, face = float_rows(5, 3), floats(6, 0.0), floats(4, 0.0)
    force, reach, hessian = floats(21, 0.0), floats(21, 0.0), float_rows(21, 24)
    stiffness = float_rows(largest if stiff else 0, 9 * largest)
    blocks = block_work(largest)
    spread, spreads = floats(3 * largest, 0.0), floats(3 * largest, 0.0)
    total = 0.0
    for element in range(len(offsets) - 1):
        own = nodes[offsets[element] : offsets[element + 1]]
        controls, shears, size = controls_of[element], shears_of[element], len(own)
        corners, sheared = own[:controls], own[controls : controls + shears]
        missing, soft = 0.0, 0.0
        spreads[: 3 * size] = 0.0
        if stiff:
            stiffness[:size] = 0.0
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            value = values[row_offsets[p] : row_offsets[p + 1]]
            weight, g, first = weights[p], stamp_of[p], shear_offsets[p]
            gather_derivatives(corners, row, positions, q)
            gather_shear(sheared, shear_rows, first, positions, shear)
            push = 0.0
            if g >= 0:
                push = unit * positions[dofs[g] // 3, dofs[g] % 3]
            energy = wall_point(
                q, shear, axes[g] if g >= 0 else no_axis, curvature[p], thickness[p], modulus,
                bulk, push, shears > 0, g >= 0, stiff, force, hessian, reach, face, work,
            )  # fmt: skip
            if not np.isfinite(energy):
                return np.nan
            total += weight * energy
            if g >= 0:
                pin = own[size - 1]
                height = face[2] - heights[g]
                height += pin_height(value, corners, positions, axes[g], arms[g], pin, x)
                missing += weight * (height - compliance * push)
                soft += weight * (face[3] + compliance)
                set_reach(row, value, shear_rows, first, shears, axes[g], arms[g], reach, spread)
                for k in range(3 * size):
                    spreads[k] += weight * spread[k]
                for i in range(3):
                    for k in range(controls):
                        gradient[own[k], i] += weight * push * axes[g, i] * value[k]
                gradient[pin, 0] += weight * push
                for i in range(2):
                    gradient[pin, 1 + i] += weight * push * arms[g, i]
            for i in range(21):
                force[i] *= weight
            scatter_force(corners, row, force, gradient)
            scatter_shear(sheared, shear_rows, first, 1.0, force, gradient)
            if not stiff:
                continue
            set_point_response(weight, row, hessian, blocks)
            if pressure != 0.0:
                gather_place(corners, value, positions, x)
                add_gas_response(-pressure * weight / 3.0, row, value, x, q, blocks[0])
            add_point_stiffness(shears, row, value, shear_rows, first, hessian, blocks, stiffness)
        if soft > 0.0:
            # One pressure for all pressed points of the element, eliminated from its own equation.
            for k in range(size):
                for i in range(3):
                    gradient[own[k], i] += missing / soft * spreads[3 * k + i]
            if stiff:
                _add_reach_stiffness(spreads, size, 1.0 / soft, stiffness)
        if stiff:
            scatter_blocks(own, stiffness, block_offsets[element], block_start, row_length, data)
    if stiff:
        mirror(block_rows, row_length, indices, data)
    return total
