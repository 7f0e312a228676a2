# SPDX-License-Identifier: Apache-2.0
"""Every codec against mutated streams: no crash, no hang, nothing out of range taken for right."""

import os
from functools import partial

import numpy as np
import pytest

from barrett_hand_bridge.emulator.can_hand import CanHand as EmulatedCanHand
from barrett_hand_bridge.emulator.mechanics import SCALE_280, HandBody, HandMechanics
from barrett_hand_bridge.emulator.serial_hand import SerialHand as EmulatedSerialHand
from barrett_hand_bridge.gcl import driver, line
from barrett_hand_bridge.gcl.driver import SerialHand
from barrett_hand_bridge.gcl.language import HandLinkError, parse_loop_end, parse_reply
from barrett_hand_bridge.gcl.realtime import BlockError, decode_feedback, layout_for
from barrett_hand_bridge.hand import HandDisturbedError, HandError
from barrett_hand_bridge.puck.frames import (
    Frame,
    FrameError,
    HandAddresses,
    decode_address,
    decode_full_frame,
    decode_position,
    decode_property,
    decode_top_10,
)
from barrett_hand_bridge.puck.properties import number
from barrett_hand_bridge.puck.replies import Cycle, ReplyReader

MUTATIONS = 1_000_000 if os.environ.get('SOAK') else 10_000


def mutated(originals, seed):
    """Streams with bytes changed, lost, doubled, added or cut off."""
    generator = np.random.default_rng(seed)
    for _ in range(MUTATIONS):
        yield mutation(originals[generator.integers(len(originals))], generator)


def mutation(original, generator):
    data = bytearray(original)
    for _ in range(generator.integers(1, 4)):
        at = int(generator.integers(len(data) + 1)) if data else 0
        kind = generator.integers(5)
        if kind == 0 and at < len(data):
            data[at] = generator.integers(256)
        elif kind == 1 and at < len(data):
            del data[at]
        elif kind == 2:
            data.insert(at, generator.integers(256))
        elif kind == 3:
            del data[at:]
        elif at < len(data):
            data.insert(at, data[at])
    return bytes(data)


@pytest.mark.timeout(1800)
def test_supervisory_replies():
    originals = [
        b'FGET P\n\r100 200 300 400\n\r=> ',
        b'FGET P\n\rERR 64\n\r=> ',
        b'FGET P\n\r=> ',
        b'FGET P\n\rBarrettHand Firmware\n\rVersion 4.4.0\n\r=> ',
    ]
    for raw in mutated(originals, 1):
        try:
            reply = parse_reply('FGET P', raw)
            values = reply.integers(4)
        except HandLinkError:
            continue
        assert raw.endswith(b'=> ') and raw.startswith(b'FGET P')
        assert len(values) == 4 and reply.status == 0


@pytest.mark.timeout(1800)
def test_ends_of_realtime_mode():
    for raw in mutated([b'\n\rERR 8192\n\r=> ', b'\n\rERR 16384\n\r=> '], 2):
        try:
            status = parse_loop_end(raw)
        except HandLinkError:
            continue
        assert 0 < status <= 99999 and raw.endswith(b'=> ')


@pytest.mark.timeout(1800)
def test_realtime_feedback_blocks():
    layout = layout_for(('strain', 'position', 'breakaway'))
    block = b'*' + bytes([120, 0x10, 0x20, 0x10, 0x00]) * 3 + bytes([6, 39])
    assert len(block) == layout.feedback_bytes
    for raw in mutated([block], 3):
        try:
            feedback = decode_feedback(layout, raw)
        except BlockError:
            continue
        for motor, own in feedback.motors.items():
            assert 0 <= own.position <= (3200 if motor == 4 else 17800)
            assert motor == 4 or 0 <= own.strain <= 255


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ('decode', 'original', 'plausible'),
    [
        (decode_property, bytes.fromhex('9900e807'), lambda v: 0 <= v[0] < 128),
        (decode_property, bytes.fromhex('b000e8070000'), lambda v: abs(v[1]) <= 2**31),
        (decode_position, bytes.fromhex('83 09 c6 81 10 20'), lambda v: abs(v[0]) <= 2**21),
        (decode_full_frame, bytes.fromhex('2100200300400500'), lambda v: max(v[1]) < 16),
        (decode_top_10, bytes.fromhex('8000017100000000'), lambda v: max(v) <= 15),
    ],
)
def test_can_payloads(decode, original, plausible):
    for raw in mutated([original], 4):
        try:
            value = decode(raw)
        except FrameError:
            continue
        assert plausible(value)


@pytest.mark.timeout(1800)
def test_can_identifiers():
    generator = np.random.default_rng(5)
    for identifier in generator.integers(-10, 1 << 29, MUTATIONS):
        try:
            address = decode_address(int(identifier))
        except FrameError:
            assert not 0 <= identifier < 0x800
            continue
        assert 0 <= address.sender < 32 and 0 <= address.destination < 32


class Clock:
    """Time that passes only while somebody waits."""

    now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


class MutatingPort:
    """A line to an emulated hand; what the hand says next can be mutated on its way."""

    baudrate, timeout = 9600, 1.0

    def __init__(self, hand, clock, generator):
        self.hand, self.clock, self.generator = hand, clock, generator
        self.mutate = False
        self.received = b''

    def write(self, data):
        self.hand.feed(data)
        said = self.hand.take()
        if said and self.mutate:
            said, self.mutate = mutation(said, self.generator), False
        self.received += said

    @property
    def in_waiting(self):
        return len(self.received)

    def read(self, size=1):
        if len(self.received) < size:
            self.clock.sleep(self.timeout)
        data, self.received = self.received[:size], self.received[size:]
        return data

    def close(self):
        self.received = b''


@pytest.mark.timeout(3600)
@pytest.mark.parametrize('feedback', [('strain', 'position'), ('delta', 'strain', 'temperature')])
def test_the_serial_driver_on_a_line_that_changes_what_it_carries(monkeypatch, feedback):
    clock = Clock()
    monkeypatch.setattr(driver, 'time', clock)
    monkeypatch.setattr(line, 'time', clock)
    emulated = EmulatedSerialHand(HandMechanics(HandBody(), 1))
    port = MutatingPort(emulated, clock, np.random.default_rng(9))
    hand = SerialHand(
        lambda: port, baud=9600, feedback=feedback, clock_ns=lambda: round(1e9 * clock.now)
    )
    emulated.feed(b'HI\r')
    emulated.advance(5.0)
    hand.connect()
    emulated.mechanics.place({1: 4000.0, 4: 1500.0})
    for _ in range(MUTATIONS):
        port.mutate = True
        begin = clock.now
        try:
            sample = hand.sample(None)
        except HandDisturbedError:
            continue
        except HandError:
            port.mutate = False
            hand.connect()
            continue
        finally:
            assert clock.now - begin < 15.0
        assert all(-50 <= counts <= 17800 for counts in sample.finger_counts)
        assert -50 <= sample.spread_counts <= 3200
        assert all(count is None or 0 <= count <= 255 for count in sample.gauge_counts)
    port.mutate = False
    # What was accepted last may be wrong; a line that is left alone is right again at once.
    hand.stop()
    sample = hand.sample(None)
    assert sample.finger_counts == (4000, 0, 0) and sample.spread_counts == 1500


@pytest.mark.timeout(3600)
def test_frames_of_the_pucks_gathered_into_cycles_and_touch_pictures():
    generator = np.random.default_rng(10)
    reader = ReplyReader(HandAddresses(), partial(number, firmware=190))
    frames = [
        (0x566, bytes.fromhex('9900e807')),
        (0x583, bytes.fromhex('8309c6811020')),
        (0x568, bytes.fromhex('8000017100000000')),
        *((0x589, bytes((part << 4, 32, 2, 0, 48, 4, 0, 80))) for part in range(5)),
    ]
    for count in range(MUTATIONS):
        identifier, original = frames[count % len(frames)]
        if generator.integers(4) == 0:
            identifier = int(generator.integers(0x1000))
        cycle = Cycle()
        try:
            reader.take(Frame(identifier, mutation(original, generator)), cycle)
        except FrameError:
            continue
        assert all(0 <= counts <= 4095 for counts in cycle.gauges.values())
        assert all(-11_000 < counts <= 215_000 for counts, _ in cycle.positions.values())
        for cells in (reader.pressures() or {}).values():
            assert len(cells) == 24 and 0.0 <= min(cells) <= max(cells) < 16.0


@pytest.mark.timeout(3600)
def test_the_emulated_serial_hand_survives_any_host():
    hand = EmulatedSerialHand(HandMechanics(HandBody(), 1))
    originals = [b'HI\r', b'1FSET HSG 200\r', b'124LOOP\rAAC\x10\x10\x10\x10', b'PGET TEMP\r\x03']
    for raw in mutated(originals, 6):
        hand.feed(raw)
        hand.take()
    hand.feed(b'\x03\r')
    hand.advance(0.01)
    assert hand.take().endswith(b'=> ') or hand.moving


@pytest.mark.timeout(3600)
def test_the_emulated_can_hand_survives_any_host():
    hand = EmulatedCanHand(HandMechanics(HandBody(scale=SCALE_280), 1))
    generator = np.random.default_rng(7)
    for raw in mutated([bytes.fromhex('85000200'), b'\x19', bytes.fromhex('88000400')], 8):
        hand.receive(int(generator.integers(0x800)), raw[:8])
        hand.take()
