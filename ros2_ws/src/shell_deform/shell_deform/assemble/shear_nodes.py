# SPDX-License-Identifier: Apache-2.0
"""Where a thick wall shears: control vertices near pins, and what their shear does at a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.shell_points import ShellPoints
from shell_deform.assemble.stamps import Stamp, StampPoints, WallError
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory.reference import sharpest_curvature

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHEAR_REACH = 2.0
"""At first, shear unknowns are within so many sqrt(R h) of a pin: at 12 mm (1.4) on a ball of
R/h 12.5 a dent of four walls is 4 % too stiff, from 1.7 on within 1 % of shear everywhere."""


class ElementUnknowns(NamedTuple):
    """All unknowns of the elements of a thick shell.

    Attributes:
        offsets, nodes: those of element e are nodes[offsets[e]:offsets[e + 1]]: its control
            points, its shear nodes, its pin. shear_counts: (e,) shear nodes of each.
        shear_offsets: (p + 1,) first shear row of each point. shear_rows: (., 12) shear and its
            derivatives (6) per component (2) of each shear node.
    """

    offsets: Index
    nodes: Index
    shear_counts: Index
    shear_offsets: Index
    shear_rows: Array


def shear_frames(surface: LimitSurface, vertices: Index) -> tuple[Array, Array]:
    """Two orthonormal tangent vectors (m, 3) of the undeformed surface at each vertex."""
    normal = surface.vertex_normals(surface.mesh.vertices)[vertices]
    helper = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normal, first)


def sheared_vertices(
    shell: ShellPoints, surface: LimitSurface, points: Array, stamps: Sequence[Stamp], reach: float
) -> Index:
    """Control vertices within `reach` sqrt(R h) of a pin; `points` (p, 3) of the rule."""
    mesh = shell.mesh
    largest = sharpest_curvature(*shell.reference.mean_and_gauss)
    limit = surface.limit_positions(mesh.vertices)
    chosen = np.zeros(len(mesh.vertices), dtype=bool)
    for stamp in stamps:
        near = int(np.argmin(np.linalg.norm(points - stamp.centre, axis=1)))
        wall = float(shell.thickness[near])
        around = np.linalg.norm(points - stamp.centre, axis=1) < stamp.radius + 2.0 * wall
        curvature = max(float(np.median(largest[around | (np.arange(len(points)) == near)])), 1e-9)
        around_pin = max(reach * np.sqrt(wall / curvature), stamp.radius + 4.0 * wall)
        near_pin = min(around_pin, np.sqrt(shell.area))
        chosen |= np.linalg.norm(limit - stamp.centre, axis=1) < near_pin
    used = used_vertices(mesh)
    return used[chosen[used]]


def used_vertices(mesh: ControlMesh) -> Index:
    """Control vertices that are corners of the surface, in order; others shape its edges alone."""
    return np.unique(mesh.triangles[mesh.active]).astype(np.int64)


def element_unknowns(
    shell: ShellPoints, surface: LimitSurface, sheared: Index, pressed: StampPoints, wall: float
) -> ElementUnknowns:
    """Unknowns of every element and the shear rows of every point.

    `wall` [m] makes lengths of the unknowns of shear. Raises WallError where two pins press on one
    triangle.
    """
    n = len(shell.mesh.vertices)
    number = np.full(n, -1, dtype=np.int64)
    number[sheared] = n + np.arange(len(sheared))
    pin_of = np.full(len(shell.node_offsets) - 1, -1, dtype=np.int64)
    element_of = np.searchsorted(shell.point_offsets, pressed.point, side='right') - 1
    for element, k in zip(element_of.tolist(), pressed.stamp.tolist(), strict=True):
        if pin_of[element] not in (-1, k):
            raise WallError(
                'two pins press on one triangle of the mesh: let them stand further apart, take '
                'more control vertices, or theory koiter'
            )
        pin_of[element] = k
    nodes, counts, shears = [], [], np.zeros(len(pin_of), dtype=np.int64)
    for e in range(len(pin_of)):
        own = shell.nodes[shell.node_offsets[e] : shell.node_offsets[e + 1]]
        extra = number[own]
        extra = extra[extra >= 0]
        shears[e] = len(extra)
        parts = [own, extra]
        if pin_of[e] >= 0:
            parts.append(np.array([n + len(sheared) + pin_of[e]]))
        nodes.append(np.concatenate(parts))
        counts.append(len(nodes[-1]))
    of_point = np.repeat(np.arange(len(pin_of)), np.diff(shell.point_offsets))
    return ElementUnknowns(
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        np.concatenate(nodes).astype(np.int64),
        shears,
        np.concatenate([[0], np.cumsum(shears[of_point])]).astype(np.int64),
        _shear_rows(shell, surface, sheared, number, wall),
    )


def _shear_rows(
    shell: ShellPoints, surface: LimitSurface, sheared: Index, number: Index, wall: float
) -> Array:
    """(., 12) shear W^a and its derivatives W^a,b along the frame, by both components of a node.

    W^a = w . A^a of the field w = sum N_I (w1_I e1_I + w2_I e2_I), so that W^a,b also turns with
    the frame: A^a,b = -Gamma^a_bc A^c + B^a_b N.
    """
    row_nodes = shell.row_nodes
    used = np.flatnonzero(number[row_nodes] >= 0)
    point = np.repeat(np.arange(len(shell.weights)), np.diff(shell.row_offsets))[used]
    which = number[row_nodes[used]] - len(shell.mesh.vertices)
    reference = shell.reference
    tangents, normal = reference.tangents[point], reference.normal[point]
    connection = np.einsum('pvi,pai->pva', reference.second[point], tangents)
    form = reference.curvature[point]
    value, first = shell.values[used], shell.rows[used, :2]
    scale = 1.0 / wall
    result = np.zeros((len(used), 6, 2))
    pair = ((0, 1), (1, 2))
    for alpha, frame in enumerate(shear_frames(surface, sheared)):
        e = frame[which]
        along = np.einsum('rai,ri->ra', tangents, e)
        out = np.einsum('ri,ri->r', normal, e)
        for a in range(2):
            result[:, a, alpha] = value * along[:, a]
            for b in range(2):
                turn = form[:, pair[a][b]] * out
                for c in range(2):
                    turn = turn - connection[:, pair[b][c], a] * along[:, c]
                result[:, 2 + 2 * a + b, alpha] = first[:, b] * along[:, a] + value * turn
    return np.ascontiguousarray(scale * result.reshape(len(used), 12))
