# SPDX-License-Identifier: Apache-2.0
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


def test_a_finger_that_reads_more_without_having_moved_into_something_is_tared_with_a_doubt():
    known = {**UNKNOWN, 2: ExpectedZero(111.0, 0.3, False)}
    outcome = take_zero(samples(), GAUGES, known)
    assert outcome.zeros[2].doubt_counts == pytest.approx(10.0, abs=0.3)
    assert 'finger 2 by 10.1 counts' in outcome.sentence


def test_a_finger_that_reads_less_is_tared_without_a_doubt():
    known = {**UNKNOWN, 2: ExpectedZero(131.0, 0.3, False)}
    assert take_zero(samples(), GAUGES, known).zeros[2].doubt_counts == 0.0


def test_the_first_tare_of_a_finger_never_seen_open_carries_the_whole_unloaded_band():
    outcome = take_zero(samples(), GAUGES, UNKNOWN)
    assert outcome.zeros[1].doubt_counts == pytest.approx(40.0 / np.sqrt(12.0))


def test_an_open_finger_is_tared_without_a_doubt_whatever_was_known():
    known = {**UNKNOWN, 2: ExpectedZero(111.0, 0.3, False, is_open=True)}
    assert take_zero(samples(), GAUGES, known).zeros[2].doubt_counts == 0.0


def test_a_load_of_more_than_a_step_since_the_finger_stood_open_is_refused():
    known = {**UNKNOWN, 2: ExpectedZero(111.0, 0.3, False, tared=False)}
    assert 'since it stood open' in take_zero(samples(), GAUGES, known).refusal


def test_a_second_tare_does_not_end_a_doubt():
    known = {**UNKNOWN, 2: ExpectedZero(121.0, 0.3, False, doubt_counts=3.0)}
    assert take_zero(samples(), GAUGES, known).zeros[2].doubt_counts == 3.0


def test_what_one_reading_can_tell_at_least_is_its_quantisation():
    still = [replace(sample, gauge_counts=(120, 121, 119)) for sample in samples()]
    zero = take_zero(still, GAUGES, UNKNOWN).zeros[1]
    assert zero.sigma_counts == pytest.approx(1.0 / np.sqrt(12.0 * 100))


@pytest.mark.parametrize(('way', 'moves'), [(2, False), (3, True)])
def test_a_finger_stands_still_within_two_counts(way, moves):
    shifted = samples()
    shifted[50] = replace(shifted[50], finger_counts=(5000 + way, 5000, 0))
    assert ('moving' in take_zero(shifted, GAUGES, UNKNOWN).refusal) is moves


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


def tared():
    zero = ZeroTracker(DRIFT_8_BIT)
    zero.tare(120.0, 0.05, 0.0)
    return zero


def feed(zero, counts, seconds=3.0, start=1.0, **posture):
    return [
        zero.free_reading(counts, 0.5, start + 0.01 * i, **posture)
        for i in range(round(100 * seconds))
    ]


@pytest.mark.parametrize('step', [-15.0, -1.0, 1.0, 15.0])
def test_an_innovation_beyond_the_gate_is_not_taken_for_drift(step):
    zero = tared()
    feed(zero, 120.0 + step)
    assert zero.counts == pytest.approx(120.0, abs=0.1)
    assert zero.doubt_counts == 0.0


@pytest.mark.parametrize('step', [-0.2, 0.2])
def test_an_innovation_within_the_gate_is_followed(step):
    zero = tared()
    feed(zero, 120.0 + step, seconds=30.0)
    assert zero.counts == pytest.approx(120.0 + step, abs=0.05)


def test_a_step_that_the_posture_allows_is_adopted_and_stays_in_doubt():
    zero = tared()
    adopted = feed(zero, 123.0, steps_counts=(-10.0, 5.0))
    assert adopted.count(True) == 1
    assert zero.counts == pytest.approx(123.0, abs=0.05)
    assert zero.sigma_counts > 2.9


def test_one_block_alone_is_no_step():
    zero = tared()
    feed(zero, 123.0, seconds=1.2, steps_counts=(-10.0, 5.0))
    feed(zero, 120.0, start=2.5, steps_counts=(-10.0, 5.0))
    assert zero.counts == pytest.approx(120.0, abs=0.1)


def test_blocks_that_disagree_are_no_step():
    zero = tared()
    for second, counts in enumerate((122.0, 124.0, 122.0, 124.0)):
        feed(zero, counts, seconds=1.01, start=1.0 + 1.1 * second, steps_counts=(-10.0, 5.0))
    assert zero.counts == pytest.approx(120.0, abs=0.1)


def test_a_step_down_is_adopted_without_a_doubt_since_nothing_pulls_a_finger_closed():
    zero = tared()
    feed(zero, 117.0, steps_counts=(-10.0, 5.0))
    assert zero.counts == pytest.approx(117.0, abs=0.05)
    assert zero.doubt_counts == 0.0


def test_a_step_that_goes_back_takes_its_doubt_along():
    zero = tared()
    feed(zero, 123.0, steps_counts=(-10.0, 5.0))
    feed(zero, 120.0, start=5.0, steps_counts=(-10.0, 5.0))
    assert zero.doubt_counts == pytest.approx(0.0, abs=0.1)


def test_a_doubt_ends_when_the_pin_has_moved_and_the_reading_has_stayed():
    zero = tared()
    here, there = np.zeros(3), np.array([0.006, 0.0, 0.0])
    feed(zero, 123.0, steps_counts=(-10.0, 5.0), place=here)
    feed(zero, 123.0, start=5.0, place=here)
    assert zero.doubt_counts > 2.9
    feed(zero, 123.0, start=10.0, place=there)
    assert zero.doubt_counts == 0.0


def test_a_zero_that_walks_faster_than_assumed_is_noticed_and_doubted_more():
    def sigma(walk):
        generator = np.random.default_rng(7)
        zero, true = tared(), 120.0
        for second in range(1, 1200, 5):
            true += walk * np.sqrt(5 / 60) * generator.standard_normal()
            for part in range(6):
                reading = true + 0.5 * generator.standard_normal()
                zero.free_reading(reading, 0.5, second + 0.25 * part, steps_counts=(-10.0, 10.0))
        zero.advance(1500.0)
        return zero.drift_sigma_counts

    assert sigma(0.5) > 1.5 * sigma(0.1)


def test_a_forgotten_zero_must_be_taken_again():
    zero = ZeroTracker(DRIFT_8_BIT)
    zero.tare(120.0, 0.05, 0.0)
    zero.forget()
    assert not zero.tared
