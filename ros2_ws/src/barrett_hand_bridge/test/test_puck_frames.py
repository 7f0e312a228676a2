# SPDX-License-Identifier: Apache-2.0
"""CAN frames: the bytes seen on the wire, round trips, refusals; property numbers by firmware."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.puck.frames import (
    Address,
    FrameError,
    decode_address,
    decode_full_frame,
    decode_position,
    decode_property,
    decode_top_10,
    encode_address,
    get_frame,
    set_frame,
)
from barrett_hand_bridge.puck.properties import PropertyError, number


def test_group_get_of_the_gauges_is_the_frame_seen_on_the_wire():
    frame = get_frame(5, number('SG', 190), group=True)
    assert (frame.identifier, frame.data) == (0x405, b'\x19')


def test_initialise_finger_1_is_the_frame_seen_on_the_wire():
    frame = set_frame(11, number('CMD', 190), 13)
    assert (frame.identifier, frame.data) == (0x00B, bytes.fromhex('9d000d00'))


@pytest.mark.parametrize(
    ('identifier', 'sender', 'destination'),
    [(0x563, 11, 3), (0x5C3, 14, 3), (0x566, 11, 6), (0x5A9, 13, 9)],
)
def test_identifiers_of_replies(identifier, sender, destination):
    assert decode_address(identifier) == Address(sender, destination, True)


@given(st.integers(0, 31), st.integers(0, 31), st.booleans())
def test_addresses_come_back(sender, destination, group):
    address = Address(sender, destination, group)
    assert decode_address(encode_address(address)) == address


@given(st.integers(0, 127), st.integers(-(2**31), 2**31 - 1))
def test_wide_properties_come_back(property_number, value):
    frame = set_frame(11, property_number, value, wide=True)
    assert decode_property(frame.data) == (property_number, value)


def test_a_value_too_large_for_16_bits_is_refused():
    with pytest.raises(FrameError, match='70000 does not fit'):
        set_frame(11, 42, 70000)


@given(st.integers(-(2**21), 2**21 - 1), st.integers(-(2**21), 2**21 - 1))
def test_positions_of_22_bits_come_back_with_their_sign(motor, inner):
    def packed(value: int) -> bytes:
        raw = value & 0x3FFFFF
        return bytes([0x80 | raw >> 16, raw >> 8 & 255, raw & 255])

    assert decode_position(packed(motor)) == (motor, None)
    assert decode_position(packed(motor) + packed(inner)) == (motor, inner)


@pytest.mark.parametrize('data', [b'', b'\x80\x00', b'\x00\x00\x00', bytes(8)])
def test_a_frame_that_is_no_position_is_refused(data):
    with pytest.raises(FrameError):
        decode_position(data)


def test_full_touch_frames_hold_five_cells_and_the_last_four():
    word = 4 << 60 | 0x100 << 48 | 0x200 << 36 | 0x300 << 24 | 0xFFF << 12
    assert decode_full_frame(word.to_bytes(8, 'big')) == (4, (1.0, 2.0, 3.0, 4095 / 256))
    assert len(decode_full_frame(bytes(8))[1]) == 5


def test_top_10_names_cells_from_the_most_significant_bit():
    word = 1 << 63 | 1 << 40 | 7 << 36 | 2 << 32
    pressures = decode_top_10(word.to_bytes(8, 'big'))
    assert (pressures[0], pressures[23]) == (7.0, 2.0)
    assert sum(pressures) == 9.0


def test_more_than_ten_cells_in_a_top_10_are_refused():
    with pytest.raises(FrameError, match='11 cells'):
        decode_top_10((0xFFE000 << 40).to_bytes(8, 'big'))


@pytest.mark.parametrize(
    ('name', 'firmware', 'expected'),
    [('SG', 190, 25), ('HOLD', 190, 77), ('HOLD', 100, 94), ('EN', 100, 77), ('TACT', 142, 106)],
)
def test_property_numbers_follow_the_firmware(name, firmware, expected):
    assert number(name, firmware) == expected


@pytest.mark.parametrize(
    ('name', 'firmware'), [('SG', 60), ('JP', 124), ('TACT', 141), ('X', 190)]
)
def test_a_property_the_firmware_does_not_have_is_refused(name, firmware):
    with pytest.raises(PropertyError):
        number(name, firmware)
