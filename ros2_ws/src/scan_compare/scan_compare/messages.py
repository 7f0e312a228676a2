# SPDX-License-Identifier: Apache-2.0
"""The only place where `scan_compare` builds or reads ROS messages."""

from __future__ import annotations

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh

from grasp_common.messages import cloud
from grasp_common.point_cloud import MessageError

ERROR_LAYOUT = np.dtype([(name, '<f4') for name in ('x', 'y', 'z', 'distance')])


def cloud_of(serialised: bytes, topic: str) -> PointCloud2:
    """A cloud as it came over the wire; raises MessageError if it is none."""
    try:
        return deserialize_message(serialised, PointCloud2)
    except RuntimeError as error:
        raise MessageError(f'{topic} is not a PointCloud2: {error}') from error


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
    return cloud(rows.view(ERROR_LAYOUT)[:, 0], stamp_ns, frame)
