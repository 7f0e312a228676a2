# SPDX-License-Identifier: Apache-2.0
"""Convex bodies of the hand's links with rounded edges, as binary STL in m.

`python -m barrett_hand_bridge.description.meshes` writes them again.

Dimensioned by the drawings: distances between joints and pads as in the kinematics, widths and
heights by the eye. They are for pictures and for collisions with room to spare, not for contact.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, HalfspaceIntersection

Array = npt.NDArray[np.float64]

FOLDER = Path(__file__).parent / 'meshes'
SIDES = 32
# Edges are rounded as a ball of this radius rolls over them; rings of the ball, and points a ring.
STL_ROW = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('unused', '<u2')])
ROUNDING_M, RINGS, AROUND = 4e-3, 5, 16


def rounded(outline: Sequence[tuple[float, float]], low: float, high: float) -> Array:
    """Triangles (n, 3, 3) of a convex outline in x and y between two z, its edges rounded.

    The hull of a ball that stands, in turn, in every corner of the body, inside by its radius.
    """
    corners = np.array(outline)
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Every side moved in by the radius; a side that is too short for it vanishes.
    offsets = ROUNDING_M - np.einsum('ij,ij->i', normals, corners)
    halves = np.column_stack([normals, offsets])
    inner = HalfspaceIntersection(halves, corners.mean(axis=0)).intersections
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, RINGS)
    longitude = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ball = ROUNDING_M * np.array(
        [
            (np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a))
            for a in latitude
            for b in longitude
        ]
    )
    centres = [(x, y, z) for x, y in inner for z in (low + ROUNDING_M, high - ROUNDING_M)]
    points = (np.array(centres)[:, None] + ball).reshape(-1, 3)
    hull = ConvexHull(points)
    triangles = points[hull.simplices]
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    turned = np.einsum('ij,ij->i', across, hull.equations[:, :3]) < 0.0
    triangles[turned] = triangles[turned][:, ::-1]
    return np.asarray(triangles[np.linalg.norm(across, axis=1) > 1e-14])


def disc(radius: float) -> list[tuple[float, float]]:
    """Corners of a round outline."""
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    return [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles]


def bodies() -> dict[str, Array]:
    """Triangles of each link in its own frame, by name.

    A knuckle carries its finger 50 mm from the spread axis; the inner link is 70 mm long; the
    outer one 55.4 mm, its pad 9.5 mm above the line from joint to tip. x points along each link.
    """
    outline = [(-0.013, -0.011), (0.012, -0.013), (0.078, -0.011), (0.084, 0.0), (0.078, 0.009)]
    inner = [*outline, (-0.011, 0.012)]
    outer = [
        (-0.011, -0.010), (0.045, -0.009), (0.0554, -0.002), (0.0554, 0.002), (0.050, 0.0095),
        (-0.006, 0.0095), (-0.012, 0.004),
    ]  # fmt: skip
    knuckle = [(-0.014, -0.014), (0.060, -0.014), (0.064, 0.0), (0.060, 0.014), (-0.014, 0.014)]
    return {
        'palm': rounded(disc(0.045), 0.0, 0.0725),
        'knuckle': rounded(knuckle, -0.011, 0.011),
        'inner_link': rounded(inner, -0.010, 0.010),
        'outer_link': rounded(outer, -0.0085, 0.0085),
    }


def stl(triangles: Array) -> bytes:
    """A binary STL file."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), STL_ROW)
    rows['normal'], rows['corners'] = normals, triangles
    return bytes(80) + np.uint32(len(triangles)).tobytes() + rows.tobytes()


def main() -> int:
    """Write the files again."""
    FOLDER.mkdir(exist_ok=True)
    for name, triangles in bodies().items():
        (FOLDER / f'{name}.stl').write_bytes(stl(triangles))
    return 0


if __name__ == '__main__':
    sys.exit(main())
