# SPDX-License-Identifier: Apache-2.0
"""Stress relaxation of the wall: one function of time for all of it, and what it remembers.

Stress is the hereditary integral of the elastic stress (Fung's quasi-linear viscoelasticity),

    S(t) = S_0 + integral of g(t - s) dS_e(s),    g(t) = g_long + sum of share_i exp(-t / time_i),

S_0 what the wall carried before the record: it has settled and stays. g is 1 at the time at which
the modulus is stated. With elastic stress linear in time over a step, each term's integral is
advanced exactly (Simo & Hughes, "Computational Inelasticity", section 10.3), so step and ramp are
exact. Rubber relaxes in proportion to the logarithm of time: such a law is turned into terms, two
to a decade, and says what that costs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TERMS_PER_DECADE = 2
MARGIN_DECADES = 1.0
"""A law in the logarithm of time is continued so far beyond its range, for steps shorter."""

SAMPLES_PER_DECADE = 40
MOST_DECADES = 15.0


class RelaxationError(ValueError):
    """A relaxation that no wall can have."""


@dataclass(frozen=True)
class Relaxation:
    """How the modulus falls with the time since a step.

    Attributes:
        terms: m pairs: a share of the modulus at `reference`, the time over which it goes [s].
        long_term: the share that stays. reference: the time at which the modulus is stated [s].
        first, last: range of times that the law is known in [s].
        per_decade: share lost a decade of time by the law; None for one given as terms.
        sigma: one standard deviation of that share.
        conversion_error: largest error of the terms inside the range [-].
    """

    terms: tuple[tuple[float, float], ...]
    long_term: float
    reference: float
    first: float
    last: float
    per_decade: float | None = None
    sigma: float = 0.0
    conversion_error: float = 0.0

    @cached_property
    def shares(self) -> Array:
        """(m,) of the modulus at the reference time."""
        return np.array([share for share, _ in self.terms])

    @cached_property
    def times(self) -> Array:
        """(m,) of the terms [s]."""
        return np.array([time for _, time in self.terms])

    def __call__(self, time: Array | float) -> Array:
        """g at times [s]."""
        decay = np.exp(-np.asarray(time, dtype=float)[..., None] / self.times)
        return np.asarray(self.long_term + decay @ self.shares)

    @property
    def slope_at_end(self) -> float:
        """Share lost a decade of time at the end of the range."""
        if self.per_decade is not None:
            return self.per_decade
        past = self.last / self.times
        return float(np.log(10.0) * np.sum(self.shares * past * np.exp(-past)))

    def sigma_of(self, time: Array | float, since: float) -> Array:
        """Sigma of g(time) where g(since) is known [-]; beyond the range it grows.

        There the law may stop or go on twice as steep: its own slope is the sigma of a decade.
        """
        time = np.asarray(time, dtype=float)
        within = self.sigma * np.abs(np.log10(np.maximum(time, since) / since))
        start = max(self.last, since)
        beyond = self.slope_at_end * np.log10(np.maximum(time, start) / start)
        return np.asarray(np.hypot(within, beyond))

    def beyond(self, time: float) -> str:
        """A sentence when `time` [s] is later than the law is known for, else ''."""
        if time <= self.last * (1.0 + 1e-9):
            return ''
        return (
            f'{time:g} s is longer than the {self.last:g} s that the relaxation is known for: '
            f'extrapolated, sigma {100.0 * float(self.sigma_of(time, self.last)):.2g} % of force'
        )

    def covering(self, time: float) -> Relaxation:
        """The same law with terms up to `time` [s]; one given as terms stays as it is."""
        if self.per_decade is None or time <= self.last:
            return self
        longer = log_law(self.per_decade, self.first, time, self.reference, self.sigma)
        return replace(longer, last=self.last)


def log_law(
    per_decade: float,
    first: float,
    last: float,
    reference: float | None = None,
    sigma: float = 0.0,
) -> Relaxation:
    """g(t) = 1 - per_decade log10(t / reference) for times from `first` to `last` [s].

    `reference` [s] defaults to `first`. Raises RelaxationError for a law that grows, whose times
    run back, or that leaves nothing of the wall.
    """
    reference = first if reference is None else reference
    if not per_decade >= 0.0:
        raise RelaxationError(
            f'the share lost a decade is {per_decade:g}: relaxation that grows; give 0 or more'
        )
    if not (0.0 < first < last < np.inf):
        raise RelaxationError(
            f'the times run back: from {first:g} s to {last:g} s; the second must be later, '
            'the first above 0'
        )
    if not first <= reference <= last:
        raise RelaxationError(
            f'the modulus is stated at {reference:g} s, outside {first:g} s to {last:g} s'
        )
    decades = float(np.log10(last / first))
    if decades > MOST_DECADES:
        raise RelaxationError(f'{decades:.0f} decades of time; at most {MOST_DECADES:.0f}')
    end = 1.0 - per_decade * (np.log10(last / reference) + MARGIN_DECADES)
    if end <= 0.0:
        raise RelaxationError(
            f'{per_decade:g} a decade leaves nothing of the modulus by {10 * last:g} s; give a '
            'smaller share or a shorter range'
        )
    from scipy.optimize import nnls  # slow to import; a file without relaxation needs none

    low, high = np.log10(first) - MARGIN_DECADES, np.log10(last) + MARGIN_DECADES
    times = 10.0 ** np.linspace(low, high, int(np.ceil(TERMS_PER_DECADE * (high - low))) + 1)
    count = int(np.ceil(SAMPLES_PER_DECADE * (decades + MARGIN_DECADES)))
    at = np.geomspace(first * 10.0**-MARGIN_DECADES, last, count)
    # Both sides count from the reference, where they are equal: g_long drops out.
    basis = np.exp(-at[:, None] / times) - np.exp(-reference / times)
    wanted = -per_decade * np.log10(at / reference)
    shares = nnls(basis, wanted)[0]
    error = float(np.abs(basis @ shares - wanted)[at >= first].max())
    kept = shares > 0.0
    shares, times = shares[kept], times[kept]
    long_term = 1.0 - float(np.sum(shares * np.exp(-reference / times)))
    return Relaxation(
        _paired(shares, times), long_term, float(reference), float(first), float(last),
        float(per_decade), float(sigma), error,
    )  # fmt: skip


def prony(
    shares: Array, times: Array, reference: float = 0.0, last: float | None = None
) -> Relaxation:
    """A law of terms: `shares` (m,) of the modulus right after a step, lost over `times` (m,) [s].

    `reference` [s]: when the modulus is stated. `last` [s]: how long the law is known, by default
    the last of its times. Raises RelaxationError as `log_law` does.
    """
    shares, times = np.asarray(shares, dtype=float), np.asarray(times, dtype=float)
    if len(shares) != len(times) or not len(shares):
        raise RelaxationError(
            f'{len(shares)} shares and {len(times)} times; every term needs one of both'
        )
    if not (shares >= 0.0).all():
        raise RelaxationError(
            f'a share is {shares.min():g}: relaxation that grows; give 0 or more'
        )
    if not (times > 0.0).all() or not (np.diff(times) > 0.0).all():
        raise RelaxationError(
            f'the times run back: {times.tolist()} s; let them rise from above 0'
        )
    if not shares.sum() < 1.0:
        raise RelaxationError(
            f'the shares sum to {shares.sum():g} and leave nothing of the modulus; their sum must '
            'be below 1'
        )
    last = float(times[-1]) if last is None else last
    if not (np.isfinite(reference) and 0.0 <= reference <= last):
        raise RelaxationError(f'the modulus is stated at {reference:g} s, outside 0 to {last:g} s')
    scale = 1.0 - float(shares.sum()) + float(np.sum(shares * np.exp(-reference / times)))
    return Relaxation(
        _paired(shares / scale, times), (1.0 - float(shares.sum())) / scale, float(reference),
        float(times[0]), last,
    )  # fmt: skip


def _paired(shares: Array, times: Array) -> tuple[tuple[float, float], ...]:
    return tuple(zip(shares.tolist(), times.tolist(), strict=True))


@dataclass(frozen=True)
class Step:
    """What a step of time does: relaxed stress now = `now` times the elastic one + what is held.

    Attributes:
        decay: (m,) what is left of each term. gain: (m,) of the change of elastic stress that
            goes into each. long_term: as in the law.
    """

    decay: Array
    gain: Array
    long_term: float

    @property
    def now(self) -> float:
        """Share of the modulus by which the wall answers within the step."""
        return self.long_term + float(self.gain.sum())


def step_of(law: Relaxation, duration: float) -> Step:
    """The step of `duration` [s] >= 0 over which elastic stress is linear in time.

    Raises RelaxationError for time that runs back.
    """
    if not (np.isfinite(duration) and duration >= 0.0):
        raise RelaxationError(f'a step of {duration:g} s: time runs back')
    past = duration / law.times
    ramp = np.where(past > 0.0, -np.expm1(-past) / np.where(past > 0.0, past, 1.0), 1.0)
    return Step(np.exp(-past), law.shares * ramp, law.long_term)


@dataclass(frozen=True)
class Heredity:
    """What one elastic quantity of any shape has left behind.

    Attributes:
        elastic: its last value. settled: its value when the record began.
        terms: (m, …) integral of each term.
    """

    elastic: Array
    settled: Array
    terms: Array

    def held(self, step: Step) -> Array:
        """What of the past acts at the end of a step: relaxed = step.now * elastic + held."""
        past = np.tensordot(step.decay, self.terms, axes=1) - step.gain.sum() * self.elastic
        return np.asarray(past + (1.0 - step.long_term) * self.settled)

    def after(self, step: Step, elastic: Array) -> Heredity:
        """The same at the end of a step at which the quantity is `elastic`."""
        shape = (-1,) + (1,) * np.ndim(elastic)
        kept = step.decay.reshape(shape) * self.terms
        terms = kept + step.gain.reshape(shape) * (elastic - self.elastic)
        return replace(self, elastic=elastic, terms=terms)


def unloaded(law: Relaxation, elastic: Array) -> Heredity:
    """The memory of a wall that has long been at this elastic value."""
    elastic = np.asarray(elastic, dtype=float)
    return Heredity(elastic, elastic, np.zeros((len(law.times), *elastic.shape)))
