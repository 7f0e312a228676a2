# SPDX-License-Identifier: Apache-2.0
"""Search of all rotations when the pose of a scan is unknown.

Many starts, spread evenly over the rotations, are refined together on a few hundred points by
trimmed point-to-plane steps against samples of the surface; the best few then compete on the
smooth surface itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.distance import measure
from scan_compare.rigid import Pose, nearest_rotation, rotation_angle, spread_rotations

STARTS = 240
"""Starting rotations: neighbours are about 25 degrees apart."""

SEARCH_POINTS = 200
SURFACE_SAMPLES = 3_000
ROUNDS = ((STARTS, 8), (48, 10), (12, 20))
"""Candidates kept and steps done in each round."""

KEPT_SHARE = 0.75
"""Share of the points of each start that enters a step: the rest may be fingers and noise."""

CONTEST_POINTS = 1_500
AMBIGUITY = 1.15
"""Poses whose trimmed rms is within this factor of the best fit equally well."""

DIFFERENT_ANGLE = np.deg2rad(10.0)


@dataclass(frozen=True)
class FoundPose:
    """The best pose, its rms over the points kept [m], and how many distinct ones fit as well."""

    pose: Pose
    rms_m: float
    alike: int


def search_pose(
    points: np.ndarray, usable: np.ndarray, surface: DeformedSurface, sigma: float
) -> FoundPose:
    """Return the best pose of scan `points` (n, 3) found from all rotations.

    usable (n,): points that may be used. sigma: scanner noise [m]. Deterministic.
    """
    points = points[usable]
    few = points[:SEARCH_POINTS]
    step = max(1, len(surface.samples.area) // SURFACE_SAMPLES)
    target = surface.samples.position[::step]
    normal = surface.samples.normal[::step]
    tree = cKDTree(target)
    rotation = spread_rotations(STARTS)
    centre = target.mean(axis=0)
    translation = centre - rotation @ few.mean(axis=0)
    for keep, steps in ROUNDS:
        score = _scores(few, rotation, translation, tree, target, normal)
        best = np.argsort(score, kind='stable')[:keep]
        rotation, translation = rotation[best], translation[best]
        for _ in range(steps):
            rotation, translation = _step(few, rotation, translation, tree, target, normal)
    return _contest(points[:CONTEST_POINTS], rotation, translation, surface, sigma)


def _residuals(
    points: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    tree: cKDTree,
    target: np.ndarray,
    normal: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return moved points (s, n, 3), normals (s, n, 3) and distances (s, n) of every start."""
    moved = np.einsum('sij,nj->sni', rotation, points) + translation[:, None, :]
    _, nearest = tree.query(moved.reshape(-1, 3))
    nearest = nearest.reshape(moved.shape[:2])
    normals = normal[nearest]
    return moved, normals, np.einsum('sni,sni->sn', moved - target[nearest], normals)


def _kept(distance: np.ndarray) -> np.ndarray:
    """Return which KEPT_SHARE of each row of |distance| (s, n) is smallest."""
    count = max(6, round(KEPT_SHARE * distance.shape[1]))
    limit = np.partition(np.abs(distance), count - 1, axis=1)[:, count - 1]
    return np.abs(distance) <= limit[:, None]


def _scores(
    points: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    tree: cKDTree,
    target: np.ndarray,
    normal: np.ndarray,
) -> np.ndarray:
    _, _, distance = _residuals(points, rotation, translation, tree, target, normal)
    kept = _kept(distance)
    return np.sum(np.where(kept, distance**2, 0.0), axis=1) / kept.sum(axis=1)


def _step(
    points: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    tree: cKDTree,
    target: np.ndarray,
    normal: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """One damped Gauss-Newton step of every start at once."""
    moved, normals, distance = _residuals(points, rotation, translation, tree, target, normal)
    kept = _kept(distance).astype(float)
    centre = moved.mean(axis=1)
    arms = moved - centre[:, None, :]
    radius = np.sqrt(np.mean(np.sum(arms**2, axis=2), axis=1))
    rows = np.concatenate((np.cross(arms, normals) / radius[:, None, None], normals), axis=2)
    matrix = np.einsum('sni,sn,snj->sij', rows, kept, rows) + 1e-3 * kept.sum(axis=1)[
        :, None, None
    ] * np.eye(6)
    motion = np.linalg.solve(matrix, -np.einsum('sni,sn->si', rows, kept * distance)[..., None])
    motion = motion[..., 0]
    turn = _small_rotations(motion[:, :3] / radius[:, None])
    new_rotation = turn @ rotation
    shift = np.einsum('sij,sj->si', turn, translation - centre) + centre + motion[:, 3:]
    return new_rotation, shift


def _small_rotations(vectors: np.ndarray) -> np.ndarray:
    """Return rotations (s, 3, 3) by Cayley's map of `vectors` (s, 3): proper at any size."""
    x, y, z = 0.5 * vectors.T
    zero = np.zeros_like(x)
    half = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), -1, 0)
    return np.linalg.solve(np.eye(3) - half, np.eye(3) + half)


def _contest(
    points: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    surface: DeformedSurface,
    sigma: float,
) -> FoundPose:
    """Compare candidates by their trimmed distances to the smooth surface."""
    poses = [
        Pose(nearest_rotation(turn), shift)
        for turn, shift in zip(rotation, translation, strict=True)
    ]
    scores = []
    for pose in poses:
        distance = measure(surface, pose.apply(points)).distance[None, :]
        kept = _kept(distance)
        scores.append(float(np.sqrt(np.mean(distance[kept] ** 2))))
    best = int(np.argmin(scores))
    # below the noise all poses are alike
    limit = AMBIGUITY * max(scores[best], 0.5 * sigma)
    distinct: list[Pose] = [poses[best]]
    for index in np.argsort(scores, kind='stable'):
        turns = [rotation_angle(poses[index].rotation @ other.rotation.T) for other in distinct]
        if scores[index] <= limit and min(turns) > DIFFERENT_ANGLE:
            distinct.append(poses[index])
    return FoundPose(poses[best], scores[best], len(distinct))
