# SPDX-License-Identifier: Apache-2.0
"""How a wall relaxes, from pushes at travel that stands still, and what they will be later.

Each standing travel is a level. With a share r lost for every decade of time, a finger feels

    push = sum over levels j of A_j (1 - r log10((t - t_j) / t_ref)) + drift,

A_j what the step to level j added. r is one for all fingers and levels. The drift of a gauge is a
random walk of known strength; least squares weigh with its covariance. On one level a drift that
slows down as relaxation does looks the same. On two it does not: relaxation goes with the force,
drift does not. Which of the two holds is found by leaving such drifts free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from shell_deform.identify.force_curve import IdentificationError
from shell_deform.theory.relaxation import Relaxation, RelaxationError, log_law

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BINS_PER_DECADE = 8
SHORTEST_HOLD_S = 5.0
STILL_M = 1e-4
"""Travel that stays within this of where it came to rest stands still."""
SETTLING = 3.0
"""A level counts from so many durations of the step to it on."""
PASSES = 12
IGNORANCE = 0.3
"""Sigma of the share a decade before anything is known."""
FREE_DRIFT_N = 100.0
SEPARABLE = 0.25
SMALL_SHARE = 0.005
NINETY = 1.6448536269514722
COUNT_N = 0.2
"""A count of the 8-bit gauge at 50 mm [N]."""
DRIFT_N = 0.02
"""Drift of its zero in a root minute, a tenth of a count [N]."""


@dataclass(frozen=True)
class HeldPushes:
    """n samples of f fingers; NaN where a finger says nothing.

    Attributes:
        time: (n,) [s], rising. push: (n, f) [N]. travel: (n, f) [m]. noise: of a push [N].
        quantum: a count of the gauge [N]. drift: of its zero, in a root minute [N].
    """

    time: Array
    push: Array
    travel: Array
    noise: float
    quantum: float
    drift: float

    @property
    def stuck(self) -> float:
        """What a mean of many whole counts is off by where noise does not dither them [N].

        The first harmonic of the error of quantisation under Gaussian noise.
        """
        dither = np.exp(-2.0 * (np.pi * self.noise / self.quantum) ** 2)
        return float(self.quantum / (np.sqrt(2.0) * np.pi) * dither)

    def __post_init__(self) -> None:
        back = np.flatnonzero(np.diff(self.time) < 0.0)
        if len(back):
            raise IdentificationError(
                f'the times run back: {self.time[back[0] + 1]:.3f} s after '
                f'{self.time[back[0]]:.3f} s; sort the samples'
            )


@dataclass(frozen=True)
class Level:
    """A travel that stands still: when the step to it was, from and until when it counts [s]."""

    began: float
    first: float
    last: float


@dataclass(frozen=True)
class RelaxationFit:
    """What the pushes say.

    Attributes:
        law: the share a decade with its sigma, from the first to the last time seen.
        levels: the standing travels. force: mean push on each [N].
        separable: whether drift and relaxation can be told apart. sigma_free: of the share when
            nothing is known of the drift.
        reduced_chi_square: near 1 when law and noise explain the pushes.
        statement: sentences.
    """

    law: Relaxation
    levels: tuple[Level, ...]
    force: Array
    separable: bool
    sigma_free: float
    reduced_chi_square: float
    statement: tuple[str, ...]
    _values: Array
    _covariance: Array

    @property
    def interval(self) -> tuple[float, float]:
        """90 % interval of the share a decade."""
        half = NINETY * self.law.sigma
        return float(self.law.per_decade or 0.0) - half, float(self.law.per_decade or 0.0) + half

    def force_at(self, time: float, finger: int = 0) -> tuple[float, float]:
        """Push of a finger at `time` [s] if its travel stays, and its sigma [N].

        Beyond the range that was seen the law is taken to go on.
        """
        rows = _design(np.array([time]), self.levels, self.law.reference)[0]
        count = len(self.levels)
        own = slice(1 + finger * count, 1 + (finger + 1) * count)
        rate, step = self._values[0], self._values[own]
        by = np.zeros(len(self._values))
        by[0], by[own] = -rows @ step, 1.0 - rate * rows
        by[own] *= np.array([time >= level.began for level in self.levels])
        return float(by[own] @ step), float(np.sqrt(by @ self._covariance @ by))


def fit_relaxation(data: HeldPushes, until: float = np.inf) -> RelaxationFit:
    """The law of all pushes up to `until` [s]. Raises IdentificationError where none is held."""
    levels = find_levels(data)
    levels = tuple(one for one in levels if one.first < until)
    if not levels:
        raise IdentificationError(
            f'the travel never stands still for {SHORTEST_HOLD_S:g} s; hold the grasp for minutes'
        )
    reference = max(min(level.first - level.began for level in levels), 1e-3)
    parts = [_binned(data, levels, finger, until) for finger in range(data.push.shape[1])]
    values, covariance, chi, freedom = _solved(data, parts, levels, reference, free=False)
    sigma_free = float(np.sqrt(_solved(data, parts, levels, reference, free=True)[1][0, 0]))
    rate, sigma = float(values[0]), float(np.sqrt(covariance[0, 0]))
    separable = sigma_free < max(SEPARABLE * abs(rate), SMALL_SHARE)
    last = max(float(time[-1]) for time, _, _ in parts) - levels[0].began
    force = np.array([_mean_force(data, level, until) for level in levels])
    if rate < -2.0 * sigma:
        raise IdentificationError(
            f'the pushes grow by {-100 * rate:.2g} % a decade at constant travel, sigma '
            f'{100 * sigma:.2g} %: no wall relaxes so; look at the drift of the gauges'
        )
    try:
        law = log_law(max(rate, 0.0), reference, last, reference, sigma)
    except RelaxationError as error:
        raise IdentificationError(f'the pushes follow no relaxation: {error}') from error
    return RelaxationFit(
        law, levels, force, separable, sigma_free, chi / max(freedom, 1),
        _statement(data, law, force, separable, sigma_free), values, covariance,
    )  # fmt: skip


def find_levels(data: HeldPushes) -> tuple[Level, ...]:
    """Where the mean travel stands still for long enough."""
    known = np.isfinite(data.travel)
    total = np.where(known, data.travel, 0.0).sum(axis=1)
    travel = np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), 0.0)
    found: list[Level] = []
    start, ended, before = 0, -1, 0.0
    while start < len(travel):
        away = np.flatnonzero(np.abs(travel[start:] - travel[start]) > STILL_M)
        stop = start + int(away[0]) if len(away) else len(travel)
        long = data.time[stop - 1] - data.time[start] >= SHORTEST_HOLD_S
        if not long or travel[start] <= STILL_M:
            start += 1
            continue
        moving = start
        while moving > 0 and abs(travel[moving] - travel[moving - 1]) > 0.0:
            if found and data.time[moving - 1] <= found[-1].last:
                break
            moving -= 1
        step = data.time[start] - data.time[moving]
        began = float(data.time[start] - 0.5 * step)
        first = float(data.time[start] + max(SETTLING * step, 0.1))
        last = float(data.time[stop - 1])
        here = float(np.median(travel[start:stop]))
        if found and start == ended and abs(here - before) < 2.0 * STILL_M:
            # Tendons that give back a little, or the slow end of a ramp: the same level goes on.
            found[-1] = replace(found[-1], last=last)
        else:
            found.append(Level(began, first, last))
            before = here
        ended = stop
        start = stop
    return tuple(found)


def _mean_force(data: HeldPushes, level: Level, until: float) -> float:
    inside = (data.time >= level.first) & (data.time <= min(level.last, until))
    return float(np.nanmean(data.push[inside]))


def _binned(
    data: HeldPushes, levels: tuple[Level, ...], finger: int, until: float
) -> tuple[Array, Array, Array]:
    """Times, means and counts of a finger's pushes over bins even in log time on each level."""
    rows = []
    for level in levels:
        inside = (data.time >= level.first) & (data.time <= min(level.last, until))
        inside &= np.isfinite(data.push[:, finger])
        time, push = data.time[inside], data.push[inside, finger]
        place = np.floor(BINS_PER_DECADE * np.log10(np.maximum(time - level.began, 1e-9)))
        for number in np.unique(place):
            own = place == number
            since = np.exp(np.mean(np.log(time[own] - level.began)))
            rows.append((level.began + since, float(push[own].mean()), float(own.sum())))
    if len(rows) < 3:
        raise IdentificationError(
            f'finger {finger + 1} says too little while the travel stands still'
        )
    time, push, count = np.array(rows).T
    return time, push, count


def _design(time: Array, levels: tuple[Level, ...], reference: float) -> Array:
    """(b, j) decades since each level began; 0 before."""
    began = np.array([level.began for level in levels])
    since = time[:, None] - began
    return np.where(since > 0.0, np.log10(np.maximum(since, 1e-9) / reference), 0.0)


def _solved(
    data: HeldPushes,
    parts: list[tuple[Array, Array, Array]],
    levels: tuple[Level, ...],
    reference: float,
    free: bool,
) -> tuple[Array, Array, float, int]:
    """Values [r, steps of finger 1, …] with covariance, chi-square and degrees of freedom.

    `free`: with a drift of each gauge as log of time and one even in time, of unknown strength.
    """
    count, fingers = len(levels), len(parts)
    extra = 2 * fingers if free else 0
    size = 1 + count * fingers + extra
    values = np.zeros(size)
    began = np.array([level.began for level in levels])
    for _ in range(PASSES):
        normal, right, chi, freedom = np.zeros((size, size)), np.zeros(size), 0.0, -size + extra
        normal[0, 0] = 1.0 / IGNORANCE**2
        right[0] = -values[0] / IGNORANCE**2
        for k in range(extra):
            at = size - extra + k
            normal[at, at] = 1.0 / FREE_DRIFT_N**2
            right[at] = -values[at] / FREE_DRIFT_N**2
        for finger, (time, push, samples) in enumerate(parts):
            decades = _design(time, levels, reference)
            present = (time[:, None] >= began).astype(float)
            own = slice(1 + finger * count, 1 + (finger + 1) * count)
            by = np.zeros((len(time), size))
            by[:, 0] = -decades @ values[own]
            by[:, own] = present - values[0] * decades
            modelled = by[:, own] @ values[own]
            if free:
                at = size - extra + 2 * finger
                by[:, at] = np.log10((time - began[0]) / reference)
                by[:, at + 1] = (time - began[0]) / (time[-1] - began[0])
                modelled = modelled + by[:, at : at + 2] @ values[at : at + 2]
            spread = (data.noise**2 + data.quantum**2 / 12.0) / samples + data.stuck**2
            walk = data.drift**2 / 60.0 * np.minimum(time[:, None], time)
            root = np.linalg.cholesky(np.diag(spread) + walk)
            both = np.column_stack([by, push - modelled])
            white = scipy.linalg.solve_triangular(root, both, lower=True)
            normal += white[:, :-1].T @ white[:, :-1]
            right += white[:, :-1].T @ white[:, -1]
            chi += float(white[:, -1] @ white[:, -1])
            freedom += len(time)
        step = np.linalg.solve(normal, right)
        values = values + step
        if np.abs(step).max() < 1e-10 * np.abs(values).max():
            break
    return values, np.asarray(np.linalg.inv(normal), float), chi, freedom


def _statement(
    data: HeldPushes, law: Relaxation, force: Array, separable: bool, sigma_free: float
) -> tuple[str, ...]:
    rate = 100.0 * float(law.per_decade or 0.0)
    said = ', '.join(f'{value:.1f}' for value in force)
    lost = 0.01 * rate * float(force.mean())
    if separable:
        return (
            f'{len(force)} levels ({said} N) tell drift from relaxation: relaxation goes with the '
            f'force, drift does not; with drift left free sigma is {100 * sigma_free:.2g} % a '
            'decade',
        )
    levels = 'one force level' if len(force) == 1 else f'levels too near each other ({said} N)'
    return (
        f'{levels}: gauge drift and relaxation cannot be told apart; a drift of {lost:.2g} N a '
        f'decade looks the same. Sigma holds if gauges drift no more than {data.drift:.2g} N in '
        'a root minute; hold at a second force to know',
    )
