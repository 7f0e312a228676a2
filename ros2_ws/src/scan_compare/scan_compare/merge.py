# SPDX-License-Identifier: Apache-2.0
"""Merging several views (a scan family) into one scan, each refined against the others.

A scanner much larger than the object sees it in several views; each is placed by hand-picked
points and carries its own small rigid error. Averaging views as they come smooths the dent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan_compare.rigid import IDENTITY, Pose, rotation_from_vector
from scan_compare.scan import Scan

NEIGHBOURS = 20
"""Points of other views to which a paraboloid is fitted around a point."""

POINTS_PER_VIEW = 20_000
ROUNDS = 60
SMALLEST_OVERLAP = 50
SETTLED = 1e-6
"""Refinement ends when no point of a view moves by more than this [m]."""


class MergeError(ValueError):
    """Views that cannot be merged; the message names the view."""


@dataclass(frozen=True)
class Merge:
    """The merged scan; `poses` applied to each view; `residual_m`: rms distance between
    overlapping views after refinement [m]; `overlap`: shared fraction of each view's points.
    """

    scan: Scan
    poses: tuple[Pose, ...]
    residual_m: float
    overlap: tuple[float, ...]


def merge(views: list[Scan], reach_m: float = 2e-3) -> Merge:
    """Merge views that already lie near each other (a scan family) [m].

    Every view in turn moves rigidly onto the local shape of all others within `reach_m`, the
    first stays. Views keep their points: nothing is averaged. Raises MergeError for no views or
    a view that overlaps no other.
    """
    if not views:
        raise MergeError('no views to merge')
    poses = [IDENTITY] * len(views)
    thinned = [view.points[_thin(len(view.points))] for view in views]
    overlap = [1.0] * len(views)
    residual = 0.0
    if len(views) > 1:
        for _ in range(ROUNDS):
            moved = 0.0
            squares, count = 0.0, 0
            for index in range(len(views)):
                fit = _pull(index, thinned, poses, reach_m)
                overlap[index] = fit.overlap
                if fit.count < SMALLEST_OVERLAP:
                    raise MergeError(
                        f'{views[index].source}: only {fit.count} points of this view lie within '
                        f'{1e3 * reach_m:.3g} mm of another; align the views first'
                    )
                squares += fit.squares
                count += fit.count
                if index > 0:
                    poses[index] = fit.step.after(poses[index])
                    moved = max(moved, fit.largest_move)
            residual = float(np.sqrt(squares / count))
            if moved < SETTLED:
                break
    return Merge(_joined(views, poses, residual, overlap), tuple(poses), residual, tuple(overlap))


def _thin(count: int) -> np.ndarray:
    return np.random.default_rng(0).permutation(count)[:POINTS_PER_VIEW]


@dataclass(frozen=True)
class _Pull:
    step: Pose
    count: int
    squares: float
    overlap: float
    largest_move: float


def _pull(index: int, thinned: list[np.ndarray], poses: list[Pose], reach: float) -> _Pull:
    """One point-to-plane step of view `index` towards all other views."""
    points = poses[index].apply(thinned[index])
    others = np.concatenate(
        [poses[k].apply(thinned[k]) for k in range(len(thinned)) if k != index]
    )
    neighbours = min(NEIGHBOURS, len(others))
    gap, nearest = cKDTree(others).query(points, neighbours, distance_upper_bound=reach)
    near = np.all(np.isfinite(gap.reshape(len(points), -1)), axis=1)
    if np.count_nonzero(near) < 6:
        return _Pull(IDENTITY, int(near.sum()), 0.0, 0.0, 0.0)
    own = points[near]
    normal, distance = _to_paraboloid(own, others[nearest.reshape(len(points), -1)[near]])
    weight = np.maximum(0.0, 1.0 - (distance / _cut(distance)) ** 2) ** 2
    middle = own.mean(axis=0)
    rows = np.hstack((np.cross(own - middle, normal), normal))
    matrix = (rows * weight[:, None]).T @ rows
    # directions that the overlap does not fix stay where they are
    motion = np.linalg.lstsq(matrix, -rows.T @ (weight * distance), rcond=1e-6)[0]
    rotation = rotation_from_vector(motion[:3])
    step = Pose(rotation, middle - rotation @ middle + motion[3:])
    return _Pull(
        step,
        int(near.sum()),
        float(weight @ distance**2 / max(weight.mean(), 1e-12)),
        float(near.mean()),
        float(np.max(np.linalg.norm(step.apply(own) - own, axis=1))),
    )


def _to_paraboloid(points: np.ndarray, patch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return normals (n, 3) and distances (n,) of points (n, 3) from neighbours (n, k, 3).

    A plane through the neighbours would lie inside a curved surface and pull every view inwards.
    """
    centre = patch.mean(axis=1, keepdims=True)
    arms = patch - centre
    _, frame = np.linalg.eigh(np.einsum('nki,nkj->nij', arms, arms))
    local = np.einsum('nki,nij->nkj', arms, frame)
    own = np.einsum('ni,nij->nj', points - centre[:, 0], frame)
    size = np.abs(local[:, :, 1:]).max(axis=(1, 2), keepdims=True)
    terms = _paraboloid_terms(local[:, :, 1:] / size)
    normal_matrix = np.einsum('nki,nkj->nij', terms, terms) + 1e-9 * np.eye(6)
    right = np.einsum('nki,nk->ni', terms, local[:, :, 0])
    shape = np.linalg.solve(normal_matrix, right[..., None])[..., 0]
    at = _paraboloid_terms((own[:, 1:] / size[:, 0])[:, None, :])[:, 0]
    return frame[:, :, 0], own[:, 0] - np.einsum('ni,ni->n', at, shape)


def _paraboloid_terms(across: np.ndarray) -> np.ndarray:
    x, y = across[..., 0], across[..., 1]
    return np.stack((np.ones_like(x), x, y, x * x, x * y, y * y), axis=-1)


def _cut(distance: np.ndarray) -> float:
    """Return the distance at which Tukey's weight ends."""
    return max(4.685 * 1.4826 * float(np.median(np.abs(distance))), 1e-9)


def _joined(views: list[Scan], poses: list[Pose], residual: float, overlap: list[float]) -> Scan:
    moved = [
        view.moved(pose.rotation, pose.translation)
        for view, pose in zip(views, poses, strict=True)
    ]
    triangles = None
    if all(view.triangles is not None for view in views):
        starts = np.cumsum([0] + [len(view.points) for view in views[:-1]])
        triangles = np.concatenate(
            [
                view.triangles + start
                for view, start in zip(views, starts, strict=True)
                if view.triangles is not None
            ]
        ).astype(np.int32)
    notes = tuple(f'{view.source}: {note}' for view in views for note in view.notes)
    return Scan(
        np.concatenate([view.points for view in moved]),
        triangles,
        views[0].unit,
        any(view.unit_inferred for view in views),
        ' + '.join(view.source for view in views),
        (*notes, _merge_note(residual, overlap)) if len(views) > 1 else views[0].notes,
        np.repeat(np.arange(len(views)), [len(view.points) for view in views]),
    )


def _merge_note(residual: float, overlap: list[float]) -> str:
    return (
        f'{len(overlap)} views merged, each refined against the others: they lie '
        f'{1e3 * residual:.3f} mm (rms) apart where they overlap, at least '
        f'{100.0 * min(overlap):.0f} % of a view'
    )
