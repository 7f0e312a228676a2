# SPDX-License-Identifier: Apache-2.0
"""Rigid pads in unilateral contact."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.building import build_model, object_contacts
from shell_deform.contact.bodies import RoundBar
from shell_deform.contact.contact_field import contact_field
from shell_deform.contact.loads import LoadError
from shell_deform.objects import load_object
from shell_deform.objects.loader import ObjectError
from shell_deform.objects.shell_object import Contact, ShellObject, Sphere
from shell_deform.solve.equilibrium import LoadCaseError, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.stability import snap_margin
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.verification import plates as verification_plates


def plates(middle_radius, thickness, young, poisson, curvature_radius=None):
    outer = middle_radius + 0.5 * thickness
    contacts = tuple(
        Contact((0.0, 0.0, z), 0.8 * middle_radius, 'pad', curvature_radius)
        for z in (outer, -outer)
    )
    return ShellObject('ball', Sphere(2.0 * outer), thickness, young, poisson, contacts=contacts)


@pytest.fixture(scope='module')
def squeezed():
    ball = plates(31.25e-3, 2.5e-3, 1e6, 0.49)
    model = build_model(ball, control_vertices=400)
    return model, object_contacts(ball, model), EquilibriumSolver(model)


def test_sphere_between_plates_pushes_back_like_a_solid_in_contact():
    # CalculiX, axisymmetric solid with contact: no code and no theory in common. The wall does
    # not shear and is not crushed at the first touch, so it is a little stiffer.
    rows = list(verification_plates.problems())
    assert sum(row.goal is not None for row in rows) == 6
    assert all(row.passed for row in rows)


def test_force_and_depth_control_meet(squeezed):
    model, contacts, solver = squeezed
    by_depth = solver.solve(displaced(contacts, [2e-3, 2e-3]))
    by_force = solver.solve(forced(contacts, by_depth.force))
    assert by_force.converged
    np.testing.assert_allclose(by_force.displacement, 2e-3, rtol=2e-3)
    np.testing.assert_allclose(by_force.force, by_depth.force, rtol=1e-9)


def test_pads_never_pull_and_sink_in_by_what_half_the_wall_gives_way(squeezed):
    model, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [3e-3, 3e-3]))
    for touch in state.touches:
        assert np.all(touch.pressure > 0.0)
        layer = 1e6 / (1.0 - 0.49**2) / 1.25e-3
        deepest = touch.pose.distance(RoundBar(25e-3), touch.face.position).value.min()
        np.testing.assert_allclose(touch.pressure.max() / layer, -deepest, rtol=1e-9)
        assert -deepest < 0.05 * 2.5e-3
    assert np.all(state.force > 0.0)
    assert np.abs(state.unbalance).max() < 1e-8 * state.force[0]


def test_pads_that_only_touch_carry_nothing(squeezed):
    _, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [0.0, 0.0]))
    assert state.converged
    np.testing.assert_allclose(state.force, 0.0, atol=1e-12)


def test_unequal_depths_shift_a_free_ball_to_the_middle(squeezed):
    model, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [2.5e-3, 1.5e-3]))
    assert state.converged
    np.testing.assert_allclose(state.force[0], state.force[1], rtol=1e-6)
    shift = model.surface.limit_positions(state.positions)[:, 2].mean()
    np.testing.assert_allclose(shift, -0.5e-3, rtol=0.02)


@pytest.mark.parametrize('curvature', [0.0, 1.0 / 0.03])
@pytest.mark.parametrize('radius', [25e-3, 4e-3])
def test_tangent_of_a_pad_is_the_derivative_of_its_push(squeezed, curvature, radius):
    model, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [2e-3, 2e-3]))
    body = replace(contacts[0].body, shape=RoundBar(radius, curvature))
    field = contact_field(model.outer_face, model.wall_stiffness, {0: body}, np.array([False]))
    direction = np.random.default_rng(1).normal(size=state.positions.shape)
    still = np.zeros((1, 6))

    def pressed(along, sink):
        control = state.positions + along * direction
        return field.press(control, np.array([3e-3 + sink]), np.array([0.7]), still)

    here = pressed(0.0, 0.0)
    values = np.zeros(len(model.shell.pattern.indices))
    field.add(here, values)
    matrix = model.shell.pattern.matrix(values)
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    np.testing.assert_allclose(here.missing[0], 0.7 - here.force[0])
    step = 1e-10

    def close(ours, up, down):
        slope = (up - down) / (2.0 * step)
        np.testing.assert_allclose(ours, slope, rtol=0, atol=1e-4 * np.abs(slope).max())

    up, down = pressed(step, 0.0), pressed(-step, 0.0)
    close(matrix @ direction.reshape(-1), up.gradient.ravel(), down.gradient.ravel())
    # The force is minus the derivative of the stored energy by the depth: one symmetric whole.
    close(-here.rows[:, 0] @ direction.reshape(-1), -up.force[0], -down.force[0])
    up, down = pressed(0.0, step), pressed(0.0, -step)
    close(here.rows[:, 0], up.gradient.ravel(), down.gradient.ravel())
    close(here.corner[0], up.force[0], down.force[0])


@pytest.mark.parametrize('force', [0.4, 0.9, 2.0, 3.4])
def test_forced_pads_need_no_more_than_thirty_factorisations_from_rest(squeezed, force):
    _, contacts, solver = squeezed
    state = solver.solve(forced(contacts, [force, force]))
    assert state.converged and state.stable
    np.testing.assert_allclose(state.force, force, rtol=1e-8)
    assert state.factorisations <= 30


def test_a_force_beyond_the_branch_ends_as_a_typed_result(squeezed):
    _, contacts, solver = squeezed
    state = solver.solve(forced(contacts, [1e3, 1e3]))
    assert not state.converged
    assert state.message and 0.0 < state.load_fraction < 1.0
    assert np.isfinite(state.positions).all() and state.negative_modes is not None


def test_curved_pads_dent_more_than_flat_ones(squeezed):
    flat = squeezed[2].solve(displaced(squeezed[1], [2e-3, 2e-3])).force[0]
    ball = plates(31.25e-3, 2.5e-3, 1e6, 0.49, curvature_radius=0.026)
    model = build_model(ball, control_vertices=400)
    curved = EquilibriumSolver(model).solve(displaced(object_contacts(ball, model), [2e-3, 2e-3]))
    assert curved.converged
    assert curved.force[0] < 0.95 * flat


def test_stability_is_counted_with_pads(squeezed):
    model, contacts, _ = squeezed
    solver = EquilibriumSolver(model, NewtonOptions(stability=True))
    for case in (displaced(contacts, [1e-3, 1e-3]), forced(contacts, [0.4, 0.4])):
        assert solver.solve(case).stable


def test_what_cannot_treat_pads_says_so(squeezed):
    _, contacts, solver = squeezed
    case = displaced(contacts, [1e-3, 1e-3])
    with pytest.raises(LoadCaseError, match='the margin to snap takes pins, no rigid pads'):
        snap_margin(solver, case, solver.rest())


def test_impossible_pads_are_refused(squeezed, tmp_path):
    model = squeezed[0]
    with pytest.raises(LoadError, match='pad radius is -1'):
        model.pad(np.array([0.0, 0.0, 0.03]), -1.0)
    with pytest.raises(LoadError, match='the face of the pad has a radius of 0.01 m, less'):
        model.pad(np.array([0.0, 0.0, 0.03]), 0.02, 0.01)
    text = (
        'name: ball\nsurface: {sphere: {outer_diameter_m: 0.065}}\nthickness_m: 0.0025\n'
        'young_modulus_pa: 1.0e+6\npoisson_ratio: 0.49\ncontacts:\n'
        '  - {at_m: [0, 0, 0.0325], radius_m: 0.002, kind: pin, curvature_radius_m: 0.1}\n'
    )
    (tmp_path / 'ball.yaml').write_text(text)
    with pytest.raises(ObjectError, match='curvature_radius_m needs kind: pad, not pin'):
        load_object(tmp_path / 'ball.yaml')
