"""The only place where `scan_compare` builds or reads ROS messages."""

from __future__ import annotations

from array import array
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh
from std_msgs.msg import Float64, Header

from scan_compare.parameters import Parameter

_TYPES = {
    PointField.INT8: 'i1',
    PointField.UINT8: 'u1',
    PointField.INT16: 'i2',
    PointField.UINT16: 'u2',
    PointField.INT32: 'i4',
    PointField.UINT32: 'u4',
    PointField.FLOAT32: 'f4',
    PointField.FLOAT64: 'f8',
}

LEVELS = {
    'ok': DiagnosticStatus.OK,
    'warn': DiagnosticStatus.WARN,
    'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE,
}

ERROR_FIELDS = ('x', 'y', 'z', 'distance')


class MessageError(ValueError):
    """A message that cannot be read; the text names the field and what is missing."""


def nanoseconds(stamp: Time) -> int:
    """A ROS time in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def time_message(stamp_ns: int) -> Time:
    """Nanoseconds as a ROS time."""
    return Time(sec=int(stamp_ns // 1_000_000_000), nanosec=int(stamp_ns % 1_000_000_000))


def columns(message: PointCloud2, names: tuple[str, ...], topic: str) -> np.ndarray:
    """Return the named fields of a cloud as (n, k) float64, in its order.

    Any field types, byte order and row padding; raises MessageError for missing fields or a
    message whose data are shorter than it announces.
    """
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    row_step = int(message.row_step) if height > 1 else width * step
    needed = (height - 1) * row_step + width * step if height and width else 0
    if len(message.data) < needed or row_step < width * step:
        raise MessageError(
            f'{topic} announces {height} x {width} points of {step} bytes but carries '
            f'{len(message.data)} bytes'
        )
    layout = _layout(message, names, topic)
    if needed == 0:
        return np.empty((0, len(names)))
    rows = np.ndarray((height, width), layout, memoryview(message.data), strides=(row_step, step))
    result = np.empty((height * width, len(names)))
    for column, name in enumerate(names):
        result[:, column] = rows[name].reshape(-1)
    return result


def _layout(message: PointCloud2, names: tuple[str, ...], topic: str) -> np.dtype:
    fields = {field.name: field for field in message.fields}
    missing = [name for name in names if name not in fields]
    if missing:
        raise MessageError(
            f'{topic} lacks the fields {", ".join(missing)}; it has {", ".join(fields) or "none"}'
        )
    order = '>' if message.is_bigendian else '<'
    formats, offsets = [], []
    for name in names:
        field = fields[name]
        if field.datatype not in _TYPES:
            raise MessageError(f'{topic} field {name!r} has unknown type {field.datatype}')
        code = order + _TYPES[field.datatype]
        if field.offset + np.dtype(code).itemsize > message.point_step:
            raise MessageError(
                f'{topic} field {name!r} ends beyond the point step of {message.point_step} bytes'
            )
        formats.append(code)
        offsets.append(int(field.offset))
    return np.dtype(
        {
            'names': list(names),
            'formats': formats,
            'offsets': offsets,
            'itemsize': int(message.point_step),
        }
    )


def triangles(message: Mesh) -> np.ndarray:
    """Return the triangles (m, 3) int32 of a mesh; raises MessageError for a bad index."""
    corners = np.array(
        [triangle.vertex_indices for triangle in message.triangles], np.int64
    ).reshape(-1, 3)
    if len(corners) == 0 or int(corners.max()) >= len(message.vertices):
        raise MessageError(
            f'deformation/mesh has {len(corners)} triangles and {len(message.vertices)} vertices '
            'that do not belong together'
        )
    return corners.astype(np.int32)


def error_cloud(
    points: np.ndarray, distance: np.ndarray, stamp_ns: int, frame: str
) -> PointCloud2:
    """Scan points (n, 3) [m] with their signed distance (n,) [m]."""
    rows = np.empty((len(points), 4), '<f4')
    rows[:, :3] = points
    rows[:, 3] = distance
    data = array('B')
    data.frombytes(rows.tobytes())
    return PointCloud2(
        header=Header(stamp=time_message(stamp_ns), frame_id=str(frame)),
        height=1,
        width=int(len(points)),
        fields=[
            PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, name in enumerate(ERROR_FIELDS)
        ],
        is_bigendian=False,
        point_step=16,
        row_step=16 * int(len(points)),
        data=data,
        is_dense=True,
    )


def number(value: float) -> Float64:
    """A Float64."""
    return Float64(data=float(value))


def diagnostics(
    stamp_ns: int, name: str, level: str, summary: str, values: Mapping[str, object]
) -> DiagnosticArray:
    """One status with its values; `level` is a key of LEVELS."""
    status = DiagnosticStatus(
        level=LEVELS[level],
        name=name,
        message=summary,
        hardware_id='',
        values=[KeyValue(key=key, value=_shown(value)) for key, value in values.items()],
    )
    return DiagnosticArray(header=Header(stamp=time_message(stamp_ns)), status=[status])


def _shown(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Descriptor with description, range and choices of a parameter."""
    message = ParameterDescriptor(
        description=parameter.description,
        additional_constraints=', '.join(parameter.choices),
    )
    if parameter.lowest is not None and parameter.highest is not None:
        message.floating_point_range = [
            FloatingPointRange(
                from_value=float(parameter.lowest), to_value=float(parameter.highest)
            )
        ]
    return message
