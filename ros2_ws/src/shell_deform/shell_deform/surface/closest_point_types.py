# SPDX-License-Identifier: Apache-2.0
"""What the closest-point searches read and fill, as named tuples, and their limits."""

from __future__ import annotations

from typing import NamedTuple

from .control_mesh import BoolArray, FloatArray, IntArray


class Patches(NamedTuple):
    """The patches of a mesh of m triangles, as flat arrays; c kinds of patches.

    Attributes:
        patch, node_offsets: (m,) kind of each triangle, and where its control points start in
            `nodes`.
        neighbour: (3m,) half-edge on the other side of each half-edge, or -1 where the active
            surface ends.
        sizes: (c,) control points of each kind.
        halvings: (c,) how often to split it towards an irregular corner.
        child: (c, 4) kinds of the children, -1 for regular ones.
        child_offset: (c, 4) start of each child's matrix in `matrices`.
        polynomial_offset: (c,) start of each regular one's matrix in `matrices`, else -1.
        matrices: all matrices in row order: child control points, or the fifteen monomial
            coefficients, from the patch's control points.
    """

    patch: IntArray
    node_offsets: IntArray
    nodes: IntArray
    neighbour: IntArray
    sizes: IntArray
    halvings: IntArray
    child: IntArray
    child_offset: IntArray
    polynomial_offset: IntArray
    matrices: FloatArray


class Feet(NamedTuple):
    """What one search from given starts finds.

    Attributes:
        triangle: (q,), parameters: (q, 2): where each foot lies.
        position: (q, 3) of it [m]. normal: (q, 3) unit normal there.
        on_boundary: (q,) whether it lies on the end of the surface.
        sure: (q,) False where another foot nearby may be nearer.
    """

    triangle: IntArray
    parameters: FloatArray
    position: FloatArray
    normal: FloatArray
    on_boundary: BoolArray
    sure: BoolArray


MAXIMUM_STEPS = 60
HALVINGS = 12
STEP_TOLERANCE = 1e-10
ROUND_OFF_STEP = 1e-5
"""A refused step below this is round-off of the distance, not a search that failed."""
ON_EDGE = 1e-12
LEAST_BEND = 1e-4
"""Newton's method takes bends of the squared distance to be at least this, a plane's being 1."""
SURE_BEND = 0.5
"""With less bend than this, another foot nearby may be nearer."""
