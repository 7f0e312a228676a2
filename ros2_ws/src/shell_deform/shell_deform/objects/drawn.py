# SPDX-License-Identifier: Apache-2.0
"""Draw the vertices of a mesh together around given places, without changing its topology."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surface.control_mesh import ControlMesh, moved
from ..surface.fit import Target
from .refined_mesh import refined

FloatArray = npt.NDArray[np.float64]

SMALLEST_SHARE = 0.3
"""Edges are shortened to that share at most: below, triangles around become too long."""

REACH = 6.0
"""Reach of the drawing in usual edges."""


def with_small_triangles(
    mesh: ControlMesh,
    target: Target,
    places: FloatArray,
    edge: float,
    rims: bool = False,
    around: bool = False,
) -> ControlMesh:
    """Edges of about `edge` [m] around `places` (k, 3): drawn together, or where that is not
    enough, by more vertices; also on the boundary if `rims`. Vertices stay on `target`.

    Drawn together they are that short at the places alone, which is not enough if they have to be
    `around` them: for rigid bodies, which press along a ring.
    """
    if not len(places):
        return mesh
    centres, _ = target.project(places)
    usual = np.array([_usual_edge(mesh, mesh.vertices, centre) for centre in centres])
    if np.all(edge >= (1.0 if around else SMALLEST_SHARE) * usual):
        return drawn_together(mesh, target, places, edge)
    return refined(mesh, target, places, edge, rims)


def drawn_together(
    mesh: ControlMesh, target: Target, places: FloatArray, edge: float
) -> ControlMesh:
    """Shorten the edges around `places` (k, 3) to about `edge` [m], smoothly.

    The nearest inner vertex with six neighbours is brought to each place; its surroundings
    follow; boundary vertices slide along their outline. Vertices stay on `target`.
    """
    points = mesh.vertices.copy()
    inner = mesh.valence == 6
    inner[mesh.boundary_vertices] = False
    inner[mesh.crease_edges] = False
    centres, _ = target.project(places)
    for centre in centres:
        usual = _usual_edge(mesh, points, centre)
        reach = REACH * usual
        others = np.linalg.norm(centres - centre, axis=1)
        apart = others[others > 0.0].min(initial=np.inf)
        reach = min(reach, 0.9 * apart)
        distance = np.linalg.norm(points - centre, axis=1)
        nearest = int(np.flatnonzero(inner)[np.argmin(distance[inner])])
        if distance[nearest] < usual:
            share = 1.0 - _smooth_step(distance / reach)
            points += share[:, None] * (centre - points[nearest])
        away = points - centre
        distance = np.linalg.norm(away, axis=1)
        least = min(1.0, max(edge / usual, SMALLEST_SHARE))
        scale = least + (1.0 - least) * _smooth_step(distance / reach)
        points = _on_target(mesh, target, centre + scale[:, None] * away)
    return moved(mesh, points)


def _on_target(mesh: ControlMesh, target: Target, points: FloatArray) -> FloatArray:
    result, _ = target.project(points)
    rim = mesh.boundary_vertices
    result[rim], _ = target.outline(points[rim])
    result[mesh.corners] = mesh.vertices[mesh.corners]
    fixed = np.unique(mesh.crease_edges)
    result[fixed] = mesh.vertices[fixed]
    return result


def _usual_edge(mesh: ControlMesh, points: FloatArray, centre: FloatArray) -> float:
    ends = points[mesh.edges]
    distance = np.linalg.norm(ends.mean(axis=1) - centre, axis=1)
    near = np.argsort(distance)[:24]
    return float(np.linalg.norm(ends[near, 0] - ends[near, 1], axis=1).mean())


def _smooth_step(t: FloatArray) -> FloatArray:
    t = np.clip(t, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
