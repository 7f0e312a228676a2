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
    observer.tare([sample(120, stamp) for stamp in range(100)])
    return observer


def sample(counts=120, stamp=100):
    return HandSample(stamp * 10_000_000, (5000, 5000, 0), 1575, (counts, 120, 120))


def judge(observer, counts=120, **changes):
    taken = replace(sample(counts), **changes)
    health = Health(state=LinkState.CYCLING)
    return health.judge(observer.observe(taken), taken)


def test_a_free_hand_is_well(observer):
    assert judge(observer) == (Level.OK, 'free')


def test_a_lost_hand_is_an_error_with_its_reason():
    assert Health(state=LinkState.LOST, reason='gone').judge(None, None) == (Level.ERROR, 'gone')


def test_a_gauge_near_its_end_is_a_warning(observer):
    level, text = judge(observer, 120 + 95)
    assert level is Level.WARN and 'gauge ends soon' in text


def test_a_gauge_beyond_its_end_is_an_error(observer):
    level, text = judge(observer, 120 + 110)
    assert level is Level.ERROR and 'not to be trusted' in text


def test_a_finger_that_relieves_itself_is_an_error(observer):
    level, text = judge(observer, relieving=(False, True, False))
    assert level is Level.ERROR and 'finger 2 protects its gauge' in text


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
