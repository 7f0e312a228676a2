# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over the points of a thin wall that carries given stresses: force and stiffness.

The stresses are what is held of a wall's past, see `held.py`. They work on the strains of the
theory as a dead load works on displacements.
"""

from __future__ import annotations

from typing import Any

from shell_deform.assemble.kernels import (
    POINTS,
    add_rows,
    gather_derivatives,
    mirror,
    point_force,
    respond,
    scatter_blocks,
    scatter_force,
)
from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bool,
    FixedFloatRows,
    Float,
    FloatBlocks,
    FloatRows,
    Floats,
    Int,
    Ints,
    Longs,
    kernel,
)
from shell_deform.theory.kernels import add_point_hessian, point_strains


@kernel(
    Float, Int, Bool, *POINTS, Floats, FloatBlocks, FloatBlocks, FloatRows, Floats, FloatRows,
    FixedFloatRows, FloatRows, Longs, Longs, Ints, Longs, Ints, Floats,
    called_from_python=True,
)  # fmt: skip
def held_tangent(
    theory: int, stiff: bool, node_offsets: Any, nodes: Any, point_offsets: Any, row_offsets: Any,
    rows: Any, values: Any, tangents: Any, second: Any, curvature: Any, weights: Any, held: Any,
    positions: Any, gradient: Any, block_offsets: Any, block_start: Any, block_rows: Any,
    row_length: Any, indices: Any, data: Any,
) -> float:  # fmt: skip
    """Work [J] of the stress resultants `held` (p, 6) on the strains; adds its gradient.

    If `stiff`, its second derivative goes into the CSR values `data` (zero before).
    """
    q, strain, stress = float_rows(5, 3), floats(6, 0.0), floats(6, 0.0)
    jac, work, blocks = float_rows(6, 15), float_rows(6, 3), float_rows(7, 3)
    hessian, force = float_rows(15, 15), floats(15, 0.0)
    largest = 0
    for element in range(len(node_offsets) - 1):
        largest = max(largest, node_offsets[element + 1] - node_offsets[element])
    stiffness = float_rows(largest if stiff else 0, 9 * largest)
    response = float_rows(6, 9 * largest)
    response[5, :] = 0.0
    ordered, mixed = float_rows(5, 45), floats(45, 0.0)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        size = len(own)
        if stiff:
            stiffness[:size] = 0.0
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            point_strains(theory, q, tangents[p], second[p], curvature[p], strain, jac, work)
            for s in range(6):
                stress[s] = weights[p] * held[p, s]
                total += stress[s] * strain[s]
            point_force(1.0, stress, jac, force)
            scatter_force(own, row, force, gradient)
            if not stiff:
                continue
            hessian[:, :] = 0.0
            add_point_hessian(theory, q, stress, work, blocks, hessian)
            respond(row, hessian, ordered, mixed, response)
            value = values[row_offsets[p] : row_offsets[p + 1]]
            for k in range(size):
                add_rows(row[k], value[k], response, 9 * k, 9 * size, stiffness[k])
        if stiff:
            scatter_blocks(own, stiffness, block_offsets[element], block_start, row_length, data)
    if stiff:
        mirror(block_rows, row_length, indices, data)
    return total
