# SPDX-License-Identifier: Apache-2.0
"""Drivers and emulated hands as separate processes, over a real pty and a real CAN bus."""

import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from barrett_hand_bridge.gcl.driver import SerialHand
from barrett_hand_bridge.gcl.port import open_port
from barrett_hand_bridge.hand import HandError, HandNotInitialisedError
from barrett_hand_bridge.puck.bus import open_bus
from barrett_hand_bridge.puck.driver import CanHand
from barrett_hand_bridge.stop_guard import guard_serial

GROUP = '239.74.163.2'


@pytest.fixture
def free_port():
    """A UDP port of its own for every test: multicast groups on one port hear each other."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('', 0))
        return probe.getsockname()[1]


def where(running):
    running.wait_for('}')
    return json.loads(running.text.splitlines()[0])['port']


def serial_hand(start, *options, **driver_options):
    emulator = start('hand_emulator', '--json', *options)
    port = where(emulator)
    hand = SerialHand(lambda: open_port(port), **driver_options)
    return hand, emulator, port


def cycle(hand, wait_until, count=1):
    """Take `count` samples, however often the machine is too busy in between."""
    samples = []

    def one():
        try:
            samples.append(hand.sample(None))
        except HandNotInitialisedError:
            raise
        except HandError:
            return False
        return len(samples) >= count

    wait_until(one, 30.0)
    return samples


def test_a_serial_hand_is_found_brought_to_38400_baud_initialised_and_cycled(start, wait_until):
    hand, _, _ = serial_hand(start)
    assert hand.connect().model == 'BH8-262'
    hand.initialize()
    samples = cycle(hand, wait_until, 100)
    assert all(100 <= counts <= 145 for counts in samples[-1].gauge_counts)
    hand.close()


def test_a_client_that_comes_back_finds_the_hand_at_its_new_speed(start, wait_until):
    hand, _, _ = serial_hand(start, '--unpaced')
    hand.connect()
    hand.initialize()
    cycle(hand, wait_until)
    hand.close()
    hand.connect()
    cycle(hand, wait_until)
    hand.close()


def test_an_unplugged_line_fails_with_a_reason_and_works_again_when_plugged(
    start, wait_until, tmp_path
):
    link = tmp_path / 'hand'
    emulator = start(
        'hand_emulator', '--json', '--unpaced', '--link', link, '--fault', 'unplug@signal:1'
    )
    assert where(emulator) == str(link)
    hand = SerialHand(lambda: open_port(str(link)))
    hand.connect()
    hand.initialize()
    emulator.process.send_signal(signal.SIGUSR1)

    def fails():
        try:
            hand.sample(None)
        except HandError as error:
            return 'gone' in str(error) or 'no longer answers' in str(error)
        return False

    wait_until(fails, 30.0)

    def reconnects():
        try:
            return hand.connect()
        except HandError:
            return False

    wait_until(reconnects, 30.0)
    cycle(hand, wait_until)
    hand.close()


def kill_while_closing(driver):
    """Run a driver in a process that closes finger 1 slowly, and kill it on the way."""
    script = (
        driver + 'hand.connect()\n'
        'hand.initialize()\n'
        'while True:\n'
        '    print(hand.sample({1: 0.05}).finger_counts[0], flush=True)\n'
    )
    owner = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True)
    try:
        while int(owner.stdout.readline()) < 200:
            continue
    finally:
        owner.send_signal(signal.SIGKILL)
        owner.wait()
        owner.stdout.close()


def test_a_killed_owner_of_the_line_leaves_no_moving_finger(start, wait_until):
    """The guard process sends Ctrl-C when the process that drives the hand is killed."""
    emulator = start('hand_emulator', '--json', '--unpaced')
    port = where(emulator)
    kill_while_closing(
        'from barrett_hand_bridge.gcl.driver import SerialHand\n'
        'from barrett_hand_bridge.gcl.port import open_port\n'
        'from barrett_hand_bridge.stop_guard import guard_serial\n'
        f'hand = SerialHand(lambda: open_port({port!r}),'
        ' guard=lambda line: guard_serial(line.fileno()))\n'
    )
    # The guard holds the line until it has stopped the hand.
    lines = []

    def opens():
        try:
            lines.append(open_port(port))
        except HandError:
            return False
        return True

    wait_until(opens, 20.0)
    line = lines[0]
    line.baudrate = 38400
    line.timeout = 0.5

    def at_prompt():
        line.write(b'\r')
        return line.read(200).endswith(b'=> ')

    wait_until(at_prompt, 20.0)
    positions = []
    for _ in range(2):
        line.write(b'1FGET P\r')
        positions.append(line.read_until(b'=> ').split()[2])
    line.close()
    assert positions[0] == positions[1]


def test_a_killed_owner_of_the_bus_leaves_no_moving_finger(start, free_port, wait_until):
    """The guard process idles all motors when the process that drives the hand is killed."""
    where(start('hand_emulator', '--hand', '280', '--json', '--can-port', free_port))
    kill_while_closing(
        'from barrett_hand_bridge.puck.bus import open_bus\n'
        'from barrett_hand_bridge.puck.driver import CanHand\n'
        'from barrett_hand_bridge.stop_guard import guard_can\n'
        f"line = ('udp_multicast', {GROUP!r}, {free_port})\n"
        'hand = CanHand(lambda: open_bus(*line), guard=lambda: guard_can(*line))\n'
    )
    hand = CanHand(lambda: open_bus('udp_multicast', GROUP, free_port))
    wait_until(lambda: connects(hand), 30.0)

    def stands():
        samples = cycle(hand, wait_until, 100)
        return samples[0].finger_counts == samples[-1].finger_counts

    wait_until(stands, 20.0)
    assert 0 < cycle(hand, wait_until)[0].finger_counts[0] < 190_000
    hand.close()


def test_a_guard_that_is_dismissed_sends_nothing(start):
    emulator = start('hand_emulator', '--json', '--unpaced')
    line = open_port(where(emulator))
    line.timeout = 0.2
    line.read(1000)
    guard_serial(line.fileno()).dismiss()
    assert line.read(10) == b''
    line.close()


def test_a_can_hand_between_two_processes(start, free_port, wait_until):
    emulator = start('hand_emulator', '--hand', '280', '--json', '--can-port', free_port)
    where(emulator)
    hand = CanHand(lambda: open_bus('udp_multicast', GROUP, free_port))
    wait_until(lambda: connects(hand), 30.0)
    hand.initialize()
    samples = cycle(hand, wait_until, 100)
    assert all(1500 < counts < 2300 for counts in samples[-1].gauge_counts)
    assert hand.strange_frames == 0
    hand.close()


def connects(hand):
    try:
        return hand.connect()
    except HandError:
        return False


def test_two_can_hands_on_two_ports_do_not_hear_each_other(start, free_port, wait_until):
    where(start('hand_emulator', '--hand', '280', '--json', '--can-port', free_port))
    other = CanHand(lambda: open_bus('udp_multicast', GROUP, free_port + 1))
    with pytest.raises(HandError, match='does not answer'):
        other.connect()


def test_a_can_hand_behind_a_usb_stick(start, wait_until):
    emulator = start('hand_emulator', '--hand', '280', '--json', '--interface', 'slcan')
    port = where(emulator)
    hand = CanHand(lambda: open_bus('slcan', port))
    wait_until(lambda: connects(hand), 30.0)
    hand.initialize()
    assert len(cycle(hand, wait_until, 20)) == 20
    hand.close()


def test_an_emulator_leaves_when_its_starter_is_gone(start):
    reader, writer = os.pipe()
    emulator = subprocess.Popen(
        [sys.executable, '-m', 'barrett_hand_bridge.commands.hand_emulator', '--until-eof'],
        stdin=reader,
        stdout=subprocess.DEVNULL,
    )
    os.close(reader)
    os.close(writer)
    assert emulator.wait(600.0) == 0


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_an_emulator_that_waits_for_its_starter_ends_cleanly_by_a_signal(number):
    reader, writer = os.pipe()
    emulator = subprocess.Popen(
        [sys.executable, '-m', 'barrett_hand_bridge.commands.hand_emulator', '--until-eof'],
        stdin=reader,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    assert b'BH8-262' in emulator.stdout.readline()
    emulator.send_signal(number)
    assert emulator.wait(600.0) == 0
    assert emulator.stdout.read() == b''
    emulator.stdout.close()
    os.close(reader)
    os.close(writer)


@pytest.mark.parametrize(
    ('options', 'code', 'complaint'),
    [
        (('--squeezed', 'no.yaml'), 1, 'no.yaml'),
        (('--hand', '280', '--interface', 'nonsense'), 1, 'nonsense'),
        (('--weigh', '/nowhere/weights.csv'), 1, '/nowhere/weights.csv'),
        (('--fault', 'meteor@1'), 2, "fault 'meteor@1'"),
        (('--fault', 'no-gauge@1:9'), 2, 'needs a finger'),
        (('--firmware', '4.4'), 2, "'4.4' is no version"),
        (('--press', '2:77:3'), 2, "'2:77:3' is not FINGER:CELL:PRESSURE"),
        (('--seed', '-1'), 2, "'-1'"),
    ],
)
def test_an_emulator_that_cannot_start_says_why(start, options, code, complaint):
    emulator = start('hand_emulator', *options)
    assert emulator.ended() == code
    assert complaint in emulator.text
    assert 'Traceback' not in emulator.text


@pytest.mark.parametrize('started', [False, True])
def test_a_guard_that_is_stopped_is_replaced_also_while_it_starts(wait_until, started):
    guard = guard_serial(os.open(os.devnull, os.O_WRONLY))
    try:
        if started:
            wait_until(lambda: guard.watch() or guard._answered > 0, 60.0)
        os.kill(guard._process.pid, signal.SIGSTOP)
        stopped = time.monotonic()
        wait_until(guard.watch, 20.0)
        assert time.monotonic() - stopped < 2.0
    finally:
        guard.dismiss()
