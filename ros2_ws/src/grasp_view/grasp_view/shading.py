# SPDX-License-Identifier: Apache-2.0
"""Light on a coloured surface that never changes the order of its colours.

An unlit ball is a disc: shape is read from shading. But a colour is a value here, so light may
only darken it, by no more than the map's steps leave room for (a test measures that), and a
hollow is darkened a little more, as it is in daylight.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .colour_map import Bytes, linear_light
from .poses import Floats
from .smooth_faces import Ints

# From above and a little from the viewer's side, fixed in the scene: eyes assume that.
LIGHT = np.array([-0.17, -0.33, 0.93]) / np.linalg.norm([-0.17, -0.33, 0.93])
# The darkest light, as a share of linear light; where no value is read it may be darker.
DARKEST, DARKEST_UNREAD, UNREAD_SHARE = 0.65, 0.50, 0.03
HOLLOW_GAIN = 1.15
# Radii round a vertex, as shares of the body's middle extent, that tell a hollow.
HOLLOW_REACH = (0.062, 0.14)


def normals_of(vertices: Floats, triangles: Ints) -> Floats:
    """Unit normals (n, 3) of vertices, mean of the faces' by area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    where = triangles.T.ravel()
    total = np.stack(
        [np.bincount(where, np.tile(across[:, k], 3), len(vertices)) for k in range(3)], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(length > 0.0, length, 1.0))


class Hollow:
    """How much deeper than at rest each vertex lies in its surroundings; made once a mesh."""

    def __init__(self, rest: Floats, triangles: Ints) -> None:
        """rest (n, 3) m."""
        # Imported with the first mesh: SciPy takes half of the page's start.
        from scipy.sparse import csr_matrix
        from scipy.spatial import cKDTree

        extent = float(np.median(np.ptp(rest, axis=0)))
        tree = cKDTree(rest)
        self._triangles = triangles
        self._means: list[tuple[Any, float]] = []
        for share in HOLLOW_REACH:
            reach = share * extent
            near = tree.sparse_distance_matrix(tree, reach, output_type='coo_matrix')
            # The matrix leaves a vertex itself out; with it no row is empty.
            row = np.concatenate([near.row, np.arange(len(rest))])
            column = np.concatenate([near.col, np.arange(len(rest))])
            weight = 1.0 / np.bincount(row, minlength=len(rest))[row]
            shape = (len(rest), len(rest))
            self._means.append((csr_matrix((weight, (row, column)), shape=shape), reach))
        self._rest = self._depth(rest, normals_of(rest, triangles))

    def _depth(self, vertices: Floats, normals: Floats) -> Floats:
        total: Floats = np.zeros(len(vertices))
        for mean, reach in self._means:
            total += np.einsum('ij,ij->i', normals, mean @ vertices - vertices) / reach
        return total

    def depth(self, vertices: Floats, normals: Floats) -> Floats:
        """Positive (n,) in a dent, negative on a bulge, 0 where nothing moved."""
        return self._depth(vertices, normals) - self._rest


def light_on(normals: Floats, hollow: Floats, share: Floats) -> Floats:
    """Shares of linear light (n,): 1 or less, never below `DARKEST` where a value is read.

    share (n,): the value on its scale, NaN where unknown.
    """
    lowest = np.where(np.nan_to_num(share) < UNREAD_SHARE, DARKEST_UNREAD, DARKEST)
    wrapped = np.clip((normals @ LIGHT + 0.38) / 1.36, 0.0, 1.0)
    soft = 0.75 * wrapped**2 * (3.0 - 2.0 * wrapped) + 0.25 * wrapped
    lit = lowest + (1.0 - lowest) * soft
    return np.clip(lit - HOLLOW_GAIN * np.maximum(hollow, 0.0), lowest, 1.0)


def lit_colours(colours: Bytes, light: Floats) -> Bytes:
    """sRGB colours (n, 3) under shares of light (n,)."""
    linear = linear_light(colours) * light[:, None]
    shown = np.where(
        linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
    return np.round(shown * 255.0).astype(np.uint8)
