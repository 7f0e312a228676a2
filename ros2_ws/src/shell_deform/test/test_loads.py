# SPDX-License-Identifier: Apache-2.0
"""Contacts and other loads: what their nodal forces add up to, and closed-form answers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from shell_deform.assemble.discretisation import discretise
from shell_deform.contact.loads import (
    PROFILES,
    LoadError,
    contact_patch,
    contact_torque,
    line_load,
    surface_load,
)
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import LoadCase, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import clamp, joined
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import grid_surface

X, Y, Z = np.eye(3)
RADIUS = 31.25e-3


@pytest.mark.parametrize('profile', PROFILES)
def test_pressure_profiles_have_a_mean_of_one(profile):
    s = (np.arange(20000) + 0.5) / 20000
    assert PROFILES[profile](s).mean() == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize('profile', PROFILES)
def test_a_unit_push_is_a_unit_force_through_the_centre(ball, profile):
    patch = ball.contact(Z, 4e-3, profile=profile)
    force = patch.force_pattern(patch.axis)
    limit = ball.surface.limit_positions(ball.rest)
    np.testing.assert_allclose(force.sum(axis=0), patch.axis, atol=1e-12)
    assert np.abs(np.cross(ball.rest - patch.point, force).sum(axis=0)).max() < 1e-6
    assert np.linalg.norm(patch.point) == pytest.approx(np.linalg.norm(limit[0]), rel=1e-3)


@given(st.floats(0.0, np.pi), st.floats(-np.pi, np.pi), st.floats(1e-3, 8e-3))
@settings(max_examples=15, deadline=None)
def test_anywhere_on_the_ball_a_contact_is_round_centred_and_inward(ball, down, around, radius):
    outward = np.array(
        [np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)]
    )
    patch = contact_patch(ball.surface, 1.2 * RADIUS * outward, radius)
    assert patch.axis @ outward < -0.999
    assert (
        np.abs(patch.moments.sum(axis=0) @ np.stack(patch.lateral, axis=1)).max() < 1e-3 * radius
    )
    assert patch.inertia == pytest.approx(0.5 * radius**2, rel=0.05)


def test_a_pad_that_presses_in_its_middle_dents_deeper_than_a_pin_of_its_size(ball):
    pads = {}
    for profile in ('uniform', 'hertz', 'cone'):
        pair = tuple(ball.contact(sign * Z, 6e-3, profile=profile) for sign in (1.0, -1.0))
        pads[profile] = EquilibriumSolver(ball).solve(displaced(pair, [1e-3, 1e-3])).force[0]
    assert pads['cone'] < pads['hertz'] < pads['uniform']


def test_contact_torque_is_a_pure_torque_about_the_axis(ball):
    patch = ball.contact(Z, 4e-3)
    force = contact_torque(patch, 2e-3)
    assert np.abs(force.sum(axis=0)).max() < 1e-3
    moment = np.cross(ball.rest - patch.point, force).sum(axis=0)
    np.testing.assert_allclose(moment, 2e-3 * patch.axis, atol=2e-5)


def test_opposite_contact_torques_twist_the_ball_about_their_axis(ball):
    top, bottom = ball.contact(Z, 6e-3), ball.contact(-Z, 6e-3)
    load = contact_torque(top, 1e-4) + contact_torque(bottom, 1e-4)
    state = EquilibriumSolver(ball).solve(LoadCase((), np.zeros(0), np.zeros(0), dead_load=load))
    assert state.converged, state.message
    moved = state.positions - ball.rest
    spins = [float(np.sum(patch.spin_row() * moved)) / patch.radius for patch in (top, bottom)]
    assert spins[0] > 0 and spins[0] == pytest.approx(spins[1], rel=1e-3)


def test_surface_load_is_its_traction_times_the_area(ball):
    load = surface_load(ball.shell, np.array([0.0, 0.0, 3.0]))
    np.testing.assert_allclose(load.sum(axis=0), [0.0, 0.0, 3.0 * ball.shell.area], atol=1e-12)
    outward = ball.shell.reference.normal
    closed = surface_load(ball.shell, outward).sum(axis=0)
    assert np.abs(closed).max() < 1e-9


def strip(length=1.0, width=0.1):
    def flat(s, t):
        return np.stack([length * s, width * (t - 0.5), 0.0 * s], axis=1)

    grid = grid_surface(flat, (10, 2))
    return grid, discretise(grid.mesh, Material(1e9, 0.0), 0.01)


def test_line_load_is_even_along_its_path():
    grid, shell = strip()
    edge = grid.edge('s1')
    load = line_load(shell.mesh, edge, np.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(load.sum(axis=0), [0.0, 0.0, 2.0], atol=1e-12)
    moment = np.cross(shell.mesh.vertices, load).sum(axis=0)
    np.testing.assert_allclose(moment, [0.0, -2.0, 0.0], atol=2e-3)


def test_a_line_load_off_the_edges_is_refused_by_its_vertices():
    grid, shell = strip()
    with pytest.raises(LoadError, match='share no edge'):
        line_load(shell.mesh, grid.edge('s1')[[0, 2]], Z)


def test_follower_pressure_blows_up_a_sphere_by_the_membrane_formula(sphere):
    young, poisson, thickness, pressure = 1e9, 0.3, 5e-3, 1e4
    model = sphere(1.0, thickness, young=young, poisson=poisson, pressure=pressure)
    state = EquilibriumSolver(model).solve(forced((), []))
    grown = np.linalg.norm(model.surface.limit_positions(state.positions), axis=1).mean() - 1.0
    assert grown == pytest.approx(pressure * (1 - poisson) / (2 * young * thickness), rel=5e-3)


def test_follower_pressure_turns_with_the_surface(sphere):
    model = sphere(1.0, 0.05, subdivisions=1, pressure=1e3)
    rng = np.random.default_rng(4)
    bent = model.rest + 0.05 * rng.normal(size=model.rest.shape)
    direction = rng.normal(size=model.rest.shape)
    step = 1e-6
    ends = [model.gradient(bent + sign * step * direction)[1] for sign in (1, -1)]
    product = model.tangent(bent).stiffness @ direction.ravel()
    np.testing.assert_allclose(
        product, (ends[0] - ends[1]) / (2 * step), atol=1e-6 * np.abs(product).max()
    )


def test_a_wall_that_thickens_along_the_strip_bends_as_its_beam():
    grid, plain = strip()
    h = 0.01 * (2.0 - plain.mesh.vertices[:, 0])
    shell = discretise(plain.mesh, Material(1e9, 0.0), h)
    model = ShellModel(shell, supports=joined(clamp(shell, grid.edge('s0'), X)))
    load = line_load(shell.mesh, grid.edge('s1'), 1e-2 * Z)
    state = EquilibriumSolver(model).solve(LoadCase((), np.zeros(0), np.zeros(0), dead_load=load))
    moved = model.surface.limit_positions(state.positions - model.rest)[grid.edge('s1'), 2]
    x = np.linspace(0.0, 1.0, 20001)
    bending = 1e9 * 0.1 * (0.01 * (2.0 - x)) ** 3 / 12.0
    assert moved.mean() == pytest.approx(trapezoid(1e-2 * (1.0 - x) ** 2 / bending, x), rel=5e-3)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'radius': 0.0}, 'positive'),
        ({'radius': np.nan}, 'positive'),
        ({'at': np.array([np.nan, 0.0, 0.0])}, 'finite'),
        ({'profile': 'square'}, 'hertz'),
    ],
)
def test_impossible_contacts_are_refused(ball, changes, words):
    with pytest.raises(LoadError, match=words):
        contact_patch(ball.surface, **{'at': Z, 'radius': 1e-3, **changes})


def test_constant_pressure_beside_sealed_gas_adds_up(sphere):
    model = replace(sphere(1.0, 0.05, subdivisions=1), pressure=200.0)
    assert model.overpressure(model.rest_volume) == 200.0
