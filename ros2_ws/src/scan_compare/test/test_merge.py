# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from scan_shells import odd_body, scan_points

from scan_compare.merge import MergeError, merge
from scan_compare.rigid import Pose, rotation_from_vector
from scan_compare.scan import Scan

BODY = odd_body()


def view(seed: int, direction: tuple[float, float, float], pose: Pose | None = None) -> Scan:
    points = scan_points(BODY, 30_000, 0.05e-3, seed)
    points = points[points @ np.array(direction) > -0.012]
    return Scan(pose.apply(points) if pose else points, None, 'm', False, f'view {seed}')


def test_misplaced_views_are_refined_onto_each_other() -> None:
    shift = Pose(
        rotation_from_vector(np.array([0.004, -0.003, 0.005])), np.array([2e-4, -3e-4, 0])
    )
    merged = merge([view(1, (1, 0, 0)), view(2, (-0.5, 0.8, 0), shift), view(3, (-0.5, -0.8, 0))])
    left = merged.poses[1].after(shift)
    probe = BODY.samples.position
    assert np.linalg.norm(left.apply(probe) - probe, axis=1).max() < 0.05e-3
    assert merged.residual_m < 0.1e-3
    assert all(0.1 < overlap < 1.0 for overlap in merged.overlap)


def test_one_view_stays_as_it_is() -> None:
    only = view(1, (1, 0, 0))
    assert np.array_equal(merge([only]).scan.points, only.points)


def test_a_view_that_overlaps_no_other_is_named() -> None:
    far = Scan(scan_points(BODY, 5_000) + 1.0, None, 'm', False, 'far view')
    with pytest.raises(MergeError, match='only 0 points of this view lie within 2 mm of another'):
        merge([view(1, (1, 0, 0)), far])


def test_no_views_are_refused() -> None:
    with pytest.raises(MergeError, match='no views'):
        merge([])


def test_meshes_keep_their_triangles() -> None:
    points = BODY.samples.position[:3_000]
    mesh = Scan(points, np.array([[0, 1, 2]], np.int32), 'm', False, 'a')
    merged = merge([mesh, mesh])
    assert merged.scan.triangles.tolist() == [[0, 1, 2], [3_000, 3_001, 3_002]]
