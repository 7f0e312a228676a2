# SPDX-License-Identifier: Apache-2.0
"""What an emulated strain gauge answers to a torque: gain, zero, cubic, play, noise, drift, ends.

The maker publishes no gauge data sheet beyond its range and resolution. The spreads are the
proposals collected for this project: gain 100 counts per N m +- 10 % and zero 100 to 140 for
the 8-bit gauge (BH8-262 manual, pages 56 and 67), the published cubic for the 12-bit one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

# Torque in N m against counts of the 12-bit gauge, lowest power first (Barrett pyHand).
PUBLISHED_CUBIC_NM = (-2.85, 3.764e-3, -1.708e-6, 2.754e-10)


@dataclass(frozen=True)
class GaugeCharacter:
    """The fixed traits of one gauge, all in counts of its own scale except `torque_range_nm`."""

    zero_counts: float
    highest_count: int
    noise_counts: float
    play_counts: float
    walk_counts_per_sqrt_minute: float
    warm_up_counts: float
    warm_up_minutes: float
    counts_per_nm: float
    cubic_counts_per_nm3: float = 0.0
    published_cubic: bool = False


def character_8_bit(generator: np.random.Generator) -> GaugeCharacter:
    """One gauge of a BH8-262 drawn at random: every finger differs."""
    return GaugeCharacter(
        zero_counts=float(generator.uniform(100.0, 140.0)),
        highest_count=255,
        noise_counts=0.5,
        play_counts=0.25,
        walk_counts_per_sqrt_minute=0.1,
        warm_up_counts=float(generator.uniform(2.0, 4.0) * generator.choice([-1.0, 1.0])),
        warm_up_minutes=float(generator.uniform(10.0, 20.0)),
        counts_per_nm=float(100.0 * generator.uniform(0.9, 1.1)),
        cubic_counts_per_nm3=float(generator.uniform(-2.0, 2.0)),
    )


def character_12_bit(generator: np.random.Generator) -> GaugeCharacter:
    """One gauge of a BH8-280 drawn at random: the published cubic, shifted to its own zero."""
    return GaugeCharacter(
        zero_counts=float(generator.uniform(1800.0, 2050.0)),
        highest_count=4095,
        noise_counts=float(generator.uniform(2.0, 4.0)),
        play_counts=3.0,
        walk_counts_per_sqrt_minute=1.0,
        warm_up_counts=float(generator.uniform(10.0, 40.0) * generator.choice([-1.0, 1.0])),
        warm_up_minutes=float(generator.uniform(10.0, 20.0)),
        counts_per_nm=float(generator.uniform(0.9, 1.1)),
        published_cubic=True,
    )


def _published_zero() -> float:
    roots = np.roots(PUBLISHED_CUBIC_NM[::-1])
    return float(next(root.real for root in roots if abs(root.imag) < 1e-9))


def published_torque(counts: float) -> float:
    """Torque in N m that the published cubic gives for a count of the 12-bit gauge."""
    c0, c1, c2, c3 = PUBLISHED_CUBIC_NM
    return c0 + counts * (c1 + counts * (c2 + counts * c3))


def invert_published_torque(torque_nm: float) -> float:
    """Counts at which the published cubic (which always rises) gives a torque in N m."""
    low, high = -4000.0, 9000.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if published_torque(middle) < torque_nm:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@dataclass
class StrainGauge:
    """One gauge with its memory: play, random walk and age. Deterministic by its generator."""

    character: GaugeCharacter
    generator: np.random.Generator
    fitted: bool = True
    age_s: float = 0.0
    noisy: bool = True
    _play: float = 0.0
    _walk: float = 0.0
    _noise: float = 0.0
    _response: Callable[[float], float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.character.published_cubic:
            torques = np.linspace(-2.5, 2.5, 501)
            counts = np.array([invert_published_torque(float(t)) for t in torques])
            counts = counts - _published_zero()
            self._response = lambda torque: float(np.interp(torque, torques, counts))
        else:
            c = self.character
            self._response = lambda torque: (
                c.counts_per_nm * torque + c.cubic_counts_per_nm3 * torque**3
            )

    def step(self, torque_nm: float, seconds: float) -> None:
        """Let `seconds` pass under a torque in N m (positive: the object opens the finger)."""
        c = self.character
        self.age_s += seconds
        draw = self.generator.standard_normal(2)
        if self.noisy:
            self._walk += (
                c.walk_counts_per_sqrt_minute * math.sqrt(seconds / 60.0) * float(draw[0])
            )
            self._noise = c.noise_counts * float(draw[1])
        elastic = self._elastic(torque_nm)
        self._play = min(max(self._play, elastic - c.play_counts), elastic + c.play_counts)

    def _elastic(self, torque_nm: float) -> float:
        if self.character.published_cubic:
            return self._response(torque_nm * self.character.counts_per_nm)
        return self._response(torque_nm)

    @property
    def drift_counts(self) -> float:
        """How far the zero has moved since power-up."""
        c = self.character
        warm_up = c.warm_up_counts * -math.expm1(-self.age_s / (60.0 * c.warm_up_minutes))
        return (warm_up + self._walk) if self.noisy else 0.0

    @property
    def counts(self) -> int:
        """The digitised reading; a gauge that is not fitted reads its highest code."""
        if not self.fitted:
            return self.character.highest_count
        analogue = self.character.zero_counts + self.drift_counts + self._play + self._noise
        return min(max(math.floor(analogue + 0.5), 0), self.character.highest_count)
