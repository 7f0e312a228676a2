# SPDX-License-Identifier: Apache-2.0
"""Pads on every kind of surface: triangles fit the place, depth counts from first touch."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from shell_deform.building import build_model, object_contacts
from shell_deform.objects import ObjectError
from shell_deform.objects.local_radius import local_radius
from shell_deform.objects.object_mesh import middle_surface, object_fit_report, object_mesh
from shell_deform.objects.shell_object import (
    Cone,
    Contact,
    Cylinder,
    Ellipsoid,
    Gas,
    HeightField,
    MeshFile,
    Revolution,
    ShellObject,
    Sphere,
)
from shell_deform.readout import mesh_warning, read_out
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.first_touch import first_touch
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.squeeze import warnings_of
from shell_deform.surface.control_mesh import moved

WIDE, LONG, SHELL = 22e-3, 28.5e-3, 0.36e-3
ENDS = ((0.0, 0.0, LONG), (0.0, 0.0, -LONG))
SIDES = ((WIDE, 0.0, 0.0), (-WIDE, 0.0, 0.0))


def egg(kind, folder, places):
    if kind == 'ellipsoid':
        surface = Ellipsoid((2 * WIDE, 2 * WIDE, 2 * LONG))
    elif kind == 'revolution':
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 81)
        profile = np.column_stack([WIDE * np.cos(angle), LONG * np.sin(angle)])
        profile[[0, -1], 0] = 0.0
        surface = Revolution(tuple(map(tuple, profile.tolist())))
    else:
        ball = trimesh.creation.icosphere(5)
        file = folder / 'egg.ply'
        trimesh.Trimesh(1e3 * ball.vertices * [WIDE, WIDE, LONG], ball.faces).export(file)
        surface = MeshFile(file, 'mm', 'outer')
    contacts = tuple(Contact(at, 12e-3, 'pad') for at in places)
    return ShellObject('egg', surface, SHELL, 32e9, 0.3, contacts=contacts)


def depths(shell_object, forces, **mesh):
    model = build_model(shell_object, **mesh)
    contacts = object_contacts(shell_object, model)
    solver = EquilibriumSolver(model)
    cases = [forced(contacts, [force, force]) for force in forces]
    states = solver.sweep(cases)
    assert all(state.converged for state in states)
    touch = first_touch(solver, contacts)[1]
    return np.array([state.displacement.sum() - touch.sum() for state in states])


@pytest.fixture(scope='module')
def fine(places):
    """What an egg of formulas on a fine mesh gives way at two forces (m)."""
    shell_object = egg('ellipsoid', Path(), places)
    return depths(shell_object, [15.0, 45.0], control_vertices=2500, refine_radius=3e-4)


@pytest.mark.parametrize('places', [ENDS, SIDES], ids=['end-on', 'sideways'], scope='module')
@pytest.mark.parametrize('kind', ['revolution', 'mesh'])
def test_an_egg_is_as_stiff_however_it_is_described(kind, places, fine, tmp_path):
    np.testing.assert_allclose(depths(egg(kind, tmp_path, places), [15.0, 45.0]), fine, rtol=0.03)


@pytest.mark.parametrize('kind', ['revolution', 'mesh'])
def test_triangles_are_as_small_around_a_pad_as_under_it_however_it_is_described(kind, tmp_path):
    """A wall so thick that drawing vertices together reaches the wanted edge at one place."""
    thick = replace(egg(kind, tmp_path, SIDES), thickness_m=1e-3)
    mesh = object_mesh(thick, 400)
    ends = mesh.vertices[mesh.edges]
    bending = np.sqrt(WIDE * thick.thickness_m)
    near = np.linalg.norm(ends.mean(axis=1) - SIDES[0], axis=1) < 0.7 * bending
    edges = np.linalg.norm(ends[near, 0] - ends[near, 1], axis=1)
    assert edges.mean() < 0.3 * bending


def test_the_radius_of_a_place_is_its_smallest_one(tmp_path):
    end, side = WIDE**2 / LONG, WIDE
    for kind in ('ellipsoid', 'revolution', 'mesh'):
        middle = middle_surface(egg(kind, tmp_path, ()))
        for place, radius in ((ENDS[0], end), (SIDES[0], side)):
            found = local_radius(middle, np.array(place), 2e-3)
            np.testing.assert_allclose(found, radius - 0.5 * SHELL, rtol=0.05)


def test_a_plane_is_round_nowhere(tmp_path):
    np.save(tmp_path / 'flat.npy', np.zeros((9, 9)))
    plate = ShellObject('plate', HeightField(tmp_path / 'flat.npy', 0.01), 1e-3, 1e9, 0.3)
    assert local_radius(middle_surface(plate), np.zeros(3), 5e-3) > 1e3


@pytest.mark.parametrize('at', [(0.0, 0.0175, 0.0), (0.0175, 0.0, 0.01)])
def test_triangles_under_a_pad_are_small_also_where_drawing_them_together_cannot_reach(at):
    tube = ShellObject(
        'tube', Cylinder(0.035, 0.1, 'open'), 1e-4, 1e9, 0.3, contacts=(Contact(at, 0.01, 'pad'),)
    )
    mesh = object_mesh(tube)
    ends = mesh.vertices[mesh.edges]
    near = np.linalg.norm(ends.mean(axis=1) - at, axis=1) < 1e-3
    wanted = 0.25 * np.sqrt(0.0175 * 1e-4)
    assert np.linalg.norm(ends[near, 0] - ends[near, 1], axis=1).max() < 1.5 * wanted


@pytest.mark.parametrize('kind', ['pin', 'pad'])
def test_a_contact_off_the_object_is_refused_by_number(kind):
    ball = ShellObject(
        'ball', Sphere(0.06), 2e-3, 1e6, 0.4,
        contacts=(Contact((0, 0, 0.03), 2e-3, kind), Contact((0, 0, -0.3), 2e-3, kind)),
    )  # fmt: skip
    with pytest.raises(ObjectError, match=r'contact 2, at_m \[0, 0, -0.3\], is 0.27 m away'):
        object_contacts(ball, build_model(ball))


@pytest.mark.parametrize('kind', ['pin', 'pad'])
def test_depth_counts_from_the_first_touch_of_a_blown_up_ball(kind):
    ball = ShellObject(
        'ball', Sphere(0.06), 3.5e-3, 19e6, 0.49, gas=Gas('sealed', 83e3),
        contacts=tuple(Contact((0, 0, z), 4e-3, kind) for z in (0.03, -0.03)),
    )  # fmt: skip
    model = build_model(ball)
    contacts = object_contacts(ball, model)
    solver = EquilibriumSolver(model)
    alone, touch = first_touch(solver, contacts)
    assert np.all(touch < -0.1e-3)
    resting = solver.solve(displaced(contacts, touch), alone)
    np.testing.assert_allclose(resting.force, 0.0, atol=1e-6)
    pressed = solver.solve(displaced(contacts, touch + 1e-5), resting)
    assert np.all(pressed.force > 0.01)


def test_energy_is_that_of_strain_and_gas_however_pads_are_driven():
    ball = ShellObject(
        'ball', Sphere(0.0402), 4e-4, 2.2e9, 0.35,
        contacts=tuple(Contact((0, 0, z), 0.012, 'pad') for z in (0.0201, -0.0201)),
    )  # fmt: skip
    model = build_model(ball)
    contacts = object_contacts(ball, model)
    solver = EquilibriumSolver(model)
    by_depth = solver.solve(displaced(contacts, [2e-4, 2e-4]))
    by_force = solver.solve(forced(contacts, by_depth.force))
    np.testing.assert_allclose(by_force.energy, by_depth.energy, rtol=1e-4)
    np.testing.assert_allclose(
        by_depth.energy, model.shell.energy('koiter', by_depth.positions), rtol=1e-9
    )


def test_fine_pins_on_few_vertices_make_no_long_triangles():
    """Large triangles beside small ones slide into none, and the rim is divided with them."""
    cup = ShellObject(
        'cup', Cone((0.052, 0.07), 0.09), 4e-4, 1.3e9, 0.4,
        contacts=tuple(Contact((x, 0.0, 0.02), 1e-3, 'pin') for x in (0.0325, -0.0325)),
    )  # fmt: skip
    mesh = object_mesh(cup, 150)
    assert mesh_warning(mesh) is None
    report = object_fit_report(cup, mesh)
    assert report.rms_error_m < 0.1 * cup.thickness_m


def test_a_mesh_of_long_triangles_is_told_with_the_way_out():
    ball = object_mesh(ShellObject('ball', Sphere(0.06), 2e-3, 1e6, 0.4), 60)
    told = mesh_warning(moved(ball, ball.vertices * [1.0, 1.0, 6.0]))
    assert told is not None
    assert 'take more control vertices (control_vertices, --vertices)' in told


def test_a_patch_of_few_quadrature_points_is_told():
    ball = ShellObject(
        'ball', Sphere(0.06), 2e-3, 1e6, 0.4,
        contacts=tuple(Contact((0, 0, z), 0.02, 'pad') for z in (0.03, -0.03)),
    )  # fmt: skip
    model = build_model(ball)
    solver = EquilibriumSolver(model)
    contacts = object_contacts(ball, model)
    told = []
    for depth in (5e-5, 2e-3):
        state = solver.solve(displaced(contacts, [depth, depth]))
        told.append(
            [
                w
                for w in warnings_of(model, state, read_out(model, state.positions))
                if 'patch' in w
            ]
        )
        assert len(told[-1]) == (min(state.pressed_points) < 10)
    assert 'quadrature points, fewer than 10' in told[0][0]
    # A hundredth of the forces times the body is what two pushes may be out of line by.
    allowed = 0.01 * 0.06 * float(np.abs(state.force).sum())
    for share, count in ((0.8, 0), (1.2, 1)):
        tilted = replace(state, unbalance=np.array([0, 0, 0, 0, share * allowed, 0]))
        said = warnings_of(model, tilted, read_out(model, state.positions))
        assert sum('not in line' in one for one in said) == count
    assert not told[1]
