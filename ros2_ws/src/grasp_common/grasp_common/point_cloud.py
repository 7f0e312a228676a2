# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 to numpy by field name, for messages that nobody has checked.

`sensor_msgs_py` does this where ROS is; bags are read where it is not. Any object with the fields
of the message will do. Its sizes come from another process: each is compared with the bytes that
really came before anything is allocated, and rows are taken apart by strides, never one by one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_common.terminal import printable

Array = NDArray[np.float64]

DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""Datatypes of sensor_msgs/PointField as numpy codes."""

MOST_FIELDS = 1000
LARGEST_POINT = 2**20
"""Bytes of a point; a numpy record cannot exceed 2**31."""

LARGEST_NUMBER = float(np.finfo(np.float32).max)
"""What is larger in a float64 field counts as infinite."""


class MessageError(ValueError):
    """A message that cannot be read; the text names the topic and what contradicts what."""


class CloudReader:
    """Reads the clouds of one topic; remembers the layout of the last one."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._key: object = None
        self._layout = np.dtype([])

    def read(self, message: Any) -> NDArray[Any]:
        """The points as records (n,) of the cloud's own field names, without a copy if it can be.

        Fields with several elements per point have the shape (n, elements). Raises MessageError.
        """
        key = (
            message.point_step,
            message.is_bigendian,
            tuple((one.name, one.offset, one.datatype, one.count) for one in message.fields),
        )
        if key != self._key:
            self._layout = self._read_layout(message)
            self._key = key
        height, width = int(message.height), int(message.width)
        step = int(message.point_step)
        row_step = int(message.row_step) if height > 1 else width * step
        data = _octets(message.data)
        if min(height, width) < 1:
            return np.empty(0, self._layout)
        if (
            step < 1
            or row_step < width * step
            or len(data) < (height - 1) * row_step + width * step
        ):
            raise self._error(
                f'announces {height} x {width} points of {step} bytes, a row every {row_step} '
                f'bytes, but carries {len(data)} bytes'
            )
        return np.ndarray((height, width), self._layout, data, strides=(row_step, step)).reshape(
            -1
        )

    def read_columns(self, message: Any, names: tuple[str, ...]) -> Array:
        """The named fields of a cloud side by side, (n, k) float64; raises MessageError."""
        return self.columns(self.read(message), names)

    def columns(self, points: NDArray[Any], names: tuple[str, ...]) -> Array:
        """The named fields side by side, (n, k) float64; MessageError for one that is missing."""
        self._require(points, names)
        result = np.empty((len(points), len(names)))
        for index, name in enumerate(names):
            result[:, index] = self._scalar(points, name)
        return result

    def column(self, points: NDArray[Any], name: str, missing: float | None = None) -> Array:
        """One field as (n,) float64; `missing` stands for it where the cloud has none."""
        if missing is not None and name not in (points.dtype.names or ()):
            return np.full(len(points), missing)
        self._require(points, (name,))
        return self._scalar(points, name).astype(np.float64)

    def integers(
        self, points: NDArray[Any], name: str, missing: int | None = None
    ) -> NDArray[np.int64]:
        """One field of whole numbers as (n,) int64, whatever its datatype."""
        if missing is not None and name not in (points.dtype.names or ()):
            return np.full(len(points), missing, np.int64)
        self._require(points, (name,))
        values = self._scalar(points, name)
        if values.dtype.kind == 'f' and not np.all(np.abs(values) < 2.0**53):
            raise self._error(f'field {printable(name)} holds numbers that are no integers')
        return values.astype(np.int64)

    def _scalar(self, points: NDArray[Any], name: str) -> NDArray[Any]:
        values = points[name]
        if values.ndim > 1:
            raise self._error(
                f'field {printable(name)} has {values.shape[1]} elements per point; it needs one'
            )
        if values.dtype.kind == 'f' and values.dtype.itemsize == 8:
            # Such numbers measure nothing; their squares, and they as float32, would overflow.
            beyond = np.abs(values) > LARGEST_NUMBER
            if beyond.any():
                return np.where(beyond, np.copysign(np.inf, values), values)
        return values

    def _require(self, points: NDArray[Any], names: tuple[str, ...]) -> None:
        present = points.dtype.names or ()
        missing = [name for name in names if name not in present]
        if missing:
            has = printable(', '.join(present)) or 'none'
            raise self._error(f'lacks the fields {", ".join(missing)}; it has {has}')

    def _read_layout(self, message: Any) -> np.dtype[Any]:
        step = int(message.point_step)
        if len(message.fields) > MOST_FIELDS:
            raise self._error(f'has {len(message.fields)} fields; {MOST_FIELDS} are read at most')
        if not 0 <= step <= LARGEST_POINT:
            raise self._error(f'has points of {step} bytes; {LARGEST_POINT} are read at most')
        order = '>' if message.is_bigendian else '<'
        names: list[str] = []
        formats: list[np.dtype[Any]] = []
        for one in message.fields:
            name = printable(str(one.name))
            if not one.name or one.name in names:
                twice = f'names the field {name} twice' if one.name else 'has a field without name'
                raise self._error(twice)
            if one.datatype not in DATATYPES:
                raise self._error(f'field {name} has the unknown datatype {one.datatype}')
            # 0 elements are what older publishers write for one.
            code, elements = np.dtype(order + DATATYPES[one.datatype]), max(1, int(one.count))
            end = int(one.offset) + elements * code.itemsize
            if int(one.offset) < 0 or end > step:
                raise self._error(f'field {name} ends at byte {end} of a point of {step} bytes')
            names.append(one.name)
            formats.append(code if elements == 1 else np.dtype((code, (elements,))))
        offsets = [int(one.offset) for one in message.fields]
        return np.dtype({'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': step})

    def _error(self, text: str) -> MessageError:
        return MessageError(f'{self.topic} {text}')


def _octets(data: Any) -> NDArray[np.uint8]:
    """The bytes of a message, whether an array, bytes, or numpy's."""
    return np.frombuffer(data, np.uint8) if len(data) else np.empty(0, np.uint8)
