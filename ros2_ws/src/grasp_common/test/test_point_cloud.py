# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 to numpy: every layout is read, and no size is believed."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cloud_headers import any_header, cloud_of, field
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp_common.point_cloud import DATATYPES, LARGEST_POINT, CloudReader, MessageError

XY = np.array([(1.0, 2.0), (3.0, 4.0), (5.0, 6.0), (7.0, 8.0)], [('x', '<f4'), ('y', '<f4')])


def read(message: Any) -> np.ndarray:
    return CloudReader('cloud').read(message)


def changed(cloud: Any, **changes: Any) -> Any:
    return SimpleNamespace(**{**vars(cloud), **changes})


@given(
    kinds=st.lists(
        st.tuples(st.sampled_from(sorted(DATATYPES.values())), st.integers(1, 3)),
        min_size=1,
        max_size=6,
    ),
    height=st.integers(1, 3),
    width=st.integers(1, 5),
    padding=st.integers(0, 7),
    order=st.sampled_from('<>'),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_layout_is_read_back(
    kinds: list[tuple[str, int]], height: int, width: int, padding: int, order: str, seed: int
) -> None:
    layout = np.dtype(
        [
            (f'f{i}', order + kind, (count,) if count > 1 else ())
            for i, (kind, count) in enumerate(kinds)
        ]
    )
    size = height * width * layout.itemsize
    points = np.random.default_rng(seed).integers(0, 256, size, np.uint8).view(layout)
    got = read(cloud_of(points, height, padding if height > 1 else 0, order == '>'))
    assert got.dtype.names == layout.names
    for name in layout.names or ():
        assert got[name].tobytes() == points[name].tobytes()


def test_a_number_beyond_float32_counts_as_infinite() -> None:
    given = np.array([(1e300,), (-1e39,), (np.nan,), (2.0,)], [('x', '<f8')])
    with np.errstate(all='raise'):
        column = CloudReader('cloud').column(read(cloud_of(given)), 'x')
        column.astype(np.float32)
    assert np.array_equal(column, [np.inf, -np.inf, np.nan, 2.0], equal_nan=True)


@settings(max_examples=1000)
@given(any_header)
def test_any_header_is_read_or_refused_with_one_typed_error(header: Any) -> None:
    try:
        points = read(header)
    except MessageError as error:
        assert str(error).startswith('cloud ') and str(error).isprintable()
        return
    names = [one.name for one in header.fields]
    assert len(points) == header.height * header.width
    assert len(points) * header.point_step <= len(header.data)
    assert list(points.dtype.names or ()) == names
    assert len(set(names)) == len(names) and '' not in names


@pytest.mark.parametrize(
    ('changes', 'complaint'),
    [
        ({'width': 5}, 'announces 1 x 5 points of 8 bytes, a row every 40 bytes, but carries 32'),
        ({'height': 10**9}, 'announces 1000000000 x 4 points'),
        ({'height': 2**32 - 1, 'row_step': 0}, 'a row every 0 bytes'),
        ({'height': 2, 'width': 2, 'row_step': 3}, 'a row every 3 bytes'),
        ({'height': 2**32 - 1, 'width': 2**32 - 1, 'row_step': 2**32 - 1}, 'announces'),
        ({'point_step': 6}, 'field y ends at byte 8 of a point of 6 bytes'),
        ({'point_step': 2**31}, f'points of {2**31} bytes; {LARGEST_POINT} are read at most'),
        ({'point_step': 2**32 - 1, 'width': 0}, 'are read at most'),
        ({'point_step': 0, 'fields': []}, 'points of 0 bytes'),
        ({'data': b''}, 'carries 0 bytes'),
        ({'fields': [field('x', 0), field('x', 4)]}, 'names the field x twice'),
        ({'fields': [field('', 0), field('x', 4)]}, 'has a field without name'),
        ({'fields': [field('x', 0, 0)]}, 'field x has the unknown datatype 0'),
        ({'fields': [field('x', 0, 9)]}, 'unknown datatype 9'),
        ({'fields': [field('x', 2**32 - 4)]}, 'ends at byte 4294967296 of a point'),
        ({'fields': [field('x', 0, 7, 2**31)]}, 'ends at byte 8589934592 of a point'),
        ({'fields': [field(f'f{i}', 0) for i in range(1001)]}, 'has 1001 fields'),
        ({'fields': [field('\x1b]0;pwned\x07', 0, 77)]}, r'field \\x1b\]0;pwned\\x07 has'),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused_by_name(
    changes: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(MessageError, match=complaint):
        read(changed(cloud_of(XY), **changes))


def test_what_is_refused_costs_neither_time_nor_memory() -> None:
    huge = changed(cloud_of(XY), height=2**32 - 1, width=1, row_step=0)
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    for _ in range(1000):
        with pytest.raises(MessageError):
            read(huge)
    assert time.process_time() - began < 1.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000


def test_a_flat_cloud_is_read_without_a_copy() -> None:
    message = cloud_of(XY)
    assert np.shares_memory(read(message), np.frombuffer(message.data, np.uint8))


def test_a_reader_notices_another_layout_on_its_topic() -> None:
    reader = CloudReader('cloud')
    assert reader.read(cloud_of(XY))['x'].tolist() == [1, 3, 5, 7]
    turned = XY.astype([('x', '<f8'), ('y', '<f4')])
    assert reader.read(cloud_of(turned))['x'].tolist() == [1, 3, 5, 7]


def test_an_empty_cloud_has_no_points() -> None:
    assert read(cloud_of(XY[:0]))['x'].shape == (0,)


def test_columns_come_in_the_order_asked_for() -> None:
    reader = CloudReader('scan/points')
    assert reader.columns(reader.read(cloud_of(XY)), ('y', 'x'))[0].tolist() == [2.0, 1.0]


def test_missing_columns_are_named_beside_those_there_are() -> None:
    reader = CloudReader('scan/points')
    with pytest.raises(MessageError, match='scan/points lacks the fields z; it has x, y'):
        reader.columns(reader.read(cloud_of(XY)), ('x', 'z'))


def test_a_column_may_have_a_value_for_where_it_is_missing() -> None:
    reader = CloudReader('hand/contacts')
    points = reader.read(cloud_of(XY))
    assert reader.column(points, 'y', np.nan).tolist() == [2, 4, 6, 8]
    assert np.isnan(reader.column(points, 'travel', np.nan)).all()


def test_a_column_of_several_elements_per_point_is_refused() -> None:
    points = np.zeros(2, [('x', '<f4', (3,))])
    reader = CloudReader('scan/points')
    with pytest.raises(MessageError, match='field x has 3 elements per point; it needs one'):
        reader.columns(reader.read(cloud_of(points)), ('x',))


@pytest.mark.parametrize('value', [np.nan, np.inf, 1e30])
def test_an_integer_column_refuses_what_is_no_integer(value: float) -> None:
    points = np.array([(value,)], [('finger', '<f4')])
    reader = CloudReader('hand/contacts')
    with pytest.raises(MessageError, match='finger holds numbers that are no integers'):
        reader.integers(reader.read(cloud_of(points)), 'finger')


def test_an_integer_column_may_come_as_any_datatype() -> None:
    reader = CloudReader('hand/contacts')
    for kind in DATATYPES.values():
        points = np.array([(3,), (1,)], [('finger', '<' + kind)])
        assert reader.integers(reader.read(cloud_of(points)), 'finger').tolist() == [3, 1]


def test_the_pure_modules_load_without_ros() -> None:
    code = (
        'import sys; sys.modules["rclpy"] = sys.modules["sensor_msgs"] = None\n'
        'import grasp_common.point_cloud, grasp_common.parameter_table, grasp_common.terminal'
    )
    subprocess.run([sys.executable, '-c', code], check=True)
