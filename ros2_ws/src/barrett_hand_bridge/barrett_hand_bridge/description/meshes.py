# SPDX-License-Identifier: Apache-2.0
"""Simple convex bodies of the hand's links, as binary STL in m: `python -m ...description.meshes`.

Dimensioned by the drawings: distances between joints and pads as in the kinematics, widths and
heights by the eye. They are for pictures and for collisions with room to spare, not for contact.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FOLDER = Path(__file__).parent / 'meshes'
SIDES = 16


def prism(outline: Sequence[tuple[float, float]], low: float, high: float) -> Array:
    """Triangles (n, 3, 3) of a convex outline in x and y, counter-clockwise, between two z."""
    count = len(outline)
    bottom = np.array([(x, y, low) for x, y in outline])
    top = np.array([(x, y, high) for x, y in outline])
    faces = []
    for k in range(1, count - 1):
        faces.append((bottom[0], bottom[k + 1], bottom[k]))
        faces.append((top[0], top[k], top[k + 1]))
    for k in range(count):
        after = (k + 1) % count
        faces.append((bottom[k], bottom[after], top[after]))
        faces.append((bottom[k], top[after], top[k]))
    return np.array(faces)


def turned(triangles: Array, axes: tuple[int, int, int]) -> Array:
    """The same body with its axes in another order, which must be an even one."""
    return triangles[..., axes]


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
        'palm': prism(disc(0.045), 0.0, 0.0725),
        'knuckle': prism(knuckle, -0.011, 0.011),
        'inner_link': prism(inner, -0.010, 0.010),
        'outer_link': prism(outer, -0.0085, 0.0085),
    }


def stl(triangles: Array) -> bytes:
    """A binary STL file."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(
        len(triangles), [('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('unused', '<u2')]
    )
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
