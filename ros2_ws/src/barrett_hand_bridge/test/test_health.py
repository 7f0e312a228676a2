# SPDX-License-Identifier: Apache-2.0
"""What /diagnostics says: the worst thing first, in one sentence."""

from dataclasses import replace

import pytest

from barrett_hand_bridge.calibration import GaugeCalibration
from barrett_hand_bridge.hand import HandSample
from barrett_hand_bridge.health import Health, Level, LinkState
from barrett_hand_bridge.observer import HandObserver, ObserverSettings
from barrett_hand_bridge.statistics import Delays, Rate

GAUGE = GaugeCalibration(
    'cubic',
    coefficients_nm=(0.0, 0.01),
    reference_counts=120.0,
    no_load_counts=(100, 140),
    noise_counts=0.5,
)


@pytest.fixture
def observer():
    observer = HandObserver(ObserverSettings(dict.fromkeys((1, 2, 3), GAUGE)))
    observer.tare([sample(120, stamp, (0, 0, 0)) for stamp in range(100)])
    return observer


def sample(counts=120, stamp=100, fingers=(5000, 5000, 0)):
    return HandSample(stamp * 10_000_000, fingers, 1575, (counts, 120, 120))


def judge(observer, counts=120, **changes):
    taken = replace(sample(counts), **changes)
    health = Health(state=LinkState.CYCLING)
    health.take(taken, 0.0)
    return health.judge(observer.observe(taken), taken, 0.5)


def test_a_free_hand_is_well(observer):
    assert judge(observer) == (Level.OK, 'free')


def test_a_lost_hand_is_an_error_with_its_reason():
    assert Health(state=LinkState.LOST, reason='gone').judge(None, None, 0.0) == (
        Level.ERROR,
        'gone',
    )


def test_a_gauge_near_its_end_is_a_warning(observer):
    level, text = judge(observer, 120 + 95)
    assert level is Level.WARN and 'gauge ends soon' in text


def test_a_gauge_beyond_its_end_is_an_error(observer):
    level, text = judge(observer, 120 + 110)
    assert level is Level.ERROR and 'not to be trusted' in text


def test_a_finger_that_relieves_itself_is_an_error(observer):
    level, text = judge(observer, relieving=(False, True, False))
    assert level is Level.ERROR and 'finger 2 protects its gauge' in text


def test_a_driver_that_stands_is_seen_within_a_second(observer):
    taken = sample()
    health = Health(state=LinkState.CYCLING)
    health.take(taken, 0.0)
    level, text = health.judge(observer.observe(taken), taken, 1.01)
    assert level is Level.STALE and 'no cycle for 1.0 s' in text


def test_a_hand_too_hot_to_hold_is_an_error_with_what_ends(observer):
    taken = replace(sample(), temperature_c=66.0)
    health = Health(state=LinkState.CYCLING, hottest_c=65.0)
    health.take(taken, 0.0)
    level, text = health.judge(observer.observe(taken), taken, 0.5)
    assert level is Level.ERROR and 'holding has ended' in text


def test_every_motor_is_told_in_numbers(observer):
    taken = replace(sample(), motors={3: {'THERM': 41}}, clutch_open=(None, None, True))
    values = Health(state=LinkState.CYCLING).values(observer.observe(taken), taken, observer, 0.0)
    assert values['motor 3 winding (degrees Celsius, THERM)'] == '41'
    assert values['finger 3 broke away'] == 'yes'


def test_a_finger_that_gave_way_between_two_diagnostics_is_still_told_of(observer):
    health = Health(state=LinkState.CYCLING)
    for time_s, relieving in ((0.0, True), (0.01, True), (0.02, False), (0.1, True), (0.2, False)):
        taken = replace(sample(), relieving=(False, relieving, False))
        health.take(taken, time_s)
    observation = observer.observe(taken)
    assert health.judge(observation, taken, 1.0)[0] is Level.ERROR
    health.take(taken, 10.0)
    assert health.judge(observation, taken, 10.0)[0] is Level.OK
    values = health.values(observation, taken, observer, 10.0)
    assert values['finger 2 gave way by itself (times)'] == '2'


def test_the_strain_limits_of_the_hand_are_shown(observer):
    taken = replace(sample(), strain_limits=(214, None, None))
    values = Health().values(observer.observe(taken), taken, observer, 0.0)
    assert values['finger 1 strain limit HSG (counts)'] == '214'
    assert values['finger 2 strain limit HSG (counts)'] == 'none'


def test_the_age_of_a_zero_is_counted_from_its_tare(observer):
    values = Health().values(observer.observe(sample(stamp=1299)), sample(), observer, 0.0)
    assert values['finger 1 zero age (s)'] == '12'


def test_a_zero_in_doubt_is_a_warning_that_says_how_to_end_it():
    observer = HandObserver(ObserverSettings(dict.fromkeys((1, 2, 3), GAUGE)))
    observer.tare([sample(120, stamp) for stamp in range(100)])
    level, text = judge(observer)
    assert level is Level.WARN and 'open the hand and tare' in text


def test_a_hot_hand_is_an_error(observer):
    assert judge(observer, temperature_c=70.0)[0] is Level.ERROR


def test_an_untared_hand_is_a_warning(observer):
    observer.forget_zeros()
    level, text = judge(observer)
    assert level is Level.WARN and 'hand/tare' in text


def test_values_tell_where_each_gauge_ends(observer):
    taken = sample()
    values = Health(state=LinkState.CYCLING).values(observer.observe(taken), taken, observer, 0.0)
    assert 10.0 < float(values['finger 1 gauge ends at (N)']) < 25.0
    assert float(values['finger 1 zero (counts)']) == pytest.approx(120.0)


def test_rates_and_delays_look_at_the_recent_past():
    rate, delays = Rate(), Delays()
    for i in range(300):
        rate.count(i / 100.0)
        delays.add(i * 1e-3)
    assert rate.per_second(3.0) == pytest.approx(100, abs=2)
    assert rate.per_second(60.0) == 0.0
    assert delays.percentile(50) == pytest.approx(0.15, abs=0.01)
