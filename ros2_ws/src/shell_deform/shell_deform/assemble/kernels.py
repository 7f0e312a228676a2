# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over quadrature points: energy, gradient and tangent stiffness of the shell.

Points are sorted by element; the rows of a point list the coefficients of its element's nodes in
the element's order, columns (1, 2, 11, 12, 22) along the reference frame of the point.
"""

from __future__ import annotations

from typing import Any

from shell_deform.compiled.kernel_arrays import float_rows, floats, longs
from shell_deform.compiled.kernel_types import (
    FixedFloatRows,
    Float,
    FloatBlocks,
    FloatRows,
    Floats,
    Int,
    Ints,
    Longs,
    Void,
    kernel,
)
from shell_deform.theory.kernels import add_point_hessian, point_strains, point_stress

# Undeformed tangents, second derivatives and curvature, weights, membrane and bending stiffness.
WALL = (FloatBlocks, FloatBlocks, FloatRows, Floats, FloatBlocks, FloatBlocks)
# First node of each element, nodes, first point of each element, first row of each point, rows.
POINTS = (Longs, Longs, Longs, Longs, FloatRows)


@kernel(Void, Longs, FloatRows, FixedFloatRows, FloatRows)
def gather_derivatives(nodes: Any, rows: Any, positions: Any, q: Any) -> None:
    """Derivative vectors q (5, 3) at a point from control positions (n, 3)."""
    for i in range(3):
        # Sums in registers: stores into q after every node would wait for each other.
        q_0, q_1, q_2, q_3, q_4 = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(len(nodes)):
            x = positions[nodes[k], i]
            q_0 += rows[k, 0] * x
            q_1 += rows[k, 1] * x
            q_2 += rows[k, 2] * x
            q_3 += rows[k, 3] * x
            q_4 += rows[k, 4] * x
        q[0, i], q[1, i], q[2, i], q[3, i], q[4, i] = q_0, q_1, q_2, q_3, q_4


@kernel(Void, Longs, Floats, FixedFloatRows, Floats)
def gather_place(nodes: Any, values: Any, positions: Any, x: Any) -> None:
    """Place x (3,) of a point from control positions (n, 3)."""
    for i in range(3):
        total = 0.0
        for k in range(len(nodes)):
            total += values[k] * positions[nodes[k], i]
        x[i] = total


@kernel(Void, Longs, FloatRows, Floats, FloatRows)
def scatter_force(nodes: Any, rows: Any, force: Any, gradient: Any) -> None:
    """Add the force (15,) that works on the derivative vectors of a point to `gradient` (n, 3)."""
    for i in range(3):
        f_0, f_1, f_2, f_3, f_4 = force[i], force[3 + i], force[6 + i], force[9 + i], force[12 + i]
        for k in range(len(nodes)):
            gradient[nodes[k], i] += (
                rows[k, 0] * f_0
                + rows[k, 1] * f_1
                + rows[k, 2] * f_2
                + rows[k, 3] * f_3
                + rows[k, 4] * f_4
            )


@kernel(Void, Float, Floats, FloatRows, Floats)
def point_force(weight: float, stress: Any, jac: Any, force: Any) -> None:
    """Force (15,) on the derivative vectors of a point with the area `weight`."""
    for d in range(15):
        value = 0.0
        for s in range(6):
            value += jac[s, d] * stress[s]
        force[d] = weight * value


@kernel(Float, Int, *POINTS, *WALL, FixedFloatRows, FloatRows, called_from_python=True)
def shell_gradient(
    theory: int,
    node_offsets: Any,
    nodes: Any,
    point_offsets: Any,
    row_offsets: Any,
    rows: Any,
    tangents: Any,
    second: Any,
    curvature: Any,
    weights: Any,
    membrane: Any,
    bending: Any,
    positions: Any,
    gradient: Any,
) -> float:
    """Strain energy [J] at control positions; adds its gradient [N] to `gradient` (n, 3)."""
    q, strain, stress = float_rows(5, 3), floats(6, 0.0), floats(6, 0.0)
    jac, work, force = float_rows(6, 15), float_rows(6, 3), floats(15, 0.0)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            point_strains(theory, q, tangents[p], second[p], curvature[p], strain, jac, work)
            total += weights[p] * point_stress(strain, membrane[p], bending[p], stress)
            point_force(weights[p], stress, jac, force)
            scatter_force(own, row, force, gradient)
    return total


@kernel(Void, Int, *POINTS, *WALL, FixedFloatRows, Floats, called_from_python=True)
def point_energies(
    theory: int,
    node_offsets: Any,
    nodes: Any,
    point_offsets: Any,
    row_offsets: Any,
    rows: Any,
    tangents: Any,
    second: Any,
    curvature: Any,
    weights: Any,
    membrane: Any,
    bending: Any,
    positions: Any,
    energies: Any,
) -> None:
    """Strain energy [J] of the area of every point, at control positions."""
    q, strain, stress = float_rows(5, 3), floats(6, 0.0), floats(6, 0.0)
    jac, work = float_rows(6, 15), float_rows(6, 3)
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            point_strains(theory, q, tangents[p], second[p], curvature[p], strain, jac, work)
            energies[p] = weights[p] * point_stress(strain, membrane[p], bending[p], stress)


@kernel(Void, Float, FloatRows, FloatRows, FloatRows, FloatRows, FloatRows)
def add_strain_stiffness(
    weight: float, jac: Any, membrane: Any, bending: Any, weighted: Any, h: Any
) -> None:
    """Add weight J^T D J to h (15, 15): what the strains of a point stiffen."""
    for s in range(3):
        m_0, m_1, m_2 = weight * membrane[s, 0], weight * membrane[s, 1], weight * membrane[s, 2]
        for d in range(6):
            weighted[s, d] = m_0 * jac[0, d] + m_1 * jac[1, d] + m_2 * jac[2, d]
        b_0, b_1, b_2 = weight * bending[s, 0], weight * bending[s, 1], weight * bending[s, 2]
        for d in range(15):
            weighted[3 + s, d] = b_0 * jac[3, d] + b_1 * jac[4, d] + b_2 * jac[5, d]
    for d in range(6):
        j_0, j_1, j_2 = jac[0, d], jac[1, d], jac[2, d]
        for e in range(6):
            h[d, e] += j_0 * weighted[0, e] + j_1 * weighted[1, e] + j_2 * weighted[2, e]
    for d in range(15):
        j_0, j_1, j_2 = jac[3, d], jac[4, d], jac[5, d]
        for e in range(15):
            h[d, e] += j_0 * weighted[3, e] + j_1 * weighted[4, e] + j_2 * weighted[5, e]


@kernel(Void, FloatRows, FloatRows, FloatRows, Floats, FloatRows)
def respond(row: Any, hessian: Any, ordered: Any, mixed: Any, response: Any) -> None:
    """Forces on the derivative vectors per motion of the nodes, into response[:5] (., 9 nodes).

    response[d, 9 m + 3 i + j] is component i of the force on vector d per motion j of node m.
    """
    for e in range(5):
        for d in range(5):
            for i in range(3):
                for j in range(3):
                    ordered[e, 9 * d + 3 * i + j] = hessian[3 * d + i, 3 * e + j]
    h_0, h_1, h_2, h_3, h_4 = ordered[0], ordered[1], ordered[2], ordered[3], ordered[4]
    for m in range(len(row)):
        r_0, r_1, r_2, r_3, r_4 = row[m, 0], row[m, 1], row[m, 2], row[m, 3], row[m, 4]
        for x in range(45):
            mixed[x] = r_0 * h_0[x] + r_1 * h_1[x] + r_2 * h_2[x] + r_3 * h_3[x] + r_4 * h_4[x]
        for d in range(5):
            for x in range(9):
                response[d, 9 * m + x] = mixed[9 * d + x]


@kernel(Void, Floats, Float, FloatRows, Int, Int, Floats)
def add_rows(row: Any, value: float, response: Any, start: int, stop: int, target: Any) -> None:
    """Add columns start:stop of `response` (6, .) times the coefficients of a node to `target`."""
    # Counted from zero on contiguous arrays of one dimension: others do not become vector code.
    t_0, t_1, t_2 = response[0][start:stop], response[1][start:stop], response[2][start:stop]
    t_3, t_4, t_5 = response[3][start:stop], response[4][start:stop], response[5][start:stop]
    into = target[start:stop]
    r_0, r_1, r_2, r_3, r_4 = row[0], row[1], row[2], row[3], row[4]
    for c in range(len(into)):
        into[c] += (
            r_0 * t_0[c]
            + r_1 * t_1[c]
            + r_2 * t_2[c]
            + r_3 * t_3[c]
            + r_4 * t_4[c]
            + value * t_5[c]
        )


@kernel(Void, Floats, Int, Float, Float, Float)
def _add_cross_block(target: Any, at: int, u_0: float, u_1: float, u_2: float) -> None:
    """Add the matrix (3, 3) of v x u, v its argument, to target[at:at + 9]."""
    target[at + 1] += u_2
    target[at + 2] -= u_1
    target[at + 3] -= u_2
    target[at + 5] += u_0
    target[at + 6] += u_1
    target[at + 7] -= u_0


@kernel(Void, Float, FloatRows, Floats, Floats, FloatRows, FloatRows)
def add_gas_response(factor: float, row: Any, values: Any, x: Any, q: Any, response: Any) -> None:
    """Add `factor` times the second derivative of x . (a_1 x a_2) to the response of a point.

    Row 5 of `response` is set to the force on x itself.
    """
    response[5, : 9 * len(row)] = 0.0
    a, b = q[0], q[1]
    for m in range(len(row)):
        v, r, s = factor * values[m], factor * row[m, 0], factor * row[m, 1]
        _add_cross_block(
            response[5], 9 * m, r * b[0] - s * a[0], r * b[1] - s * a[1], r * b[2] - s * a[2]
        )
        _add_cross_block(
            response[0], 9 * m, s * x[0] - v * b[0], s * x[1] - v * b[1], s * x[2] - v * b[2]
        )
        _add_cross_block(
            response[1], 9 * m, v * a[0] - r * x[0], v * a[1] - r * x[1], v * a[2] - r * x[2]
        )


@kernel(Void, Ints, Longs, Ints, Floats)
def mirror(block_rows: Any, row_length: Any, indices: Any, data: Any) -> None:
    """Copy the 3 x 3 blocks above the diagonal of the CSR values below it.

    Row v of blocks starts at block_rows[v]. Its blocks below the diagonal come in the order in
    which the rows above list it, so one place per row suffices to find them.
    """
    at = longs(len(row_length), 0)
    for v in range(len(row_length)):
        length = row_length[v]
        for q in range(block_rows[v], block_rows[v] + length, 3):
            w = indices[q] // 3
            if w == v:
                at[v] = q + 3
            elif w < v:
                for i in range(3):
                    for j in range(3):
                        data[q + i * length + j] = data[at[w] + j * row_length[w] + i]
                at[w] += 3


@kernel(Void, Longs, FloatRows, Int, Longs, Longs, Floats)
def scatter_blocks(
    own: Any, stiffness: Any, start: int, block_start: Any, row_length: Any, data: Any
) -> None:
    """Add an element's blocks on and above the diagonal to the CSR values."""
    size = len(own)
    for k in range(size):
        for m in range(k, size):
            source = stiffness[k, 9 * m : 9 * m + 9]
            if own[k] <= own[m]:
                at, length = block_start[start + k * size + m], row_length[own[k]]
                for i in range(3):
                    for j in range(3):
                        data[at + i * length + j] += source[3 * i + j]
            else:
                at, length = block_start[start + m * size + k], row_length[own[m]]
                for i in range(3):
                    for j in range(3):
                        data[at + i * length + j] += source[3 * j + i]


@kernel(
    Float, Int, Float, *POINTS, Floats, *WALL, FixedFloatRows, FloatRows, Longs, Longs, Ints,
    Longs, Ints, Floats,
    called_from_python=True,
)  # fmt: skip
def shell_tangent(
    theory: int,
    pressure: float,
    node_offsets: Any,
    nodes: Any,
    point_offsets: Any,
    row_offsets: Any,
    rows: Any,
    values: Any,
    tangents: Any,
    second: Any,
    curvature: Any,
    weights: Any,
    membrane: Any,
    bending: Any,
    positions: Any,
    gradient: Any,
    block_offsets: Any,
    block_start: Any,
    block_rows: Any,
    row_length: Any,
    indices: Any,
    data: Any,
) -> float:
    """`shell_gradient`, and the tangent stiffness [N/m] into the CSR values `data`, zero before.

    Minus `pressure` times the second derivative of the volume is part of the stiffness. Block
    (k, l) of an element starts at block_start[block_offsets[element] + k * size + l]; the rows of
    control point v start at block_rows[v] and are row_length[v] values long.
    """
    q, x, strain, stress = float_rows(5, 3), floats(3, 0.0), floats(6, 0.0), floats(6, 0.0)
    jac, work, blocks = float_rows(6, 15), float_rows(6, 3), float_rows(7, 3)
    weighted, hessian, force = float_rows(6, 15), float_rows(15, 15), floats(15, 0.0)
    largest = 0
    for element in range(len(node_offsets) - 1):
        largest = max(largest, node_offsets[element + 1] - node_offsets[element])
    stiffness = float_rows(largest, 9 * largest)
    response = float_rows(6, 9 * largest)
    ordered, mixed = float_rows(5, 45), floats(45, 0.0)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        size = len(own)
        stiffness[:size] = 0.0
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            weight = weights[p]
            gather_derivatives(own, row, positions, q)
            point_strains(theory, q, tangents[p], second[p], curvature[p], strain, jac, work)
            total += weight * point_stress(strain, membrane[p], bending[p], stress)
            point_force(weight, stress, jac, force)
            scatter_force(own, row, force, gradient)
            for s in range(6):
                stress[s] *= weight
            hessian[:, :] = 0.0
            add_point_hessian(theory, q, stress, work, blocks, hessian)
            add_strain_stiffness(weight, jac, membrane[p], bending[p], weighted, hessian)
            respond(row, hessian, ordered, mixed, response)
            value = values[row_offsets[p] : row_offsets[p + 1]]
            if pressure != 0.0:
                gather_place(own, value, positions, x)
                add_gas_response(-pressure * weight / 3.0, row, value, x, q, response)
            for k in range(size):
                add_rows(row[k], value[k], response, 9 * k, 9 * size, stiffness[k])
        scatter_blocks(own, stiffness, block_offsets[element], block_start, row_length, data)
    mirror(block_rows, row_length, indices, data)
    return total


@kernel(Float, *POINTS, Floats, Floats, FixedFloatRows, FloatRows, called_from_python=True)
def volume_gradient(
    node_offsets: Any,
    nodes: Any,
    point_offsets: Any,
    row_offsets: Any,
    rows: Any,
    values: Any,
    weights: Any,
    positions: Any,
    gradient: Any,
) -> float:
    """Enclosed volume [m^3] of control positions; adds its gradient [m^2] to `gradient`."""
    a, b, x = floats(3, 0.0), floats(3, 0.0), floats(3, 0.0)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            value = values[row_offsets[p] : row_offsets[p + 1]]
            for i in range(3):
                a_i, b_i, x_i = 0.0, 0.0, 0.0
                for k in range(len(own)):
                    place = positions[own[k], i]
                    a_i += row[k, 0] * place
                    b_i += row[k, 1] * place
                    x_i += value[k] * place
                a[i], b[i], x[i] = a_i, b_i, x_i
            w = weights[p] / 3.0
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                on_x = w * (a[j] * b[m] - a[m] * b[j])
                on_a = w * (b[j] * x[m] - b[m] * x[j])
                on_b = w * (x[j] * a[m] - x[m] * a[j])
                for k in range(len(own)):
                    gradient[own[k], i] += value[k] * on_x + row[k, 0] * on_a + row[k, 1] * on_b
                total += x[i] * on_x
    return total
