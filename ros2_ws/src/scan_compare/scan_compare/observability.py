# SPDX-License-Identifier: Apache-2.0
"""Which rigid motions the distances to a surface can see, and how well.

A motion (w, t) of a point p about a centre c changes its distance to the surface by
n . (w x (p - c) + t). The mean square of that change over all points, for a motion of unit size
(rotations measured as arc length at the root-mean-square radius), is the sensitivity squared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STRONG_SENSITIVITY = 0.05
"""Directions that change distances by less than this share are not left to the undeformed region
alone: an error of the model of 0.1 mm would become 2 mm of sliding."""

VISIBLE_SENSITIVITY = 0.01
"""Directions that change all distances by less than this share cannot be seen at all."""

CONTACT_SENSITIVITY = 0.1
"""Contacts fix a motion that moves them by at least this share of what it moves the scan."""


@dataclass(frozen=True)
class Motions:
    """Rows of the linearised distances.

    rows (n, 6): change of distance per rotation [m arc] and translation [m]; centre (3,) [m];
    radius [m]: arc length per radian.
    """

    rows: np.ndarray
    centre: np.ndarray
    radius: float


def motion_rows(points: np.ndarray, normals: np.ndarray) -> Motions:
    """Linearise the distances of `points` (n, 3) along `normals` (n, 3) in a rigid motion."""
    centre = points.mean(axis=0)
    arms = points - centre
    radius = float(np.sqrt(np.mean(np.sum(arms**2, axis=1)))) or 1.0
    return Motions(np.hstack((np.cross(arms, normals) / radius, normals)), centre, radius)


def information(rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the mean (6, 6) of row outer products, weighted by `weight` (n,)."""
    total = float(weight.sum())
    return (rows * weight[:, None]).T @ rows / (total if total > 0.0 else 1.0)


def split_by_contacts(
    hidden: np.ndarray, contacts: np.ndarray, centre: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Split unobservable motions (6, k) into those that move known contacts (c, 3) and the rest.

    Three contacts that do not lie on a line fix every motion; two leave the spin about their
    line. Each part spans its motions and may have other directions than `hidden`.
    """
    if not hidden.shape[1] or not len(contacts):
        return hidden[:, :0], hidden
    arms = (contacts - centre) / radius
    moved = [np.cross(hidden[:3].T, arm).T + hidden[3:] for arm in arms]
    values, vectors = np.linalg.eigh(sum(block.T @ block for block in moved) / len(arms))
    fixed = values > CONTACT_SENSITIVITY**2
    return hidden @ vectors[:, fixed], hidden @ vectors[:, ~fixed]


def describe_direction(direction: np.ndarray, centre: np.ndarray, radius: float) -> str:
    """Say in words what the unit motion `direction` (6,) does; lengths in millimetres."""
    turn, shift = direction[:3], direction[3:]
    if np.linalg.norm(turn) < 0.1:
        return f'translation along {_vector(shift / np.linalg.norm(shift))}'
    axis = turn / np.linalg.norm(turn)
    # a screw: the axis passes through the point that only moves along it
    rate = turn / radius
    point = centre + np.cross(rate, shift) / float(rate @ rate)
    return f'rotation about {_vector(axis)} through {_vector(1e3 * point)} mm'


def _vector(values: np.ndarray) -> str:
    # adding zero turns -0.00 into 0.00
    return '(' + ', '.join(f'{round(float(v), 2) + 0.0:.2f}' for v in values) + ')'
