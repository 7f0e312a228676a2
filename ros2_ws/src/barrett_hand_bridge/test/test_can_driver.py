"""The CAN driver and the emulated pucks over an in-process bus: set-up, cycles, trouble."""

import itertools
import math

import can
import pytest

from barrett_hand_bridge.emulator.can_hand import CanHand as EmulatedHand
from barrett_hand_bridge.emulator.can_port import BusSchedule, CanPort
from barrett_hand_bridge.emulator.faults import Fault
from barrett_hand_bridge.emulator.mechanics import SCALE_280, HandBody, HandMechanics
from barrett_hand_bridge.hand import HandError, HandNotInitialisedError
from barrett_hand_bridge.puck import driver
from barrett_hand_bridge.puck.bus import open_bus
from barrett_hand_bridge.puck.driver import CanHand

channels = (f'hand_{number}' for number in itertools.count())


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(driver, 'WAKE_SILENCE_S', 0.02)
    monkeypatch.setattr(driver, 'RETRIES_S', (0.5, 3.0))


@pytest.fixture
def bench(quick):
    """An emulated hand served in a thread, and a driver for it."""
    started = []

    def build(*, firmware=190, faults=(), seed=1, prepare=lambda emulated: None, **options):
        emulated = EmulatedHand(HandMechanics(HandBody(scale=SCALE_280), seed), firmware=firmware)
        prepare(emulated)
        channel = next(channels)
        port = CanPort(
            BusSchedule(emulated, paced=False, faults=faults),
            lambda: can.Bus(interface='virtual', channel=channel),
        )
        port.start()
        hand = CanHand(lambda: open_bus('virtual', channel), **options)
        hand.strike = port.faults.strike
        started.append((hand, port))
        return hand, emulated

    yield build
    for hand, port in started:
        hand.close()
        port.stop()


def test_sleeping_pucks_are_woken_and_the_hand_says_what_it_is(bench):
    hand, emulated = bench()
    facts = hand.connect()
    assert (facts.model, facts.firmware, facts.serial_number) == ('BH8-280', '190', '2801')
    assert all(puck.awake for puck in emulated.pucks.values())


def test_a_hand_that_just_woke_up_must_be_initialised(bench):
    hand, _ = bench()
    hand.connect()
    with pytest.raises(HandNotInitialisedError):
        hand.sample(None)
    hand.initialize()
    assert hand.sample(None).finger_counts == (0, 0, 0)


def test_a_hand_that_was_awake_keeps_its_positions(bench):
    def awake(emulated):
        for puck in emulated.pucks.values():
            puck.awake = True
        emulated.mechanics.place({1: 50_000.0})

    hand, _ = bench(prepare=awake)
    hand.connect()
    assert hand.sample(None).finger_counts[0] == 50_000


def test_gauges_positions_and_inner_encoders_come_together(bench):
    hand, emulated = bench()
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({2: 80_000.0, 4: 17_920.0})
    for _ in range(2):
        sample = hand.sample(None)
    assert sample.finger_counts[1] == 80_000
    assert sample.spread_counts == 17_920
    assert sample.inner_rad[1] == pytest.approx(80_000 * 1.2271847e-5, abs=5e-5)
    assert all(1500 < counts < 2300 for counts in sample.gauge_counts)


def test_old_firmware_has_no_inner_encoder(bench):
    hand, _ = bench(firmware=120)
    hand.connect()
    hand.initialize()
    assert hand.sample(None).inner_rad == (None, None, None)


def test_firmware_without_a_gauge_property_is_refused_with_its_number(bench):
    hand, _ = bench(firmware=60)
    with pytest.raises(HandError, match='needs firmware 61'):
        hand.connect()


def test_velocities_move_and_zero_stops(bench):
    hand, emulated = bench(prefetch=False)
    hand.connect()
    hand.initialize()
    while hand.sample({1: 0.5}).finger_counts[0] < 5000:
        continue
    hand.sample({})
    hand.sample({})
    assert not emulated.mechanics.motors[1].moving


def test_a_finger_without_gauge_is_told_by_its_role(bench):
    def no_gauge(emulated):
        emulated.mechanics.gauges[3].fitted = False

    hand, _ = bench(prepare=no_gauge)
    hand.connect()
    hand.initialize()
    assert hand.sample(None).gauge_counts[2] is None


def test_a_finger_above_its_gauge_limit_is_seen_to_relieve_itself(bench):
    hand, emulated = bench()
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({1: 60_000.0})
    emulated.mechanics._torques[1] = 1.3
    emulated.mechanics._settle = lambda: None
    seen = False
    for _ in range(2000):
        sample = hand.sample(None)
        seen = seen or sample.relieving[0]
        if seen and sample.finger_counts[0] < 60_000:
            break
    assert seen
    assert sample.finger_counts[0] < 60_000


def test_lost_frames_are_noticed_and_named(bench):
    hand, emulated = bench(prefetch=False)
    hand.connect()
    hand.initialize()
    hand.sample(None)
    emulated.pucks[2].awake = False
    late = []
    hand.late = lambda: late.append(1)
    with pytest.raises(HandError, match='finger 2: is it asleep'):
        hand.sample(None)
    assert late
    with pytest.raises(HandNotInitialisedError):
        hand.sample(None)


@pytest.mark.parametrize('kind', ['drop', 'garble'])
def test_a_lost_or_changed_frame_is_asked_for_again(bench, kind):
    hand, emulated = bench(faults=[Fault(kind, math.inf, 2)])
    hand.connect()
    hand.initialize()
    late = []
    hand.late = lambda: late.append(1)
    hand.sample(None)
    emulated.mechanics.place({1: 50_000.0})
    hand.strike()
    samples = [hand.sample(None) for _ in range(5)]
    assert late
    # Nothing of the doubled answers is left for later cycles.
    emulated.mechanics.place({1: 60_000.0})
    samples = [hand.sample(None) for _ in range(2)]
    assert samples[-1].finger_counts[0] == 60_000


def test_a_finger_above_its_strain_limit_is_seen_to_give_way(bench):
    hand, emulated = bench(prefetch=False)
    hand.connect()
    hand.initialize()
    zero = hand.sample(None).gauge_counts[0]
    hand.limit_force({1: zero + 300})
    assert not hand.sample(None).relieving[0]
    emulated.mechanics.place({1: 60_000.0})
    emulated.mechanics._torques[1] = 0.3
    emulated.mechanics._settle = lambda: None
    for _ in range(2000):
        sample = hand.sample(None)
        if sample.relieving[0] and sample.finger_counts[0] < 60_000:
            break
    assert sample.relieving[0]
    assert sample.strain_limits == (zero + 300, None, None)


def test_garbled_frames_are_counted_not_believed(bench):
    hand, _ = bench(faults=[Fault('garble', 0.0, 4)])
    with pytest.raises(HandError, match='does not answer'):
        hand.connect()


def test_full_touch_frames_arrive_cell_by_cell(bench):
    def press(emulated):
        emulated.pressures[2][7] = 3.5

    hand, _ = bench(prepare=press, touch='full', touch_every=1)
    hand.connect()
    hand.initialize()
    for _ in range(5):
        sample = hand.sample(None)
    assert sample.tactile_n_per_cm2[2][7] == 3.5
    assert sum(sample.tactile_n_per_cm2[1]) == 0.0


def test_top_10_touch_frames_arrive_in_whole_newtons(bench):
    def press(emulated):
        emulated.pressures[3][23] = 6.9

    hand, _ = bench(prepare=press, touch='top10', touch_every=1)
    hand.connect()
    hand.initialize()
    for _ in range(5):
        sample = hand.sample(None)
    assert sample.tactile_n_per_cm2[3][23] == 6.0


def test_the_hottest_motor_controller_is_told_of(bench):
    hand, emulated = bench(faults=[Fault('hot', math.inf, 0)])
    hand.connect()
    hand.initialize()
    assert max(hand.sample(None).temperature_c or 0 for _ in range(3)) == 32
    hand.strike()
    assert any(hand.sample(None).temperature_c == 70 for _ in range(3000))


def test_strain_limits_reach_the_pucks(bench):
    hand, emulated = bench()
    hand.connect()
    hand.limit_force({1: 3000, 2: None, 3: 2500})
    hand._pucks.get(1, 'STAT')
    assert [emulated.pucks[finger].values[71] for finger in (1, 2, 3)] == [3000, 0, 2500]


def test_a_silent_bus_is_one_clear_sentence(quick):
    hand = CanHand(lambda: open_bus('virtual', next(channels)))
    with pytest.raises(HandError, match='node 11, 12, 13, 14 does not answer'):
        hand.connect()


def test_a_channel_that_cannot_be_opened_is_named():
    with pytest.raises(HandError, match="'nowhere' of interface 'slcan'"):
        open_bus('slcan', 'nowhere')
