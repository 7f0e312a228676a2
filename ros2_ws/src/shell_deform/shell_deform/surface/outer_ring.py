# SPDX-License-Identifier: Apache-2.0
"""One ring of control points beyond every edge of an open mesh.

Loop's rules for an edge mirror the control points beyond it: the surface has no curvature across
its edge, and neither has any displacement, which a bent wall contradicts. With control points of
their own beyond the edge (inactive triangles: they carry no surface) the displacement is a full
spline up to the edge.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from .control_mesh import ControlMesh, FloatArray, IntArray, MeshError, control_mesh

REGULAR_VALENCE = 6


def with_outer_ring(mesh: ControlMesh) -> ControlMesh:
    """`mesh` with inactive triangles around; its own vertices and triangles keep their numbers.

    New points mirror those inside, so where an edge vertex has three triangles the surface stays
    exactly as it was. Edge vertices get six neighbours as far as new ones can make them. A closed
    mesh is returned as it is.

    Raises MeshError where a crease meets the edge.
    """
    if mesh.is_closed:
        return mesh
    edges, apex = _boundary(mesh)
    meeting = np.intersect1d(mesh.crease_edges, edges)
    if len(meeting):
        raise MeshError(
            f'a crease meets the edge of the surface at vertex {meeting[0]}; end it before'
        )
    points = mesh.vertices
    count = len(points)
    following = {int(start): k for k, (start, _) in enumerate(edges)}
    beyond = _shared_points(mesh, edges, following)
    names = np.unique(beyond)
    number = count + np.searchsorted(names, beyond)
    mirrored = points[edges[:, 0]] + points[edges[:, 1]] - points[apex]
    new = np.zeros((len(names), 3))
    np.add.at(new, number - count, mirrored)
    new /= np.bincount(number - count)[:, None]
    added = list(new)
    triangles = [(int(b), int(a), int(d)) for (a, b), d in zip(edges, number, strict=True)]
    for k, (before, vertex) in enumerate(edges.tolist()):
        after = following[vertex]
        if number[k] == number[after]:
            continue
        fan = [int(number[k])]
        mirror = 2.0 * points[vertex]
        missing = REGULAR_VALENCE - 3 - int(mesh.triangle_valence[vertex])
        if missing == 1:
            added.append(added[fan[0] - count] + added[number[after] - count] - points[vertex])
        elif missing == 2:
            added.append(mirror - points[edges[after, 1]])
            added.append(mirror - points[before])
        fan += list(range(count + len(added) - max(missing, 0), count + len(added)))
        fan.append(int(number[after]))
        triangles += [(vertex, c, d) for c, d in zip(fan[:-1], fan[1:], strict=True)]
    return control_mesh(
        np.concatenate([points, added]),
        np.concatenate([mesh.triangles, np.array(triangles)]),
        mesh.crease_edges,
        corners=np.intersect1d(mesh.corners, mesh.crease_edges),
        active=np.concatenate([mesh.active, np.zeros(len(triangles), dtype=bool)]),
    )


def _boundary(mesh: ControlMesh) -> tuple[IntArray, IntArray]:
    """Directed boundary edges (b, 2), the surface on their left, and the vertex opposite each."""
    half = np.flatnonzero(mesh.twins < 0)
    corner = mesh.triangles.reshape(-1).astype(np.int64)
    first = half - half % 3
    edges = np.column_stack([corner[half], corner[first + (half % 3 + 1) % 3]])
    return edges, corner[first + (half % 3 + 2) % 3]


def _shared_points(mesh: ControlMesh, edges: IntArray, following: dict[int, int]) -> IntArray:
    """Which new point lies beyond each boundary edge: one for both edges of a crowded vertex.

    A vertex with four or more triangles has room for one more neighbour only.
    """
    name = np.arange(len(edges))
    for k, (_, vertex) in enumerate(edges.tolist()):
        if mesh.triangle_valence[vertex] > REGULAR_VALENCE - 3:
            old, new = name[following[vertex]], name[k]
            name[name == old] = new
    return name


def extended(values: FloatArray, mesh: ControlMesh) -> FloatArray:
    """(n,) values at all vertices of a ringed mesh from those (k,) inside: the nearest inside."""
    inside = len(values)
    if inside == mesh.vertex_count:
        return values
    _, nearest = cKDTree(mesh.vertices[:inside]).query(mesh.vertices[inside:])
    return np.concatenate([values, values[nearest]])
