from __future__ import annotations

import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_observer import cloud
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh

from scan_compare import messages

POINTS = np.arange(12.0).reshape(4, 3)


def test_a_cloud_comes_back_by_field_name() -> None:
    message = cloud(('z', 'intensity', 'x', 'y'), np.arange(12.0).reshape(3, 4), 5, 'scanner')
    assert messages.columns(message, ('x', 'y', 'z'), 'scan').tolist() == [
        [2, 3, 0], [6, 7, 4], [10, 11, 8],
    ]  # fmt: skip


def test_an_error_cloud_comes_back_with_its_distance() -> None:
    message = messages.error_cloud(POINTS, POINTS[:, 0], 3_000_000_004, 'object')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 4)
    rows = messages.columns(message, ('x', 'y', 'z', 'distance'), 'scan/error')
    assert np.array_equal(rows, np.column_stack((POINTS, POINTS[:, 0])))


def test_organised_big_endian_clouds_with_padded_rows_are_read() -> None:
    data = array.array('B')
    for row in range(2):
        data.frombytes(POINTS[2 * row : 2 * row + 2].astype('>f8').tobytes() + b'\0' * 5)
    message = PointCloud2(
        height=2, width=2, point_step=24, row_step=53, is_bigendian=True, data=data,
        fields=[
            PointField(name=name, offset=8 * i, datatype=PointField.FLOAT64, count=1)
            for i, name in enumerate('xyz')
        ],
    )  # fmt: skip
    assert np.array_equal(messages.columns(message, ('x', 'y', 'z'), 'scan'), POINTS)


def test_missing_fields_are_named() -> None:
    message = cloud(('x', 'y'), np.zeros((1, 2)), 0, '')
    with pytest.raises(messages.MessageError, match='scan/points lacks the fields z; it has x, y'):
        messages.columns(message, ('x', 'y', 'z'), 'scan/points')


def test_announced_points_that_are_not_there_are_refused() -> None:
    message = cloud(('x', 'y', 'z'), POINTS, 0, '')
    message.width = 10_000_000
    with pytest.raises(messages.MessageError, match='announces 1 x 10000000 points'):
        messages.columns(message, ('x', 'y', 'z'), 'scan/points')


@settings(max_examples=200, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1),
    st.integers(0, 2**32 - 1), st.integers(0, 40), st.integers(0, 255), st.binary(max_size=60),
)  # fmt: skip
def test_any_header_is_read_or_refused(
    height: int, width: int, step: int, row_step: int, offset: int, kind: int, data: bytes
) -> None:
    message = PointCloud2(
        height=height, width=width, point_step=step, row_step=row_step,
        data=array.array('B', data),
        fields=[PointField(name=n, offset=offset, datatype=kind, count=1) for n in 'xyz'],
    )  # fmt: skip
    try:
        rows = messages.columns(message, ('x', 'y', 'z'), 'scan')
    except messages.MessageError:
        return
    assert rows.shape == (height * width, 3)


def test_a_mesh_without_triangles_is_refused() -> None:
    with pytest.raises(messages.MessageError, match='0 triangles'):
        messages.triangles(Mesh())
