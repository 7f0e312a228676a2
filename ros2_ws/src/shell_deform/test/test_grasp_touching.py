# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies as contacts of a grasp: what their own pressure says, ring and all."""

import numpy as np
import pytest

from shell_deform.grasp.capacity import load_capacity
from shell_deform.grasp.contacts import UNIFORM_ARM
from shell_deform.grasp.margins import margins
from shell_deform.grasp.touching import read_grasp
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.verification.friction import plated, squeezed

MU = 0.3


@pytest.fixture(scope='module')
def plates():
    """A ball of R/h 50 squeezed by a wall and a half between two plates with friction."""
    model, patches = plated(MU, 400)
    wall = float(model.shell.thickness[0])
    states = squeezed(EquilibriumSolver(model), patches, wall * np.array([0.25, 0.5, 1.0, 1.5]))
    assert all(state.converged for state in states)
    return model, patches, states


def test_plates_push_with_their_normals_and_lift_twice_mu_n(plates):
    model, patches, states = plates
    grasp = read_grasp(model, patches, states[-1], 9.9)
    assert np.abs(grasp.normal[:, 2]) == pytest.approx(np.ones(2), abs=1e-6)
    assert grasp.push == pytest.approx(states[-1].force, rel=1e-6)
    assert grasp.friction.tolist() == [MU, MU]
    lifted = load_capacity(grasp, np.array([1.0, 0, 0, 0, 0, 0]), np.zeros(3)).factor
    assert lifted == pytest.approx(2.0 * MU * grasp.push.mean(), rel=1e-3)
    told = margins(grasp, np.zeros(2), np.zeros(2), 0.0)
    assert told.soft_margin == pytest.approx(np.ones(2), abs=1e-3)


def test_the_arm_is_that_of_the_ring_and_so_is_the_torque_that_holds(plates):
    """CalculiX solids have 0.76, 0.86, 0.92 of the contact radius at 0.5, 1, 1.5 walls (0.05)."""
    model, patches, states = plates
    for state, solid in zip(states[1:], (0.76, 0.86, 0.92), strict=True):
        grasp = read_grasp(model, patches, state, MU)
        touch = state.touches[0]
        radius = np.linalg.norm((touch.face.position - grasp.point[0])[:, :2], axis=1).max()
        assert grasp.arm[0] / radius == pytest.approx(solid, abs=0.12)
        assert grasp.arm[0] > 1.1 * UNIFORM_ARM * radius
        twist = load_capacity(grasp, np.array([0, 0, 0, 0, 0, 1.0]), np.zeros(3)).factor
        assert twist == pytest.approx(MU * grasp.push @ grasp.arm, rel=1e-3)
