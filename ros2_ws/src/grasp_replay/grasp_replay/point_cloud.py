"""PointCloud2 to numpy, by field name.

`sensor_msgs_py` does this with ROS; offline there is none, so this is our own conversion. It takes
any object with the fields of the message and trusts none of its numbers.
"""

from __future__ import annotations

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
    order = '>' if message.is_bigendian else '<'
    step, width, height = int(message.point_step), int(message.width), int(message.height)
    names, formats, offsets = [], [], []
    for field in message.fields:
        if field.datatype not in DATATYPES:
            raise BagError(f'cloud field {field.name!r} has unknown datatype {field.datatype}')
        count = max(1, int(field.count))
        if count > 65535:
            raise BagError(f'cloud field {field.name!r} has {count} elements per point')
        kind = np.dtype((order + DATATYPES[field.datatype], (count,) if count > 1 else ()))
        if field.offset + kind.itemsize > step:
            raise BagError(
                f'cloud field {field.name!r} ends at byte {field.offset + kind.itemsize} of a '
                f'point of {step} bytes'
            )
        names.append(field.name)
        formats.append(kind)
        offsets.append(int(field.offset))
    if len(set(names)) != len(names):
        raise BagError(f'a cloud names a field twice: {names}')
    data = np.asarray(message.data, dtype=np.uint8)
    rows = int(message.row_step) if height > 1 else step * width
    if rows < step * width or len(data) < (height - 1) * rows + step * width:
        raise BagError(
            f'a cloud of {width} x {height} points of {step} bytes has {len(data)} bytes of data'
        )
    if width * height == 0:
        return {name: np.zeros(0, kind) for name, kind in zip(names, formats, strict=True)}
    layout = np.dtype({'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': step})
    used = [data[row * rows : row * rows + step * width] for row in range(height)]
    points = np.concatenate(used).view(layout) if height > 1 else used[0].view(layout)
    return {name: points[name] for name in names}


def matrix(columns: dict[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[np.float64]:
    """The named columns side by side, (points, len(names)); raises BagError for a missing one."""
    missing = [name for name in names if name not in columns]
    if missing:
        raise BagError(f'a cloud lacks the fields {", ".join(missing)}; it has {sorted(columns)}')
    return np.stack([columns[name].astype(np.float64) for name in names], axis=1)
