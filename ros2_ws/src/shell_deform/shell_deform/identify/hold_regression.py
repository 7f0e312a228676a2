# SPDX-License-Identifier: Apache-2.0
"""Pushes of a hold over the logarithm of time: a regression that knows what it cannot know.

The wall's law is a line in the logarithm of time whose slope may wander, by a share of itself for
a root decade; each gauge's zero walks at random. How strong either is nobody knows beforehand, and
one minute says little: the answer is the mean over several strengths, each weighted by how well it
explains the pushes (restricted likelihood) and by what is expected of it.
C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", sections 2.7, 5.2;
a slope that wanders is the cubic smoothing spline of G. Wahba, section 6.3 there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PASSES = 12
NINETY = 1.6448536269514722
IGNORANCE = 0.3
"""Sigma of the share a decade before anything is known."""
FREE_DRIFT_N = 100.0

WALKS = ((0.5, 0.25), (1.0, 0.5), (2.0, 0.25))
"""The walk over the stated one, and how likely."""
WANDERS = ((0.0, 0.8), (0.1, 0.1), (0.4, 0.1))
"""By which share of itself the slope changes in a root decade, and how likely: most rubber goes
with the logarithm of time."""


@dataclass(frozen=True)
class Binned:
    """b means of pushes on standing travel, of all fingers, j levels.

    Attributes:
        time: (b,) [s]. push: (b,) [N]. spread: (b,) variance of a mean [N^2]. finger: (b,).
        began: (j,) steps to the levels [s]. reference: from where decades count [s].
        drift: of a gauge's zero in a root minute [N].
    """

    time: Array
    push: Array
    spread: Array
    finger: Index
    began: Array
    reference: float
    drift: float

    @cached_property
    def spline(self) -> Array:
        """(b, b, j, j) `wander` between all bins and levels."""
        decades = self.decades(self.time)
        return wander(decades[:, None, :, None], decades[None, :, None, :])

    @property
    def fingers(self) -> int:
        """How many there are."""
        return int(self.finger.max()) + 1

    def decades(self, time: Array) -> Array:
        """(b, j) decades of time since each level began; 0 before."""
        since = time[:, None] - self.began
        return np.where(since > 0.0, np.log10(np.maximum(since, 1e-9) / self.reference), 0.0)

    def own(self, finger: int) -> slice:
        """Where the steps of a finger stand among the values."""
        return slice(1 + finger * len(self.began), 1 + (finger + 1) * len(self.began))

    def walk(self, time: Array, finger: Index) -> Array:
        """(b, n) covariance of the bins with walks at times (n,) of fingers (n,) [N^2]."""
        together = self.finger[:, None] == finger
        return np.asarray(self.drift**2 / 60.0 * np.minimum(self.time[:, None], time) * together)

    def rows(self, values: Array, time: Array, finger: Index) -> tuple[Array, Array, Array]:
        """Derivatives (n, v) of pushes at times (n,) by all values, the pushes (n,), and by how
        much each level takes part in a wander (n, j).
        """
        decades, levels = self.decades(time), len(self.began)
        steps = values[1 : 1 + self.fingers * levels].reshape(-1, levels)[finger]
        present = (time[:, None] >= self.began).astype(float)
        by = np.zeros((len(time), len(values)))
        by[:, 0] = -np.sum(decades * steps, axis=1)
        for k, f in enumerate(finger.tolist()):
            by[k, self.own(f)] = present[k] - values[0] * decades[k]
        return by, np.sum((present - values[0] * decades) * steps, axis=1), -present * steps


def wander(first: Array, second: Array) -> Array:
    """Covariance of a line whose slope walks by one in a root decade; both from 0 [decades]."""
    low, high = np.minimum(first, second), np.maximum(first, second)
    return np.asarray(np.where(low > 0.0, low**2 * (3.0 * high - low) / 6.0, 0.0))


def _wandering(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """(b, n) covariance of two sets of pushes, each its decades and parts (., j) of the levels."""
    (decades, parts), (others, other_parts) = one, other
    kernel = wander(decades[:, None, :, None], others[None, :, None, :])
    return np.asarray(np.einsum('bj,bnjk,nk->bn', parts, kernel, other_parts))


@dataclass(frozen=True)
class Regression:
    """Values [share a decade, steps of finger 1, …] at one strength of walk and wander.

    Attributes:
        values: (v,). covariance: (v, v). chi: residual square. evidence: logarithm of how well
            the strengths explain the pushes.
    """

    bins: Binned
    slope: float
    strength: tuple[float, float]
    values: Array
    covariance: Array
    chi: float
    evidence: float
    _whiten: Array
    _by: Array
    _left: Array

    def share(self, decades: float) -> tuple[float, float]:
        """Share lost a decade, mean over so many, and its variance."""
        bins, (_, bends) = self.bins, self.strength
        by = np.zeros(len(self.values))
        by[0] = 1.0
        parts = bins.rows(self.values, bins.time, bins.finger)[2]
        end = np.array([[decades]]), np.array([[1.0 / decades]])
        size = (bends * self.slope) ** 2
        along = size * _wandering((bins.decades(bins.time), parts), end)[:, 0]
        own = size * float(_wandering(end, end)[0, 0])
        return self._told(by, self.values[0], along, own)

    def push(self, time: float, finger: int, read: bool) -> tuple[float, float]:
        """Push of a finger at `time` [s], and its variance; `read`: with the walk of its gauge."""
        bins, (walks, bends) = self.bins, self.strength
        at, whose = np.array([time]), np.array([finger])
        by, push, parts = bins.rows(self.values, at, whose)
        ours = bins.decades(bins.time), bins.rows(self.values, bins.time, bins.finger)[2]
        there = bins.decades(at), parts
        size = (bends * self.slope) ** 2
        along = size * _wandering(ours, there)[:, 0]
        own = size * float(_wandering(there, there)[0, 0])
        if read:
            along = along + walks**2 * bins.walk(at, whose)[:, 0]
            own += (walks * bins.drift) ** 2 / 60.0 * time
        return self._told(by[0], float(push[0]), along, own)

    def _told(self, by: Array, value: float, along: Array, own: float) -> tuple[float, float]:
        """Mean and variance of what the values give as `value` with derivatives `by` (v,).

        `along` (b,): its covariance with the bins beside that. `own`: its variance beside that.
        """
        white = self._whiten @ along
        left = by - white @ self._by
        variance = own - white @ white + left @ self.covariance @ left
        return value + float(white @ self._left), max(float(variance), 1e-18)


def regression(
    bins: Binned,
    walks: float = 1.0,
    bends: float = 0.0,
    slope: float = 0.0,
    free: bool = False,
    start: Array | None = None,
) -> Regression:
    """The values at one strength of walk and of wander over `slope`, the share a decade.

    `start` (v,): values near them. `free`: with a drift of each gauge as log of time and one even
    in time, of unknown strength.
    """
    count = len(bins.began) * bins.fingers
    extra = 2 * bins.fingers if free else 0
    prior = np.zeros(1 + count + extra)
    prior[0] = 1.0 / IGNORANCE**2
    prior[1 + count :] = 1.0 / FREE_DRIFT_N**2
    values = np.zeros(len(prior)) if start is None else start
    steady = np.diag(bins.spread) + walks**2 * bins.walk(bins.time, bins.finger)
    for _ in range(PASSES):
        by, push, parts = bins.rows(values, bins.time, bins.finger)
        if free:
            since = bins.time - bins.began[0]
            for k in range(bins.fingers):
                at, own = 1 + count + 2 * k, bins.finger == k
                by[own, at] = np.log10(since[own] / bins.reference)
                by[own, at + 1] = since[own] / since.max()
            push = push + by[:, 1 + count :] @ values[1 + count :]
        covariance = steady
        if bends:
            bent = np.einsum('bj,bnjk,nk->bn', parts, bins.spline, parts)
            covariance = steady + (bends * slope) ** 2 * bent
        # SciPy's triangular solve wakes threads, which takes longer on a busy machine than all.
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        white = whiten @ np.column_stack([by, bins.push - push])
        left = white[:, -1]
        normal = white[:, :-1].T @ white[:, :-1] + np.diag(prior)
        step = np.linalg.solve(normal, white[:, :-1].T @ left - prior * values)
        values = values + step
        if np.abs(step).max() < 1e-10 * np.abs(values).max():
            break
    chi = float(left @ left)
    evidence = -0.5 * chi + float(np.log(np.diag(whiten)).sum())
    evidence -= 0.5 * float(np.linalg.slogdet(normal)[1] + prior @ values**2)
    return Regression(
        bins, slope, (walks, bends), values, np.linalg.inv(normal), chi, evidence,
        whiten, white[:, :-1], left,
    )  # fmt: skip


@dataclass(frozen=True)
class Mixture:
    """The regressions at several strengths of walk and wander, with their weights (m,)."""

    parts: Sequence[Regression]
    weights: Array

    def told(self, ask: Callable[[Regression], tuple[float, float]]) -> tuple[float, float]:
        """Mean of what `ask` answers with mean and variance, and a sigma.

        1.645 of that is half of the 90 % interval, whose ends leave 5 % outside.
        """
        mean, variance = np.array([ask(part) for part in self.parts]).T
        sigma = np.sqrt(variance)
        ends = np.array([mean - 10.0 * sigma, mean + 10.0 * sigma])
        low, high = float(ends.min()), float(ends.max())

        def beyond(value: float, share: float) -> float:
            return float(self.weights @ ndtr((value - mean) / sigma)) - share

        width = brentq(beyond, low, high, (0.95,)) - brentq(beyond, low, high, (0.05,))
        return float(self.weights @ mean), 0.5 * float(width) / NINETY


def mixture(bins: Binned, first: Regression) -> Mixture:
    """Of all strengths, about a first guess of the values."""
    slope = abs(float(first.values[0]))
    parts, weights = [], []
    for walks, walk_weight in WALKS:
        for bends, bend_weight in WANDERS:
            part = regression(bins, walks, bends, slope, start=first.values)
            parts.append(part)
            weights.append(part.evidence + np.log(walk_weight * bend_weight))
    scaled = np.exp(np.array(weights) - max(weights))
    return Mixture(parts, scaled / scaled.sum())
