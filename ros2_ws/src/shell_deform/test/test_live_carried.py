# SPDX-License-Identifier: Apache-2.0
"""Rigid motion of an object that only fingers hold is no displacement of its surface."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_hand import SURE, opposed, pipeline

from shell_deform.building import build_model
from shell_deform.live.background.carried import carried
from shell_deform.live.pose import rotation_of
from shell_deform.objects import load_object


@pytest.fixture(scope='module')
def model():
    return build_model(load_object('tennis_ball'), control_vertices=150)


@given(
    turn=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    shift=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    depth=st.floats(0.0, 0.01),
)
def test_a_dent_does_not_hide_the_motion_of_the_rest(model, turn, shift, depth):
    rest = model.surface.limit_positions(model.rest)
    dented = rest.copy()
    dented[:, 0] = np.minimum(dented[:, 0], dented[:, 0].max() - depth)
    surface = dented @ rotation_of(np.array(turn)).T + np.array(shift)
    found = carried(rest, surface, np.ones(len(rest)))
    assert np.abs(found.translation - shift).max() < 1e-6
    assert np.abs(found.rotation - rotation_of(np.array(turn))).max() < 1e-5


def test_fingers_that_carry_a_squeezed_ball_do_not_deform_it_more(model):
    live = pipeline(model, replace(SURE, drive='motion'))
    held = live.settle(opposed([10.0, 10.0], [2e-3, 2e-3], stamp=1))
    squeezed = held.max_displacement
    # One finger goes on by 3 mm and the other gives way as much.
    for k in range(1, 7):
        step = 5e-4 * k
        moved = opposed([10.0, 10.0], [2e-3 + step, 2e-3 - step], stamp=1 + k)
        held = live.settle(moved)
    assert held.max_displacement == pytest.approx(squeezed, rel=2e-2)
    assert np.abs(held.packed[:, 3:6]).max() < 1.1 * squeezed
