# SPDX-License-Identifier: Apache-2.0
"""The CAN driver and the emulated pucks over an in-process bus: set-up, cycles, trouble."""

import errno
import itertools
import math
from types import SimpleNamespace

import can
import pytest
from can.interfaces.virtual import VirtualBus

from barrett_hand_bridge.emulator.can_hand import CanHand as EmulatedHand
from barrett_hand_bridge.emulator.can_port import BusSchedule, CanPort
from barrett_hand_bridge.emulator.faults import Fault
from barrett_hand_bridge.emulator.mechanics import SCALE_280, HandBody, HandMechanics
from barrett_hand_bridge.hand import HandError, HandNotInitialisedError
from barrett_hand_bridge.puck import driver, homing, pucks
from barrett_hand_bridge.puck.bus import open_bus
from barrett_hand_bridge.puck.driver import CanHand, PuckOptions
from barrett_hand_bridge.puck.frames import HandAddresses, set_frame
from barrett_hand_bridge.puck.properties import is_wide
from barrett_hand_bridge.puck.pucks import Pucks

channels = (f'hand_{number}' for number in itertools.count())


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(driver, 'WAKE_SILENCE_S', 0.02)
    monkeypatch.setattr(driver, 'RETRIES_S', (0.5, 3.0))
    monkeypatch.setattr(homing, 'STARTING_S', 0.0)
    monkeypatch.setattr(homing, 'POLL_S', 0.001)


@pytest.fixture
def bench(quick):
    """An emulated hand served in a thread, and a driver for it that asks for nothing forbidden."""
    started = []

    def build(
        *,
        firmware=190,
        faults=(),
        seed=1,
        first_node=11,
        channel=None,
        prepare=lambda emulated: None,
        **driver_options,
    ):
        emulated = EmulatedHand(
            HandMechanics(HandBody(scale=SCALE_280), seed),
            firmware=firmware,
            first_node=first_node,
        )
        prepare(emulated)
        channel = channel or next(channels)
        port = CanPort(
            BusSchedule(emulated, paced=False, faults=faults),
            lambda: can.Bus(interface='virtual', channel=channel),
        )
        port.start()
        hand = CanHand(lambda: open_bus('virtual', channel), **driver_options)
        hand.strike = port.faults.strike
        started.append((hand, port, emulated))
        return hand, emulated

    yield build
    for hand, port, emulated in started:
        hand.close()
        port.stop()
        assert emulated.refusals == []


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


def test_a_hand_that_was_homed_keeps_its_positions_over_a_restart_of_the_bridge(bench):
    hand, emulated = bench()
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({1: 50_000.0})
    hand.connect()
    assert hand.sample(None).finger_counts[0] == 50_000


def test_a_hand_that_was_only_woken_is_not_homed_after_a_restart_of_the_bridge(bench):
    hand, _ = bench()
    hand.connect()
    hand.connect()
    with pytest.raises(HandNotInitialisedError, match='since it was switched on'):
        hand.sample(None)


def test_a_hand_that_lost_its_power_must_be_homed_again(bench):
    hand, emulated = bench()
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({1: 50_000.0})
    emulated.power_cycle()
    hand.connect()
    with pytest.raises(HandNotInitialisedError):
        hand.sample(None)


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
    hand, emulated = bench(options=PuckOptions(touch='full', touch_every=1))
    hand.connect()
    hand.initialize()
    hand.sample(None)
    emulated.pressures[2][7] = 3.5
    samples = (hand.sample(None).tactile_n_per_cm2 for _ in range(1000))
    cells = next(cells for cells in samples if cells and cells[2][7])
    assert cells[2][7] == 3.5
    assert sum(cells[1]) == 0.0


def test_top_10_touch_frames_arrive_in_whole_newtons(bench):
    hand, emulated = bench(options=PuckOptions(touch='top10', touch_every=1))
    hand.connect()
    hand.initialize()
    hand.sample(None)
    emulated.pressures[3][23] = 6.9
    samples = (hand.sample(None).tactile_n_per_cm2 for _ in range(1000))
    cells = next(cells for cells in samples if cells and cells[3][23])
    assert cells[3][23] == 6.0


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


def test_firmware_without_a_strain_limit_is_told_and_gets_none(bench):
    hand, _ = bench(firmware=180)
    assert 'no strain limit HSG' in hand.connect().warnings[0]
    hand.limit_force({1: 3000, 2: None, 3: 2500})
    assert hand._pucks.get(1, 'STAT') == 2


def test_homing_follows_the_makers_order_three_times_over(bench, monkeypatch):
    hand, emulated = bench()
    commands = []
    received = emulated.receive
    monkeypatch.setattr(
        emulated,
        'receive',
        lambda identifier, data: (
            commands.append(identifier & 0x1F) if data[0] == 0x80 | 29 else None,
            received(identifier, data),
        ),
    )
    hand.connect()
    hand.initialize()
    assert commands == [11, 12, 13] * 3 + [14]


def test_a_finger_that_does_not_finish_homing_stops_all_motors(bench, monkeypatch):
    monkeypatch.setattr(homing, 'MOTOR_TIMEOUT_S', 0.2)
    hand, emulated = bench()
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({2: 190_000.0})
    with pytest.raises(HandError, match=r'finger 2 \(node 12\) did not finish'):
        hand.initialize()
    hand._pucks.get(1, 'STAT')
    assert [puck.mode for puck in emulated.pucks.values()] == [0, 0, 0, 0]
    with pytest.raises(HandNotInitialisedError):
        hand.sample(None)


def test_a_finger_under_position_control_still_travels_unless_it_holds(bench):
    hand, emulated = bench()
    hand.connect()
    for motor in (1, 4):
        emulated.pucks[motor].mode = 3
    assert not homing.at_rest(hand._pucks, 1)
    assert homing.at_rest(hand._pucks, 4)


def test_velocity_mode_gets_its_stall_time_and_limits_and_gives_them_back(bench):
    hand, emulated = bench(prefetch=False, options=PuckOptions(motor_torque=1500))
    hand.connect()
    hand.initialize()
    hand.sample({1: 2.5})
    values = emulated.pucks[1].values
    assert (values[78], values[43]) == (0, 1500)
    assert values[45] >= 2.5 / 1.2272e-2
    hand.sample({})
    hand.sample({})
    assert values[78] == 50


def test_fingers_open_by_a_movement_command_that_ends_when_nobody_watches(bench, wait_until):
    hand, emulated = bench(prefetch=False)
    hand.connect()
    hand.initialize()
    while hand.sample({1: 2.5}).finger_counts[0] < 5000:
        continue
    hand.sample({})
    assert hand.open_by_itself({1: 0.8})
    # Not one frame more: this is what remains of a motion whose host has died.
    wait_until(lambda: emulated.mechanics.encoder_counts(1) == 0, 20.0)
    wait_until(lambda: emulated.pucks[1].mode == 0, 20.0)
    slowed = emulated.pucks[1].values[45]
    hand.sample({1: 2.5})
    wait_until(lambda: emulated.pucks[1].values[45] > slowed, 20.0)


def test_a_motor_before_its_homing_does_not_run_whatever_it_is_told(bench):
    hand, emulated = bench()
    hand.connect()
    hand._pucks.set(1, 'V', 100)
    hand._pucks.set(1, 'MODE', 4)
    hand._pucks.set(1, 'CMD', 18)
    assert hand._pucks.get(1, 'MODE') == 0
    assert emulated.refusals == ['mode 4 of node 11 before HI', 'command 18 of node 11 before HI']
    emulated.refusals.clear()


@pytest.mark.parametrize(
    ('firmware', 'motor', 'name', 'value', 'refusal'),
    [
        (190, 1, 'MODE', 1, 'mode 1 of node 11, which is none'),
        (190, 1, 'MODE', 6, 'mode 6 of node 11, which is none'),
        (190, 1, 'CMD', 99, 'command 99 of node 11, which is none'),
        (190, 1, 'V', 5000, 'V 5000 of node 11 beyond MV 306'),
        (190, 2, 'TEMP', 20, 'a value for property 9, which is measured'),
        (190, 2, 'SG', 100, 'a value for property 25, which is measured'),
        (180, 3, 71, 3000, 'property 71 in firmware 180'),
        (140, 3, 106, 2, 'property 106 in firmware 140'),
        (124, 3, 96, 0, 'property 96 in firmware 124'),
    ],
)
def test_the_emulated_hand_refuses_what_a_hand_would(bench, firmware, motor, name, value, refusal):
    hand, emulated = bench(firmware=firmware)
    hand.connect()
    hand.initialize()
    pucks = hand._pucks
    if name == 'V':
        pucks.set(motor, 'MODE', 4)
    number = name if isinstance(name, int) else pucks.number(name)
    pucks.send(set_frame(pucks.addresses.node(motor), number, value, wide=is_wide(number)))
    # The answer to this comes after what was sent before.
    assert pucks.get(motor, 'STAT') == 2
    assert emulated.refusals == [refusal]
    emulated.refusals.clear()


def test_a_homing_that_was_broken_off_is_none(bench):
    hand, emulated = bench()
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({1: 100_000.0})
    hand._pucks.set(1, 'CMD', 13)
    hand._pucks.set(1, 'MODE', 0)
    hand._pucks.set(1, 'MODE', 4)
    assert hand._pucks.get(1, 'MODE') == 0
    assert emulated.refusals == ['mode 4 of node 11 before HI']
    emulated.refusals.clear()


def test_the_spread_does_not_find_its_zero_before_the_fingers(bench):
    hand, emulated = bench()
    hand.connect()
    hand._pucks.set(4, 'CMD', 13)
    assert hand._pucks.get(4, 'MODE') == 0
    assert emulated.refusals == ['HI of node 14 before that of the fingers has ended']
    emulated.refusals.clear()


def test_a_slow_squeeze_goes_on_because_its_stall_time_is_taken_away(bench, monkeypatch):
    hand, emulated = bench(prefetch=False)
    hand.connect()
    hand.initialize()
    monkeypatch.setattr(emulated.mechanics, 'truth', lambda finger: SimpleNamespace(force_n=5.0))
    # With the maker's stall time the same squeeze ends by itself.
    hand._pucks.set(2, 'V', 1)
    hand._pucks.set(2, 'MODE', 4)
    while hand.sample({1: 0.0123}).finger_counts[0] < 300:
        continue
    assert [emulated.pucks[finger].mode for finger in (1, 2)] == [4, 0]


def test_a_full_transmit_queue_is_waited_for(quick):
    class Full(VirtualBus):
        full = 3

        def send(self, message, timeout=None):
            if self.full:
                self.full -= 1
                raise can.CanOperationError('No buffer space available', errno.ENOBUFS)
            super().send(message, timeout)

    Pucks(Full(channel=next(channels))).ask_all('STAT')


def test_a_queue_that_stays_full_is_one_sentence_with_the_state_of_the_bus(quick):
    class Full(VirtualBus):
        def send(self, message, timeout=None):
            raise can.CanOperationError('No buffer space available', errno.ENOBUFS)

    with pytest.raises(HandError, match='No buffer space .* 0 error frames'):
        Pucks(Full(channel=next(channels))).ask_all('STAT')


def test_error_frames_are_counted_and_told_with_the_terminator(quick):
    channel = next(channels)
    noise = can.Bus(interface='virtual', channel=channel)
    hand = CanHand(lambda: open_bus('virtual', channel))
    opened = hand._open_line
    hand._open_line = lambda: (opened(), noise.send(can.Message(is_error_frame=True)))[0]
    with pytest.raises(HandError, match='1 error frames.*one terminator'):
        hand.connect()
    noise.shutdown()


@pytest.mark.parametrize('kind', ['another hand', 'an arm', 'a host', 'a broken cable'])
def test_others_who_talk_without_end_hold_nothing_up(kind, monkeypatch):
    monkeypatch.setattr(pucks, 'CHATTER_S', 0.01)
    told = {
        'another hand': {'arbitration_id': 0x6E3, 'data': bytes(6)},
        'an arm': {'arbitration_id': 0x423, 'data': bytes(3)},
        'a host': {'arbitration_id': 0x00B, 'data': b'\x05'},
        'a broken cable': {'is_error_frame': True},
    }[kind]
    heard = itertools.repeat(can.Message(is_extended_id=False, **told), 10**6)
    bus = SimpleNamespace(recv=lambda timeout: next(heard), send=lambda message, timeout: None)
    ours = Pucks(bus)
    ours.drain()
    ours.drain(driver.QUIET_S)
    assert ours.get(1, 'STAT') is None
    # Which is no more than a part of what came.
    assert next(heard)


def test_broken_inner_encoders_can_be_left_out(bench):
    hand, emulated = bench(options=PuckOptions(inner_encoders=False))
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({2: 80_000.0})
    sample = hand.sample(None)
    assert (sample.inner_rad, sample.clutch_open) == ((None, None, None), (None, None, None))


def test_a_finger_that_broke_away_is_told(bench):
    hand, emulated = bench(prefetch=False)
    hand.connect()
    hand.initialize()
    emulated.mechanics.place({2: 80_000.0})
    assert hand.sample(None).clutch_open == (False, False, False)
    emulated.mechanics.breakaway_counts[2] = 40_000.0
    assert hand.sample(None).clutch_open == (False, True, False)


def test_what_each_motor_says_of_itself_comes_round_once_a_second(bench):
    hand, _ = bench()
    hand.connect()
    hand.initialize()
    for _ in range(driver.MONITOR_CYCLES * 6 + 2):
        motors = hand.sample(None).motors
    assert motors[3] == {
        'TEMP': 32, 'THERM': 32, 'VBUS': 48, 'IMOTOR': 0, 'MODE': 0, 'ERROR': 0,
    }  # fmt: skip


def test_two_hands_on_one_bus_do_not_disturb_each_other(bench):
    channel = next(channels)
    own = PuckOptions(addresses=HandAddresses((21, 22, 23, 24), 17))
    left, left_hand = bench(channel=channel)
    right, right_hand = bench(channel=channel, first_node=21, options=own, seed=2)
    for hand in (left, right):
        hand.connect()
        hand.initialize()
    left_hand.mechanics.place({1: 10_000.0})
    right_hand.mechanics.place({1: 20_000.0})
    pairs = [(left.sample(None), right.sample(None)) for _ in range(3)]
    assert [sample.finger_counts[0] for sample in pairs[-1]] == [10_000, 20_000]
    right.sample({2: 0.5})
    left.stop()
    assert left._pucks.get(1, 'MODE') == 0
    assert right._pucks.get(2, 'MODE') == 4


def test_touch_cells_are_tared_when_the_hand_is_open(bench):
    def press(emulated):
        emulated.pressures[2][7] = 3.5

    hand, emulated = bench(prepare=press, options=PuckOptions(touch='full', touch_every=1))
    hand.connect()
    hand.initialize()
    hand.sample(None)
    emulated.pressures[2][8] = 2.0
    samples = (hand.sample(None).tactile_n_per_cm2 for _ in range(1000))
    cells = next(cells for cells in samples if cells and cells[2][8])
    assert (cells[2][7], cells[2][8]) == (0.0, 2.0)


def test_touch_cells_that_did_not_start_are_told_and_not_believed(bench):
    hand, emulated = bench(options=PuckOptions(touch='full', touch_every=1))
    emulated.touch_broken.add(2)
    assert 'finger 2 (node 12) did not start' in hand.connect().warnings[0]
    hand.initialize()
    for _ in range(5):
        sample = hand.sample(None)
    assert sorted(sample.tactile_n_per_cm2) == [1, 3, 4]


def test_a_silent_bus_is_one_clear_sentence(quick):
    hand = CanHand(lambda: open_bus('virtual', next(channels)))
    with pytest.raises(HandError, match='node 11, 12, 13, 14 does not answer'):
        hand.connect()


def test_a_channel_that_cannot_be_opened_is_named():
    with pytest.raises(HandError, match="'nowhere' of interface 'slcan'"):
        open_bus('slcan', 'nowhere')
