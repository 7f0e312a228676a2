# SPDX-License-Identifier: Apache-2.0
"""The emulated BH8-262 against the documented protocol, byte by byte."""

import math
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.running import wait_until

from barrett_hand_bridge.emulator.faults import Fault
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.pty_port import PtyPort
from barrett_hand_bridge.emulator.serial_hand import SerialHand


@pytest.fixture
def hand():
    emulated = SerialHand(HandMechanics(HandBody(), seed=3), serial_number=77)
    emulated.take()
    return emulated


def answer(hand, line):
    hand.feed(line.encode() + b'\r')
    return hand.take()


def initialise(hand):
    hand.feed(b'HI\r')
    hand.advance(5.0)
    assert hand.take().endswith(b'\n\r=> ')


def test_banner_ends_with_the_prompt():
    emulated = SerialHand(HandMechanics(HandBody(), seed=3))
    banner = emulated.take()
    assert b'BarrettHand Firmware\n\r' in banner
    assert banner.endswith(b'=> ')


def test_every_character_is_echoed_at_once(hand):
    hand.feed(b'P')
    assert hand.take() == b'P'


def test_values_come_between_line_feed_carriage_return_and_prompt(hand):
    assert answer(hand, 'PGET SN') == b'PGET SN\n\r77\n\r=> '


def test_a_command_without_output_gives_just_a_prompt(hand):
    assert answer(hand, '12FSET LCV 1 LCVC 2') == b'12FSET LCV 1 LCVC 2\n\r=> '


def test_fget_without_prefix_answers_for_four_motors(hand):
    words = answer(hand, 'FGET P').split()
    assert words[2:6] == [b'0', b'0', b'0', b'0']


def test_a_bare_carriage_return_gives_a_prompt(hand):
    assert answer(hand, '') == b'\n\r=> '


@pytest.mark.parametrize(
    ('line', 'status'),
    [
        ('C', 4),
        ('XYZ', 32),
        ('FGET XYZ', 64),
        ('FSET HSG 300', 128),
        ('PSET BAUD 100', 128),
        ('FSET P 3', 256),
        ('M 1 2', 1024),
        ('1PGET SN', 4096),
        ('2VERS', 4096),
    ],
)
def test_refusals_carry_the_documented_status(hand, line, status):
    assert answer(hand, line) == line.encode() + f'\n\rERR {status}\n\r=> '.encode()


def test_msg_is_another_name_for_hsg(hand):
    answer(hand, '1FSET MSG 180')
    assert answer(hand, '1FGET HSG') == b'1FGET HSG\n\r180\n\r=> '


def test_lists_name_every_parameter_and_its_values(hand):
    words = answer(hand, 'PLISTV').split()
    assert words[words.index(b'BAUD') + 1] == b'96'
    words = answer(hand, 'GFLISTV').split()
    assert words[words.index(b'HSG') + 1 :][:3] == [b'256'] * 3
    assert b'HSG LSG' in answer(hand, 'FLIST')


def test_a_question_mark_names_every_command(hand):
    words = answer(hand, '?').split()
    assert {b'FGET', b'PSET', b'LOOP', b'HI', b'TC', b'VERS'} <= set(words)


def test_err_tells_the_status_of_the_last_motion(hand):
    initialise(hand)
    hand.feed(b'GC\r')
    hand.advance(0.1)
    hand.feed(b'\x03')
    hand.take()
    assert answer(hand, 'ERR') == b'ERR\n\r16384\n\r=> '


def test_the_prompt_comes_only_when_a_motion_has_ended(hand):
    initialise(hand)
    hand.feed(b'1M 1000\r')
    hand.advance(0.05)
    assert hand.take() == b'1M 1000'
    hand.advance(1.0)
    assert hand.take() == b'\n\r=> '
    assert answer(hand, '1FGET P') == b'1FGET P\n\r1000\n\r=> '


def test_control_c_aborts_a_motion_with_status_16384(hand):
    initialise(hand)
    hand.feed(b'GC\r')
    hand.advance(0.1)
    hand.take()
    hand.feed(b'\x03')
    assert hand.take() == b'\n\rERR 16384\n\r=> '


def test_strain_limit_stops_a_closing_finger_and_the_move_reports_16(hand):
    initialise(hand)
    zero = hand.mechanics.gauges[1].counts
    answer(hand, f'1FSET HSG {zero - 20}')
    hand.feed(b'1M 5000\r')
    hand.advance(2.0)
    assert hand.take().endswith(b'\n\rERR 16\n\r=> ')


def test_a_finger_at_its_strain_limit_does_not_creep_on_with_every_block(hand):
    initialise(hand)
    answer(hand, '1FSET LFV 0 LFS 0 LFAP 0 LFDP 0 LCPG 0')
    answer(hand, f'1FSET HSG {hand.mechanics.gauges[1].counts - 20}')
    answer(hand, '1LOOP')
    for _ in range(20):
        hand.feed(b'C\x10')
        hand.advance(0.01)
    assert hand.mechanics.motors[1].position == 0.0


def test_deltas_count_from_the_last_position_that_was_reported(hand):
    initialise(hand)
    answer(hand, '1FSET LFV 0 LFS 0 LFAP 0 LFDP 1 LFDPC 1')
    hand.mechanics.place({1: 300.0})
    answer(hand, '1FGET P')
    hand.mechanics.place({1: 310.0})
    answer(hand, '1LOOP')
    hand.feed(b'A')
    assert hand.take() == b'*\x0a'


def test_the_worked_realtime_example_of_the_manual():
    hand = SerialHand(HandMechanics(HandBody(), seed=3), firmware=(4, 3, 1))
    hand.take()
    initialise(hand)
    answer(hand, '12FSET LCV 1 LCVC 1 LCPG 0 LFV 0 LFS 1 LFAP 0 LFDP 1 LFDPC 1')
    answer(hand, '4FSET LCV 0 LCPG 0 LFV 0 LFS 0 LFAP 0 LFDP 1 LFDPC 1')
    answer(hand, 'PSET LFT 1')
    assert answer(hand, '124LOOP') == b'124LOOP*'
    hand.feed(b'C\x10')
    assert len(hand.take()) == 8
    hand.feed(b'\x10')
    assert hand.mechanics.motors[1].velocity == pytest.approx(100.0)


def test_temperature_takes_one_byte_from_firmware_4_4_on(hand):
    initialise(hand)
    answer(hand, 'PSET LFT 1')
    answer(hand, '1FSET LFV 0 LFS 1 LFAP 0 LFDP 0')
    answer(hand, '1LOOP')
    hand.feed(b'A')
    assert len(hand.take()) == 3


def test_firmware_4_3_does_not_know_the_flags_of_4_4():
    hand = SerialHand(HandMechanics(HandBody(), seed=3), firmware=(4, 3, 1))
    hand.take()
    assert answer(hand, '1FSET LFBP 0').endswith(b'ERR 64\n\r=> ')
    assert b'LFBP' not in answer(hand, 'FLIST')


def test_an_invalid_header_ends_the_loop_with_2048(hand):
    initialise(hand)
    answer(hand, 'LOOP')
    hand.feed(b'X')
    assert hand.take() == b'\n\rERR 2048\n\r=> '


def test_delta_positions_carry_over_what_does_not_fit(hand):
    initialise(hand)
    answer(hand, '1FSET LFV 0 LFS 0 LFAP 0 LFDP 1 LFDPC 1')
    answer(hand, '1LOOP')
    hand.mechanics.place({1: 200.0})
    deltas = []
    for _ in range(3):
        hand.feed(b'A')
        deltas.append(hand.take()[1])
    assert deltas == [127, 73, 0]


def test_loop_before_initialisation_is_refused(hand):
    assert answer(hand, '1234LOOP').endswith(b'ERR 4\n\r=> ')


def test_a_brown_out_prints_the_banner_at_9600_baud_and_forgets_initialisation(hand):
    initialise(hand)
    hand.power_cycle()
    assert b'BarrettHand Firmware' in hand.take()
    assert hand.baud == 9600
    assert answer(hand, 'GC').endswith(b'ERR 4\n\r=> ')


def test_same_seed_gives_the_same_bytes():
    def run(seed):
        hand = SerialHand(HandMechanics(HandBody(), seed))
        hand.take()
        initialise(hand)
        answer(hand, 'LOOP')
        data = b''
        for _ in range(50):
            hand.feed(b'A')
            hand.advance(0.01)
            data += hand.take()
        return data

    assert run(5) == run(5)
    assert run(5) != run(6)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=200))
def test_no_bytes_crash_the_emulated_hand(data):
    hand = SerialHand(HandMechanics(HandBody(), seed=1))
    hand.feed(data)
    hand.advance(0.05)
    hand.take()


@pytest.fixture
def line(hand, request):
    """A pty with a hand behind it that shows a fault when told to: its port and a way to ask."""
    port = PtyPort(hand, paced=False, real_time=False, faults=[request.param])
    port.start()
    client = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
    os.set_blocking(client, False)
    heard = bytearray()

    def hears(text):
        try:
            heard.extend(os.read(client, 4096))
        except BlockingIOError:
            return False
        return text in heard

    def asked(question, end):
        heard.clear()
        os.write(client, question)
        wait_until(lambda: hears(end))
        return bytes(heard)

    yield port, asked
    port.stop()
    os.close(client)


PLAIN = b'PGET SN\n\r77\n\r=> '


@pytest.mark.parametrize(
    ('line', 'answer'),
    [
        (Fault('drop', math.inf, 3), b'T SN\n\r77\n\r=> '),
        (Fault('garble', math.inf, 2), bytes(b ^ 0x5A for b in b'PG') + PLAIN[2:]),
        (Fault('brown-out', math.inf, 0), None),
    ],
    indirect=['line'],
)
def test_a_fault_strikes_the_line_when_it_is_told_to_and_not_before(line, answer, capsys):
    port, asked = line
    assert asked(b'PGET SN\r', b'=> ') == PLAIN
    port.faults.strike()
    if answer is None:
        assert b'BarrettHand Firmware' in asked(b'', b'=> ')
    else:
        wait_until(lambda: 'fault' in capsys.readouterr().err)
        with port.lock:
            pass
        assert asked(b'PGET SN\r', b'=> ') == answer


@pytest.mark.parametrize(
    ('line', 'shown'),
    [
        (Fault('hot', math.inf, 0), lambda hand: hand.temperature_c == 70.0),
        (Fault('loop-error', math.inf, 8), lambda hand: hand.loop_error == 8),
        (
            Fault('no-gauge', math.inf, 2),
            lambda hand: (
                [hand.mechanics.gauges[k].fitted for k in (1, 2, 3)] == [True, False, True]
            ),
        ),
    ],
    indirect=['line'],
)
def test_a_fault_of_the_hand_itself_is_that_and_no_other(line, shown):
    port, asked = line
    asked(b'PGET SN\r', b'=> ')
    assert not shown(port.hand)
    port.faults.strike()
    wait_until(lambda: shown(port.hand))
    fitted = all(port.hand.mechanics.gauges[finger].fitted for finger in (1, 2, 3))
    changed = (port.hand.temperature_c == 70.0, bool(port.hand.loop_error), not fitted)
    assert sum(changed) == 1
