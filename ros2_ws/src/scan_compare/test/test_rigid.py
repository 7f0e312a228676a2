# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scan_compare.rigid import (
    Pose,
    nearest_rotation,
    pose_from_points,
    rotation_angle,
    rotation_from_quaternion,
    rotation_from_vector,
    spread_rotations,
)

VECTORS = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


@given(VECTORS)
def test_rotations_agree_with_scipy(vector: np.ndarray) -> None:
    expected = Rotation.from_rotvec(vector).as_matrix()
    assert rotation_from_vector(vector) == pytest.approx(expected, abs=1e-12)


@given(st.floats(1e-9, 3.1))
def test_the_angle_of_a_rotation_is_found_at_any_size(angle: float) -> None:
    rotation = rotation_from_vector(angle * np.array([0.6, 0.0, 0.8]))
    assert rotation_angle(rotation) == pytest.approx(angle, rel=1e-6)


def test_quaternions_agree_with_scipy() -> None:
    quaternions = np.random.default_rng(0).standard_normal((50, 4))
    expected = Rotation.from_quat(quaternions).as_matrix()
    assert rotation_from_quaternion(quaternions) == pytest.approx(expected, abs=1e-12)


@given(VECTORS, VECTORS)
def test_a_pose_after_its_inverse_is_nothing(turn: np.ndarray, shift: np.ndarray) -> None:
    pose = Pose(rotation_from_vector(turn), shift)
    points = np.eye(3)
    assert pose.inverse().apply(pose.apply(points)) == pytest.approx(points, abs=1e-12)
    assert pose.after(pose.inverse()).apply(points) == pytest.approx(points, abs=1e-12)


def test_the_nearest_rotation_of_a_mirror_is_no_mirror() -> None:
    assert np.linalg.det(nearest_rotation(np.diag([1.0, 1.0, -1.0]))) == pytest.approx(1.0)


def test_spread_rotations_leave_no_large_gap() -> None:
    spread = spread_rotations(240)
    random = rotation_from_quaternion(np.random.default_rng(0).standard_normal((300, 4)))
    traces = np.einsum('aij,bij->ab', random, spread)
    gaps = np.arccos(np.clip(0.5 * (traces.max(axis=1) - 1.0), -1.0, 1.0))
    assert np.rad2deg(gaps.max()) < 40.0


def test_three_points_in_both_frames_give_the_pose() -> None:
    pose = Pose(rotation_from_vector(np.array([1.0, -2.0, 0.5])), np.array([0.1, 0.2, 0.3]))
    points = 0.03 * np.random.default_rng(0).standard_normal((3, 3))
    found = pose_from_points(points, pose.apply(points))
    assert found.rotation == pytest.approx(pose.rotation, abs=1e-4)
    assert found.translation == pytest.approx(pose.translation, abs=1e-5)
