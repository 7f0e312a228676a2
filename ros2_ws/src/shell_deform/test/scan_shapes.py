# SPDX-License-Identifier: Apache-2.0
"""Synthetic scans with everything that real ones suffer from, and their truth."""

from __future__ import annotations

import numpy as np
import trimesh


def potato_radius(direction: np.ndarray) -> np.ndarray:
    """Radius [m] of a free-form closed shell about the origin, by direction (n, 3)."""
    x, y, z = direction.T
    return 0.03 * (1 + 0.12 * x * y + 0.1 * z**3 + 0.06 * np.sin(3 * x + 2 * y) + 0.15 * y * y)


def potato(level: int, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Scan of the potato's outer face: points (n, 3) [m] with noise [m], triangles."""
    ball = trimesh.creation.icosphere(level)
    points = ball.vertices * potato_radius(ball.vertices)[:, None]
    normals = trimesh.Trimesh(points, ball.faces, process=False).vertex_normals
    random = np.random.default_rng(seed)
    return points + noise * random.normal(size=(len(points), 1)) * normals, np.array(ball.faces)


def potato_distance(points: np.ndarray) -> np.ndarray:
    """Distance [m] of points near the potato from it, to first order."""
    step = 1e-6
    slope = np.stack(
        [
            (_level(points + step * axis) - _level(points - step * axis)) / (2 * step)
            for axis in np.eye(3)
        ],
        axis=1,
    )
    return _level(points) / np.linalg.norm(slope, axis=1)


def _level(points: np.ndarray) -> np.ndarray:
    radius = np.linalg.norm(points, axis=1)
    return radius - potato_radius(points / radius[:, None])


def bowl(level: int, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Scan of a bowl: the lower part of a sphere of 40 mm radius, open above z = 10 mm."""
    ball = trimesh.creation.icosphere(level, radius=0.04)
    keep = ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.01
    faces = np.array(ball.faces)[keep]
    used, faces = np.unique(faces, return_inverse=True)
    points = ball.vertices[used]
    random = np.random.default_rng(seed)
    away = points / np.linalg.norm(points, axis=1)[:, None]
    return points + noise * random.normal(size=(len(points), 1)) * away, faces.reshape(-1, 3)


def damaged(points: np.ndarray, faces: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Turn some triangles over, tear a small hole, double some, add a speck and bad triangles."""
    random = np.random.default_rng(seed)
    centre = points[random.integers(len(points))]
    middle = points[faces].mean(axis=1)
    faces = faces[np.linalg.norm(middle - centre, axis=1) > 0.003]
    turned = random.random(len(faces)) < 0.3
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    speck = trimesh.creation.icosphere(1, radius=0.002)
    extra = np.array(speck.faces) + len(points)
    third = np.array([[faces[0, 0], faces[0, 1], len(points)]])
    flat = np.array([[faces[1, 0], faces[1, 0], faces[1, 1]]])
    everything = np.concatenate([faces, faces[:50], extra, third, flat])
    return np.concatenate([points, speck.vertices + [0.2, 0, 0]]), everything
