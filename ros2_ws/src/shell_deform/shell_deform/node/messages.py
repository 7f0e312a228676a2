# SPDX-License-Identifier: Apache-2.0
"""The only place where `shell_deform` builds or reads ROS messages."""

from __future__ import annotations

from array import array

import numpy as np
from geometry_msgs.msg import Point, PoseStamped, WrenchStamped
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker

from grasp_common.messages import header, point_fields, time_message
from shell_deform.live.pose import Pose, pose_of
from shell_deform.live.tick.serve_kernel import FIELDS, OUTER_FIELDS

Array = NDArray[np.float64]

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


def read_pose(message: PoseStamped, what: str = 'object pose') -> Pose:
    """Pose of a message; raises PoseError for numbers that are none."""
    p, q = message.pose.position, message.pose.orientation
    return pose_of([p.x, p.y, p.z, q.x, q.y, q.z, q.w], what)


def wrench_message(wrench: Array, stamp_ns: int, frame: str) -> WrenchStamped:
    """Force [N] and torque [N m] of `wrench` (6,)."""
    message = WrenchStamped(header=header(stamp_ns, frame))
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = (float(one) for one in wrench)
    return message


class SurfaceWriter:
    """Builds PointCloud2 messages of (n, f) float32 fields, reusing everything but the data."""

    def __init__(self, vertices: int, fields: tuple[str, ...] = FIELDS) -> None:
        self._message = PointCloud2(
            height=1,
            width=int(vertices),
            fields=point_fields(np.dtype([(name, '<f4') for name in fields])),
            is_bigendian=False,
            point_step=4 * len(fields),
            row_step=4 * len(fields) * int(vertices),
            is_dense=True,
        )

    def message(self, packed: NDArray[np.float32], stamp_ns: int, frame: str) -> PointCloud2:
        """The message for one packed field; valid until the next call."""
        message = self._message
        header = message.header
        header.stamp = time_message(stamp_ns)
        header.frame_id = frame
        data = array('B')
        data.frombytes(packed.data.cast('B'))
        message.data = data
        return message


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
    """Triangles coloured by displacement, from dark blue at rest to yellow at the largest.

    Of the outer face, where `packed` (n, f) has one, else of the middle surface.
    """
    drawn = packed[:, :3] if packed.shape[1] == len(FIELDS) else packed[:, -len(OUTER_FIELDS) :]
    size = packed[:, 6]
    share = size / max(float(size.max()), 1e-9)
    shown = [np.interp(share, np.linspace(0.0, 1.0, len(CIVIDIS)), part) for part in CIVIDIS.T]
    points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in drawn]
    colours = [
        ColorRGBA(r=float(r), g=float(g), b=float(b), a=1.0)
        for r, g, b in zip(*shown, strict=True)
    ]
    corners = triangles.ravel().tolist()
    marker = Marker(header=header(stamp_ns, frame))
    marker.ns, marker.id = 'deformation', 0
    marker.type, marker.action = Marker.TRIANGLE_LIST, Marker.ADD
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    marker.color.a = 1.0
    marker.pose.orientation.w = 1.0
    marker.points = [points[i] for i in corners]
    marker.colors = [colours[i] for i in corners]
    return marker
