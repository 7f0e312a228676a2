# SPDX-License-Identifier: Apache-2.0
"""Taking the zero of the gauges: in the measuring pose, at rest, unloaded, or not at all."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.calibration import GaugeCalibration
from barrett_hand_bridge.hand import FINGERS, HandSample
from barrett_hand_bridge.posture import STILL_COUNTS

TARE_SAMPLES = 100
LOADED_SIGMAS = 5.0
LOADED_COUNTS = 1.5
# What a zero may step by itself: 2 % of the gauge's whole scale, as the play of a bonded gauge.
HYSTERESIS_NM = 0.05


@dataclass(frozen=True)
class Zero:
    """A measured zero in counts with the standard deviation of its mean.

    `doubt_counts`: what of it may be a load that nothing speaks against, as a standard deviation.
    """

    counts: float
    sigma_counts: float
    doubt_counts: float = 0.0


@dataclass(frozen=True)
class TareOutcome:
    """What a tare brought: the zeros, or the sentence that says why there are none."""

    zeros: Mapping[int, Zero]
    refusal: str = ''

    @property
    def sentence(self) -> str:
        """The zeros in words, with their doubts, or the refusal."""
        if self.refusal:
            return self.refusal
        text = 'zero in counts: ' + ', '.join(
            f'finger {finger} {zero.counts:.2f}' for finger, zero in self.zeros.items()
        )
        doubts = ', '.join(
            f'finger {finger} by {zero.doubt_counts:.1f} counts'
            for finger, zero in self.zeros.items()
            if zero.doubt_counts > 0.0
        )
        if doubts:
            text += (
                f'; in doubt (a light load would read the same): {doubts}; moving the finger free '
                'by 5 mm ends the doubt, and so does a tare with the hand open'
            )
        return text


@dataclass(frozen=True)
class ExpectedZero:
    """What speaks for or against a load before the samples are looked at.

    `counts` with sigma: the zero known in the present pose, from a tare or (`tared` False) from
    the open hand. `touching`: the finger moved into a contact and has not left it. `is_open`: it
    stands at its open end, where it holds nothing. `doubt_counts`: a doubt that nothing has ended.
    """

    counts: float | None
    sigma_counts: float
    touching: bool
    is_open: bool = False
    tared: bool = True
    doubt_counts: float = 0.0


def take_zero(
    samples: list[HandSample],
    calibrations: Mapping[int, GaugeCalibration],
    expected: Mapping[int, ExpectedZero],
) -> TareOutcome:
    """Zeros of all fitted gauges from samples of a hand at rest.

    Judged against the band of unloaded readings and the posture, not against the last zero alone,
    which may itself be wrong: a reading far from it means load where the finger moved into a
    contact; elsewhere it is taken, and the difference stays as a doubt.
    """
    zeros: dict[int, Zero] = {}
    if _moves([sample.spread_counts for sample in samples]):
        return TareOutcome({}, 'the spread is moving: stop the hand, then tare')
    for index, finger in enumerate(FINGERS):
        if _moves([sample.finger_counts[index] for sample in samples]):
            return TareOutcome({}, f'finger {finger} is moving: stop the hand, then tare')
        readings = [sample.gauge_counts[index] for sample in samples]
        present = [reading for reading in readings if reading is not None]
        gauge = calibrations[finger]
        if gauge.kind == 'none' or not present:
            continue
        if len(present) < len(readings):
            return TareOutcome({}, f'finger {finger}: gauge readings come and go, check its cable')
        mean = float(np.mean(present))
        known = expected[finger]
        low, high = gauge.no_load_counts
        if not low <= mean <= high:
            return TareOutcome(
                {},
                f'finger {finger} reads {mean:.1f} counts, an unloaded gauge reads {low:g} to '
                f'{high:g}: free the finger, or set its potentiometer',
            )
        refusal, doubt = _judge(finger, mean, gauge, known)
        if refusal:
            return TareOutcome({}, refusal)
        noise = float(np.std(present))
        sigma = max(noise, 1 / np.sqrt(12.0)) / np.sqrt(len(present))
        zeros[finger] = Zero(mean, sigma, doubt)
    if not zeros:
        return TareOutcome({}, 'no finger has a gauge to tare')
    return TareOutcome(zeros)


def _judge(
    finger: int, mean: float, gauge: GaugeCalibration, known: ExpectedZero
) -> tuple[str, float]:
    """Why a reading is no zero (empty: it is one), and the doubt that stays, in counts."""
    if known.is_open:
        return '', 0.0
    if known.counts is None:
        low, high = gauge.no_load_counts
        # Anywhere in the band alike: the standard deviation of a uniform distribution.
        return '', (high - low) / math.sqrt(12.0)
    off = mean - known.counts
    if abs(off) <= LOADED_SIGMAS * known.sigma_counts + LOADED_COUNTS:
        return '', known.doubt_counts
    if known.touching:
        return (
            f'finger {finger} is loaded ({off:+.1f} counts from its last zero): open the hand, '
            'then tare',
            0.0,
        )
    if not known.tared and off * gauge.slope(mean, mean) > HYSTERESIS_NM:
        return (
            f'finger {finger} is loaded ({off:+.1f} counts since it stood open): open the hand, '
            'then tare',
            0.0,
        )
    # Nothing pulls a finger closed: a reading that fell is nearer to the unloaded one.
    return '', math.hypot(known.doubt_counts, off) if off > 0.0 else 0.0


def _moves(positions: list[int]) -> bool:
    return max(positions) - min(positions) > STILL_COUNTS
