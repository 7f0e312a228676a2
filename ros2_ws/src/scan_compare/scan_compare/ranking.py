# SPDX-License-Identifier: Apache-2.0
"""Verdict between two models of the same scan: only beyond the noise floor, by a paired test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from scan_compare.comparison import Comparison
from scan_compare.statistics import group_by_cell

CORRELATION_LENGTH = 5e-3
"""Differences further apart than this [m] count as independent: what the views of the scan have in
common drops out of them."""

SIGNIFICANCE = 0.01
"""Largest probability of the observed difference if both models were equally good."""


@dataclass(frozen=True)
class Verdict:
    """Outcome of a paired comparison of models A and B.

    better: 'A', 'B' or None (no verdict); difference_m: mean |error of A| - |error of B| over the
    points both use [m]; floor_m: what a difference must exceed; p_value: of the paired test over
    `patches` patches; text: the verdict in a sentence.
    """

    better: str | None
    difference_m: float
    floor_m: float
    p_value: float
    patches: int
    text: str


def rank(a: Comparison, b: Comparison, names: tuple[str, str] = ('A', 'B')) -> Verdict:
    """Say which of two models fits the same scan better, if the scan can tell.

    Differences of |error| are averaged over patches of CORRELATION_LENGTH, which count as
    independent, and tested by Student's paired test. A verdict also needs the mean difference to
    exceed the floor: the larger of the scanner's noise floor and the residual of the undeformed
    region. Raises ValueError if the comparisons are not of the same scan points.
    """
    if len(a.points) != len(b.points):
        raise ValueError(
            f'{len(a.points)} and {len(b.points)} scan points: a paired test needs the same scan'
        )
    both = a.used & b.used
    if not both.any():
        raise ValueError('no scan point lies on both surfaces')
    difference = np.abs(a.distances.distance[both]) - np.abs(b.distances.distance[both])
    patch, count = group_by_cell(a.distances.foot[both], CORRELATION_LENGTH)
    weight = np.bincount(patch, minlength=count) / len(difference)
    patch_mean = np.bincount(patch, difference, minlength=count) / np.bincount(patch)
    mean = float(difference.mean())
    spread = float(np.sqrt(np.sum((weight * (patch_mean - mean)) ** 2)))
    effective = 1.0 / float(np.sum(weight**2))
    p_value = 1.0
    if spread > 0.0 and effective > 2.0:
        p_value = float(2.0 * student.sf(abs(mean) / spread, effective - 1.0))
    residuals = [c.undeformed_residual_m for c in (a, b) if c.undeformed_residual_m is not None]
    floor = max(a.noise_floor_m, min(residuals, default=0.0))
    if abs(mean) <= floor:
        text = (
            f'no verdict: {names[0]} and {names[1]} differ by {1e3 * abs(mean):.3f} mm, '
            f'within the floor of {1e3 * floor:.3f} mm'
        )
        return Verdict(None, mean, floor, p_value, count, text)
    if p_value > SIGNIFICANCE:
        text = (
            f'no verdict: the difference of {1e3 * abs(mean):.3f} mm between {names[0]} and '
            f'{names[1]} is not significant (p = {p_value:.2g}, {count} patches)'
        )
        return Verdict(None, mean, floor, p_value, count, text)
    better, winner, loser = ('A', *names) if mean < 0.0 else ('B', *names[::-1])
    text = (
        f'{winner} is better than {loser} by {1e3 * abs(mean):.3f} mm '
        f'(floor {1e3 * floor:.3f} mm, p = {p_value:.2g}, {count} patches)'
    )
    return Verdict(better, mean, floor, p_value, count, text)
