# SPDX-License-Identifier: Apache-2.0
"""Cuts through the dent: where a plane meets a triangulated face and its scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera import dent_axis, side_direction
from .scene import Floats, Ints, RowScene


@dataclass(frozen=True)
class DentSection:
    """Cuts of one row in the plane of the contact axis.

    Each surface: (s, 2, 2) m, segments as end points (across, along); `along` counts from the
    rest face at the contact, negative = into the body. scan: (n, 2) m, points within
    `half_width_m` of the plane.
    """

    rest: Floats
    nonlinear: Floats
    linear: Floats
    scan: Floats
    half_width_m: float


def level_lines(vertices: Floats, triangles: Ints, values: Floats, level: float) -> Floats:
    """Segments (s, 2, 3) m on which `values` (v,), linear in each face, equals `level`."""
    height = values - level
    # A vertex exactly on the level would give segments of no length or twice the same one.
    height = np.where(height == 0.0, np.finfo(float).tiny, height)
    above = (height > 0)[triangles]
    crossed = above.any(axis=1) & ~above.all(axis=1)
    faces, above = triangles[crossed], above[crossed]
    # The corner alone on its side: both cut edges meet there.
    single = above.sum(axis=1) == 1
    alone = np.where(single, above.argmax(axis=1), (~above).argmax(axis=1))
    row = np.arange(len(faces))
    first = faces[row, alone]
    ends = []
    for step in (1, 2):
        other = faces[row, (alone + step) % 3]
        weight = (height[first] / (height[first] - height[other]))[:, None]
        ends.append(vertices[first] + weight * (vertices[other] - vertices[first]))
    return np.stack(ends, axis=1)


def cut(vertices: Floats, triangles: Ints, normal: Floats, offset: float) -> Floats:
    """Segments (s, 2, 3) m in which the plane normal . x = offset cuts the faces."""
    return level_lines(vertices, triangles, vertices @ normal, offset)


def dent_section(scene: RowScene, half_width_m: float = 0.75e-3) -> DentSection:
    """Cut a row through its first contact, in the plane of the contact axis (SI, m)."""
    axis = dent_axis(scene)
    side = side_direction(axis)
    normal = np.cross(axis, side)
    centre = scene.rest.mean(axis=0)
    top = float(((scene.rest - centre) @ axis).max())
    frame = np.stack([side, axis], axis=1)
    shift = np.array([0.0, top])

    def flat(vertices: Floats) -> Floats:
        segments = cut(vertices, scene.triangles, normal, float(centre @ normal))
        return (segments - centre) @ frame - shift

    moved = scene.scan_points - centre
    near = np.abs(moved @ normal) <= half_width_m
    return DentSection(
        flat(scene.rest),
        flat(scene.nonlinear),
        flat(scene.linear),
        moved[near] @ frame - shift,
        half_width_m,
    )
