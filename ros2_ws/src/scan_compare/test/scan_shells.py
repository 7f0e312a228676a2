# SPDX-License-Identifier: Apache-2.0
"""Shells with known shape for the tests: Loop surfaces through given points, and scans of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scan_compare.deformed_surface import DeformedSurface, surface_from_limit_positions
from shell_deform.surface.control_mesh import control_mesh
from shell_deform.surface.limit import LimitSurface

BALL_RADIUS = 0.03125
BALL_THICKNESS = 0.0025
SCANNER_SIGMA = 0.127e-3

Displacement = Callable[[np.ndarray], np.ndarray]


def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit sphere: vertices (n, 3), triangles (m, 3); 642 vertices for three subdivisions."""
    t = (1.0 + 5.0**0.5) / 2.0
    vertices = [
        (-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t),
        (0, -1, -t), (0, 1, -t), (t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1),
    ]  # fmt: skip
    faces = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
        (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
        (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ]  # fmt: skip
    points = np.array(vertices, float)
    triangles = np.array(faces)
    for _ in range(subdivisions):
        edges = np.sort(
            np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]),
            axis=1,
        )
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = len(points) + inverse.reshape(3, -1).T
        points = np.concatenate([points, points[unique].mean(axis=1)])
        a, b, c = triangles.T
        ab, bc, ca = middle.T
        triangles = np.concatenate(
            [np.column_stack(x) for x in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )
    return points / np.linalg.norm(points, axis=1, keepdims=True), triangles


def two_dents(depth: float, width: float = 0.008, bulge: float = 0.0) -> Displacement:
    """Displacement of a ball pressed along z from both sides; `bulge` widens the equator."""

    def displacement(points: np.ndarray) -> np.ndarray:
        radius = np.linalg.norm(points, axis=1, keepdims=True)
        direction = points / radius
        lateral = np.hypot(points[:, 0], points[:, 1])
        inward = depth * np.exp(-((lateral / width) ** 2))
        along = np.zeros_like(points)
        along[:, 2] = -np.sign(points[:, 2]) * inward
        return along + bulge * (1.0 - direction[:, 2:] ** 2) * direction

    return displacement


def shell(
    middle: np.ndarray, triangles: np.ndarray, thickness: float, field: Displacement | None = None
) -> DeformedSurface:
    """Shell whose limit surface passes through `middle` (n, 3), moved by `field` there."""
    topology = LimitSurface(control_mesh(middle, triangles))
    deformed = middle if field is None else middle + field(middle)
    return surface_from_limit_positions(topology, middle, deformed, thickness)


def ball(field: Displacement | None = None, subdivisions: int = 3) -> DeformedSurface:
    """The tennis ball's middle surface (outer diameter 65 mm, wall 2.5 mm)."""
    points, triangles = icosphere(subdivisions)
    return shell(BALL_RADIUS * points, triangles, BALL_THICKNESS, field)


def odd_body(field: Displacement | None = None) -> DeformedSurface:
    """A closed body without any symmetry, about 60 mm large."""
    points, triangles = icosphere(3)
    x, y, z = points.T
    radius = 1.0 + 0.15 * x + 0.12 * x * y + 0.1 * y * z**2 - 0.14 * z * x**2 + 0.08 * y**3
    scale = np.array([0.032, 0.027, 0.023])
    return shell(points * radius[:, None] * scale, triangles, BALL_THICKNESS, field)


def half_can(field: Displacement | None = None) -> DeformedSurface:
    """Half of a soda can: radius 33 mm, length 100 mm, wall 0.1 mm, open at its boundary."""
    columns, rows = 25, 25
    angle, height = np.meshgrid(
        np.linspace(0.0, np.pi, columns), np.linspace(-0.05, 0.05, rows), indexing='ij'
    )
    radius = 0.033
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    index = np.arange(columns * rows).reshape(columns, rows)
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    triangles = np.concatenate([np.column_stack((a, b, c)), np.column_stack((a, c, d))])
    return shell(points.reshape(-1, 3), triangles, 0.0001, field)


def scan_points(
    surface: DeformedSurface, count: int, sigma: float = SCANNER_SIGMA, seed: int = 1
) -> np.ndarray:
    """Points (about count, 3) evenly over the outer face with isotropic noise `sigma`."""
    generator = np.random.default_rng(seed)
    samples = surface.samples
    chosen = generator.choice(len(samples.area), count, p=samples.area / samples.area.sum())
    parameters = generator.random((count, 2))
    flip = parameters.sum(axis=1) > 1.0
    parameters[flip] = 1.0 - parameters[flip]
    points = surface.evaluate(samples.triangle[chosen], parameters).position
    return points + sigma * generator.standard_normal(points.shape)


def occlude(points: np.ndarray, share: float, direction: np.ndarray) -> np.ndarray:
    """Drop the `share` of the points that lies furthest along `direction`."""
    along = points @ (direction / np.linalg.norm(direction))
    return points[along <= np.quantile(along, 1.0 - share)]
