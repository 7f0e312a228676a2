# SPDX-License-Identifier: Apache-2.0
"""The mesh that the ball's peers share: an octant graded towards the pole, and the pin on it."""

from __future__ import annotations

import numpy as np

RADIUS, THICKNESS, YOUNG, POISSON, PIN = 31.25, 2.5, 1.0, 0.49, 2.0
GRADING = 1.5


def octant(edge: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles of one octant, graded towards the pole z."""
    number: dict[tuple[int, int], int] = {}
    points = []
    for row in range(edge + 1):
        down = 0.5 * np.pi * (row / edge) ** GRADING
        for k in range(row + 1):
            around = 0.5 * np.pi * k / max(row, 1)
            number[row, k] = len(points)
            points.append(
                [np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)]
            )
    triangles = []
    for row in range(edge):
        for k in range(row + 1):
            triangles.append([number[row, k], number[row + 1, k], number[row + 1, k + 1]])
            if k < row:
                triangles.append([number[row, k], number[row + 1, k + 1], number[row, k + 1]])
    return RADIUS * np.array(points), np.array(triangles)


def sphere(edge: int) -> tuple[np.ndarray, np.ndarray]:
    """The octant mirrored to the whole sphere."""
    points, triangles = octant(edge)
    for axis in range(3):
        mirrored = points * np.where(np.arange(3) == axis, -1.0, 1.0)
        both = np.concatenate([points, mirrored])
        faces = np.concatenate([triangles, triangles[:, ::-1] + len(points)])
        _, first, inverse = np.unique(
            np.round(both, 6), axis=0, return_index=True, return_inverse=True
        )
        points, triangles = both[first], inverse.reshape(-1)[faces]
    return points, triangles


def pin_weights(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) share of a unit force, spread evenly over the arc <= PIN about the pole z, per node."""
    weights = np.zeros(len(points))
    corners = points[triangles]
    top = np.flatnonzero(np.all(corners[:, :, 2] > 0.5 * RADIUS, axis=1))
    for k in range(30):
        arc = PIN * np.sqrt((k + 0.5) / 30)
        for j in range(48):
            around = 2.0 * np.pi * (j + 0.5) / 48
            ray = np.array(
                [
                    np.sin(arc / RADIUS) * np.cos(around),
                    np.sin(arc / RADIUS) * np.sin(around),
                    np.cos(arc / RADIUS),
                ]
            )
            rays = np.tile(ray, (len(top), 1))[..., None]
            inside = np.linalg.solve(np.swapaxes(corners[top], 1, 2), rays)
            found = int(np.argmax(inside[:, :, 0].min(axis=1)))
            share = inside[found, :, 0]
            if share.min() > -1e-9:
                weights[triangles[top[found]]] += share / share.sum()
    return weights / (30 * 48)
