# SPDX-License-Identifier: Apache-2.0
"""Standard deviations: of a mean error, of where a point lies, of what merging does to a place.

A scan is made of views, each laid onto the others with an error of its own. Inside a view that
error is no noise: it moves a whole neighbourhood, and no number of points averages it out. How
large it is shows outside the dents, where two scans of one object, or a scan and its model, should
lie on each other.
"""

from __future__ import annotations

import numpy as np

from scan_compare.distance import Distances
from scan_compare.pose_covariance import groups_alike
from scan_compare.registration import Registration
from scan_compare.robust import spread_of
from scan_compare.statistics import group_by_cell

FEWEST_POINTS = 50
"""A neighbourhood of fewer scan points has no mean."""

FEWEST_PLACES = 5
"""Means of fewer neighbourhoods have no spread."""


def merging_sigma(
    foot: np.ndarray,
    distance: np.ndarray,
    reference: tuple[np.ndarray, np.ndarray] | None,
    size: float,
) -> float | None:
    """Return the standard deviation [m] of a scan's mean distance over neighbourhoods of `size`.

    foot (n, 3), distance (n,): of undeformed points to the model [m]. reference: the same of the
    scan at rest, whose means are taken off place by place, so that what is wrong with the model
    does not count; None leaves it in. None, unknown, for fewer than FEWEST_PLACES neighbourhoods.
    """
    parts = [(foot, distance)] if reference is None else [(foot, distance), reference]
    cell, cells = group_by_cell(np.concatenate([part[0] for part in parts]), size)
    difference = np.zeros(cells)
    seen = np.ones(cells, bool)
    sign, start = 1.0, 0
    for _, values in parts:
        own = cell[start : start + len(values)]
        count = np.bincount(own, minlength=cells)
        difference += sign * np.bincount(own, values, minlength=cells) / np.maximum(count, 1)
        seen &= count >= FEWEST_POINTS
        sign, start = -1.0, len(values)
    return spread_of(difference[seen], 0.0) if np.count_nonzero(seen) >= FEWEST_PLACES else None


def mean_error_sigma(
    distances: Distances, used: np.ndarray, found: Registration, views: np.ndarray | None = None
) -> float:
    """Return the standard deviation [m] of the mean unsigned distance.

    Two parts: the registration's covariance carried through the mean, and the scatter of means
    over groups of points whose errors are alike: views (n,) where they are numbered, else patches
    of the size that makes the mean least certain.
    """
    sign = np.sign(distances.distance[used])
    arms = distances.foot[used] - found.centre
    normal = distances.normal[used]
    gradient = np.concatenate((sign @ np.cross(arms, normal), sign @ normal)) / np.count_nonzero(
        used
    )
    from_pose = float(gradient @ found.covariance @ gradient)
    unsigned = np.abs(distances.distance[used])
    excess = unsigned - unsigned.mean()
    known = None if views is None else views[used]
    scatter = [float(excess @ excess)]
    for group in groups_alike(distances.foot[used], found.radius_m, known):
        sums: np.ndarray = np.bincount(group, excess)
        count = int(group.max()) + 1
        # The groups' own mean is taken off: few of them scatter less than they err.
        scatter.append(float(sums @ sums) * count / max(count - 1, 1))
    return float(np.sqrt(max(0.0, from_pose) + max(scatter) / unsigned.size**2))


def pose_sigma(
    poses: tuple[Registration | None, ...], point: np.ndarray, direction: np.ndarray
) -> float:
    """Return the standard deviation [m] of `point` (3,) along `direction` (3,) from poses."""
    variance = 0.0
    for found in poses:
        if found is not None:
            row = np.concatenate((np.cross(point - found.centre, direction), direction))
            variance += max(0.0, float(row @ found.covariance @ row))
    return float(np.sqrt(variance))
