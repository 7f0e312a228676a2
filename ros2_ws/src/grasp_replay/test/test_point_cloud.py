"""PointCloud2 to numpy: every layout, and nothing trusted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_replay.errors import BagError
from grasp_replay.point_cloud import DATATYPES, cloud_columns, matrix


def message(points: np.ndarray, height: int = 1, padding: int = 0) -> Any:
    """A cloud of a structured array."""
    width = len(points) // height
    step = points.dtype.itemsize
    rows = points.view(np.uint8).reshape(height, width * step)
    data = np.concatenate([rows, np.zeros((height, padding), np.uint8)], axis=1).ravel()
    kinds = {code: number for number, code in DATATYPES.items()}
    assert points.dtype.names is not None and points.dtype.fields is not None
    fields = []
    for name in points.dtype.names:
        kind, offset = points.dtype.fields[name][:2]
        count = int(np.prod(kind.shape)) if kind.shape else 1
        fields.append(
            SimpleNamespace(
                name=name, offset=offset, datatype=kinds[kind.base.str[1:]], count=count
            )
        )
    return SimpleNamespace(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=points.dtype[0].base.str[0] == '>',
        point_step=step,
        row_step=width * step + padding,
        data=data,
    )


def changed(cloud: Any, changes: dict[str, Any]) -> Any:
    """The same message with other values."""
    return SimpleNamespace(**{**vars(cloud), **changes})


@given(
    kinds=st.lists(st.sampled_from(sorted(DATATYPES.values())), min_size=1, max_size=6),
    height=st.integers(1, 3),
    width=st.integers(1, 5),
    padding=st.integers(0, 7),
    order=st.sampled_from('<>'),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_layout_is_read_back(
    kinds: list[str], height: int, width: int, padding: int, order: str, seed: int
) -> None:
    dtype = np.dtype([(f'f{i}', order + kind) for i, kind in enumerate(kinds)])
    raw = np.random.default_rng(seed).integers(0, 256, height * width * dtype.itemsize, np.uint8)
    points = raw.view(dtype)
    big = any(points.dtype[i].str[0] == '>' for i in range(len(kinds)))
    columns = cloud_columns(
        changed(message(points, height, padding if height > 1 else 0), {'is_bigendian': big})
    )
    assert list(columns) == list(dtype.names or ())
    for name in columns:
        assert columns[name].tobytes() == points[name].tobytes()


POINTS = np.zeros(4, [('x', '<f4'), ('y', '<f4')])


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({'width': 5}, 'has 32 bytes of data'),
        ({'height': 10**9}, 'has 32 bytes of data'),
        ({'point_step': 6}, 'ends at byte 8 of a point of 6 bytes'),
        ({'height': 2, 'width': 2, 'row_step': 3}, 'has 32 bytes of data'),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(BagError, match=text):
        cloud_columns(changed(message(POINTS), changes))


@pytest.mark.parametrize(('key', 'value'), [('datatype', 99), ('count', 10**6), ('name', 'y')])
def test_an_impossible_field_is_refused(key: str, value: Any) -> None:
    broken = message(POINTS)
    setattr(broken.fields[0], key, value)
    with pytest.raises(BagError):
        cloud_columns(broken)


def test_an_empty_cloud_has_empty_columns() -> None:
    assert cloud_columns(message(POINTS[:0]))['x'].shape == (0,)


def test_missing_columns_are_named() -> None:
    with pytest.raises(BagError, match=r"lacks the fields z; it has \['x', 'y'\]"):
        matrix(cloud_columns(message(POINTS)), ('x', 'z'))
