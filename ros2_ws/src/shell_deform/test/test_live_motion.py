# SPDX-License-Identifier: Apache-2.0
"""Solving ahead of the motion of the contacts."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.live.background.motion import FARTHEST, SLOWEST, SLOWEST_TURN, Motion
from shell_deform.live.background.tracked_state import Target

WALL = 2.5e-3


def target(depth, driven=True):
    """Two contacts driven to a depth [m]."""
    count = np.full(2, driven)
    return Target(np.ones(2), np.full(2, depth), count, np.zeros(1), np.zeros(6))


def asked(steps, refresh=0.1, gap=0.1):
    """Depths [m] solved for when contacts are at `steps` [m], `gap` [s] apart."""
    motion = Motion(WALL)
    motion.took(refresh)
    return [
        float(motion.ahead(target(depth), 7, 1.0 + gap * i).displacement[0])
        for i, depth in enumerate(steps)
    ]


def test_a_steady_motion_is_solved_a_refresh_ahead():
    assert asked([0.0, 1e-3, 2e-3, 3e-3]) == pytest.approx([0.0, 2e-3, 3e-3, 4e-3])
    assert asked([0.0, 1e-3, 2e-3], refresh=0.05)[-1] == pytest.approx(2.5e-3)


def test_contacts_that_stand_or_creep_are_solved_where_they_are():
    slow = 0.9 * SLOWEST * WALL
    assert asked([1e-3] * 4) == pytest.approx([1e-3] * 4)
    assert asked([0.0, slow, 2 * slow]) == pytest.approx([0.0, slow, 2 * slow])


def test_a_motion_that_turns_round_or_leaps_is_not_carried_on_blindly():
    assert asked([0.0, 1e-3, 2e-3, 1e-3])[-1] == pytest.approx(1e-3)
    leap = 10.0 * FARTHEST * WALL
    assert asked([0.0, leap])[-1] == pytest.approx(leap + FARTHEST * WALL)


def test_a_pause_other_contacts_and_pushes_tell_no_motion():
    assert asked([0.0, 1e-3, 2e-3], gap=5.0) == pytest.approx([0.0, 1e-3, 2e-3])
    motion = Motion(WALL)
    motion.took(0.1)
    motion.ahead(target(0.0), 1, 1.0)
    assert motion.ahead(target(1e-3), 2, 1.1).displacement[0] == pytest.approx(1e-3)
    pushed = Motion(WALL)
    pushed.took(0.1)
    for i in range(3):
        found = pushed.ahead(target(1e-3 * i, driven=False), 1, 0.1 * i)
        assert found.displacement[0] == pytest.approx(1e-3 * i)


def turned(angles, refresh, gap=0.1):
    """Turns [rad] solved for when a grip is at `angles` [rad], `gap` [s] apart."""
    motion = Motion(WALL)
    motion.took(refresh)
    poses = [replace(target(0.0), grips=np.array([[0.0, 0, 0, 0, 0, turn]])) for turn in angles]
    found = [motion.ahead(pose, 7, 1.0 + gap * i) for i, pose in enumerate(poses)]
    return [float(one.grips[0, 5]) for one in found]


def test_a_grip_that_turns_is_solved_a_refresh_ahead_and_no_further_than_its_last_step():
    assert turned([0.0, 0.02, 0.04], refresh=0.05) == pytest.approx([0.0, 0.03, 0.05])
    assert turned([0.0, 0.02, 0.04], refresh=0.3) == pytest.approx([0.0, 0.04, 0.06])


def test_a_grip_that_stands_or_was_long_silent_is_solved_where_it_is():
    still = 0.9 * SLOWEST_TURN
    assert turned([0.1, 0.1 + still], refresh=0.1) == pytest.approx([0.1, 0.1 + still], abs=1e-12)
    assert turned([0.0, 0.02], refresh=0.1, gap=5.0) == pytest.approx([0.0, 0.02])
