# SPDX-License-Identifier: Apache-2.0
"""Messages that every package builds: right on the wire, harmless to read."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from grasp_common import messages
from grasp_common.parameter_table import Parameter
from grasp_common.point_cloud import CloudReader

LAYOUT = np.dtype([('x', '<f4'), ('finger', 'u1'), ('_unused', 'u1'), ('late', '<f8')])


def test_a_cloud_comes_back_from_the_wire_without_its_padding() -> None:
    points = np.array([(1.5, 2, 9, 3.5), (4.5, 5, 9, 6.5)], LAYOUT)
    wire = serialize_message(messages.cloud(points, 5_000_000_007, 'hand_base'))
    message = deserialize_message(wire, PointCloud2)
    got = CloudReader('hand/contacts').read(message)
    assert got.dtype.names == ('x', 'finger', 'late')
    assert got.tolist() == [(1.5, 2, 3.5), (4.5, 5, 6.5)]
    assert messages.nanoseconds(message.header.stamp) == 5_000_000_007
    assert message.header.frame_id == 'hand_base'


@pytest.mark.parametrize('stamp', [0, 1, 999_999_999, 1_000_000_000, 2**31 * 10**9 - 1])
def test_a_stamp_keeps_its_nanoseconds(stamp: int) -> None:
    assert messages.nanoseconds(messages.time_message(stamp)) == stamp


def test_a_stamp_that_no_time_holds_becomes_its_first_or_last_second() -> None:
    assert messages.time_message(2**31 * 10**9 + 5).sec == 2**31 - 1
    assert messages.time_message(-(2**31 + 9) * 10**9).sec == -(2**31)


def test_diagnostics_carry_level_name_and_values() -> None:
    values = {'depth': 1.23456789, 'name': '\x1b[31m', 'broken': '\udcff'}
    status = messages.diagnostics(1, 'left/hand: part', 'warn', 'hot', values, 'BH8-262').status[0]
    assert (status.level, status.name, status.message) == (b'\x01', 'left/hand: part', 'hot')
    assert [one.value for one in status.values] == ['1.23457', r'\x1b[31m', r'\udcff']
    assert status.hardware_id == 'BH8-262'


@pytest.mark.parametrize(
    ('default', 'integers', 'floats'), [(1, 1, 0), (1.0, 0, 1), ([1.0], 0, 0), ('one', 0, 0)]
)
def test_a_descriptor_has_the_range_of_its_type(
    default: object, integers: int, floats: int
) -> None:
    bounded = not isinstance(default, str)
    low, high = (0, 5) if bounded else (None, None)
    made = messages.descriptor(Parameter('p', default, 'a thing', low, high))  # type: ignore[arg-type]
    assert (len(made.integer_range), len(made.floating_point_range)) == (integers, floats)


def test_a_start_only_parameter_is_read_only() -> None:
    assert messages.descriptor(Parameter('p', 1, 'a thing', settable='start')).read_only
    assert not messages.descriptor(Parameter('p', 1, 'a thing', settable='configure')).read_only


@pytest.mark.parametrize('seconds', [-(2**31) - 1, 2**31 - 1, 2**31 + 4])
def test_a_time_that_no_message_holds_becomes_the_nearest_second(seconds):
    made = messages.time_message(seconds * 1_000_000_000 + 5)
    assert made.sec == min(max(seconds, -(2**31)), 2**31 - 1)
    assert made.nanosec == 5
