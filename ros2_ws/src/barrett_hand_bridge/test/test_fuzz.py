"""Every codec against mutated streams: no crash, no hang, nothing out of range taken for right."""

import os

import numpy as np
import pytest

from barrett_hand_bridge.emulator.can_hand import CanHand as EmulatedCanHand
from barrett_hand_bridge.emulator.mechanics import SCALE_280, HandBody, HandMechanics
from barrett_hand_bridge.emulator.serial_hand import SerialHand as EmulatedSerialHand
from barrett_hand_bridge.gcl.language import HandLinkError, parse_loop_end, parse_reply
from barrett_hand_bridge.gcl.realtime import BlockError, decode_feedback, layout_for
from barrett_hand_bridge.puck.frames import (
    FrameError,
    decode_address,
    decode_full_frame,
    decode_position,
    decode_property,
    decode_top_10,
)

MUTATIONS = 1_000_000 if os.environ.get('SOAK') else 10_000


def mutated(originals, seed):
    """Streams with bytes changed, lost, doubled, added or cut off."""
    generator = np.random.default_rng(seed)
    for _ in range(MUTATIONS):
        data = bytearray(originals[generator.integers(len(originals))])
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
        yield bytes(data)


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
