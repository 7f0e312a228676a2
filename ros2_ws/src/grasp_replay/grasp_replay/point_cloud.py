"""PointCloud2 to numpy, by field name.

`sensor_msgs_py` does this with ROS; offline there is none, so this is our own conversion. It takes
any object with the fields of the message and trusts none of its numbers.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_replay.errors import BagError

# sensor_msgs/PointField datatypes.
DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}


def cloud_columns(message: Any) -> dict[str, NDArray[Any]]:
    """The fields of a PointCloud2 by name, each (points,) in its own type.

    Fields with more than one element per point become (points, count). Raises BagError when the
    message contradicts itself.
    """
    step, width, height = int(message.point_step), int(message.width), int(message.height)
    layout = _layout(
        tuple((field.name, field.offset, field.datatype, field.count) for field in message.fields),
        bool(message.is_bigendian),
        step,
    )
    data = np.asarray(message.data, dtype=np.uint8)
    rows = int(message.row_step) if height > 1 else step * width
    if rows < step * width or len(data) < (height - 1) * rows + step * width:
        raise BagError(
            f'a cloud of {width} x {height} points of {step} bytes has {len(data)} bytes of data'
        )
    if width * height == 0:
        points = np.zeros(0, layout)
    elif height == 1:
        points = data[: step * width].view(layout)
    else:
        used = [data[row * rows : row * rows + step * width] for row in range(height)]
        points = np.concatenate(used).view(layout)
    return {name: points[name] for name in layout.names or ()}


@lru_cache(maxsize=16)
def _layout(
    fields: tuple[tuple[str, int, int, int], ...], is_bigendian: bool, step: int
) -> np.dtype[Any]:
    """The structured type of one point; raises BagError."""
    order = '>' if is_bigendian else '<'
    formats = []
    for name, offset, datatype, elements in fields:
        if datatype not in DATATYPES:
            raise BagError(f'cloud field {name!r} has unknown datatype {datatype}')
        count = max(1, int(elements))
        if count > 65535:
            raise BagError(f'cloud field {name!r} has {count} elements per point')
        kind = np.dtype((order + DATATYPES[datatype], (count,) if count > 1 else ()))
        if offset + kind.itemsize > step:
            raise BagError(
                f'cloud field {name!r} ends at byte {offset + kind.itemsize} of a point of '
                f'{step} bytes'
            )
        formats.append(kind)
    names = [field[0] for field in fields]
    if len(set(names)) != len(names):
        raise BagError(f'a cloud names a field twice: {names}')
    return np.dtype(
        {
            'names': names,
            'formats': formats,
            'offsets': [field[1] for field in fields],
            'itemsize': step,
        }
    )


def matrix(columns: dict[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[np.float64]:
    """The named columns side by side, (points, len(names)); raises BagError for a missing one."""
    missing = [name for name in names if name not in columns]
    if missing:
        raise BagError(f'a cloud lacks the fields {", ".join(missing)}; it has {sorted(columns)}')
    return np.stack([columns[name].astype(np.float64) for name in names], axis=1)
