# SPDX-License-Identifier: Apache-2.0
"""How far fingers have carried an object that nothing else holds, apart from its deformation.

Of all rigid motions of the unloaded shape the one that most of the surface follows: a dent is far
off it and hardly counts. Weights of Cauchy's distribution, found again from each fit (P. J. Huber,
Robust Statistics, 1981, section 7.8); the rotation by W. Kabsch (1976),
doi:10.1107/S0567739476001873.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.pose import Pose

Array = NDArray[np.float64]

ROUNDS = 8
MEDIAN_OF_NORMAL = 0.6745
FINEST = 1e-9
"""Spread below which all of the surface follows [m]."""


def carried(unloaded: Array, surface: Array, areas: Array) -> Pose:
    """The rigid motion from `unloaded` to `surface`, (n, 3) [m] each, with `areas` (n,) [m^2]."""
    weights = areas
    for _ in range(ROUNDS):
        pose = _fit(unloaded, surface, weights)
        off = np.linalg.norm(surface - pose.from_object(unloaded), axis=1)
        spread = max(float(np.median(off)) / MEDIAN_OF_NORMAL, FINEST)
        weights = areas / (1.0 + (off / spread) ** 2)
    return pose


def _fit(points: Array, moved: Array, weights: Array) -> Pose:
    """The rigid motion with the least weighted squares."""
    share = weights / weights.sum()
    centre, there = share @ points, share @ moved
    u, _, vt = np.linalg.svd((moved - there).T @ ((points - centre) * share[:, None]))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return Pose(rotation, there - rotation @ centre)
