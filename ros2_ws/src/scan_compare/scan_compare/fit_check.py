# SPDX-License-Identifier: Apache-2.0
"""Whether a registration that settled is one: signs of another object, a mirror image, outliers.

A robust fit always settles somewhere, and its scale widens until most points belong to it. What
gives it away: distances far above the scanner's noise, few points within that noise, a mirror
image that fits better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.pose_search import search_pose

LARGEST_RMS = 3.0
"""An rms of so many scanner sigmas is no noise: with one degree of freedom 0.3 % lie beyond."""

SMALLEST_SHARE = 0.5
"""Fewer scan points than this share within LARGEST_RMS sigmas of the surface are no scan of it."""

SUSPICIOUS_RMS = 2.0
"""From this many scanner sigmas on, the mirror image is tried."""

BETTER = 0.7
"""A mirror image whose trimmed rms is this share of the scan's own fits better."""

MIRROR_POINTS = 1_500


@dataclass(frozen=True)
class FitCheck:
    """What was measured of a fit, and the sentences that speak against it.

    explained: share of the points outside dents that lie within LARGEST_RMS scanner sigmas of the
    surface. doubts: empty for a fit that may be trusted.
    """

    explained: float
    doubts: tuple[str, ...]


def check_fit(
    points: np.ndarray,
    surface: DeformedSurface,
    distance: np.ndarray,
    outside: np.ndarray,
    rms: float,
    sigma: float,
) -> FitCheck:
    """Judge a fit of scan `points` (n, 3) [m], still in their own frame.

    distance (n,): signed, at the pose found; outside (n,): which points are no part of a dent;
    rms: of the distances that the fit used; sigma: scanner noise of one point [m].
    """
    explained = float(np.mean(np.abs(distance[outside]) < LARGEST_RMS * sigma))
    doubts = []
    if rms > LARGEST_RMS * sigma:
        doubts.append(
            f'the scan does not fit: rms {1e3 * rms:.2f} mm at a scanner sigma of '
            f'{1e3 * sigma:.3f} mm; check object, unit, size and start pose, or state the '
            "scanner's true sigma"
        )
    if explained < SMALLEST_SHARE:
        doubts.append(
            f'only {100 * explained:.0f} % of the scan outside the dents lies within '
            f'{LARGEST_RMS:g} sigma of the surface: cut away what is not the object'
        )
    if rms > SUSPICIOUS_RMS * sigma and _mirror_fits_better(points, surface, sigma):
        doubts.append('the mirror image of the scan fits better: check the axes of the scanner')
    return FitCheck(explained, tuple(doubts))


def _mirror_fits_better(points: np.ndarray, surface: DeformedSurface, sigma: float) -> bool:
    few = points[:MIRROR_POINTS]
    usable = np.ones(len(few), bool)
    own = search_pose(few, usable, surface, sigma)
    mirrored = search_pose(few * np.array([-1.0, 1.0, 1.0]), usable, surface, sigma)
    return mirrored.rms_m < BETTER * own.rms_m
