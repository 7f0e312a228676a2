# SPDX-License-Identifier: Apache-2.0
"""Following equilibria, and the condensed response about them."""

import numpy as np
import pytest

from shell_deform.building import build_model
from shell_deform.live.background.condensed import contact_rows
from shell_deform.live.background.tracked_state import Target
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.gas import Gas

R, H = 31.25e-3, 2.5e-3


@pytest.fixture(scope='module')
def model(sphere):
    return sphere(R, H, subdivisions=2, young=12e6, gas=Gas('sealed'))


@pytest.fixture(scope='module')
def patches(model):
    return tuple(model.contact(np.array([x, 0.0, 0.0]), 4e-3) for x in (R, -R))


@pytest.fixture
def tracker(model, patches):
    tracker = EquilibriumTracker(model)
    tracker.set_contacts(contact_rows(model, patches), np.zeros(2))
    return tracker


def driven_to(tracker, displacement):
    here = tracker.present(np.ones(2, bool))
    return Target(here.force, np.asarray(displacement, float), here.driven, here.rigid, here.held)


def forced_to(tracker, force):
    here = tracker.present(np.zeros(2, bool))
    return Target(np.asarray(force, float), here.displacement, here.driven, here.rigid, here.held)


def test_the_tracked_state_is_the_equilibrium_that_newton_finds(model, patches, tracker):
    assert tracker.advance(driven_to(tracker, [3e-3, 3e-3])) == 1.0
    expected = EquilibriumSolver(model).solve(displaced(patches, [3e-3, 3e-3]))
    assert tracker.state.force == pytest.approx(expected.force, rel=1e-4)
    assert np.abs(tracker.positions - expected.positions).max() < 1e-7


def test_a_small_step_costs_no_new_tangent(tracker):
    tracker.advance(driven_to(tracker, [3e-3, 3e-3]))
    tracker.condense()
    before = tracker.factorisations
    assert tracker.advance(driven_to(tracker, [3.2e-3, 3.2e-3])) == 1.0
    assert tracker.factorisations == before


def test_a_step_of_a_wall_goes_on_the_last_tangent_to_the_same_state(model, patches, tracker):
    tracker.advance(driven_to(tracker, [3e-3, 3e-3]))
    tracker.condense()
    before = tracker.factorisations
    assert tracker.advance(driven_to(tracker, [5.5e-3, 5.5e-3])) == 1.0
    assert tracker.factorisations == before
    expected = EquilibriumSolver(model).solve(displaced(patches, [5.5e-3, 5.5e-3]))
    assert tracker.state.force == pytest.approx(expected.force, rel=1e-4)
    assert np.abs(tracker.positions - expected.positions).max() < 1e-7


def test_a_jump_of_four_walls_is_carried(tracker):
    assert tracker.advance(driven_to(tracker, [10e-3, 10e-3])) == 1.0
    assert tracker.present(np.ones(2, bool)).displacement == pytest.approx([10e-3, 10e-3])


def test_an_impossible_load_leaves_an_equilibrium_on_the_way_and_says_why(tracker):
    share = tracker.advance(driven_to(tracker, [80e-3, 80e-3]))
    assert share < 1.0
    assert tracker.message
    assert tracker.state.residual < 1e-3


def test_push_columns_are_the_derivative_of_the_equilibrium(tracker):
    tracker.advance(forced_to(tracker, [9.0, 9.0]))
    condensed = tracker.condense()
    before = tracker.state.moved
    tracker.advance(forced_to(tracker, [9.01, 9.0]))
    change = (tracker.state.moved - before) / 0.01
    assert np.abs(change - condensed.fields[:, 0]).max() < 5e-3 * np.abs(change).max()


def test_the_lateral_column_moves_its_patch_and_no_other(model, tracker):
    tracker.advance(forced_to(tracker, [9.0, 9.0]))
    condensed = tracker.condense()
    rows = contact_rows(model, tracker_patches(model))
    moved = rows.held.T @ condensed.fields[:, 2]
    assert moved == pytest.approx([1.0, 0, 0, 0, 0, 0], abs=1e-9)


def tracker_patches(model):
    return tuple(model.contact(np.array([x, 0.0, 0.0]), 4e-3) for x in (R, -R))


def test_the_modulus_column_is_what_a_softer_shell_does(sphere, tracker, model):
    tracker.advance(forced_to(tracker, [9.0, 9.0]))
    column = tracker.condense().fields[:, -1]
    other = sphere(R, H, subdivisions=2, young=12e6 * 1.002, gas=Gas('sealed'))
    softer = EquilibriumTracker(other)
    softer.set_contacts(contact_rows(other, tracker_patches(other)), np.zeros(2))
    softer.advance(forced_to(softer, [9.0, 9.0]))
    change = (softer.state.moved - tracker.state.moved) / np.log(1.002)
    assert np.abs(change - column).max() < 0.02 * np.abs(column).max()


def test_a_squeezed_ball_is_stable_under_force_and_motion(tracker):
    tracker.advance(driven_to(tracker, [4e-3, 4e-3]))
    tracker.condense()
    assert tracker.system().negative_modes == 0
    assert tracker.system().negative_modes_driven(np.ones(2, bool)) == 0


def test_a_supported_shell_without_contacts_has_columns_too(capfd):
    model = build_model(load_object('half_soda_can'), control_vertices=200)
    tracker = EquilibriumTracker(model)
    tracker.set_contacts(contact_rows(model, ()), np.zeros(0))
    condensed = tracker.condense()
    assert condensed.fields.shape == (3 * len(model.rest), 1)
    assert np.abs(condensed.fields).max() < 1e-9
    assert capfd.readouterr().err == ''


def test_a_body_without_contacts_stays_at_rest(model):
    tracker = EquilibriumTracker(model)
    tracker.set_contacts(contact_rows(model, ()), np.zeros(0))
    assert tracker.advance(tracker.present(np.zeros(0, bool))) == 1.0
    assert np.abs(tracker.state.moved).max() < 1e-12
