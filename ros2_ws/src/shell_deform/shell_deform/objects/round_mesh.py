# SPDX-License-Identifier: Apache-2.0
"""Control meshes of spheres and ellipsoids, graded towards two poles."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .rings import ring_count_with_caps, ring_mesh, row_height

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LARGEST_STRETCH = 1.2
"""Rows may be that much higher than equilateral triangles to reach a wanted pole edge."""

FEWEST_AROUND = 24
"""Vertices around the equator below which a sphere counts as too coarse."""


def graded_sphere(vertices: int, pole_edge: float | None) -> tuple[FloatArray, IntArray]:
    """Triangulate the unit sphere with fine triangles at both poles of z.

    All vertices have six neighbours, but twelve that have five.

    Args:
        vertices: about how many vertices to use.
        pole_edge: wanted edge length at the poles as a share of the radius; None for triangles
            of about one size.

    Returns:
        Vertices (n, 3) on the unit sphere and outward triangles (m, 3).
    """
    best: tuple[float, int, int, float] | None = None
    for cap_rings in range(2, 200):
        around = 6 * cap_rings
        caps = ring_count_with_caps(cap_rings, 1, 2)
        if best is not None and caps > 1.05 * vertices:
            break
        rows = 1 + max(0, round((vertices - caps) / around))
        even = row_height(around)
        edge = pole_edge if pole_edge is not None else 2.0 * math.pi / around
        # From the equator to the rim of a cap whose innermost ring has the wanted edge.
        half_height = -math.log(math.tan(0.5 * min(edge, 2.0))) - math.log(cap_rings)
        needed = max(half_height, 1e-3) / (0.5 * rows) / even
        stretch = min(max(needed, 1.0 / LARGEST_STRETCH), LARGEST_STRETCH)
        # Few vertices around make long triangles at the equator; they cost as much as missing
        # the wanted edge at the poles.
        missed = abs(math.log(needed)) + abs(math.log(min(1.0, around / FEWEST_AROUND)))
        if best is None or missed < best[0]:
            best = missed, around, rows, stretch * even
    assert best is not None
    mesh = ring_mesh(*best[1:])
    full = mesh.height[(mesh.row >= 0) & (mesh.row < mesh.row.max())]
    height = mesh.height - 0.5 * (full.min() + full.max())
    polar = 2.0 * np.arctan(np.exp(height))
    points = np.column_stack(
        [
            np.sin(polar) * np.cos(mesh.longitude),
            np.sin(polar) * np.sin(mesh.longitude),
            -np.cos(polar),
        ]
    )
    return points, mesh.triangles


def turned_to(points: FloatArray, direction: FloatArray) -> FloatArray:
    """Turn points (n, 3) so that the z axis becomes the unit vector `direction`."""
    z = direction / np.linalg.norm(direction)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return points @ np.stack([x, np.cross(z, x), z])
