# SPDX-License-Identifier: Apache-2.0
"""Fitting a gauge's law to known weights, with what the fit leaves over.

The scatter that is published is for a 90 % interval of a normal distribution: what few weights
leave over is itself uncertain, so it is widened to that interval of Student's distribution, and it
is never less than the noise of the weighings, which no fit can have averaged away for sure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import norm, t

from barrett_hand_bridge.calibration import CalibrationError, GaugeCalibration
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.kinematics import GRAVITY_M_PER_S2, Array
from grasp_common import bounded_yaml

# What weight of the link, drift and temperature may add to an unloaded gauge (N m).
UNLOADED_NM = 0.1
# A mean count is one of at least so many readings, whose noise is all that the table tells.
FEWEST_READINGS = 4
HEADER = 'finger,mass_kg,arm_m,counts,noise_counts'


@dataclass(frozen=True)
class Weighing:
    """One known weight on one finger: its torque about joint 3, the mean and noise in counts."""

    torque_nm: float
    counts: float
    noise_counts: float


@dataclass(frozen=True)
class GaugeFit:
    """A fitted gauge and the residual torque of each weighing in N m."""

    gauge: GaugeCalibration
    weighings: tuple[Weighing, ...]
    residuals_nm: tuple[float, ...]

    @property
    def one_way(self) -> bool:
        """Whether the weights only rose, or only fell: then no hysteresis can be seen."""
        steps = np.diff([weighing.torque_nm for weighing in self.weighings])
        return bool((steps >= 0.0).all() or (steps <= 0.0).all())


def read_weighings(path: Path) -> dict[int, list[Weighing]]:
    """Read a CSV table of known weights.

    Header `finger,mass_kg,arm_m,counts,noise_counts`: a mass hung (negative: pulling the finger
    closed) at a horizontal arm from joint 3, the mean count and the standard deviation of single
    readings. Lines that start with # are comments.

    Raises:
        CalibrationError: missing file, other header, or a row that cannot be read, with its line.
    """
    try:
        lines = bounded_yaml.text_of(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f'{path}: cannot be read ({error})') from error
    return parse_weighings(lines, str(path))


def parse_weighings(lines: Sequence[str], name: str) -> dict[int, list[Weighing]]:
    """Read the lines of a table of known weights; `name` stands in front of complaints.

    Raises:
        CalibrationError: other header, or a row that cannot be read, with its line.
    """
    rows = [
        (number, line.strip())
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith('#')
    ]
    if not rows or rows[0][1].replace(' ', '') != HEADER:
        raise CalibrationError(f'{name}: the first line must be {HEADER!r}')
    table: dict[int, list[Weighing]] = {finger: [] for finger in FINGERS}
    for number, line in rows[1:]:
        try:
            finger_text, *numbers = line.split(',')
            finger = int(finger_text)
            mass, arm, counts, noise = (float(text) for text in numbers)
        except ValueError as error:
            raise CalibrationError(f'{name} line {number}: {line!r} ({error})') from error
        if finger not in FINGERS:
            raise CalibrationError(f'{name} line {number}: finger {finger}, must be 1, 2 or 3')
        if not all(math.isfinite(value) for value in (mass, arm, counts, noise)) or noise < 0.0:
            raise CalibrationError(f'{name} line {number}: {line!r} holds an impossible number')
        table[finger].append(Weighing(mass * arm * GRAVITY_M_PER_S2, counts, noise))
    return table


def fit_gauge(
    weighings: Sequence[Weighing],
    *,
    kind: str = 'cubic',
    degree: int = 3,
    zero: str = 'difference',
    highest_count: int = 255,
) -> GaugeFit:
    """Fit one gauge: a polynomial of `degree`, or a table of the mean counts themselves.

    Weighings whose noise reaches either end of the scale (0 to `highest_count`) are left out: a
    clipped mean is not the gauge's.

    Raises:
        CalibrationError: too few weights, none without load, or a law that does not rise.
    """
    weighings = [w for w in weighings if _unclipped(w, highest_count)]
    needed = degree + 2 if kind == 'cubic' else 3
    if len({round(w.torque_nm, 9) for w in weighings}) < needed:
        raise CalibrationError(f'{len(weighings)} weighings: this fit needs {needed} weights')
    torque = np.array([w.torque_nm for w in weighings])
    counts = np.array([w.counts for w in weighings])
    unloaded = counts[np.abs(torque) < 1e-9]
    if unloaded.size == 0:
        raise CalibrationError('no weighing without load: one row must have mass 0')
    reference = float(unloaded.mean())
    noise = float(np.sqrt(np.mean([w.noise_counts**2 for w in weighings])))
    span = float(np.ptp(counts))
    if span <= 0.0:
        raise CalibrationError('all weighings show the same count: is the gauge connected?')
    noise_nm = noise / math.sqrt(FEWEST_READINGS) * float(np.ptp(torque)) / span
    coefficients: tuple[float, ...] = ()
    table_counts: tuple[float, ...] = ()
    table_torque: tuple[float, ...] = ()
    if kind == 'cubic':
        coefficients, scatter, relative = _polynomial(
            counts, torque, reference, span, degree, noise_nm
        )
    else:
        table_counts, table_torque, left, apart = _table(counts, torque)
        scatter = max(_widened(left, len(left)), noise_nm)
        if apart.any():
            scatter = max(scatter, _widened(apart, len(torque) - len(table_torque)))
        relative = 1.0 / (math.sqrt(12.0) * span)
    law = GaugeCalibration(
        kind=kind,
        coefficients_nm=coefficients,
        counts=table_counts,
        torque_nm=table_torque,
        zero=zero,
        reference_counts=reference,
    )
    residuals = [law.law(w.counts) - w.torque_nm for w in weighings]
    if law.slope(reference, reference) <= 0.0:
        raise CalibrationError('torque falls with rising counts: check the signs of the masses')
    wide = UNLOADED_NM / law.slope(reference, reference)
    gauge = GaugeCalibration(
        kind=kind,
        coefficients_nm=coefficients,
        counts=table_counts,
        torque_nm=table_torque,
        zero=zero,
        reference_counts=reference,
        no_load_counts=(reference - wide, reference + wide),
        noise_counts=max(math.sqrt(max(noise**2 - 1.0 / 12.0, 0.0)), 0.0),
        residual_nm=scatter,
        relative_sigma=relative,
        valid_torque_nm=float(np.abs(torque).max()),
    )
    return GaugeFit(gauge, tuple(weighings), tuple(residuals))


def _unclipped(weighing: Weighing, highest_count: int) -> bool:
    margin = 3.0 * weighing.noise_counts + 0.5
    return margin <= weighing.counts <= highest_count - margin


def _widened(residuals: Array, freedom: int) -> float:
    """Scatter of residuals whose normal 90 % interval is that of Student's distribution."""
    scatter = math.sqrt(float(residuals @ residuals) / freedom)
    return scatter * float(t.ppf(0.95, freedom) / norm.ppf(0.95))


def _polynomial(
    counts: Array, torque: Array, reference: float, span: float, degree: int, noise_nm: float
) -> tuple[tuple[float, ...], float, float]:
    """Coefficients in powers of the raw count, scatter (N m), relative sigma at the largest one.

    The scatter is not less than `noise_nm`, the noise of the weighings.
    """
    scaled = (counts - reference) / span
    design = np.vander(scaled, degree + 1, increasing=True)
    solution, _, rank, _ = np.linalg.lstsq(design, torque, rcond=None)
    if rank < degree + 1:
        raise CalibrationError('the weights are too alike for this fit: use more different ones')
    left = torque - design @ solution
    scatter = max(_widened(left, len(torque) - degree - 1), noise_nm)
    covariance = scatter**2 * np.linalg.inv(design.T @ design)
    largest = int(np.argmax(np.abs(torque)))
    row = design[largest]
    relative = math.sqrt(float(row @ covariance @ row)) / abs(float(torque[largest]))
    law = np.polynomial.Polynomial(solution)(
        np.polynomial.Polynomial([-reference / span, 1 / span])
    )
    return tuple(float(c) for c in law.coef), scatter, relative


def _table(
    counts: Array, torque: Array
) -> tuple[tuple[float, ...], tuple[float, ...], Array, Array]:
    """Mean counts and torques of the levels, and what the table leaves over, in torques.

    A table passes through its own weights: only a level left out shows how well it tells others.
    So: how far the inner levels are off their neighbours, and how far each weighing is off the
    mean of its level, which keeps what a gauge that lags reads on the way up and on the way down.
    """
    levels = np.unique(torque)
    means = np.array([float(counts[torque == level].mean()) for level in levels])
    if np.any(np.diff(means) <= 0.0):
        raise CalibrationError('counts do not rise with the torque: check the signs of masses')
    share = (means[1:-1] - means[:-2]) / (means[2:] - means[:-2])
    told = levels[:-2] + share * (levels[2:] - levels[:-2])
    level = np.searchsorted(levels, torque)
    apart = (counts - means[level]) * np.gradient(levels, means)[level]
    return tuple(map(float, means)), tuple(map(float, levels)), told - levels[1:-1], apart


def fit_hand(
    table: Mapping[int, Sequence[Weighing]],
    *,
    kind: str = 'cubic',
    degree: int = 3,
    zero: str = 'difference',
    highest_count: int = 255,
) -> dict[int, GaugeFit]:
    """Fit every finger that has weighings.

    Raises:
        CalibrationError: with the finger's number in front.
    """
    fits: dict[int, GaugeFit] = {}
    for finger, weighings in table.items():
        if not weighings:
            continue
        try:
            fits[finger] = fit_gauge(
                weighings, kind=kind, degree=degree, zero=zero, highest_count=highest_count
            )
        except CalibrationError as error:
            raise CalibrationError(f'finger {finger}: {error}') from error
    if not fits:
        raise CalibrationError('the table holds no weighings')
    return fits
