# SPDX-License-Identifier: Apache-2.0
"""The live pipeline on a thick wall: its settled answers are the equilibria."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from live_hand import SURE

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

RADIUS = 1e-3


@pytest.fixture(scope='module')
def ball():
    return with_material(load_object('tennis_ball'), poisson_ratio=0.49)


@pytest.fixture(scope='module')
def model(ball):
    return build_model(ball, 'thick', control_vertices=250)


@pytest.fixture(scope='module')
def truth(ball, model):
    """Forces [N] and limit surface (n, 3) at a travel [m], by the offline solver."""
    solver = EquilibriumSolver(model)
    contacts = object_contacts(ball, model, RADIUS)

    def at(travel):
        state = solver.solve(displaced(contacts, [travel, travel]))
        assert state.converged
        return state.force, model.surface.limit_positions(state.positions)

    return at


def squeeze(force, travel, **options):
    return live_hand.opposed(force, [travel, travel], radius=RADIUS, **options)


def error(packed, surface):
    return float(np.linalg.norm(packed[:, :3] - surface, axis=1).max())


@pytest.mark.parametrize('drive', ['force', 'motion', 'fused'])
def test_the_settled_answer_is_the_equilibrium(model, truth, drive):
    force, surface = truth(3e-3)
    pipeline = live_hand.pipeline(model, replace(SURE, drive=drive))
    served = pipeline.settle(squeeze(force, 3e-3), rounds=5)
    assert error(served.packed, surface) < 3e-5


def test_a_small_step_is_carried_by_the_tangent_of_the_stamps(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, _ = truth(2e-3)
    pipeline.settle(squeeze(force, 2e-3), rounds=4)
    force, surface = truth(2.2e-3)
    served = pipeline.tick(squeeze(force, 2.2e-3, stamp=2))
    assert error(served.packed, surface) < 0.03e-3


def test_a_release_ends_at_rest_and_the_next_grasp_is_the_first_again(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, surface = truth(2e-3)
    pipeline.settle(squeeze(force, 2e-3), rounds=4)
    pipeline.settle(squeeze([0.0, 0.0], 0.0, flags=0, stamp=2))
    rest = pipeline.tick(squeeze([0.0, 0.0], 0.0, flags=0, stamp=3))
    assert rest.max_displacement < 1e-6
    served = pipeline.settle(squeeze(force, 2e-3, stamp=4), rounds=4)
    assert error(served.packed, surface) < 3e-5
