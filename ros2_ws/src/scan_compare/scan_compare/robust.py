# SPDX-License-Identifier: Apache-2.0
"""Weights that keep dents, fingers and wrong depths from pushing the pose of a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan_compare.statistics import group_by_cell

TUKEY = 4.685
"""Tukey's constant: 95 % efficiency for Gaussian noise."""

CLUSTER = 5e-3
"""Size [m] of the patches that may deviate as a whole."""


def spread_of(distance: np.ndarray, least: float) -> float:
    """Return a robust scale of `distance`: the median of |d|, as a standard deviation.

    Not the median deviation: while the pose is still off, a common offset must not make every
    point an outlier.
    """
    return max(least, 1.4826 * float(np.median(np.abs(distance))))


def tukey(distance: np.ndarray, scale: float) -> np.ndarray:
    """Return Tukey's biweight (n,) of distances whose standard deviation is `scale`."""
    return np.maximum(0.0, 1.0 - (distance / (TUKEY * scale)) ** 2) ** 2


def tukey_slope(distance: np.ndarray, scale: float) -> np.ndarray:
    """Return the derivative (n,) of Tukey's weight times the distance."""
    share = np.minimum((distance / (TUKEY * scale)) ** 2, 1.0)
    return (1.0 - share) * (1.0 - 5.0 * share)


@dataclass(frozen=True)
class RobustWeights:
    """Weights of distances and how they follow them.

    weight (n,); slope (n,): derivative of weight times distance, the patches' weights kept; patch
    (n,) of each point; pull (patches,): derivative of a patch's weight times the sum of its
    otherwise weighted distances.
    """

    weight: np.ndarray
    slope: np.ndarray
    patch: np.ndarray
    pull: np.ndarray


def robust_weights(
    points: np.ndarray, distance: np.ndarray, rigid: np.ndarray, sigma: float
) -> RobustWeights:
    """Return the weights of the points of the undeformed region `rigid` (n,) bool.

    Tukey's biweight of single points, times weights that leave out patches which deviate as a
    whole: a dent that the model does not know ends in a skirt no deeper than the noise; the mean
    over a patch shows it where single points do not.
    """
    scale = spread_of(distance[rigid], sigma)
    single = np.where(rigid, tukey(distance, scale), 0.0)
    patch, count = group_by_cell(points, CLUSTER)
    members = np.bincount(patch, rigid, minlength=count)
    total = np.bincount(patch, np.where(rigid, distance, 0.0), minlength=count)
    mean = total / np.maximum(members, 1.0)
    seen = members > 0
    middle = float(np.median(mean[seen]))
    least = sigma / np.sqrt(float(np.median(members[seen])))
    spread = spread_of(mean[seen] - middle, least)
    common = tukey(mean - middle, spread)
    followed = tukey_slope(mean - middle, spread) - common
    pulled = np.bincount(patch, single * distance, minlength=count)
    off = np.where(mean == middle, 1.0, mean - middle)
    return RobustWeights(
        weight=single * common[patch],
        slope=np.where(rigid, tukey_slope(distance, scale), 0.0) * common[patch],
        patch=patch,
        pull=np.where(seen, followed / off * pulled, 0.0),
    )


def weight_beside_depth(distance: np.ndarray, depth: np.ndarray, sigma: float) -> np.ndarray:
    """Return Tukey's weights of points in the dents, a common error of their depth set aside."""
    weight = np.ones(len(distance))
    for _ in range(5):
        norm = float(weight @ depth**2)
        factor = float((weight * depth) @ distance) / norm if norm > 0.0 else 0.0
        remainder = distance - factor * depth
        weight = tukey(remainder, spread_of(remainder, sigma))
    return weight


def partialled_out(rows: np.ndarray, columns: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Remove from `rows` (n, k) what `columns` (n, m) explain as well, in the weighted sense.

    The solution then leaves a free factor on each column: of the dents' depth, of a uniform
    offset. Both are what a comparison is about and must not push the pose.
    """
    weighted = columns * weight[:, None]
    factors = np.linalg.lstsq(weighted.T @ columns, weighted.T @ rows, rcond=1e-12)[0]
    return rows - columns @ factors
