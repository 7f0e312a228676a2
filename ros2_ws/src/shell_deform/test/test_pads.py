"""Rigid pads in unilateral contact."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.building import build_model, object_contacts
from shell_deform.loads import LoadError
from shell_deform.objects import load_object
from shell_deform.objects.loader import ObjectError
from shell_deform.objects.shell_object import Contact, ShellObject, Sphere
from shell_deform.pads import Pad, gap
from shell_deform.solve.equilibrium import LoadCaseError, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions
from shell_deform.solve.pad_contact import pad_field
from shell_deform.solve.stability import snap_margin
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


def test_pads_never_pull_and_hardly_sink_in(squeezed):
    model, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [3e-3, 3e-3]))
    field = pad_field(model, {0: contacts[0].pad, 1: contacts[1].pad}, np.ones(2, bool))
    points = field.matrix @ state.positions
    for contact in contacts:
        clear = gap(contact.pad, 3e-3, points).value - 0.5 * model.shell.thickness
        assert clear.min() > -5e-3 * 2.5e-3
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
def test_gap_is_a_distance_with_these_derivatives(curvature):
    pad = Pad(np.array([0.0, 0.01, 0.02]), np.array([0.0, 0.6, 0.8]), 0.02, curvature)
    points = pad.apex + 0.03 * np.random.default_rng(3).normal(size=(400, 3))
    points += 0.03 * pad.axis
    here = gap(pad, 1e-3, points)
    np.testing.assert_allclose(np.linalg.norm(here.normal, axis=1), 1.0, atol=1e-12)
    step = 1e-7
    for i, direction in enumerate(np.eye(3) * step):
        up, down = gap(pad, 1e-3, points + direction), gap(pad, 1e-3, points - direction)
        slope = (up.value - down.value) / (2 * step)
        bend = (up.normal - down.normal) / (2 * step)
        smooth = np.abs(bend - here.hessian()[:, i]).max(axis=1) < 1e-4 * np.abs(bend).max()
        np.testing.assert_allclose(slope, here.normal[:, i], atol=1e-7)
        assert smooth.mean() > 0.97


@pytest.mark.parametrize('driven', [True, False])
def test_tangent_of_a_pad_is_the_derivative_of_its_push(squeezed, driven):
    model, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [2e-3, 2e-3]))
    curved = replace(contacts[0].pad, curvature=1.0 / 0.05)
    field = pad_field(model, {0: curved}, np.array([driven]))
    depth, force = np.array([4e-3]), np.array([0.7])
    direction = np.random.default_rng(1).normal(size=state.positions.shape)
    step = 1e-10
    here = field.press(state.positions, depth, force)
    moved = [
        field.press(state.positions + s * step * direction, here.depth, force).gradient
        for s in (1.0, -1.0)
    ]
    by_difference = ((moved[0] - moved[1]) / (2 * step)).reshape(-1)
    matrix = field.pressed(model.tangent(state.positions), here)
    own = (matrix.stiffness - model.tangent(state.positions).stiffness) @ direction.reshape(-1)
    if not driven:
        rows, corner = here.rows[:, 0], here.corner[0]
        own = own - rows * (rows @ direction.reshape(-1)) / corner
    np.testing.assert_allclose(own, by_difference, atol=1e-5 * np.abs(by_difference).max())


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
