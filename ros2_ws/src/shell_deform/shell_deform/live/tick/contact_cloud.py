# SPDX-License-Identifier: Apache-2.0
"""`hand/contacts` and `hand/tactile` as the estimator takes them, from a topic or from a bag."""

from __future__ import annotations

from typing import Any

import numpy as np

from grasp_common.point_cloud import CloudReader
from shell_deform.live.tick.sample import ContactSample
from shell_deform.live.tick.touch_check import TouchCells

ALONG = ('ax', 'ay', 'az')
"""Direction in the pad to the tip of the finger: fields that a hand may leave out."""


class ContactReader:
    """Reads one stream of contacts by field name; remembers the layout of the last message."""

    def __init__(self) -> None:
        self._cloud = CloudReader('hand/contacts')

    def read(self, message: Any, stamp_ns: int) -> ContactSample:
        """The sample in a PointCloud2; raises MessageError for missing fields or wrong sizes."""
        cloud = self._cloud
        points = cloud.read(message)
        return ContactSample(
            stamp=stamp_ns,
            finger=cloud.integers(points, 'finger'),
            flags=cloud.integers(points, 'flags'),
            point=cloud.columns(points, ('x', 'y', 'z')),
            normal=cloud.columns(points, ('nx', 'ny', 'nz')),
            force=cloud.columns(points, ('fx', 'fy', 'fz')),
            sigma_normal=cloud.column(points, 'sigma_n'),
            sigma_tangential=cloud.column(points, 'sigma_t', np.inf),
            radius=cloud.column(points, 'radius'),
            travel=cloud.column(points, 'travel', np.nan),
            sigma_travel=cloud.column(points, 'sigma_travel', np.nan),
            along=np.stack([cloud.column(points, name, np.nan) for name in ALONG], axis=1),
            sigma_point=cloud.column(points, 'sigma_point', np.nan),
        )


class CellReader:
    """Reads one stream of touch cells by field name: `finger`, `cell` and `force` [N]."""

    def __init__(self) -> None:
        self._cloud = CloudReader('hand/tactile')

    def read(self, message: Any, stamp_ns: int) -> TouchCells:
        """The cells in a PointCloud2; raises MessageError for missing fields or wrong sizes."""
        cloud = self._cloud
        points = cloud.read(message)
        return TouchCells(
            stamp_ns,
            cloud.integers(points, 'finger'),
            cloud.integers(points, 'cell'),
            cloud.column(points, 'force'),
        )
