# SPDX-License-Identifier: Apache-2.0
"""The scan's points, coloured by their signed distance to the model where that is shown."""

from __future__ import annotations

import numpy as np
import viser

from .colour_map import SIGNED_TABLE, SteadyScale, colour_index
from .layer import SCALE, Memory, hide
from .scene_model import SCAN_ERROR, Snapshot
from .view_options import ViewOptions
from .visitors import Visitors

PLAIN = (90, 30, 30)


class ScanLayer:
    """Points on the scale of the scan error."""

    def __init__(self, server: viser.ViserServer, scale: SteadyScale) -> None:
        self._scene = server.scene
        self._scale = scale
        self._points: viser.PointCloudHandle | None = None
        self._memory = Memory()

    def draw(self, snapshot: Snapshot, options: ViewOptions, visitors: Visitors) -> None:
        """Bring the browsers up to date."""
        cloud = snapshot.scan_error or snapshot.scan
        error = options.quantity is SCAN_ERROR
        wanted = options.scan == 'always' or (options.scan == 'with scan error' and error)
        if cloud is None or not wanted or not len(cloud.points):
            hide(self._points)
            self._memory.forget()
            return
        top = self._scale.top if error else 0.0
        if not self._memory.changed(cloud, snapshot.object_pose, snapshot.frame, top):
            return
        points = snapshot.in_scene(cloud.frame).points(cloud.points) * SCALE
        if error and cloud.distance is not None:
            index = colour_index(cloud.distance * SCAN_ERROR.factor, -top, top)
            colours = SIGNED_TABLE[index]
        else:
            colours = np.broadcast_to(np.array([PLAIN], dtype=np.uint8), points.shape)
        self._points = self._scene.add_point_cloud(
            '/scan',
            points.astype(np.float32),
            np.ascontiguousarray(colours),
            point_size=0.006,
            point_shape='circle',
            point_shading='flat',
            precision='float32',
        )
