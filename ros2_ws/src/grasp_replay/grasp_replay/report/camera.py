# SPDX-License-Identifier: Apache-2.0
"""An orthographic camera that looks at a dent from the side, and what it can see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import Floats, Ints, RowScene

OFF_AXIS = np.radians(56.0)
ELEVATION = np.radians(18.0)


@dataclass(frozen=True)
class Camera:
    """right, up, toward: (3,) orthonormal, `toward` points at the viewer; centre: (3,) m."""

    right: Floats
    up: Floats
    toward: Floats
    centre: Floats

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """Picture coordinates (n, 2) m and depth (n,) m, larger = nearer to the viewer."""
        moved = points - self.centre
        return moved @ np.stack([self.right, self.up], axis=1), moved @ self.toward


def dent_axis(scene: RowScene) -> Floats:
    """Unit vector (3,) from the body's middle to the first contact; z where there is none."""
    if len(scene.contact_points):
        axis = scene.contact_points[0] - scene.rest.mean(axis=0)
        length = float(np.linalg.norm(axis))
        if length > 0.0:
            return axis / length
    return np.array([0.0, 0.0, 1.0])


def side_direction(axis: Floats) -> Floats:
    """A unit vector (3,) perpendicular to `axis`, horizontal where that is possible."""
    vertical = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(vertical, axis)
    return side / np.linalg.norm(side)


def dent_camera(scene: RowScene) -> Camera:
    """The one camera of a row: towards the first contact, off its axis, a little from above."""
    axis = dent_axis(scene)
    side = side_direction(axis)
    vertical = np.cross(axis, side)
    toward = np.cos(ELEVATION) * (np.cos(OFF_AXIS) * axis + np.sin(OFF_AXIS) * side)
    toward = toward + np.sin(ELEVATION) * vertical
    right = np.cross(vertical, toward)
    right /= np.linalg.norm(right)
    low, high = scene.rest.min(axis=0), scene.rest.max(axis=0)
    return Camera(right, np.cross(toward, right), toward, (low + high) / 2)


def painter_order(camera: Camera, vertices: Floats, triangles: Ints) -> Ints:
    """Indices of all faces, far ones first: the order in which a painter covers them."""
    depth = (vertices @ camera.toward)[triangles].mean(axis=1)
    return np.argsort(depth, kind='stable').astype(np.int32)


def faces_viewer(camera: Camera, vertices: Floats, triangles: Ints) -> np.ndarray:
    """(t,) bool: the outer side of the face is turned to the viewer."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) @ camera.toward > 0.0


def is_closed(triangles: Ints) -> bool:
    """Whether every edge belongs to two faces."""
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    _, count = np.unique(edges, axis=0, return_counts=True)
    return bool((count == 2).all())


def visible_points(camera: Camera, points: Floats, cell: float, depth: float) -> np.ndarray:
    """(n,) bool: no other point of the same `cell` m square lies more than `depth` m in front."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    flat, near = camera.project(points)
    index = np.floor((flat - flat.min(axis=0)) / cell).astype(np.int64)
    shape = index.max(axis=0) + 3
    front = np.full(tuple(shape), -np.inf)
    np.maximum.at(front, (index[:, 0] + 1, index[:, 1] + 1), near)
    widest = front.copy()
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            widest = np.maximum(widest, np.roll(front, (i, j), axis=(0, 1)))
    return near > widest[index[:, 0] + 1, index[:, 1] + 1] - depth
