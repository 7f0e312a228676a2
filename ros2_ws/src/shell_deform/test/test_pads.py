# SPDX-License-Identifier: Apache-2.0
"""Rigid pads in unilateral contact."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.building import build_model, object_contacts
from shell_deform.contact.loads import LoadError
from shell_deform.contact.pad_contact import add_point_blocks, pad_field
from shell_deform.contact.pads import Pad, gap
from shell_deform.objects import load_object
from shell_deform.objects.loader import ObjectError
from shell_deform.objects.shell_object import Contact, ShellObject, Sphere
from shell_deform.solve.equilibrium import LoadCaseError, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions
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
    field = pad_field(
        model.shell, model.surface, {0: contacts[0].pad, 1: contacts[1].pad}, np.ones(2, bool)
    )
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


def push_of(pad, depth, points, multiplier, stiffness, wall, weights):
    """Push of a pad on points (p, 3), of the distance's closed form; complex numbers pass through.

    Second: the push along the axis [N].
    """
    away = points - pad.apex - depth * pad.axis
    height = away @ pad.axis
    across = away - height[:, None] * pad.axis
    reach = np.sqrt(np.einsum('pi,pi->p', across, across))
    outward = across / reach[:, None]
    if pad.curvature:
        ball = 1.0 / pad.curvature
        far = np.sqrt(reach**2 + (height + ball) ** 2)
        value, normal = far - ball, (across + (height + ball)[:, None] * pad.axis) / far[:, None]
        face = reach.real <= pad.radius * pad.curvature * far.real
        rim = height + ball - np.sqrt(ball**2 - pad.radius**2)
    else:
        value, normal = height, np.broadcast_to(pad.axis, points.shape)
        face, rim = reach.real <= pad.radius, height
    rim = np.where(rim.real > 0.0, rim, 0.0)
    beside = reach - pad.radius
    edge = np.sqrt(beside**2 + rim**2)
    rounded = (beside[:, None] * outward + rim[:, None] * pad.axis) / edge[:, None]
    value, normal = np.where(face, value, edge), np.where(face[:, None], normal, rounded)
    pressure = multiplier - stiffness * (value - wall)
    push = weights * np.where(pressure.real > 0.0, pressure, 0.0)
    return push[:, None] * normal, push @ (normal @ pad.axis)


@pytest.mark.parametrize('curvature', [0.0, 1.0 / 0.03])
@pytest.mark.parametrize('radius', [25e-3, 4e-3])
def test_tangent_of_a_pad_is_the_complex_step_of_its_push(squeezed, curvature, radius):
    model, contacts, solver = squeezed
    state = solver.solve(displaced(contacts, [2e-3, 2e-3]))
    pad = replace(contacts[0].pad, curvature=curvature, radius=radius)
    forced_pad = pad_field(model.shell, model.surface, {0: pad}, np.array([False]))
    random = np.random.default_rng(1)
    field = replace(
        forced_pad, multipliers=1e3 * random.uniform(size=(1, len(model.shell.weights)))
    )
    depth = np.array([3e-3])
    here = field.press(state.positions, depth, np.array([0.7]))
    direction = random.normal(size=state.positions.shape)

    def push(along, sink):
        points = field.matrix @ state.positions + 1e-30j * along * (field.matrix @ direction)
        force, total = push_of(
            pad, depth[0] + 1e-30j * sink, points, field.multipliers[0], field.stiffness,
            0.5 * model.shell.thickness, model.shell.weights,
        )  # fmt: skip
        gradient = -(field.matrix.T @ force).reshape(-1)
        return gradient.real, gradient.imag / 1e-30, total.real, total.imag / 1e-30

    def close(ours, theirs):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())

    gradient, moved, force, pulled = push(1.0, 0.0)
    close(here.gradient.reshape(-1), gradient)
    close(here.force[0], force)
    np.testing.assert_allclose(here.missing[0], 0.7 - force)
    values = np.zeros(len(model.shell.pattern.indices))
    add_point_blocks(model.shell, here.stiffness, values)
    matrix = model.shell.pattern.matrix(values)
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    close(matrix @ direction.reshape(-1), moved)
    # The force is minus the derivative of the stored energy by the depth: one symmetric whole.
    close(-here.rows[:, 0] @ direction.reshape(-1), -pulled)
    _, sunk, _, stiffer = push(0.0, 1.0)
    close(here.rows[:, 0], sunk)
    close(here.corner[0], stiffer)


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
