# SPDX-License-Identifier: Apache-2.0
"""Basis functions of the Loop limit surface: values, first and second derivatives anywhere.

Values and first derivatives are exact up to round-off at any point of any triangle. Towards a
vertex of irregular valence the derivatives with respect to the triangle's own parameters behave
like (2 lambda)^k after k halvings (lambda: subdominant eigenvalue of the rules there): they fade
for valences below six and grow above; normals converge. Nearer to such a vertex than
``Patch.halvings`` halvings the derivatives are those at that distance. Second derivatives are in
general unbounded at such a vertex, though square integrable: integrate around it with
``refine_irregular``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from .box_spline import box_spline
from .control_mesh import ControlMesh, FloatArray, IndexArray, IntArray
from .patch import CHILD_SCALE, CHILD_SHIFT, Patch
from .patch_table import patch_table
from .quadrature import triangle_rule


@dataclass(frozen=True)
class BasisRows:
    """Basis functions at p points, in compressed rows.

    Attributes:
        node_offsets: (p + 1,) start of each point's row.
        nodes: (k,) control point numbers.
        values: (k,) weights of the position.
        first: (k, 2) weights of its derivative with respect to u and v.
        second: (k, 3) weights of its uu, uv and vv derivative.
    """

    node_offsets: IntArray
    nodes: IndexArray
    values: FloatArray
    first: FloatArray
    second: FloatArray


@dataclass(frozen=True)
class QuadratureBasis:
    """Basis functions at the integration points of every active triangle.

    Attributes:
        triangle: (e,) mesh triangle of each element.
        node_offsets: (e + 1,) start of each element's control points in `nodes`.
        nodes: control point numbers of all elements.
        element: (q,) element of each integration point.
        parameters: (q, 2) position of each point in its triangle.
        weight: (q,) parameter-area weight; the weights of an element add up to 1/2.
        row_offsets: (q + 1,) start of each point's row in the arrays below; the row lists the
            coefficients for the nodes of its element, in order.
        values, first, second: (r,), (r, 2), (r, 3) as in :class:`BasisRows`.
    """

    triangle: IntArray
    node_offsets: IntArray
    nodes: IndexArray
    element: IntArray
    parameters: FloatArray
    weight: FloatArray
    row_offsets: IntArray
    values: FloatArray
    first: FloatArray
    second: FloatArray


def basis_rows(mesh: ControlMesh, triangle: npt.ArrayLike, parameters: npt.ArrayLike) -> BasisRows:
    """Basis functions at points given by triangle and parameters.

    The point is (1 - u - v) corner 0 + u corner 1 + v corner 2 of the triangle's parameter
    domain; x = sum_i value_i control_point_i.

    Args:
        triangle: (p,) triangle numbers.
        parameters: (p, 2) u, v >= 0 with u + v <= 1.
    """
    triangles = np.asarray(triangle, dtype=np.int64)
    points = np.asarray(parameters, dtype=np.float64).reshape(-1, 2)
    table = patch_table(mesh)
    kind = table.patch[triangles]
    sizes = np.diff(table.node_offsets)[triangles]
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    rows = np.empty((offsets[-1], 6))
    nodes = np.empty(offsets[-1], dtype=np.int32)
    for index, members in _groups(kind):
        patch = table.patches[index]
        where = offsets[members][:, None] + np.arange(patch.size)
        rows[where] = patch_basis(patch, points[members])
        nodes[where] = table.nodes_of(triangles[members])
    return BasisRows(offsets, nodes, rows[:, 0].copy(), rows[:, 1:3].copy(), rows[:, 3:].copy())


def quadrature_basis(
    mesh: ControlMesh,
    points_per_triangle: int = 3,
    refine_irregular: int = 0,
    splits: npt.ArrayLike | None = None,
) -> QuadratureBasis:
    """Basis functions at the integration points of every active triangle.

    Args:
        points_per_triangle: 1, 3, 6, 7 or 12 (exact to degree 1, 2, 4, 5, 6).
        refine_irregular: levels of ever smaller sub-triangles around irregular vertices; zero
            integrates triangles at irregular vertices like all others.
        splits: (t,) how often each triangle is split in four, each with the rule of a whole one:
            where something acts on a part of a triangle. None splits no triangle.
    """
    table = patch_table(mesh)
    active = np.flatnonzero(mesh.active)
    split = np.zeros(len(active), np.int64) if splits is None else np.asarray(splits)[active]
    most = int(split.max(initial=0)) + 1
    kind = table.patch[active].astype(np.int64) * most + split
    node_counts = np.diff(table.node_offsets)[active]
    node_offsets = np.concatenate([[0], np.cumsum(node_counts)])
    rules = {
        index: _refined_rule(
            table.patches[index // most], points_per_triangle, refine_irregular, index % most
        )
        for index in np.unique(kind).tolist()
    }
    point_counts = np.array([len(rules[index][1]) for index in kind.tolist()], dtype=np.int64)
    first_point = np.concatenate([[0], np.cumsum(point_counts)])
    element = np.repeat(np.arange(len(active)), point_counts)
    row_offsets = np.concatenate([[0], np.cumsum(node_counts[element])])
    nodes = np.empty(node_offsets[-1], dtype=np.int32)
    rows = np.empty((row_offsets[-1], 6))
    parameters, weight = np.empty((len(element), 2)), np.empty(len(element))
    for index, members in _groups(kind):
        patch, (points, weights, basis) = table.patches[index // most], rules[index]
        where = node_offsets[members][:, None] + np.arange(patch.size)
        nodes[where] = table.nodes_of(active[members])
        where = first_point[members][:, None] + np.arange(len(weights))
        parameters[where], weight[where] = points, weights
        flat = basis.reshape(-1, 6)
        where = row_offsets[first_point[members]][:, None] + np.arange(len(flat))
        rows[where] = flat
    return QuadratureBasis(
        active, node_offsets, nodes, element, parameters, weight, row_offsets,
        rows[:, 0].copy(), rows[:, 1:3].copy(), rows[:, 3:].copy(),
    )  # fmt: skip


def patch_basis(patch: Patch, parameters: FloatArray) -> FloatArray:
    """(p, size, 6) value, u, v, uu, uv, vv weights of a patch's control points at (p, 2)."""
    if patch.is_regular:
        return np.einsum('pbk,bn->pnk', box_spline(parameters), patch.to_box)
    result = np.empty((len(parameters), patch.size, 6))
    here = np.arange(len(parameters))
    local = parameters
    matrix, scale, current = np.eye(patch.size), 1.0, patch
    pending = [(current, here, local, matrix, scale, 0)]
    while pending:
        current, here, local, matrix, scale, depth = pending.pop()
        if current.is_regular:
            factors = np.array([1.0, scale, scale, scale**2, scale**2, scale**2])
            basis = np.einsum('pbk,bn->pnk', box_spline(local), current.to_box @ matrix)
            result[here] = basis * factors
            continue
        if depth == patch.halvings:
            local = _off_corner(current, local)
        child = _child_of(local)
        for index, (piece, step) in enumerate(current.children):
            mine = np.flatnonzero(child == index)
            if len(mine) == 0:
                continue
            inner = CHILD_SCALE[index] * local[mine] + CHILD_SHIFT[index]
            pending.append(
                (piece, here[mine], inner, step @ matrix, scale * CHILD_SCALE[index], depth + 1)
            )
    for corner in np.flatnonzero(patch.irregular_corners).tolist():
        at = np.flatnonzero(_distance_to_corner(parameters, corner) < 2.0**-patch.halvings)
        result[at, :, 0] = patch.limit_row(corner)
    return result


def _child_of(local: FloatArray) -> IntArray:
    """(p,) which of the four pieces a point lies in; edges go to the middle piece."""
    u, v = local[:, 0], local[:, 1]
    return np.select([u + v < 0.5, u > 0.5, v > 0.5], [0, 1, 2], default=3)


def _distance_to_corner(local: FloatArray, corner: int) -> FloatArray:
    """(p,) one minus the barycentric coordinate of a corner."""
    u, v = local[:, 0], local[:, 1]
    return (u + v, 1.0 - u, 1.0 - v)[corner]


def _off_corner(patch: Patch, local: FloatArray) -> FloatArray:
    """Move points that are nearer to an irregular corner than half the patch out to its half."""
    weights = np.column_stack([1.0 - local.sum(axis=1), local])
    for corner in np.flatnonzero(patch.irregular_corners).tolist():
        near = weights[:, corner] > 0.5
        others = np.array([i for i in range(3) if i != corner])
        share = weights[np.ix_(near, others)]
        total = share.sum(axis=1, keepdims=True)
        share = np.where(total > 0.0, share / np.where(total > 0.0, total, 1.0), 0.5)
        weights[np.ix_(near, others)] = 0.5 * share
        weights[near, corner] = 0.5
    return weights[:, 1:]


@lru_cache(maxsize=4096)
def _refined_rule(
    patch: Patch, points_per_triangle: int, levels: int, splits: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points, weights and basis of one patch's integration rule, graded to irregular corners."""
    points, weights = _graded(patch, points_per_triangle, levels, splits)
    return points, weights, patch_basis(patch, points)


def _graded(patch: Patch, count: int, levels: int, splits: int) -> tuple[FloatArray, FloatArray]:
    """Rule of a patch split `splits` times, then towards its irregular corners `levels` times."""
    if splits == 0 and (levels == 0 or patch.is_regular):
        return triangle_rule(count)
    pieces = [patch] * 4 if patch.is_regular else [piece for piece, _ in patch.children]
    points, weights = [], []
    for index, piece in enumerate(pieces):
        deeper = (levels, splits - 1) if splits else (levels - 1, 0)
        inner, inner_weights = _graded(piece, count, *deeper)
        points.append((inner - CHILD_SHIFT[index]) / CHILD_SCALE[index])
        weights.append(0.25 * inner_weights)
    return np.concatenate(points), np.concatenate(weights)


def _groups(kind: IntArray) -> list[tuple[int, IntArray]]:
    """Members of each distinct value."""
    if len(kind) == 0:
        return []
    order = np.argsort(kind, kind='stable')
    values, starts = np.unique(kind[order], return_index=True)
    return list(zip(values.tolist(), np.split(order, starts[1:]), strict=True))
