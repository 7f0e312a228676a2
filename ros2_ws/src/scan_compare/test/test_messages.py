# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from shape_msgs.msg import Mesh

from grasp_common.point_cloud import CloudReader, MessageError
from scan_compare import messages

POINTS = np.arange(12.0).reshape(4, 3)


def test_an_error_cloud_comes_back_with_its_distance() -> None:
    message = messages.error_cloud(POINTS, POINTS[:, 0], 3_000_000_004, 'object')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 4)
    rows = CloudReader('scan/error').read_columns(message, ('x', 'y', 'z', 'distance'))
    assert np.array_equal(rows, np.column_stack((POINTS, POINTS[:, 0])))


def test_a_mesh_without_triangles_is_refused() -> None:
    with pytest.raises(MessageError, match='0 triangles'):
        messages.triangles(Mesh())
