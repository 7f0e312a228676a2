# SPDX-License-Identifier: Apache-2.0
"""Smaller triangles around given places by more vertices, where drawing together cannot reach."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ..surface.control_mesh import ControlMesh, control_mesh
from ..surface.fit import Target
from .remesh import edge_table, flipped, split_long

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

GROWTH = 0.25
"""How much longer edges become per length of way from a place."""

LONGEST = 4.0 / 3.0
"""Edges longer than that share of the wanted length are halved."""

ROUNDS = 6


def wanted_edge(distance: FloatArray, edge: float) -> FloatArray:
    """Edge length [m] at a distance [m] from a place where it is to be `edge`."""
    return edge + GROWTH * np.maximum(0.0, distance - 2.0 * edge)


def refined(
    mesh: ControlMesh, target: Target, places: FloatArray, edge: float, rims: bool = False
) -> ControlMesh:
    """The mesh with edges of about `edge` [m] around `places` (k, 3), vertices on `target`.

    Long edges are halved, edges flipped towards six neighbours, vertices moved within the surface;
    far from the places nothing changes. Vertices on the boundary, on creases and at corners stay;
    if `rims`, there will be more of them on the boundary.
    """
    centres, _ = target.project(places)
    firm = np.unique(
        np.concatenate([mesh.boundary_vertices, mesh.crease_edges.ravel(), mesh.corners])
    ).astype(np.int64)
    order = np.concatenate([firm, np.setdiff1d(np.arange(mesh.vertex_count), firm)])
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    points, faces = mesh.vertices[order], number[mesh.triangles]
    ends = points[number[mesh.edges]]
    tree = cKDTree(ends.mean(axis=1))
    usual = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    near_places = cKDTree(centres)

    def size(at: FloatArray) -> FloatArray:
        old = usual[tree.query(at, k=6)[1]].mean(axis=1)
        return np.minimum(old, wanted_edge(near_places.query(at)[0], edge))

    touched = size(points) < 0.95 * usual[tree.query(points, k=6)[1]].mean(axis=1)
    for _ in range(ROUNDS):
        count = len(points)
        points, faces = split_long(points, faces, lambda at: LONGEST * size(at), len(firm), rims)
        touched = np.concatenate([touched, np.ones(len(points) - count, dtype=bool)])
        if rims:
            edges, beside, _ = edge_table(faces)
            rim = np.unique(edges[beside[:, 1] < 0])
            touched[rim] = False
            fresh = rim[rim >= count]
            points[fresh], _ = target.outline(points[fresh])
        for _ in range(3):
            faces = flipped(points, faces, len(firm))
        points = _relaxed(points, faces, target, size(points), touched, len(firm))
    creases = number[mesh.crease_edges] if len(mesh.crease_edges) else None
    return control_mesh(points, faces, creases, corners=number[mesh.corners])


def _relaxed(
    points: FloatArray,
    faces: IntArray,
    target: Target,
    size: FloatArray,
    touched: npt.NDArray[np.bool_],
    fixed: int,
) -> FloatArray:
    """Free vertices moved towards the mean of their neighbours, small edges counting like large.

    Only `touched` vertices move, and none of the first `fixed`.
    """
    edges, _, _ = edge_table(faces)
    total, weight = np.zeros_like(points), np.zeros(len(points))
    pull = 1.0 / size[edges].mean(axis=1) ** 2
    for a, b in (edges.T, edges.T[::-1]):
        np.add.at(total, a, pull[:, None] * points[b])
        np.add.at(weight, a, pull)
    free = np.flatnonzero(touched)
    free = free[free >= fixed]
    moved = points.copy()
    moved[free] += 0.7 * (total[free] / weight[free, None] - points[free])
    moved[free], _ = target.project(moved[free])
    return moved
