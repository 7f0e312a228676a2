# SPDX-License-Identifier: Apache-2.0
"""The closest-point search in plain numpy: the compiled kernel's oracle, and its stand-in.

All points take their steps together; apart from that it is the same search.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from .closest_point_types import (
    HALVINGS,
    LEAST_BEND,
    MAXIMUM_STEPS,
    ON_EDGE,
    ROUND_OFF_STEP,
    STEP_TOLERANCE,
    SURE_BEND,
)
from .control_mesh import BoolArray, ControlMesh, FloatArray, IntArray
from .loop_basis import basis_rows

_ALONG = np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, -1.0]])
_START = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def project_points(
    mesh: ControlMesh,
    neighbour: IntArray,
    control_points: FloatArray,
    queries: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
    """Move each seed (triangle, parameters), in place, to the foot point of its query.

    Args:
        neighbour: (3m,) half-edge on the other side of each half-edge, -1 at the surface's end.

    Returns:
        Position (q, 3), unit normal (q, 3), whether the foot lies on the surface's end (q,), and
        whether no other foot nearby can be nearer (q,).
    """
    at_end, stuck, sure, alone = np.zeros((4, len(queries)), dtype=bool)
    came_from = np.full(len(queries), -1)
    busy = np.arange(len(queries))
    for _ in range(MAXIMUM_STEPS):
        if len(busy) == 0:
            break
        t, uv, here = triangle[busy], parameters[busy], queries[busy]
        position, first, second = _evaluate(mesh, control_points, t, uv)
        gap = position - here
        squared = (gap**2).sum(axis=1)
        gradient, metric, hessian, bend = _model(gap, first, second)
        alone[busy] = bend > SURE_BEND
        lift = np.maximum(np.abs(bend), LEAST_BEND) - bend
        lifted = np.where(stuck[busy, None, None], metric, hessian + lift[:, None, None] * metric)
        step: FloatArray = -np.linalg.solve(lifted, gradient[:, :, None])[:, :, 0].astype(float)
        share, edge = _leave_share(uv, step)
        pinned = (edge >= 0) & (share < ON_EDGE)
        twin = np.where(pinned, neighbour[3 * t + np.maximum(edge, 0)], 0)
        at_end[busy] = pinned & (twin < 0)
        # Pushed outward on the edge of the surface, or from both sides onto an edge inside it:
        # slide along that edge.
        slides = pinned & ((twin < 0) | (twin // 3 == came_from[busy]))
        along = _ALONG[edge]
        slope = np.einsum('pi,pi->p', gradient, along)
        plain = np.einsum('pi,pij,pj->p', along, metric, along)
        bent = np.einsum('pi,pij,pj->p', along, hessian, along)
        bent = np.maximum(np.abs(bent), LEAST_BEND * plain)
        step = np.where(slides[:, None], -(slope / bent)[:, None] * along, step)
        again, other_edge = _leave_share(uv, step)
        share, edge = np.where(slides, again, share), np.where(slides, other_edge, edge)
        pinned = (edge >= 0) & (share < ON_EDGE)
        cornered = pinned & (neighbour[3 * t + np.maximum(edge, 0)] < 0)
        at_end[busy] |= cornered
        done = cornered | ((step**2).sum(axis=1) < STEP_TOLERANCE**2)
        crossing = pinned & ~done
        came_from[busy[crossing]] = triangle[busy[crossing]]
        _cross(neighbour, triangle, parameters, busy[crossing], edge[crossing])
        going = ~done & ~crossing
        moved, small = _take(
            mesh, control_points, queries, triangle, parameters, busy[going], step[going],
            share[going], edge[going], squared[going],
        )  # fmt: skip
        index = busy[going]
        hopeless = ~moved & stuck[index]
        finished = hopeless | (moved & small & (edge[going] < 0))
        round_off = (step[going] ** 2).sum(axis=1) < ROUND_OFF_STEP**2
        sure[busy[done]] = True
        sure[index[finished & (moved | round_off)]] = True
        stuck[busy[crossing]] = True
        stuck[index] = ~moved
        came_from[index[moved]] = -1
        keep = np.ones(len(busy), dtype=bool)
        keep[done] = False
        keep[np.flatnonzero(going)[finished]] = False
        busy = busy[keep]
    position, first, _ = _evaluate(mesh, control_points, triangle, parameters)
    normal = np.cross(first[:, :, 0], first[:, :, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return position, normal, at_end, sure & alone & ~at_end


def _evaluate(
    mesh: ControlMesh, control_points: FloatArray, triangle: IntArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows = basis_rows(mesh, triangle, parameters)
    weights = np.column_stack([rows.values, rows.first, rows.second])
    shape = (len(triangle), len(control_points))
    parts = [
        csr_matrix((weights[:, k], rows.nodes, rows.node_offsets), shape) @ control_points
        for k in range(6)
    ]
    return parts[0], np.stack(parts[1:3], axis=2), np.stack(parts[3:], axis=2)


def _model(
    gap: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Half the squared distance: gradient, metric, second derivative and its least bend.

    A bend is the second derivative along the surface over that of a plane's, which is the metric.
    """
    gradient = np.einsum('pi,pia->pa', gap, first)
    metric = np.einsum('pia,pib->pab', first, first)
    hessian = metric + np.einsum('pi,pik->pk', gap, second)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    relative = np.linalg.solve(metric, hessian)
    mean = 0.5 * np.trace(relative, axis1=1, axis2=2)
    spread = np.sqrt(np.maximum(0.0, mean**2 - np.linalg.det(relative)))
    return gradient, metric, hessian, mean - spread


def _leave_share(uv: FloatArray, step: FloatArray) -> tuple[FloatArray, IntArray]:
    """How much of each step stays in the triangle, and the edge through which it leaves."""
    u, v = uv.T
    du, dv = step.T
    with np.errstate(divide='ignore', invalid='ignore'):
        reach = np.stack(
            [
                np.where(v + dv < 0.0, v / -dv, np.inf),
                np.where(u + du + v + dv > 1.0, np.maximum(0.0, 1.0 - u - v) / (du + dv), np.inf),
                np.where(u + du < 0.0, u / -du, np.inf),
            ]
        )
    edge = np.argmin(reach, axis=0)
    share = reach[edge, np.arange(len(uv))]
    return np.minimum(share, 1.0), np.where(np.isfinite(share), edge, -1)


def _cross(
    neighbour: IntArray,
    triangle: IntArray,
    parameters: FloatArray,
    index: IntArray,
    edge: IntArray,
) -> None:
    """Express points on an edge in the triangle on its other side."""
    u, v = parameters[index].T
    back = np.choose(edge, [1.0 - u, 1.0 - v, v])
    twin = neighbour[3 * triangle[index] + edge]
    corner = twin % 3
    triangle[index] = twin // 3
    parameters[index] = _START[corner] + back[:, None] * _ALONG[corner]


def _take(
    mesh: ControlMesh,
    control_points: FloatArray,
    queries: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
    index: IntArray,
    step: FloatArray,
    share: FloatArray,
    edge: IntArray,
    squared: FloatArray,
) -> tuple[BoolArray, BoolArray]:
    """Take each step, halved until the distance does not grow; whether taken, and whether tiny."""
    moved = np.zeros(len(index), dtype=bool)
    small = np.zeros(len(index), dtype=bool)
    taken = share.copy()
    for _ in range(HALVINGS):
        left = np.flatnonzero(~moved)
        if len(left) == 0:
            break
        old = parameters[index[left]]
        new = old + taken[left, None] * step[left]
        full = taken[left] == share[left]
        new[full & (edge[left] == 0), 1] = 0.0
        new[full & (edge[left] == 2), 0] = 0.0
        diagonal = full & (edge[left] == 1)
        new[diagonal, 1] = 1.0 - new[diagonal, 0]
        new = np.clip(new, 0.0, 1.0)
        position, _, _ = _evaluate(mesh, control_points, triangle[index[left]], new)
        trial = ((position - queries[index[left]]) ** 2).sum(axis=1)
        good = trial <= squared[left] * (1.0 + 1e-15) + 1e-300
        parameters[index[left[good]]] = new[good]
        moved[left[good]] = True
        small[left[good]] = ((new - old)[good] ** 2).sum(axis=1) < STEP_TOLERANCE**2
        taken[left[~good]] *= 0.5
    return moved, small
