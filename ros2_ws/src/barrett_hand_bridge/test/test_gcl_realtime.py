# SPDX-License-Identifier: Apache-2.0
"""RealTime blocks: the manual's worked example, round trips, ranges."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.gcl.realtime import (
    BlockError,
    Layout,
    MotorBlock,
    decode_feedback,
    encode_control,
    layout_for,
)

# BH8-series manual for firmware 4.3x, page 41.
WORKED_EXAMPLE = Layout(
    {
        1: MotorBlock(velocity_command=True, strain=True, delta=True),
        2: MotorBlock(velocity_command=True, strain=True, delta=True),
        4: MotorBlock(delta=True),
    },
    temperature_bytes=2,
)


def test_block_sizes_of_the_worked_example():
    assert WORKED_EXAMPLE.control_bytes == 3
    assert WORKED_EXAMPLE.feedback_bytes == 8


def test_worked_example_is_read_motor_by_motor_then_temperature():
    data = bytes([0x2A, 120, 5, 121, 0xFB, 0x80, 0x01, 0x40])
    feedback = decode_feedback(WORKED_EXAMPLE, data)
    assert (feedback.motors[1].strain, feedback.motors[1].delta) == (120, 5)
    assert (feedback.motors[2].strain, feedback.motors[2].delta) == (121, -5)
    assert feedback.motors[4].delta == -128
    assert feedback.temperature_c == 32.0


def test_default_layout_fills_the_13_byte_cycle():
    assert layout_for().feedback_bytes == 12


@given(
    positions=st.tuples(*[st.integers(0, 17800)] * 3),
    strains=st.tuples(*[st.integers(0, 255)] * 3),
    spread=st.integers(0, 3200),
)
def test_feedback_comes_back_as_it_was_sent(positions, strains, spread):
    data = bytearray(b'*')
    for strain, position in zip(strains, positions, strict=True):
        data.append(strain)
        data += position.to_bytes(2, 'big')
    data += spread.to_bytes(2, 'big')
    feedback = decode_feedback(layout_for(), bytes(data))
    assert tuple(feedback.motors[m].strain for m in (1, 2, 3)) == strains
    assert tuple(feedback.motors[m].position for m in (1, 2, 3)) == positions
    assert feedback.motors[4].position == spread


@given(st.binary(max_size=30))
def test_any_other_length_is_refused(data):
    if len(data) != 12:
        with pytest.raises(BlockError):
            decode_feedback(layout_for(), data)


def test_a_position_beyond_the_mechanical_stop_is_refused():
    data = b'*' + bytes([120, 0xFF, 0xFF]) + bytes(8)
    with pytest.raises(BlockError, match='motor 1: position 65535 beyond 17800'):
        decode_feedback(layout_for(), data)


@given(st.floats(-63.0, 63.0))
def test_velocities_are_signed_fixed_point_with_a_coefficient(velocity):
    data = encode_control(layout_for(), {1: velocity})
    raw = data[1] - 256 if data[1] > 127 else data[1]
    assert data[:1] == b'C' and len(data) == 5 and data[2:] == bytes(3)
    assert raw * 8 / 16 == pytest.approx(velocity, abs=0.76)


@given(st.floats(-63.0, 63.0))
def test_no_velocity_is_ever_sent_as_control_c(velocity):
    assert b'\x03' not in encode_control(layout_for(), {m: velocity for m in (1, 2, 3, 4)})


def test_a_velocity_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match='motor 2: velocity 100 counts'):
        encode_control(layout_for(), {2: 100.0})


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_fastest_velocity_fits_and_the_next_is_refused_not_wrapped(sign):
    step = layout_for().velocity_coefficient / 16.0
    assert encode_control(layout_for(), {1: sign * 127 * step})[1] == int(sign * 127) & 0xFF
    with pytest.raises(ValueError, match='motor 1'):
        encode_control(layout_for(), {1: sign * 128 * step})
