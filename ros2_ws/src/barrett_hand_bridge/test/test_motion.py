# SPDX-License-Identifier: Apache-2.0
"""Motions: what they command, when they end, what they refuse."""

import math
from dataclasses import replace

import numpy as np
import pytest

from barrett_hand_bridge.calibration import GaugeCalibration
from barrett_hand_bridge.contacts import FLAG_CONTACT, FLAG_NOT_TARED
from barrett_hand_bridge.hand import ENCODER_262, HandSample
from barrett_hand_bridge.motion import (
    CloseSettings,
    Closing,
    Following,
    MotionError,
    MotionResult,
    Opening,
    ToGap,
    TrajectoryPoint,
    out_of_reach,
    slower_than_hand,
)
from barrett_hand_bridge.observer import HandObserver, ObserverSettings
from barrett_hand_bridge.tracking import Tracking, far_from_hand

GAUGE = GaugeCalibration(
    'cubic', coefficients_nm=(0.0, 0.01), no_load_counts=(100, 140), noise_counts=0.5
)
OBSERVER = HandObserver(ObserverSettings(dict.fromkeys((1, 2, 3), GAUGE)))
SETTINGS = CloseSettings(5.0, 1.0, 0.3, 0.02)


def state(degrees=40.0, force=0.0, flags=0, torque=0.0, spread=90.0):
    counts = round(math.radians(degrees) / ENCODER_262.finger_rad_per_count)
    turn = round(math.radians(spread) / ENCODER_262.spread_rad_per_count)
    sample = HandSample(0, (counts, counts, counts), turn, (120, 120, 120))
    observation = OBSERVER.observe(sample)
    fingers = {}
    for finger, reading in observation.fingers.items():
        contact = replace(
            reading.contact, flags=flags, force=force * np.asarray(reading.contact.normal)
        )
        fingers[finger] = replace(reading, contact=contact, torque_nm=torque)
    return replace(observation, fingers=fingers)


def test_opening_runs_all_closed_fingers_backwards_until_they_are_open():
    motion = Opening((1, 2, 3), 0.8)
    assert motion.step(state(40.0), 0.0) == {1: -0.8, 2: -0.8, 3: -0.8}
    assert motion.step(state(0.0), 1.0) == MotionResult(True, 'open')


def test_opening_gives_up_when_nothing_moves():
    motion = Opening((1,), 0.8)
    motion.step(state(40.0), 0.0)
    result = motion.step(state(40.0), 2.0)
    assert isinstance(result, MotionResult) and not result.done


def test_closing_slows_down_at_touch():
    motion = Closing((1, 2), SETTINGS)
    assert motion.step(state(), 0.0) == {1: 0.3, 2: 0.3}
    assert motion.step(state(41.0, 1.0, FLAG_CONTACT), 0.1) == {1: 0.02, 2: 0.02}


def test_closing_ends_when_every_finger_has_its_force_and_answers_with_it():
    motion = Closing((1, 2), SETTINGS)
    assert motion.step(state(40, 5.1, FLAG_CONTACT), 0.0) == {}
    # It went on rising until the motors stood.
    assert motion.step(state(40, 9.3, FLAG_CONTACT), 0.2) == MotionResult(
        True, 'closed, finger 1 9.30 N, finger 2 9.30 N; 5 N were asked for'
    )


def test_a_speed_below_the_step_of_the_hand_is_refused_with_the_step():
    assert slower_than_hand({'squeeze_speed': 0.02}, 0.0123) == ''
    assert 'squeeze_speed is 0.003 rad/s' in slower_than_hand({'squeeze_speed': 0.003}, 0.0123)


def test_closing_stops_at_the_torque_limit():
    result = Closing((1, 2), SETTINGS).step(state(40, 2.0, FLAG_CONTACT, torque=1.01), 0.0)
    assert isinstance(result, MotionResult)
    assert 'torque limit of 1 N m' in result.message


def test_closing_needs_a_tared_gauge():
    result = Closing((1,), SETTINGS).step(state(flags=FLAG_NOT_TARED), 0.0)
    assert isinstance(result, MotionResult)
    assert 'hand/tare' in result.message


def test_closing_lets_the_hand_stop_itself_a_little_above_the_force():
    observation = state()
    arm = observation.fingers[1].arm_m
    limit = Closing((1,), SETTINGS).limit_nm(observation)
    assert 5.0 * arm < limit < 1.5 * 5.0 * arm


def test_the_hand_never_gets_a_strain_limit_beyond_the_torque_limit():
    settings = replace(SETTINGS, force_n=25.0)
    assert Closing((1,), settings).limit_nm(state()) == settings.torque_limit_nm


def test_closing_on_nothing_ends_at_the_end_of_travel():
    result = Closing((1,), SETTINGS).step(state(140.0), 0.0)
    assert isinstance(result, MotionResult) and not result.done


def pins_apart(gap_m, force=0.0, flags=0):
    observation = state(40.0, force, flags)
    fingers = dict(observation.fingers)
    for finger, side in ((1, -0.5), (2, 0.5)):
        place = np.array([side * gap_m, 0.0, 0.1])
        contact = replace(fingers[finger].contact, point=place)
        fingers[finger] = replace(fingers[finger], contact=contact)
    return replace(observation, fingers=fingers)


def to_gap(gap_m):
    return ToGap(gap_m, Closing((1, 2), SETTINGS), Opening((1, 2, 3), 0.8))


def test_pins_further_apart_than_asked_for_close_until_they_are_not():
    motion = to_gap(0.040)
    assert motion.gap_m(pins_apart(0.060)) == pytest.approx(0.060)
    assert motion.step(pins_apart(0.060), 0.0) == {1: 0.3, 2: 0.3}
    assert not motion.reached
    ended = motion.step(pins_apart(0.0398), 1.0)
    assert ended == MotionResult(True, 'the pins stand 39.8 mm apart')
    assert motion.reached and not motion.stalled


def test_pins_nearer_than_asked_for_open_until_they_are_not():
    motion = to_gap(0.040)
    assert motion.step(pins_apart(0.020), 0.0) == {1: -0.8, 2: -0.8, 3: -0.8}
    ended = motion.step(pins_apart(0.041), 1.0)
    assert ended == MotionResult(True, 'the pins stand 41.0 mm apart')
    assert motion.reached and not motion.stalled


def test_pins_that_meet_their_force_first_have_stalled():
    motion = to_gap(0.040)
    held = pins_apart(0.060, 5.2, FLAG_CONTACT)
    assert motion.force_n(held) == pytest.approx(5.2)
    motion.step(held, 0.0)
    assert motion.step(held, 0.3).done
    assert motion.stalled and not motion.reached


def test_a_gap_is_of_two_fingers_and_no_wider_than_the_hand():
    with pytest.raises(MotionError, match='gap is -0.001 m'):
        to_gap(-0.001)
    with pytest.raises(MotionError, match='other than two fingers'):
        ToGap(0.04, Closing((1, 2, 3), SETTINGS), Opening((1, 2, 3), 0.8))
    assert to_gap(0.04).speeds() == {
        'approach_speed': 0.3, 'squeeze_speed': 0.02, 'open_speed': 0.8,
    }  # fmt: skip


@pytest.mark.parametrize(('motor', 'highest'), [(1, math.radians(140.0)), (4, math.pi)])
def test_a_joint_reaches_its_stops_and_not_beyond(motor, highest):
    # A twentieth of a degree, 0.87 mrad, counts as at the stop.
    for inside in (0.0, -0.0008, highest, highest + 0.0008):
        assert out_of_reach(motor, inside) == ''
    for outside in (-0.001, highest + 0.001, math.nan):
        assert 'must be 0 to' in out_of_reach(motor, outside)


def following(*points, **options):
    options = {'fastest_rad_s': 1.0, 'torque_limit_nm': 1.0, **options}
    return Following([TrajectoryPoint(t, p) for t, p in points], **options)


def test_a_trajectory_runs_at_the_speed_of_its_lines():
    motion = following((2.0, {1: math.radians(60)}))
    velocity = motion.step(state(40.0), 10.0)[1]
    assert velocity == pytest.approx(math.radians(10), rel=0.02)


def test_a_trajectory_corrects_what_it_lags():
    motion = following((2.0, {1: math.radians(60)}))
    motion.step(state(40.0), 10.0)
    assert motion.step(state(45.0), 11.0)[1] > math.radians(10) * 1.5


def test_a_trajectory_ends_on_its_last_point():
    motion = following((2.0, {1: math.radians(60)}))
    motion.step(state(40.0), 10.0)
    assert motion.step(state(60.0), 12.1) == MotionResult(True, 'trajectory followed')


def test_a_trajectory_that_ends_elsewhere_says_by_how_much():
    motion = following((2.0, {1: math.radians(60)}))
    motion.step(state(40.0), 10.0)
    result = motion.step(state(55.0), 16.0)
    assert '5.0' in result.message and not result.done


def test_a_trajectory_stops_at_the_torque_limit():
    motion = following((2.0, {1: math.radians(60)}))
    result = motion.step(state(40.0, torque=1.2), 10.0)
    assert isinstance(result, MotionResult) and '1.20 N m' in result.message


def test_a_first_point_too_far_away_is_refused_before_anything_moves():
    result = following((0.1, {1: math.radians(90)})).step(state(40.0), 0.0)
    assert isinstance(result, MotionResult) and 'too fast' in result.message


@pytest.mark.parametrize(
    ('points', 'complaint'),
    [
        ([], 'no points'),
        ([(1.0, {1: 9.0})], 'must be 0 to'),
        ([(1.0, {1: float('nan')})], 'must be 0 to'),
        ([(1.0, {1: 0.5}), (1.0, {1: 0.6})], 'times must rise'),
        ([(1.0, {1: 0.0}), (1.1, {1: 1.0})], 'would run 10.00 rad/s'),
        ([(-1.0, {1: 0.0})], 'time -1'),
    ],
)
def test_an_impossible_trajectory_is_refused(points, complaint):
    with pytest.raises(MotionError, match=complaint):
        following(*points)


def test_a_command_far_from_the_hand_does_not_start_it():
    assert far_from_hand(state(40.0), {1: math.radians(41.0)}) == ''
    assert 'stands 40.0 degrees' in far_from_hand(state(40.0), {1: 0.0})


def test_it_goes_where_it_is_aimed_at_last_and_ends_there():
    motion = Tracking({1: math.radians(41.0)}, fastest_rad_s=0.8, torque_limit_nm=1.0)
    assert motion.step(state(40.0), 0.0)[1] == pytest.approx(10.0 * math.radians(1.0), rel=0.01)
    motion.aim({1: math.radians(80.0)})
    assert motion.step(state(41.0), 0.1) == {1: 0.8}
    assert isinstance(motion.step(state(80.0), 0.4), dict)
    assert motion.step(state(80.0), 0.7) == MotionResult(True, 'at the commanded position')
    assert motion.arrived == {1: math.radians(80.0)}


def test_a_finger_that_meets_something_or_stands_ends_it():
    motion = Tracking({1: math.radians(60.0)}, fastest_rad_s=0.8, torque_limit_nm=0.5)
    met = motion.step(state(40.0, torque=0.6), 0.0)
    assert not met.done and '0.60 N m' in met.message
    motion.step(state(40.0), 0.1)
    stuck = motion.step(state(40.0), 1.3)
    assert not stuck.done and 'does not come nearer' in stuck.message
