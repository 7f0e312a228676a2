"""The only place where `shell_deform` builds or reads ROS messages."""

from __future__ import annotations

from array import array
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseStamped
from numpy.typing import NDArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import ColorRGBA, Float64, Header, String
from visualization_msgs.msg import Marker

from shell_deform.live.pose import Pose, pose_of
from shell_deform.live.tick.sample import ContactSample
from shell_deform.live.tick.serve_kernel import FIELDS
from shell_deform.node.parameters import Parameter

Array = NDArray[np.float64]

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
_REQUIRED = ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius')
_REQUIRED_COUNTS = ('finger', 'flags')

# Nine colours of cividis (doi:10.1371/journal.pone.0199239), which read without colour vision.
CIVIDIS = np.array(
    [
        [0.0, 0.135, 0.305],
        [0.103, 0.22, 0.436],
        [0.264, 0.308, 0.423],
        [0.381, 0.395, 0.436],
        [0.489, 0.485, 0.471],
        [0.609, 0.58, 0.464],
        [0.736, 0.681, 0.424],
        [0.871, 0.79, 0.343],
        [0.996, 0.909, 0.218],
    ]
)
LEVELS = {
    'ok': DiagnosticStatus.OK,
    'warn': DiagnosticStatus.WARN,
    'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE,
}


class MessageError(ValueError):
    """A message that cannot be read; the text names the field and what is missing."""


def nanoseconds(stamp: Time) -> int:
    """A ROS time in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def time_message(stamp_ns: int) -> Time:
    """Nanoseconds as a ROS time."""
    return Time(sec=int(stamp_ns // 1_000_000_000), nanosec=int(stamp_ns % 1_000_000_000))


class ContactReader:
    """Reads `hand/contacts` by field name; remembers the layout of the last message."""

    def __init__(self) -> None:
        self._key: object = None
        self._dtype = np.dtype([])

    def read(self, message: PointCloud2) -> ContactSample:
        """The sample in a message; raises MessageError for missing fields or wrong sizes."""
        key = (
            message.point_step,
            message.is_bigendian,
            tuple((f.name, f.offset, f.datatype, f.count) for f in message.fields),
        )
        if key != self._key:
            self._dtype = _layout(message)
            self._key = key
        count = message.width * message.height
        if len(message.data) < count * message.point_step:
            raise MessageError(
                f'hand/contacts announces {count} points of {message.point_step} bytes but '
                f'carries {len(message.data)} bytes'
            )
        rows = np.frombuffer(memoryview(message.data), self._dtype, count)
        names = self._dtype.names or ()

        def vectors(*fields: str) -> Array:
            result = np.empty((count, 3))
            for i, field in enumerate(fields):
                result[:, i] = rows[field]
            return result

        def optional(field: str, missing: float) -> Array:
            if field in names:
                return rows[field].astype(np.float64)
            return np.full(count, missing)

        return ContactSample(
            stamp=nanoseconds(message.header.stamp),
            finger=rows['finger'].astype(np.int64),
            flags=rows['flags'].astype(np.int64),
            point=vectors('x', 'y', 'z'),
            normal=vectors('nx', 'ny', 'nz'),
            force=vectors('fx', 'fy', 'fz'),
            sigma_normal=rows['sigma_n'].astype(np.float64),
            sigma_tangential=optional('sigma_t', np.inf),
            radius=rows['radius'].astype(np.float64),
            travel=optional('travel', np.nan),
            sigma_travel=optional('sigma_travel', np.nan),
        )


def _layout(message: PointCloud2) -> np.dtype:
    order = '>' if message.is_bigendian else '<'
    names, formats, offsets = [], [], []
    for one in message.fields:
        if one.datatype not in _TYPES:
            raise MessageError(f'hand/contacts field {one.name!r} has unknown type {one.datatype}')
        code = order + _TYPES[one.datatype]
        if one.offset + np.dtype(code).itemsize > message.point_step:
            raise MessageError(
                f'hand/contacts field {one.name!r} ends beyond the point step of '
                f'{message.point_step} bytes'
            )
        names.append(one.name)
        formats.append(code)
        offsets.append(one.offset)
    missing = [name for name in (*_REQUIRED, *_REQUIRED_COUNTS) if name not in names]
    if missing:
        raise MessageError(
            f'hand/contacts lacks the fields {", ".join(missing)}; it has '
            f'{", ".join(names) or "none"}'
        )
    return np.dtype(
        {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': message.point_step}
    )


def read_pose(message: PoseStamped) -> Pose:
    """Pose of a message; raises PoseError for numbers that are none."""
    p, q = message.pose.position, message.pose.orientation
    return pose_of([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


class SurfaceWriter:
    """Builds PointCloud2 messages of (n, f) float32 fields, reusing everything but the data."""

    def __init__(self, vertices: int, fields: tuple[str, ...] = FIELDS) -> None:
        self._message = PointCloud2(
            height=1,
            width=int(vertices),
            fields=[
                PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
                for i, name in enumerate(fields)
            ],
            is_bigendian=False,
            point_step=4 * len(fields),
            row_step=4 * len(fields) * int(vertices),
            is_dense=True,
        )

    def message(self, packed: NDArray[np.float32], stamp_ns: int, frame: str) -> PointCloud2:
        """The message for one packed field; valid until the next call."""
        message = self._message
        header = message.header
        header.stamp.sec = int(stamp_ns // 1_000_000_000)
        header.stamp.nanosec = int(stamp_ns % 1_000_000_000)
        header.frame_id = frame
        data = array('B')
        data.frombytes(packed.data.cast('B'))
        message.data = data
        return message


def number(value: float) -> Float64:
    """A Float64."""
    return Float64(data=float(value))


def text(value: str) -> String:
    """A String."""
    return String(data=str(value))


def mesh_message(triangles: NDArray[np.int32], vertices: Array) -> Mesh:
    """Control topology and rest limit positions [m]."""
    return Mesh(
        triangles=[
            MeshTriangle(vertex_indices=np.asarray(row, dtype=np.uint32)) for row in triangles
        ],
        vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in vertices],
    )


def marker_message(
    triangles: NDArray[np.int32], packed: NDArray[np.float32], stamp_ns: int, frame: str
) -> Marker:
    """Triangles coloured by displacement, from dark blue at rest to yellow at the largest."""
    size = packed[:, 6]
    share = size / max(float(size.max()), 1e-9)
    shown = [np.interp(share, np.linspace(0.0, 1.0, len(CIVIDIS)), part) for part in CIVIDIS.T]
    points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in packed[:, :3]]
    colours = [
        ColorRGBA(r=float(r), g=float(g), b=float(b), a=1.0)
        for r, g, b in zip(*shown, strict=True)
    ]
    corners = triangles.ravel().tolist()
    marker = Marker(header=Header(stamp=time_message(stamp_ns), frame_id=frame))
    marker.ns, marker.id = 'deformation', 0
    marker.type, marker.action = Marker.TRIANGLE_LIST, Marker.ADD
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    marker.color.a = 1.0
    marker.pose.orientation.w = 1.0
    marker.points = [points[i] for i in corners]
    marker.colors = [colours[i] for i in corners]
    return marker


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
        read_only=parameter.fixed,
        additional_constraints=', '.join(parameter.choices),
    )
    if parameter.lowest is not None and parameter.highest is not None:
        low, high = parameter.lowest, parameter.highest
        if isinstance(parameter.default, int):
            message.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        else:
            message.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
    return message
