# SPDX-License-Identifier: Apache-2.0
"""Solving ahead of the motion of the contacts."""

import numpy as np
import pytest

from shell_deform.live.background.motion import FARTHEST, SLOWEST, Motion
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
