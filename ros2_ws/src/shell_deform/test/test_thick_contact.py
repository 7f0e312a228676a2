# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies on the outer face of a thick wall: the face, its derivatives, forces, friction."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shell_deform.assemble.thick import thick_shell
from shell_deform.building import build_model, object_contacts
from shell_deform.contact.bodies import ball as body_ball
from shell_deform.contact.thick_face import thick_face
from shell_deform.objects import ShellObject, load_object
from shell_deform.objects.shell_object import Contact, Cylinder, Sphere, Support
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.material import Material

RADIUS, THICKNESS = 31.25e-3, 2.5e-3
OUTER = RADIUS + 0.5 * THICKNESS


@pytest.fixture(scope='module')
def shell():
    mesh = build_model(load_object('tennis_ball'), control_vertices=100).shell.mesh
    return thick_shell(mesh, Material(1e6, 0.49), THICKNESS, everywhere=True)


@pytest.fixture(scope='module')
def face(shell):
    return thick_face(shell)


def disturbed(shell, seed=1):
    rng = np.random.default_rng(seed)
    n = len(shell.mesh.vertices)
    motion = np.zeros_like(shell.start)
    motion[:n] = rng.normal(size=(n, 3))
    motion[n:, :2] = rng.normal(size=(len(motion) - n, 2))
    return motion


def test_the_undeformed_face_lies_half_a_wall_outside_the_middle_surface(shell, face):
    middle = face.points.value_matrix() @ shell.mesh.vertices
    away = np.linalg.norm(face.positions(shell.start) - middle, axis=1)
    assert_allclose(away, 0.5 * THICKNESS, rtol=1e-9)


def test_a_stretched_wall_is_thinner_and_its_face_nearer(shell, face):
    """Blown up by 10 %, an incompressible wall keeps its volume."""
    state = shell.start.copy()
    n = len(shell.mesh.vertices)
    state[:n] *= 1.1
    middle = face.points.value_matrix() @ state[:n]
    away = np.linalg.norm(face.positions(state) - middle, axis=1)
    assert_allclose(away, 0.5 * THICKNESS / 1.21, rtol=2e-2)


def test_the_derivative_of_the_face_is_that_of_its_places(shell, face):
    state = shell.start + 1e-4 * disturbed(shell)
    direction, step = disturbed(shell, 2), 1e-8
    at = np.array([3, 100, 500, 700])
    above, below = (face.positions(state + s * direction)[at] for s in (step, -step))
    fields = (face._fields(at) @ direction.ravel()).reshape(len(at), -1)
    found = np.einsum('pif,pf->pi', face.at(state, at).change, fields)
    assert_allclose(found, (above - below) / (2 * step), atol=1e-7 * np.abs(found).max())


def test_the_stiffness_of_a_traction_is_the_derivative_of_its_nodal_forces(shell, face):
    state = shell.start + 1e-4 * disturbed(shell)
    direction, step = disturbed(shell, 2), 1e-8
    at = np.array([3, 100, 500, 700])
    force = np.random.default_rng(3).normal(size=(len(at), 3))
    above, below = (face.forces(face.at(state + s * direction, at), force) for s in (step, -step))
    data = np.zeros(len(shell.pattern.indices))
    points = face.at(state, at)
    face.add(points, face.blocks(points, np.zeros((len(at), 3, 3)), force), data)
    found = -(shell.pattern.matrix(data) @ direction.ravel()).reshape(-1, 3)
    assert_allclose(found, (above - below) / (2 * step), atol=1e-6 * np.abs(found).max())


def open_tube(length=0.06, wall=2e-3, young=2e9):
    described = ShellObject(
        'tube', Cylinder(2 * RADIUS + wall, length, 'open'), wall, young, 0.3,
        supports=(Support('hinged', 'lower'),),
        contacts=(Contact((0.0, 0.0, 0.1), 0.05, 'plate', towards=(0.0, 0.0, -1.0)),),
    )  # fmt: skip
    model = build_model(described, 'thick', control_vertices=300)
    return model, object_contacts(described, model), young * 2 * np.pi * RADIUS * wall / length


def test_a_plate_on_the_edge_of_an_open_thick_wall_feels_it_along_its_axis():
    model, plates, stiffness = open_tube()
    state = EquilibriumSolver(model).solve(displaced(plates, [5e-5]))
    assert state.converged, state.message
    assert state.force[0] == pytest.approx(stiffness * 5e-5, rel=0.02)


def test_the_end_of_a_thick_wall_has_the_derivatives_of_its_place():
    model, _, _ = open_tube()
    shell, face = model.shell, model.outer_face
    state = shell.start + 1e-4 * disturbed(shell)
    direction, step = disturbed(shell, 2), 1e-8
    at = np.arange(len(face.element))[-5:]
    assert_allclose(face.positions(state)[at], face.ends[-5:] @ state[: len(shell.mesh.vertices)])
    above, below = (face.positions(state + s * direction)[at] for s in (step, -step))
    moved = face.moved(face.at(state, at), direction)
    assert_allclose(moved, (above - below) / (2 * step), atol=1e-7 * np.abs(moved).max())


def squeezed(kind='pad', radius=0.8 * RADIUS, vertices=300):
    described = ShellObject(
        'ball', Sphere(2.0 * OUTER), THICKNESS, 1e6, 0.49,
        contacts=tuple(Contact((0.0, 0.0, z), radius, kind) for z in (OUTER, -OUTER)),
    )  # fmt: skip
    model = build_model(described, 'thick', control_vertices=vertices)
    return model, object_contacts(described, model)


def test_plates_press_on_the_deformed_outer_face_which_gives_way_by_its_half_wall():
    model, plates = squeezed()
    solver = EquilibriumSolver(model)
    state = solver.solve(displaced(plates, [1e-3, 1e-3]))
    assert state.converged, state.message
    assert state.force[0] == pytest.approx(state.force[1], rel=1e-3)
    height = np.abs(thick_face(solver.model.shell).positions(state.unknowns)[:, 2])
    sunk = height.max() - (OUTER - 1e-3)
    pressure = max(touch.pressure.max() for touch in state.touches)
    assert sunk == pytest.approx(pressure / solver.model.wall_stiffness.across[0], rel=0.1)
    assert sunk < 0.02 * THICKNESS
    assert np.abs(state.unbalance).max() < 1e-3 * state.force[0]


def test_force_and_depth_of_a_plate_say_the_same():
    model, plates = squeezed()
    by_depth = EquilibriumSolver(model).solve(displaced(plates, [0.5e-3, 0.5e-3]))
    by_force = EquilibriumSolver(model).solve(forced(plates, by_depth.force.tolist()))
    assert by_force.converged, by_force.message
    assert by_force.displacement.sum() == pytest.approx(1e-3, rel=1e-3)


def test_a_pin_holds_what_a_ball_presses():
    """Pins and bodies in one load case: forces balance, and each keeps its own travel."""
    model, plates = squeezed()
    pin = model.contact(np.array([0.0, 0.0, OUTER]), 2e-3)
    tip = model.touched_by(body_ball(8e-3), np.array([0.0, 0.0, -OUTER]), 8e-3)
    state = EquilibriumSolver(model).solve(displaced((pin, tip), [1e-3, 1e-3]))
    assert state.converged, state.message
    assert state.displacement == pytest.approx([1e-3, 1e-3], abs=1e-8)
    assert state.force[0] == pytest.approx(state.force[1], rel=1e-3)


def test_a_rubbing_tip_is_held_back_by_the_friction_of_its_force():
    """Moved far along the face, a ball carries its coefficient times its push."""
    model, _ = squeezed()
    tips = tuple(
        model.touched_by(body_ball(8e-3), np.array([0.0, 0.0, z]), 8e-3, friction=0.2)
        for z in (OUTER, -OUTER)
    )
    solver = EquilibriumSolver(model)
    state = solver.solve(displaced(tips, [1e-3, 1e-3]))
    assert state.converged, state.message
    for touch in state.touches:
        along = touch.traction - np.einsum('pi,pi->p', touch.traction, _normals(touch))[
            :, None
        ] * _normals(touch)
        assert np.all(np.linalg.norm(along, axis=1) <= 0.2 * touch.pressure * (1.0 + 1e-6))


def _normals(touch):
    """(p, 3) unit normals of a pressed ball's surface."""
    centre = touch.pose.outside(np.array([[0.0, 0.0, -8e-3]]))[0]
    away = touch.face.position - centre
    return away / np.linalg.norm(away, axis=1)[:, None]
