# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from grasp_common.parameter_table import ParameterError
from scan_compare.pairing import finger_forces, remarks, start_pose
from scan_compare.parameters import PARAMETERS, pose
from scan_compare.rigid import IDENTITY
from scan_compare.surface_history import StampedSurface

SECOND = 1_000_000_000
VALUES = {parameter.name: parameter.default for parameter in PARAMETERS}
MOVED = [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]
SURFACE = StampedSurface(2 * SECOND, np.zeros((4, 3)), np.zeros((4, 3)), 'hand_base')


def test_a_scan_in_the_frame_of_the_surface_starts_there() -> None:
    assert start_pose(VALUES, 'hand_base', SURFACE) is IDENTITY


def test_a_scan_in_the_object_frame_starts_at_the_pose_of_the_object() -> None:
    found = start_pose({**VALUES, 'object_pose': MOVED}, 'object', SURFACE)
    assert found is not None
    assert found.translation.tolist() == [0.1, 0.2, 0.3]


def test_a_scan_in_a_foreign_frame_is_searched() -> None:
    assert start_pose(VALUES, 'scanner', SURFACE) is None
    assert start_pose({**VALUES, 'scan_start': 'search'}, 'hand_base', SURFACE) is None


def test_a_given_pose_starts_any_scan() -> None:
    found = start_pose({**VALUES, 'scan_start': 'given', 'scan_pose': MOVED}, 'scanner', SURFACE)
    assert found is not None
    assert found.translation.tolist() == [0.1, 0.2, 0.3]


def test_the_cells_of_one_finger_add_up_as_vectors() -> None:
    rows = np.array([[1, 3.0, 0, 0], [1, 0, 4.0, 0], [2, 0, 0, -2.0], [3, np.nan, 0, 0]])
    assert finger_forces(rows) == {1: 5.0, 2: 2.0, 3: 0.0}


def test_a_surface_of_another_time_and_the_forces_are_remarked() -> None:
    assert remarks(SECOND, SURFACE, 0.5, {1: 10.631}) == (
        'the surface is 1 s later than the scan',
        'forces when the scan arrived: finger 1: 10.63 N',
    )
    assert remarks(2 * SECOND, SURFACE, 0.5, {}) == ()


def test_without_a_surface_the_object_at_rest_is_named() -> None:
    assert 'object at rest' in remarks(SECOND, None, 0.5, {})[0]


@pytest.mark.parametrize(
    ('numbers', 'sentence'),
    [
        ([1e300, 0, 0, 0, 0, 0, 1], 'within 10 m is allowed'),
        ([0, 325.0, 0, 0, 0, 0, 1], 'within 10 m is allowed'),
        ([0, 0, 0, 0, 0, 0, 2], 'a quaternion of length 2'),
        ([0, 0, 0, 0, 0, 0, np.nan], 'needs x y z'),
        ([0, 0, 0], 'needs x y z'),
    ],
)
def test_a_pose_that_is_none_is_refused(numbers: list[float], sentence: str) -> None:
    with pytest.raises(ParameterError, match=sentence):
        pose('scan_pose', numbers)
