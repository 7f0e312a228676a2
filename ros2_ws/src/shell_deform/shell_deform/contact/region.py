# SPDX-License-Identifier: Apache-2.0
"""How much of a shell's face a rigid body touches, read between its contact points.

A region ends somewhere between two contact points: counting those that are pressed misses its
radius by a good part of their distance. The distances of the six points of a triangle belong to
one quadratic function, and what lies below its zero is touched.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shell_deform.contact.contact_field import Face, Memory, Touch
from shell_deform.contact.outer_face import POINTS_PER_TRIANGLE
from shell_deform.surface.quadrature import triangle_rule

Array = NDArray[np.float64]

PARTS = 8
"""A triangle is looked at in so many parts squared."""


def pressed_areas(face: Face, memory: Memory, touch: Touch) -> Array:
    """(p,) undeformed area of the region that each pressed point stands for [m^2].

    Of all that the body touches each point has what is nearest to it. `memory` is that of the
    state in which the body does what `touch` says. A point on an edge that ends the surface has
    its own area.
    """
    inner = POINTS_PER_TRIANGLE * (int(face.element.max(initial=-1)) + 1)
    pressed = touch.face.at
    areas, own = np.array(touch.weights), pressed < inner
    if not own.any():
        return areas
    distance = memory.distance[touch.body, :inner].reshape(-1, POINTS_PER_TRIANGLE)
    size = face.weights[:inner].reshape(distance.shape).sum(axis=1)
    near = np.flatnonzero(distance.min(axis=1) < np.sqrt(size))
    below = distance[near] @ _parts().T < 0.0
    # Triangles that are touched all over keep the areas of their points.
    rim = ~(below.all(axis=1) & (distance[near] < 0.0).all(axis=1))
    near, below = near[rim], below[rim]
    triangle, part = np.nonzero(below)
    anchor = memory.anchor[touch.body]
    corners = anchor[:inner].reshape(*distance.shape, 3)[near[triangle]]
    places = np.einsum('sk,ski->si', _parts()[part], corners)
    nearest = cKDTree(anchor[pressed[own]]).query(places)[1]
    own_triangle = pressed[own] // POINTS_PER_TRIANGLE
    share = size / PARTS**2
    split = np.isin(own_triangle, near)
    found = np.where(split, 0.0, touch.weights[own])
    found += np.bincount(nearest, share[near[triangle]], len(found))
    # Where no part has its middle in the region, a point that presses stands for one itself.
    areas[own] = np.maximum(found, share[own_triangle])
    return areas


@cache
def _parts() -> Array:
    """(PARTS^2, 6) value in the middle of each part of a triangle, from those at its points."""
    i, j = np.divmod(np.arange(PARTS**2), PARTS)
    upright = i + j < PARTS
    # Parts that stand upside down fill the other half of the square.
    u = np.where(upright, i + 1.0 / 3.0, PARTS - i - 1.0 / 3.0) / PARTS
    v = np.where(upright, j + 1.0 / 3.0, PARTS - j - 1.0 / 3.0) / PARTS
    known = _quadratic(*triangle_rule(POINTS_PER_TRIANGLE)[0].T)
    return np.asarray(_quadratic(u, v) @ np.linalg.inv(known))


def _quadratic(u: Array, v: Array) -> Array:
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
