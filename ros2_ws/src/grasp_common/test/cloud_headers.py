# SPDX-License-Identifier: Apache-2.0
"""Generated PointCloud2 headers, right and wrong, without ROS."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from grasp_common.point_cloud import DATATYPES

UINT32 = st.one_of(
    st.integers(0, 40),
    st.sampled_from([2**16, 2**31 - 1, 2**31, 2**32 - 1]),
    st.integers(0, 2**32 - 1),
)


def field(name: str, offset: int, datatype: int = 7, count: int = 1) -> Any:
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


def cloud_of(points: np.ndarray, height: int = 1, padding: int = 0, big: bool = False) -> Any:
    """A cloud of structured records (n,), its rows padded."""
    width, step = len(points) // height, points.dtype.itemsize
    rows = np.frombuffer(points.tobytes(), np.uint8).reshape(height, width * step)
    data = np.concatenate([rows, np.zeros((height, padding), np.uint8)], axis=1).tobytes()
    kinds = {code: number for number, code in DATATYPES.items()}
    fields = []
    for name in points.dtype.names or ():
        kind, offset = points.dtype.fields[name][:2]  # type: ignore[index]
        count = int(np.prod(kind.shape)) if kind.shape else 1
        fields.append(field(name, offset, kinds[kind.base.str[1:]], count))
    return SimpleNamespace(
        height=height, width=width, fields=fields, is_bigendian=big, point_step=step,
        row_step=width * step + padding, data=data,
    )  # fmt: skip


any_field = st.builds(
    field,
    st.one_of(st.sampled_from(['x', 'y', 'z', '']), st.text(max_size=4)),
    UINT32,
    st.integers(0, 255),
    UINT32,
)

any_header = st.builds(
    lambda **parts: SimpleNamespace(**parts),
    height=UINT32,
    width=UINT32,
    fields=st.lists(any_field, max_size=5),
    is_bigendian=st.booleans(),
    point_step=UINT32,
    row_step=UINT32,
    data=st.binary(max_size=200),
)
