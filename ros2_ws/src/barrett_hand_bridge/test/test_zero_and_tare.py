"""Zeros: tare refuses what it must, drift is followed while free, doubt grows while loaded."""

from dataclasses import replace

import numpy as np
import pytest

from barrett_hand_bridge.calibration import NO_GAUGE, GaugeCalibration
from barrett_hand_bridge.hand import HandSample
from barrett_hand_bridge.tare import ExpectedZero, take_zero
from barrett_hand_bridge.zero import DRIFT_8_BIT, ZeroTracker

GAUGE = GaugeCalibration('cubic', coefficients_nm=(0, 0.01), no_load_counts=(100, 140))
GAUGES = dict.fromkeys((1, 2, 3), GAUGE)
UNKNOWN = dict.fromkeys((1, 2, 3), ExpectedZero(None, 0.0, False))


def samples(counts=(120, 121, 119), positions=(5000, 5000, 0), move=0):
    generator = np.random.default_rng(0)
    return [
        HandSample(
            i * 10_000_000,
            (positions[0] + i * move, positions[1], positions[2]),
            1575,
            tuple(None if c is None else int(c + generator.integers(-1, 2)) for c in counts),
        )
        for i in range(100)
    ]


def test_zeros_are_means_with_their_uncertainty():
    outcome = take_zero(samples(), GAUGES, UNKNOWN)
    assert outcome.zeros[1].counts == pytest.approx(120, abs=0.3)
    assert 0.02 < outcome.zeros[1].sigma_counts < 0.2


def test_a_moving_finger_is_not_tared():
    outcome = take_zero(samples(move=1), GAUGES, UNKNOWN)
    assert 'finger 1 is moving' in outcome.refusal
    assert not outcome.zeros


def test_a_moving_spread_is_not_tared():
    spreading = [replace(s, spread_counts=1575 + i) for i, s in enumerate(samples())]
    assert 'the spread is moving' in take_zero(spreading, GAUGES, UNKNOWN).refusal


def test_a_reading_outside_the_no_load_band_is_not_tared():
    outcome = take_zero(samples(counts=(190, 121, 119)), GAUGES, UNKNOWN)
    assert 'finger 1 reads 190' in outcome.refusal


def test_a_loaded_finger_is_not_tared():
    known = {**UNKNOWN, 2: ExpectedZero(111.0, 0.3, True)}
    assert 'finger 2 is loaded' in take_zero(samples(), GAUGES, known).refusal


def test_a_drifted_but_free_finger_is_tared():
    known = {**UNKNOWN, 2: ExpectedZero(111.0, 0.3, False)}
    assert not take_zero(samples(), GAUGES, known).refusal


def test_fingers_without_gauge_are_left_out():
    gauges = {1: GAUGE, 2: NO_GAUGE, 3: GAUGE}
    outcome = take_zero(samples(counts=(120, 121, None)), gauges, UNKNOWN)
    assert set(outcome.zeros) == {1}


def test_a_hand_without_any_gauge_cannot_be_tared():
    gauges = dict.fromkeys((1, 2, 3), NO_GAUGE)
    assert 'no finger has a gauge' in take_zero(samples(), gauges, UNKNOWN).refusal


def test_a_warm_up_is_followed_between_grasps():
    generator = np.random.default_rng(3)
    zero = ZeroTracker(DRIFT_8_BIT)
    zero.tare(120.0, 0.05, 0.0)
    true = 120.0
    for second in range(1, 1800):
        true = 120.0 + 3.0 * (1 - np.exp(-second / 900))
        for part in range(5):
            reading = round(true + 0.5 * generator.standard_normal())
            zero.free_reading(reading, 0.5, second + part * 0.26)
    assert zero.counts == pytest.approx(true, abs=3 * zero.sigma_counts)
    assert zero.sigma_counts < 0.3


def test_doubt_grows_while_the_finger_is_loaded():
    zero = ZeroTracker(DRIFT_8_BIT)
    zero.tare(120.0, 0.05, 0.0)
    sigmas = []
    for minute in (1, 5, 20):
        zero.advance(60.0 * minute)
        sigmas.append(zero.sigma_counts)
    assert sigmas == sorted(sigmas)
    assert 0.2 < sigmas[0] < 0.5
    assert 2.0 < sigmas[2] < 5.0


def test_a_touch_is_not_taken_for_drift():
    zero = ZeroTracker(DRIFT_8_BIT)
    zero.tare(120.0, 0.05, 0.0)
    for i in range(300):
        zero.free_reading(135.0, 0.5, 1.0 + 0.01 * i)
    assert zero.counts == pytest.approx(120.0, abs=0.1)


def test_a_forgotten_zero_must_be_taken_again():
    zero = ZeroTracker(DRIFT_8_BIT)
    zero.tare(120.0, 0.05, 0.0)
    zero.forget()
    assert not zero.tared
