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
from numpy.typing import NDArray

from shell_deform.identify.force_curve import IdentificationError
from shell_deform.identify.hold_regression import NINETY, Binned, Mixture, mixture, regression
from shell_deform.theory.relaxation import Relaxation, RelaxationError, log_law

Array = NDArray[np.float64]

BINS_PER_DECADE = 8
SHORTEST_HOLD_S = 5.0
STILL_M = 1e-4
"""Travel that stays within this of where it came to rest stands still."""
SETTLING = 3.0
"""A level counts from so many durations of the step to it on."""
SEPARABLE = 0.25
SMALL_SHARE = 0.005
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
    _mixture: Mixture

    @property
    def interval(self) -> tuple[float, float]:
        """90 % interval of the share a decade."""
        half = NINETY * self.law.sigma
        return float(self.law.per_decade or 0.0) - half, float(self.law.per_decade or 0.0) + half

    def force_at(self, time: float, finger: int = 0) -> tuple[float, float]:
        """Push of a finger at `time` [s] if its travel stays, and its sigma [N].

        Beyond the range that was seen the law goes on, its slope as steady as it was.
        """
        return self._mixture.told(lambda part: part.push(time, finger, read=False))

    def reading_at(self, time: float, finger: int = 0) -> tuple[float, float]:
        """The same as its gauge will say, whose zero has walked on by then; without its noise."""
        return self._mixture.told(lambda part: part.push(time, finger, read=True))


def fit_relaxation(data: HeldPushes, until: float = np.inf) -> RelaxationFit:
    """The law of all pushes up to `until` [s]. Raises IdentificationError where none is held."""
    levels = find_levels(data)
    levels = tuple(one for one in levels if one.first < until)
    if not levels:
        raise IdentificationError(
            f'the travel never stands still for {SHORTEST_HOLD_S:g} s; hold the grasp for minutes'
        )
    reference = max(min(level.first - level.began for level in levels), 1e-3)
    bins = _binned(data, levels, until, reference)
    steady = regression(bins)
    sigma_free = float(np.sqrt(regression(bins, free=True).covariance[0, 0]))
    last = float(bins.time.max()) - levels[0].began
    mixed = mixture(bins, steady)
    decades = float(np.log10(last / reference))
    rate, sigma = mixed.told(lambda part: part.share(decades))
    separable = sigma_free < max(SEPARABLE * abs(rate), SMALL_SHARE)
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
    freedom = max(len(bins.time) - len(steady.values), 1)
    return RelaxationFit(
        law, levels, force, separable, sigma_free, steady.chi / freedom,
        _statement(data, law, force, separable, sigma_free), mixed,
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


def _binned(data: HeldPushes, levels: tuple[Level, ...], until: float, reference: float) -> Binned:
    """Means of the fingers' pushes over bins even in log time on each level."""
    rows: list[tuple[float, float, float, int]] = []
    for finger in range(data.push.shape[1]):
        before = len(rows)
        for level in levels:
            inside = (data.time >= level.first) & (data.time <= min(level.last, until))
            inside &= np.isfinite(data.push[:, finger])
            time, push = data.time[inside], data.push[inside, finger]
            place = np.floor(BINS_PER_DECADE * np.log10(np.maximum(time - level.began, 1e-9)))
            for number in np.unique(place):
                own = place == number
                since = np.exp(np.mean(np.log(time[own] - level.began)))
                spread = (data.noise**2 + data.quantum**2 / 12.0) / own.sum() + data.stuck**2
                rows.append((level.began + since, float(push[own].mean()), float(spread), finger))
        if len(rows) < before + 3:
            raise IdentificationError(
                f'finger {finger + 1} says too little while the travel stands still'
            )
    time, push, spread, finger = np.array(rows).T
    began = np.array([level.began for level in levels])
    return Binned(time, push, spread, finger.astype(np.int64), began, reference, data.drift)


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
        f'decade looks the same. Sigma takes gauges that drift half to twice {data.drift:.2g} N '
        'in a root minute; hold at a second force to know',
    )
