# SPDX-License-Identifier: Apache-2.0
"""Theory `thick` on whole shells: derivatives, invariance, the thin limit, solids, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shell_deform.assemble.discretisation import discretise
from shell_deform.assemble.stamps import Stamp, WallError
from shell_deform.assemble.thick import EXTRA_COMPLIANCE, thick_shell
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.objects import load_object
from shell_deform.readout import read_out
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.material import Material

RADIUS, THICKNESS = 31.25e-3, 2.5e-3

SOLID = {1.05e-3: 0.3965, 3.62e-3: 0.8979, 6.29e-3: 1.1222, 10.63e-3: 1.4567}
"""Force [N] of a CalculiX CAX8R ball: R/h 12.5, E 1 MPa, nu 0.49, rigid pin of 1 mm, no air."""


@pytest.fixture(scope='module')
def ball():
    description = load_object('tennis_ball')
    return with_material(description, young_modulus=1e6, poisson_ratio=0.49, gas_kind='none')


@pytest.fixture(scope='module')
def model(ball):
    return build_model(ball, 'thick', control_vertices=300)


@pytest.fixture(scope='module')
def pressed(ball, model):
    """The model under its two pins."""
    return model.on_contacts(object_contacts(ball, model, 1e-3))


@pytest.fixture(scope='module')
def squeezed(ball, model):
    """Its equilibrium at 3 mm on either side."""
    solver = EquilibriumSolver(model)
    state = solver.solve(displaced(object_contacts(ball, model, 1e-3), [3e-3, 3e-3]))
    assert state.converged
    return solver.model, state


def turned(count, unknowns, angle):
    """All unknowns after a rotation about an axis through the middle, pins aside."""
    axis = np.array([0.6, 0.0, 0.8])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    result = unknowns.copy()
    result[:count] = unknowns[:count] @ rotation.T
    return result


@pytest.mark.parametrize('degrees', [1.0, 30.0, 90.0, 180.0])
def test_turning_a_sheared_wall_costs_nothing(degrees):
    mesh = build_model(load_object('tennis_ball'), control_vertices=100).shell.mesh
    shell = thick_shell(mesh, Material(1e6, 0.49), THICKNESS, everywhere=True)
    rng = np.random.default_rng(2)
    unknowns = shell.start.copy()
    unknowns[: len(mesh.vertices)] *= 1.0 + 0.05 * rng.normal(size=(len(mesh.vertices), 1))
    unknowns[len(mesh.vertices) :, :2] = 0.1 * THICKNESS * rng.normal(size=(len(shell.sheared), 2))
    before, _ = shell.gradient('thick', unknowns)
    after, _ = shell.gradient('thick', turned(len(mesh.vertices), unknowns, np.radians(degrees)))
    assert after == pytest.approx(before, rel=1e-12)


def test_a_rotation_of_the_undeformed_wall_has_no_energy_to_speak_of(model):
    shell = model.shell
    squeeze = shell.gradient('thick', 0.9 * shell.start)[0]
    for degrees in (1.0, 60.0, 180.0):
        energy = shell.gradient(
            'thick', turned(len(model.rest), shell.start, np.radians(degrees))
        )[0]
        assert abs(energy) < 1e-12 * squeeze


def test_the_tangent_is_the_derivative_of_the_gradient_with_the_pressures_following(pressed):
    shell = pressed.shell
    rng = np.random.default_rng(4)
    own = len(pressed.rest) + len(shell.sheared) + len(shell.stamps)

    def settled(unknowns):
        for _ in range(6):
            unknowns = shell.settled(unknowns)
        return unknowns

    at = shell.start.copy()
    at[:own] += 1e-6 * rng.normal(size=(own, 3))
    at.reshape(-1)[shell.idle_dofs] = 0.0
    at = settled(at)
    direction = np.zeros_like(at)
    direction[:own] = rng.normal(size=(own, 3))
    direction.reshape(-1)[shell.idle_dofs] = 0.0
    step = 1e-9
    above = shell.gradient('thick', settled(at + step * direction))[1]
    below = shell.gradient('thick', settled(at - step * direction))[1]
    _, gradient, values = shell.tangent('thick', at)
    expected = (shell.pattern.matrix(values) @ direction.reshape(-1)).reshape(-1, 3)
    assert_allclose((above - below) / (2 * step), expected, atol=1e-7 * np.abs(expected).max())
    assert_allclose(gradient, shell.gradient('thick', at)[1], atol=1e-15)


def test_a_thin_wall_under_a_smooth_load_is_koiters(ball):
    mesh = build_model(ball, control_vertices=150).shell.mesh
    thin = RADIUS / 1000.0
    material = Material(1e6, 0.3)
    wall = thick_shell(mesh, material, thin, everywhere=True)
    plain = discretise(mesh, material, thin)
    rng = np.random.default_rng(3)
    n = len(mesh.vertices)
    motion = 1e-7 * rng.normal(size=(n, 3))
    at = wall.start.copy()
    at[:n] += motion
    ours = wall.gradient('thick', at)[0]
    assert ours == pytest.approx(plain.energy('koiter', mesh.vertices + motion), rel=1e-3)


def test_the_ball_under_a_pin_is_as_stiff_as_the_solid(ball):
    model = build_model(ball, 'thick')
    contacts = object_contacts(ball, model, 1e-3)
    solver = EquilibriumSolver(model)
    state = solver.rest()
    for travel, force in SOLID.items():
        state = solver.solve(displaced(contacts, [travel, travel]), state)
        assert state.converged
        assert state.force == pytest.approx([force, force], rel=0.022)


def test_a_dent_that_outgrows_the_shear_around_its_pins_gets_more_of_it(ball, squeezed):
    model, state = squeezed
    shell = model.shell
    assert shell.widened(3.9 * THICKNESS) is shell
    wider = shell.widened(4.1 * THICKNESS)
    assert set(shell.sheared) < set(wider.sheared)
    assert wider.widened(4.1 * THICKNESS) is wider
    solver = EquilibriumSolver(model)
    deep = solver.solve(displaced(object_contacts(ball, model, 1e-3), [10.3e-3] * 2), state)
    assert deep.converged
    assert_allclose(solver.model.shell.sheared, wider.sheared)
    assert len(deep.unknowns) == len(wider.start)


def test_force_and_travel_control_find_the_same_state(ball, model, squeezed):
    _, state = squeezed
    solver = EquilibriumSolver(model)
    again = solver.solve(forced(object_contacts(ball, model, 1e-3), state.force.tolist()))
    assert again.converged
    # Under forces the free body lies elsewhere: what counts is how far the pins came together.
    assert again.displacement.sum() == pytest.approx(6e-3, rel=1e-6)
    shift = (again.positions - state.positions).mean(axis=0)
    assert_allclose(again.positions - shift, state.positions, atol=1e-8)


def test_the_points_under_a_pin_move_alike_and_carry_its_force(squeezed):
    model, state = squeezed
    shell = model.shell
    states = shell.point_states(state.unknowns, shell.pressed.point)
    height, push = states[:, 2], states[:, 4]
    weight = shell.weights[shell.pressed.point]
    for cell in range(shell.pressed.cell.max() + 1):
        own = shell.pressed.cell == cell
        gives_way = EXTRA_COMPLIANCE * THICKNESS / 1e6 * push[own][0] * weight[own].sum()
        assert weight[own] @ height[own] == pytest.approx(gives_way, rel=1e-3)
    for k in range(2):
        own = shell.pressed.stamp == k
        assert weight[own] @ push[own] == pytest.approx(state.force[k], rel=1e-9)


def test_the_served_outer_face_lies_on_the_pin_and_half_a_wall_out_far_from_it(squeezed):
    model, state = squeezed
    stamp = model.shell.stamps[0]
    before, after = model.shell.outer_face(model.start), model.shell.outer_face(state.unknowns)
    under = np.argmin(np.linalg.norm(model.rest - stamp.centre, axis=1))
    far = np.argmin(np.abs(model.rest[:, 0]))
    assert (after - before)[under] @ stamp.axis == pytest.approx(3e-3, abs=0.03e-3)
    middle = model.surface.limit_positions(state.positions)
    assert np.linalg.norm(after - middle, axis=1)[far] == pytest.approx(0.5 * THICKNESS, rel=0.01)


def test_an_incompressible_wall_is_run_as_one_of_nu_0_4999(ball):
    energies = []
    for poisson in (0.4999, 0.5):
        shell = build_model(
            with_material(ball, poisson_ratio=poisson), 'thick', control_vertices=60
        ).shell
        energies.append(shell.gradient('thick', 0.99 * shell.start)[0])
    assert energies[1] == energies[0]


def test_a_pin_within_an_element_or_two_of_a_coarse_mesh_keeps_its_direction(model):
    rng = np.random.default_rng(0)
    steady = 0
    for _ in range(6):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        pins = tuple(model.contact(side * RADIUS * axis, 1e-3) for side in (1.0, -1.0))
        solver = EquilibriumSolver(model)
        state = solver.solve(displaced(pins, [1e-4, 1e-4]))
        shell = model.on_contacts(pins).shell
        steady += int(np.count_nonzero(~shell.pressed.tilts))
        tilts = state.wall[len(shell.sheared) : len(shell.sheared) + 2, 1:]
        assert state.converged
        assert state.iterations <= 6
        # Two tilts times the radius: none turns the pin by more than its travel does.
        assert np.abs(tilts).max() < 1e-4
    assert steady > 0


def test_a_wall_that_reaches_its_centre_of_curvature_is_refused():
    mesh = build_model(load_object('tennis_ball'), control_vertices=60).shell.mesh
    with pytest.raises(WallError, match='reaches beyond its centre of curvature'):
        thick_shell(mesh, Material(1e6, 0.49), 70e-3)


def test_a_pin_smaller_than_the_mesh_can_see_is_split_for_and_two_on_one_triangle_refused(ball):
    model = build_model(ball, 'thick', control_vertices=60)
    at = object_contacts(ball, model, 1e-3)[0].point
    beside = model.surface.closest_point(model.rest, (at + [0.0, 1e-3, 0.0])[None]).position[0]
    axis = np.array([-1.0, 0.0, 0.0])
    shell = model.shell.with_stamps([Stamp(at, axis, 0.2e-3)])
    assert len(shell.pressed.point) >= 3
    with pytest.raises(WallError, match='two pins press on one triangle'):
        model.shell.with_stamps([Stamp(at, axis, 0.3e-3), Stamp(beside, axis, 0.3e-3)])


def test_auto_takes_the_thick_wall_for_the_ball_and_koiters_for_the_can():
    assert build_model(load_object('tennis_ball'), 'auto', control_vertices=100).theory == 'thick'
    can = build_model(load_object('half_soda_can'), 'auto', control_vertices=200)
    assert can.theory == 'koiter'


def test_auto_takes_koiters_where_a_grip_holds_the_wall_and_says_so(tmp_path):
    path = tmp_path / 'tube.yaml'
    path.write_text(
        'name: tube\nsurface: {cylinder: {outer_diameter_m: 0.05, length_m: 0.1, ends: open}}\n'
        'thickness_m: 0.002\nyoung_modulus_pa: 1.0e+6\npoisson_ratio: 0.45\n'
        'contacts: [{kind: grip, where: lower}, {kind: grip, where: upper}]\n'
    )
    model = build_model(load_object(path), 'auto', control_vertices=60)
    assert model.theory == 'koiter'
    assert 'but more than pins press on it' in model.reason


def test_the_stresses_of_a_sphere_under_pressure_are_those_of_a_thick_wall(ball):
    rubber = with_material(ball, poisson_ratio=0.4999)
    model = build_model(rubber, 'thick', control_vertices=100)
    grown = 1.02 * model.start
    found = read_out(model, grown)
    stretch = 1.02
    # Equal in-plane stretches at every height up to the change of thickness: the middle one.
    assert_allclose(found.membrane_strain[:, :2], 0.5 * (stretch**2 - 1.0), rtol=5e-3)
    shear = 1e6 / 3.0
    expected = shear * (stretch**2 - stretch**-4)
    mean = 0.5 * (found.outer_stress + found.inner_stress)[:, :2].mean()
    assert mean == pytest.approx(expected, rel=0.01)
    assert found.outer_stress[:, 0].mean() < found.inner_stress[:, 0].mean()


def test_unknowns_of_another_discretisation_are_refused_instead_of_read_beyond(pressed):
    for ask in (pressed.shell.gradient, pressed.shell.tangent):
        with pytest.raises(ValueError, match='unknowns for a thick shell that has'):
            ask('thick', pressed.rest)


def test_a_rigid_motion_takes_the_pins_along_and_strains_nothing(ball, model):
    # Pins that press past the middle are levered by a turn.
    aside = [
        replace(
            pin, axis=(pin.axis + [0.3, 0.2, 0.1]) / np.linalg.norm(pin.axis + [0.3, 0.2, 0.1])
        )
        for pin in object_contacts(ball, model, 1e-3)
    ]
    pressed = model.on_contacts(aside)
    motions = pressed.free_modes
    stiff = pressed.rest_tangent.stiffness @ motions
    any_motion = np.random.default_rng(72).standard_normal(motions.shape)
    scale = np.abs(pressed.rest_tangent.stiffness @ any_motion).max()
    assert np.abs(stiff).max() < 1e-6 * scale
