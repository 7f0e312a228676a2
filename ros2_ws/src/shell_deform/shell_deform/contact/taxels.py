# SPDX-License-Identifier: Apache-2.0
"""What the cells of a touch array feel of a contact: forces, never pressures at points.

A thin shell carries a flat finger on a ring so narrow that its pressure has no limit as meshes
become finer; the integral over a cell has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shell_deform.contact.cell_load import square_parts
from shell_deform.contact.contact_field import Touch

Array = NDArray[np.float64]


PARTS = 4
"""A pressed point stands for a square that is cut into so many parts squared."""


def point_shares(touch: Touch, centres: Array) -> Array:
    """(c, p) how much of each pressed point lies on each cell of a body; columns sum to 1.

    `centres` (c, 3): of the cells in the body's frame [m]. A point stands for a square of its own
    area along the pad, each part of which loads the cell nearest to it: the cells together carry
    the whole force, and none of it jumps from cell to cell where a point passes between them.
    """
    count = len(touch.weights)
    if not count:
        return np.zeros((len(centres), 0))
    parts = square_parts(PARTS)
    within = np.sqrt(touch.weights)[:, None, None] * parts
    places = touch.pose.inside(touch.face.position)[:, None] + within
    cell = cKDTree(centres).query(places.reshape(-1, 3))[1]
    flat = cell * count + np.repeat(np.arange(count), len(parts))
    return np.bincount(flat, minlength=len(centres) * count).reshape(-1, count) / len(parts)


def cell_forces(touch: Touch, centres: Array) -> Array:
    """(c, 3) forces of the shell on the cells of a body [N], in the body's frame.

    `centres` (c, 3): of the cells in that frame [m]; see `point_shares`.
    """
    if not len(centres):
        return np.zeros((0, 3))
    return np.asarray(point_shares(touch, centres) @ (-touch.forces @ touch.pose.turn))


@dataclass(frozen=True)
class FingerReading:
    """What one rigid body feels of the shell; integrals over its contact region.

    Attributes:
        push: pressure, friction: its shear, each summed over the region as lengths [N].
        area: of the region on the undeformed shell, sticking: of its part that sticks [m^2].
        points: contact points in it. cells: (c, 3) on its touch cells, in its own frame [N].
    """

    push: float
    friction: float
    area: float
    sticking: float
    points: int
    cells: Array


def finger_reading(touch: Touch, areas: Array, centres: Array) -> FingerReading:
    """What the body of a contact feels; `centres` (c, 3) of its cells, in its frame [m].

    `areas` (p,): of its region, by `pressed_areas`.
    """
    weights = touch.weights
    return FingerReading(
        push=float(weights @ touch.pressure),
        friction=float(weights @ np.linalg.norm(touch.friction, axis=1)),
        area=float(areas.sum()),
        sticking=float(areas[touch.sticking].sum()),
        points=len(weights),
        cells=cell_forces(touch, centres) if len(centres) else np.zeros((0, 3)),
    )
