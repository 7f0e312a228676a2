"""The only place where ROS messages are read (and, for what-if, built)."""

from __future__ import annotations

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState, PointCloud2, PointField
from shape_msgs.msg import Mesh as MeshMessage
from std_msgs.msg import Header

from .hand_shape import FingerAngles, finger_angles
from .poses import Floats, Pose
from .scene_model import Cloud, Contacts, Mesh, Surface

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


class MessageError(ValueError):
    """A message that cannot be read; the text names the field and what is missing."""


def seconds(stamp: Time) -> float:
    """A ROS time as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def cloud_array(message: PointCloud2) -> np.ndarray:
    """The points as a structured array (n,) with the cloud's own field names.

    Raises MessageError if fields or sizes contradict each other.
    """
    order = '>' if message.is_bigendian else '<'
    names, formats, offsets = [], [], []
    for one in message.fields:
        if one.datatype not in _TYPES:
            raise MessageError(f'field {one.name!r} has the unknown datatype {one.datatype}')
        code = order + _TYPES[one.datatype]
        if one.offset + np.dtype(code).itemsize * max(one.count, 1) > message.point_step:
            raise MessageError(
                f'field {one.name!r} ends beyond the point_step of {message.point_step} bytes'
            )
        names.append(one.name)
        formats.append(code if one.count <= 1 else (code, (one.count,)))
        offsets.append(one.offset)
    dtype = np.dtype(
        {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': message.point_step}
    )
    rows, columns = message.height, message.width
    needed = (
        (rows - 1) * message.row_step + columns * message.point_step if rows and columns else 0
    )
    if len(message.data) < needed:
        raise MessageError(
            f'{len(message.data)} bytes for {rows} x {columns} points of '
            f'{message.point_step} bytes'
        )
    data = np.frombuffer(message.data, dtype=np.uint8)
    if rows <= 1:
        return data[:needed].view(dtype)
    lines = [
        data[r * message.row_step : r * message.row_step + columns * message.point_step]
        for r in range(rows)
    ]
    return np.concatenate(lines).view(dtype)


def _columns(points: np.ndarray, names: tuple[str, ...]) -> Floats:
    missing = [name for name in names if name not in (points.dtype.names or ())]
    if missing:
        raise MessageError(
            f'the cloud has no field {", ".join(missing)}; it has '
            f'{", ".join(points.dtype.names or ()) or "none"}'
        )
    return np.stack([points[name].astype(np.float64) for name in names], axis=1)


def _column(points: np.ndarray, name: str, default: float) -> Floats:
    if name in (points.dtype.names or ()):
        return points[name].astype(np.float64)
    return np.full(len(points), default)


def read_surface(message: PointCloud2) -> Surface:
    """`deformation/surface`, `linear` or `nonlinear`."""
    points = cloud_array(message)
    position = _columns(points, ('x', 'y', 'z'))
    moved = _columns(points, ('ux', 'uy', 'uz'))
    known = int(np.isfinite(np.hstack([position, moved])).all(axis=1).sum())
    if known < len(points):
        raise MessageError(f'{len(points) - known} of {len(points)} vertices are not finite')
    energy = 'energy_density' in (points.dtype.names or ())
    return Surface(
        seconds(message.header.stamp),
        message.header.frame_id,
        position.astype(np.float32),
        moved.astype(np.float32),
        _column(points, 'sigma', np.nan).astype(np.float32),
        points['energy_density'].astype(np.float32) if energy else None,
    )


def read_contacts(message: PointCloud2) -> Contacts:
    """`hand/contacts`."""
    points = cloud_array(message)
    return Contacts(
        seconds(message.header.stamp),
        message.header.frame_id,
        _columns(points, ('x', 'y', 'z')),
        _columns(points, ('nx', 'ny', 'nz')),
        _columns(points, ('fx', 'fy', 'fz')),
        _column(points, 'sigma_n', np.nan),
        _column(points, 'radius', 0.0),
        _column(points, 'finger', 0.0).astype(np.int64),
        _column(points, 'flags', 0.0).astype(np.int64),
    )


def read_cloud(message: PointCloud2, most: int) -> Cloud:
    """`scan/points` or `scan/error`, thinned evenly to at most `most` finite points."""
    points = cloud_array(message)
    points = points[:: max(1, -(-len(points) // most))]
    place = _columns(points, ('x', 'y', 'z'))
    finite = np.isfinite(place).all(axis=1)
    distance = None
    if 'distance' in (points.dtype.names or ()):
        distance = points['distance'].astype(np.float64)
        finite &= np.isfinite(distance)
        distance = distance[finite]
    return Cloud(seconds(message.header.stamp), message.header.frame_id, place[finite], distance)


def read_mesh(message: MeshMessage) -> Mesh:
    """`deformation/mesh`; raises MessageError if a triangle names a vertex that is not there."""
    rest = np.array([(p.x, p.y, p.z) for p in message.vertices], dtype=np.float64).reshape(-1, 3)
    faces = [t.vertex_indices for t in message.triangles]
    triangles = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if len(triangles) and int(triangles.max()) >= len(rest):
        raise MessageError(f'a triangle names vertex {triangles.max()} of {len(rest)}')
    return Mesh(triangles, rest)


def read_joints(message: JointState) -> dict[int, FingerAngles]:
    """`hand/joint_states` as angles per finger."""
    return finger_angles(list(message.name), np.array(message.position, dtype=np.float64))


def read_pose(message: PoseStamped) -> Pose:
    """`object_pose`."""
    p, q = message.pose.position, message.pose.orientation
    return Pose.of([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


CONTACT_FIELDS = (
    *(
        (name, PointField.FLOAT32)
        for name in (
            *'xyz',
            *('nx', 'ny', 'nz'),
            *('fx', 'fy', 'fz'),
            'sigma_n',
            'radius',
            'sigma_t',
        )
    ),
    ('finger', PointField.UINT8),
    ('flags', PointField.UINT8),
)
_NUMPY = {PointField.FLOAT32: '<f4', PointField.UINT8: 'u1'}
CONTACT_TYPE = np.dtype([(name, _NUMPY[kind]) for name, kind in CONTACT_FIELDS])
CONTACT_OFFSETS = [
    sum(np.dtype(_NUMPY[kind]).itemsize for _, kind in CONTACT_FIELDS[:k])
    for k in range(len(CONTACT_FIELDS))
]


def contacts_message(contacts: Contacts, stamp: Time) -> PointCloud2:
    """`hand/contacts` from contacts placed in the page."""
    points = np.zeros(len(contacts.points), dtype=CONTACT_TYPE)
    for names, values in (
        ('xyz', contacts.points),
        (('nx', 'ny', 'nz'), contacts.normals),
        (('fx', 'fy', 'fz'), contacts.forces),
    ):
        for k, name in enumerate(names):
            points[name] = values[:, k]
    points['sigma_n'], points['radius'] = contacts.sigma, contacts.radius
    points['sigma_t'] = np.inf
    points['finger'], points['flags'] = contacts.finger, contacts.flags
    return PointCloud2(
        header=Header(stamp=stamp, frame_id=contacts.frame),
        height=1,
        width=int(len(points)),
        fields=[
            PointField(
                name=name,
                offset=offset,
                datatype=int(kind),
                count=1,
            )
            for (name, kind), offset in zip(CONTACT_FIELDS, CONTACT_OFFSETS, strict=True)
        ],
        is_bigendian=False,
        point_step=int(CONTACT_TYPE.itemsize),
        row_step=int(CONTACT_TYPE.itemsize * len(points)),
        data=array('B', points.tobytes()),
        is_dense=True,
    )
