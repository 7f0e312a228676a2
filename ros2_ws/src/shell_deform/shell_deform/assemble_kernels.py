"""Compiled loops over quadrature points: energy, gradient and tangent stiffness of the shell.

Points are sorted by element; the rows of a point list the coefficients of its element's nodes in
the element's order, columns (1, 2, 11, 12, 22) along the reference frame of the point.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled import compiled
from shell_deform.theory.kernels import add_point_hessian, point_strains, point_stress


@compiled
def gather_derivatives(nodes: Any, rows: Any, positions: Any, q: Any) -> None:
    """Derivative vectors q (5, 3) at a point from control positions (n, 3)."""
    q[:, :] = 0.0
    for k in range(len(nodes)):
        node = nodes[k]
        for d in range(5):
            for i in range(3):
                q[d, i] += rows[k, d] * positions[node, i]


@compiled
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
    q, strain, stress = np.empty((5, 3)), np.empty(6), np.empty(6)
    jac, work, force = np.empty((6, 15)), np.empty((8, 3)), np.empty(15)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            point_strains(theory, q, tangents[p], second[p], curvature[p], strain, jac, work)
            total += weights[p] * point_stress(strain, membrane[p], bending[p], stress)
            for d in range(15):
                value = 0.0
                for s in range(6):
                    value += jac[s, d] * stress[s]
                force[d] = weights[p] * value
            for k in range(len(own)):
                for d in range(5):
                    for i in range(3):
                        gradient[own[k], i] += row[k, d] * force[3 * d + i]
    return total


@compiled
def shell_tangent(
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
    block_offsets: Any,
    block_start: Any,
    row_length: Any,
    data: Any,
) -> float:
    """`shell_gradient`, and the tangent stiffness [N/m] added into the CSR values `data`.

    Block (k, l) of an element starts at block_start[block_offsets[element] + k * size + l] and its
    rows are row_length[nodes[k]] values apart.
    """
    q, strain, stress = np.empty((5, 3)), np.empty(6), np.empty(6)
    jac, work, blocks = np.empty((6, 15)), np.empty((8, 3)), np.empty((4, 3, 3))
    weighted, hessian, force = np.empty((6, 15)), np.empty((15, 15)), np.empty(15)
    largest = 0
    for element in range(len(node_offsets) - 1):
        largest = max(largest, node_offsets[element + 1] - node_offsets[element])
    stiffness = np.empty((3 * largest, 3, largest))
    transposed, left = np.empty((5, largest)), np.empty(15)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        size = len(own)
        stiffness[: 3 * size, :, :size] = 0.0
        for p in range(point_offsets[element], point_offsets[element + 1]):
            row = rows[row_offsets[p] : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            stretch = point_strains(
                theory, q, tangents[p], second[p], curvature[p], strain, jac, work
            )
            weight = weights[p]
            total += weight * point_stress(strain, membrane[p], bending[p], stress)
            d_m, d_b = membrane[p], bending[p]
            for d in range(15):
                value = 0.0
                for s in range(6):
                    value += jac[s, d] * stress[s]
                force[d] = weight * value
                for s in range(3):
                    weighted[s, d] = weight * (
                        d_m[s, 0] * jac[0, d] + d_m[s, 1] * jac[1, d] + d_m[s, 2] * jac[2, d]
                    )
                    weighted[3 + s, d] = weight * (
                        d_b[s, 0] * jac[3, d] + d_b[s, 1] * jac[4, d] + d_b[s, 2] * jac[5, d]
                    )
            for s in range(6):
                stress[s] *= weight
            hessian[:, :] = 0.0
            add_point_hessian(theory, q, stress, stretch, work, blocks, hessian)
            for d in range(15):
                for s in range(6):
                    factor = jac[s, d]
                    if factor != 0.0:
                        for e in range(15):
                            hessian[d, e] += factor * weighted[s, e]
            for k in range(size):
                for d in range(5):
                    transposed[d, k] = row[k, d]
                    for i in range(3):
                        gradient[own[k], i] += row[k, d] * force[3 * d + i]
            t_0, t_1, t_2 = transposed[0], transposed[1], transposed[2]
            t_3, t_4 = transposed[3], transposed[4]
            for k in range(size):
                for i in range(3):
                    left[:] = 0.0
                    for d in range(5):
                        factor = row[k, d]
                        for e in range(15):
                            left[e] += factor * hessian[3 * d + i, e]
                    for j in range(3):
                        target = stiffness[3 * k + i, j]
                        l_0, l_1, l_2 = left[j], left[3 + j], left[6 + j]
                        l_3, l_4 = left[9 + j], left[12 + j]
                        for m in range(k, size):
                            target[m] += (
                                l_0 * t_0[m]
                                + l_1 * t_1[m]
                                + l_2 * t_2[m]
                                + l_3 * t_3[m]
                                + l_4 * t_4[m]
                            )
        start = block_offsets[element]
        for k in range(size):
            for m in range(k, size):
                upper = block_start[start + k * size + m]
                length = row_length[own[k]]
                for i in range(3):
                    for j in range(3):
                        data[upper + i * length + j] += stiffness[3 * k + i, j, m]
                if m != k:
                    lower = block_start[start + m * size + k]
                    length = row_length[own[m]]
                    for i in range(3):
                        for j in range(3):
                            data[lower + j * length + i] += stiffness[3 * k + i, j, m]
    return total


@compiled
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
    q, x = np.empty((5, 3)), np.empty(3)
    total = 0.0
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            first = row_offsets[p]
            row = rows[first : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            x[:] = 0.0
            for k in range(len(own)):
                for i in range(3):
                    x[i] += values[first + k] * positions[own[k], i]
            a, b = q[0], q[1]
            w = weights[p] / 3.0
            for k in range(len(own)):
                n_0, n_1, n_2 = w * values[first + k], w * row[k, 0], w * row[k, 1]
                for i in range(3):
                    j, m = (i + 1) % 3, (i + 2) % 3
                    gradient[own[k], i] += (
                        n_0 * (a[j] * b[m] - a[m] * b[j])
                        + n_1 * (b[j] * x[m] - b[m] * x[j])
                        + n_2 * (x[j] * a[m] - x[m] * a[j])
                    )
            total += w * (
                x[0] * (a[1] * b[2] - a[2] * b[1])
                + x[1] * (a[2] * b[0] - a[0] * b[2])
                + x[2] * (a[0] * b[1] - a[1] * b[0])
            )
    return total


@compiled
def volume_tangent(
    pressure: float,
    node_offsets: Any,
    nodes: Any,
    point_offsets: Any,
    row_offsets: Any,
    rows: Any,
    values: Any,
    weights: Any,
    positions: Any,
    block_offsets: Any,
    block_start: Any,
    row_length: Any,
    data: Any,
) -> None:
    """Add -pressure times the second derivative of the enclosed volume to the CSR values."""
    q, x, c = np.empty((5, 3)), np.empty(3), np.empty(3)
    for element in range(len(node_offsets) - 1):
        own = nodes[node_offsets[element] : node_offsets[element + 1]]
        size = len(own)
        start = block_offsets[element]
        for p in range(point_offsets[element], point_offsets[element + 1]):
            first = row_offsets[p]
            row = rows[first : row_offsets[p + 1]]
            gather_derivatives(own, row, positions, q)
            x[:] = 0.0
            for k in range(size):
                for i in range(3):
                    x[i] += values[first + k] * positions[own[k], i]
            w = -pressure * weights[p] / 3.0
            for k in range(size):
                for m in range(size):
                    # x . (a x b): the mixed derivative of two arguments crosses with the third.
                    f_x = row[k, 0] * row[m, 1] - row[k, 1] * row[m, 0]
                    f_a = row[k, 1] * values[first + m] - values[first + k] * row[m, 1]
                    f_b = values[first + k] * row[m, 0] - row[k, 0] * values[first + m]
                    for i in range(3):
                        c[i] = w * (f_x * x[i] + f_a * q[0, i] + f_b * q[1, i])
                    at = block_start[start + k * size + m]
                    length = row_length[own[k]]
                    data[at + 1] += c[2]
                    data[at + 2] -= c[1]
                    data[at + length] -= c[2]
                    data[at + length + 2] += c[0]
                    data[at + 2 * length] += c[1]
                    data[at + 2 * length + 1] -= c[0]
