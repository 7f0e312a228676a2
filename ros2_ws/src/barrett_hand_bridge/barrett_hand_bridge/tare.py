"""Taking the zero of the gauges: in the measuring pose, at rest, unloaded, or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.calibration import GaugeCalibration
from barrett_hand_bridge.hand import FINGERS, HandSample

TARE_SAMPLES = 100
STILL_COUNTS = 2
LOADED_SIGMAS = 5.0
LOADED_COUNTS = 1.5


@dataclass(frozen=True)
class Zero:
    """A measured zero in counts with the standard deviation of its mean."""

    counts: float
    sigma_counts: float


@dataclass(frozen=True)
class TareOutcome:
    """What a tare brought: the zeros, or the sentence that says why there are none."""

    zeros: Mapping[int, Zero]
    refusal: str = ''


@dataclass(frozen=True)
class ExpectedZero:
    """What is known of a zero before: counts with sigma, and whether the finger is in contact."""

    counts: float | None
    sigma_counts: float
    touching: bool


def take_zero(
    samples: list[HandSample],
    calibrations: Mapping[int, GaugeCalibration],
    expected: Mapping[int, ExpectedZero],
) -> TareOutcome:
    """Zeros of all fitted gauges from samples of a hand at rest.

    `expected` holds earlier zeros, moved to the present pose; a reading far from one means load.
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
        if known.counts is not None:
            allowed = LOADED_SIGMAS * known.sigma_counts + LOADED_COUNTS
            if known.touching and abs(mean - known.counts) > allowed:
                return TareOutcome(
                    {},
                    f'finger {finger} is loaded ({mean - known.counts:+.1f} counts from its last '
                    'zero): open the hand, then tare',
                )
        noise = float(np.std(present))
        zeros[finger] = Zero(mean, max(noise, 1 / np.sqrt(12.0)) / np.sqrt(len(present)))
    if not zeros:
        return TareOutcome({}, 'no finger has a gauge to tare')
    return TareOutcome(zeros)


def _moves(positions: list[int]) -> bool:
    return max(positions) - min(positions) > STILL_COUNTS
