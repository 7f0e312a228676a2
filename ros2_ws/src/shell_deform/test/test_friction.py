# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies with friction: tangent, slip, stick, hold."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from shell_deform.contact.contact_field import contact_field
from shell_deform.contact.outer_face import outer_face
from shell_deform.contact.taxels import cell_forces
from shell_deform.objects import ObjectError, load_object
from shell_deform.solve.equilibrium import LoadCaseError, displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.squeeze import load
from shell_deform.verification import capstan
from shell_deform.verification import friction as verification_friction
from shell_deform.verification.friction import plated, squeezed

MU = 0.3


@pytest.fixture(scope='module')
def held():
    """A ball between two plates with friction, squeezed by four tenths of its wall."""
    model, contacts = plated(MU, 400)
    solver = EquilibriumSolver(model)
    states = squeezed(solver, contacts, 1e-4 * np.arange(1, 5))
    assert all(state.converged for state in states)
    return model, contacts, solver, states[-1]


def pulled(held, share):
    """The state under a pull across the plates that is a share of what friction can hold."""
    model, contacts, solver, state = held
    area = model.shell.value_matrix().T @ model.shell.weights
    dead = np.zeros_like(model.rest)
    dead[:, 0] = area / area.sum() * share * 2.0 * MU * state.force[0]
    case = replace(displaced(contacts, [4e-4, 4e-4]), dead_load=dead)
    return solver.solve(case, state), dead


def test_the_outer_face_has_these_derivatives(held):
    model = held[0]
    face, random = outer_face(model.shell), np.random.default_rng(0)
    control = model.rest + 1e-3 * random.normal(size=model.rest.shape)
    chosen = np.sort(random.choice(len(face.weights), 40, replace=False))
    force, hard = random.normal(size=(40, 3)), random.normal(size=(40, 3, 3))
    hard = hard + hard.transpose(0, 2, 1)
    start = face.at(control, chosen).position

    def gradient(at):
        there = face.at(at, chosen)
        pull = force - np.einsum('pij,pj->pi', hard, there.position - start)
        return -face.forces(there, pull)

    here = face.at(control, chosen)
    values = np.zeros(len(model.shell.pattern.indices))
    face.add(here, face.blocks(here, hard, force), values)
    matrix = model.shell.pattern.matrix(values)
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    direction = random.normal(size=control.shape)
    step = 1e-8
    slope = (gradient(control + step * direction) - gradient(control - step * direction)) / (
        2.0 * step
    )
    ours = (matrix @ direction.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(ours, slope, atol=1e-6 * np.abs(slope).max())


def test_friction_keeps_the_tangent_symmetric(held):
    model, contacts, _, state = held
    field = contact_field(
        model.outer_face, model.wall_stiffness, {0: contacts[0].body, 1: contacts[1].body},
        np.ones(2, bool),
    ).started(state.memory, state.positions, state.displacement, np.zeros((2, 6)))  # fmt: skip
    shaken = state.positions + 1e-7 * np.random.default_rng(1).normal(size=state.positions.shape)
    press = field.press(shaken, state.displacement, state.force, np.zeros((2, 6)))
    values = np.zeros(len(model.shell.pattern.indices))
    field.add(press, values)
    matrix = model.shell.pattern.matrix(values)
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()


def test_bodies_that_go_on_push_what_sticks_as_their_tangent_says(held):
    model, contacts, _, state = held
    still = np.zeros((2, 6))
    field = contact_field(
        model.outer_face, model.wall_stiffness, {0: contacts[0].body, 1: contacts[1].body},
        np.ones(2, bool),
    ).started(state.memory, state.positions, state.displacement, still).sticking  # fmt: skip
    here = field.press(state.positions, state.displacement, state.force, still)
    # What slipped on the way there carries its friction still.
    np.testing.assert_allclose(here.force, state.force, rtol=1e-9)
    depth, motion = state.displacement + [3e-10, -2e-10], 1e-8 * np.eye(2, 6, 2)
    motion[1, 5] = 2e-7
    there = field.press(state.positions, depth, state.force, motion)
    found = field.carried(here, depth, motion)
    wanted = (here.gradient - there.gradient).ravel()
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


def test_all_friction_of_a_plate_stays_below_mu_times_its_push(held):
    for touch in pulled(held, 0.5)[0].touches:
        size = np.linalg.norm(touch.friction, axis=1)
        assert size @ touch.weights <= 1.001 * MU * (touch.pressure @ touch.weights)


def test_plates_hold_a_pull_below_their_friction_and_share_it(held):
    state, dead = pulled(held, 0.5)
    assert state.converged
    forces = np.array([touch.force for touch in state.touches])
    np.testing.assert_allclose(forces[:, 0].sum(), -dead[:, 0].sum(), rtol=1e-6)
    np.testing.assert_allclose(forces[0, 0], forces[1, 0], rtol=1e-4)


def test_two_plates_let_go_when_they_carry_twice_mu_times_their_push_within_a_thousandth(held):
    assert pulled(held, 0.95)[0].converged
    lost, _ = pulled(held, 1.01)
    assert not lost.converged
    # The last state before they slide all over.
    pull = sum(touch.force for touch in lost.touches)[0]
    push = sum(abs(touch.force[2]) for touch in lost.touches)
    assert 0.999 < abs(pull) / (MU * push) < 1.0 + 1e-6


def test_a_closed_cycle_loses_nothing_without_friction_nor_where_all_sticks_but_in_between():
    lost = {}
    depths = 1e-4 * np.array([1, 2, 3, 4, 3, 2, 1, 0])
    for friction in (0.0, 0.5, 50.0):
        model, contacts = plated(friction, 300)
        states = squeezed(EquilibriumSolver(model), contacts, depths)
        assert len(states) == len(depths)
        force = np.array([0.0, *(state.force[0] for state in states)])
        width = np.diff(np.concatenate([[0.0], depths]))
        lost[friction] = 0.5 * float((force[1:] + force[:-1]) @ width)
    assert abs(lost[0.0]) < 1e-6 * lost[0.5]
    assert abs(lost[50.0]) < 0.05 * lost[0.5]


def test_a_pull_of_95_percent_held_for_an_hour_of_solves_moves_nothing(held):
    model, contacts, solver, _ = held
    state, dead = pulled(held, 0.95)
    assert state.converged
    case = replace(displaced(contacts, [4e-4, 4e-4]), dead_load=dead)
    first = state.positions
    for _ in range(60):
        state = solver.solve(case, state)
        assert state.factorisations == 0
    assert state.positions.tobytes() == first.tobytes()


def test_a_pull_that_comes_and_goes_shakes_down_and_does_not_creep(held):
    model, contacts, solver, _ = held
    low, high = (pulled(held, share)[1] for share in (0.7, 0.9))
    ends, state = [], held[3]
    for _ in range(4):
        for dead in (high, low):
            state = solver.solve(replace(displaced(contacts, [4e-4, 4e-4]), dead_load=dead), state)
            assert state.converged
        ends.append(state.positions)
    moved = [np.linalg.norm(b - a, axis=1).max() for a, b in itertools.pairwise(ends)]
    assert moved[2] < min(1e-9, 0.1 * moved[0])


def test_nothing_slips_further_than_mu_times_its_pressure(held):
    for touch in pulled(held, 0.9)[0].touches:
        size = np.linalg.norm(touch.friction, axis=1)
        assert np.all(size <= (1.0 + 1e-9) * MU * touch.pressure)
        np.testing.assert_allclose(
            size[~touch.sticking], MU * touch.pressure[~touch.sticking], rtol=1e-9
        )


def test_the_moment_of_a_plate_that_slips_all_over_is_mu_times_the_arm_of_its_pressure():
    row = next(verification_friction.spin(400))
    assert row.value > 0.0
    assert row.passed


@pytest.mark.parametrize('friction', [MU, 0.8])
def test_tensions_of_a_strip_that_slips_around_a_rod_are_in_the_ratio_of_euler(friction):
    row = next(capstan.problems(frictions=(friction,)))
    assert row.passed
    # Where the strip is thin against the rod the ratio is Euler's own.
    assert row.value == pytest.approx(np.exp(friction * capstan.ARC), rel=0.01 + 0.02 * friction)


def test_a_squeeze_with_friction_is_as_stiff_and_as_wide_as_in_a_solid():
    kept = {**verification_friction.kept_friction(), 'depth_m': [5e-4]}
    force, radius = verification_friction._squeezed(kept, kept['friction'].index(MU), 650)
    assert force.passed
    assert radius.passed


def test_a_motion_that_fits_no_contact_is_refused(held):
    contacts = held[1]
    for motion in (np.zeros((1, 6)), np.full((2, 6), np.nan)):
        with pytest.raises(LoadCaseError, match='motion must be 2 x 6 finite numbers'):
            replace(displaced(contacts, [0.0, 0.0]), motion=motion)


TEXT = (
    'name: ball\nsurface: {sphere: {outer_diameter_m: 0.101}}\nthickness_m: 0.001\n'
    'young_modulus_pa: 1.0e+9\npoisson_ratio: 0.3\ncontacts:\n'
)


def test_pads_of_an_object_file_may_rub(tmp_path):
    file = tmp_path / 'ball.yaml'
    rows = ''.join(
        f'  - {{at_m: [0, 0, {z}], radius_m: 0.04, kind: pad, friction: 0.3}}\n'
        for z in (0.0505, -0.0505)
    )
    file.write_text(TEXT + rows)
    ball = load(file, control_vertices=300)
    assert [contact.body.friction for contact in ball.contacts] == [0.3, 0.3]
    squeezed_ball = ball.squeeze(displacement=1e-4)
    assert squeezed_ball.state.touches[0].force[2] < 0.0 < squeezed_ball.contact_force[0]


@pytest.mark.parametrize(
    ('kind', 'friction', 'says'),
    [('pin', '0.3', 'friction needs kind: pad'), ('pad', '-0.1', '-0.1'), ('pad', '.nan', 'nan')],
)
def test_friction_that_cannot_be_is_refused_with_its_line(kind, friction, says, tmp_path):
    file = tmp_path / 'ball.yaml'
    row = f'  - {{at_m: [0, 0, 0.0505], radius_m: 0.004, kind: {kind}, friction: {friction}}}\n'
    file.write_text(TEXT + row)
    with pytest.raises(ObjectError, match=says):
        load_object(file)


def test_touch_cells_together_feel_the_force_of_the_contact_in_its_own_frame(held):
    state = pulled(held, 0.5)[0]
    grid = 5e-4 * np.arange(-12, 13)
    centres = np.array([[x, y, 0.0] for x in grid for y in grid])
    for touch in state.touches:
        cells = cell_forces(touch, centres)
        np.testing.assert_allclose(
            touch.pose.turn @ cells.sum(axis=0), -touch.force, atol=1e-12 * abs(touch.force[2])
        )
        # What is felt is pressure, into the body, on several cells around the middle.
        felt = np.linalg.norm(cells, axis=1) > 0.0
        assert felt.sum() >= 4
        assert np.all(cells[felt, 2] < 0.0)
        assert np.all(np.linalg.norm(centres[felt], axis=1) < 5e-3)


def test_cells_of_a_body_that_touches_nothing_feel_nothing(held):
    model, contacts, solver, _ = held
    state = solver.solve(displaced(contacts, [-1e-4, -1e-4]))
    assert not cell_forces(state.touches[0], np.zeros((4, 3))).any()
