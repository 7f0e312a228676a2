# SPDX-License-Identifier: Apache-2.0
"""From an object to a shell model: supports where they are named, walls, gas, contacts."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform import building
from shell_deform.building import (
    boundary_vertices,
    build_model,
    model_on_mesh,
    object_contacts,
    with_material,
)
from shell_deform.objects import ObjectError, ShellObject, Support, load_object
from shell_deform.objects.shell_object import Cone, Contact, Cylinder, Sphere
from shell_deform.solve.equilibrium import forced
from shell_deform.solve.newton import EquilibriumSolver


def cup(**changes):
    values = {
        'name': 'cup',
        'surface': Cylinder(0.08, 0.1, 'open'),
        'thickness_m': 1e-3,
        'young_modulus_pa': 1e9,
        'poisson_ratio': 0.35,
        'contacts': tuple(Contact((x, 0.0, 0.0), 4e-3, 'pin') for x in (0.04, -0.04)),
        'control_vertices': 250,
        **changes,
    }
    return ShellObject(**values)


@pytest.mark.parametrize('name', ['tennis_ball', 'half_soda_can'])
def test_shipped_objects_become_models_that_can_be_pushed(name):
    shell_object = load_object(name)
    model = build_model(shell_object, control_vertices=300)
    contacts = object_contacts(shell_object, model)
    state = EquilibriumSolver(model).solve(forced(contacts, [1e-2] * len(contacts)))
    assert state.converged, state.message
    assert np.all(state.displacement > 0)


def test_clamped_end_leaves_no_rigid_motion_and_a_free_cup_leaves_six():
    fixed = cup(supports=(Support('clamped', 'lower'),))
    assert build_model(fixed).free_modes.shape[1] == 0
    assert build_model(cup()).free_modes.shape[1] == 6


def test_a_clamped_end_is_stiffer_than_a_diaphragm_and_both_than_none():
    stiffness = []
    for supports in ((), (Support('diaphragm', 'ends'),), (Support('clamped', 'ends'),)):
        shell_object = cup(supports=supports)
        model = build_model(shell_object)
        contacts = object_contacts(shell_object, model)
        state = EquilibriumSolver(model).solve(forced(contacts, [1e-3, 1e-3]))
        stiffness.append(1e-3 / state.displacement.mean())
    assert stiffness[0] < 0.5 * stiffness[1]
    assert stiffness[1] < stiffness[2]


def test_a_support_where_there_is_no_edge_is_refused_by_name():
    closed = ShellObject(
        'ball', Sphere(0.06), 2e-3, 1e6, 0.4, supports=(Support('clamped', 'boundary'),)
    )
    with pytest.raises(ObjectError, match='clamped'):
        build_model(closed, control_vertices=150)


def test_contacts_are_needed_before_pushing():
    bare = replace(cup(), contacts=())
    with pytest.raises(ObjectError, match='contacts'):
        object_contacts(bare, build_model(bare))


def test_thickness_of_every_vertex_enters_the_wall():
    plain = cup()
    mesh = build_model(plain).shell.mesh
    linear = 1e-3 * (1.0 + mesh.vertices[:, 2] / 0.1)
    varied = replace(plain, vertex_thickness_m=linear)
    shell = model_on_mesh(varied, mesh).shell
    height = shell.value_matrix() @ mesh.vertices[:, 2]
    np.testing.assert_allclose(shell.thickness, 1e-3 * (1.0 + height / 0.1), rtol=1e-9)


def test_other_numbers_replace_those_of_the_object():
    changed = with_material(load_object('tennis_ball'), 2e6, 0.3, 3e-3, 'none')
    assert (changed.young_modulus_pa, changed.poisson_ratio, changed.thickness_m) == (
        2e6,
        0.3,
        3e-3,
    )
    assert changed.gas.kind == 'none'
    same = load_object('tennis_ball')
    assert with_material(same).young_modulus_pa == same.young_modulus_pa


def test_rim_of_an_open_cylinder_is_its_two_ends_with_unit_directions_along_them():
    model = build_model(cup())
    rim, along = boundary_vertices(model.shell.mesh)
    height = model.surface.limit_positions(model.rest)[rim, 2]
    np.testing.assert_allclose(np.abs(height), np.abs(height).max(), rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0)
    assert np.abs(along[:, 2]).max() < 1e-6


def test_the_end_of_a_coarse_mesh_is_held_whole_though_it_is_not_flat():
    """A fine pin on a coarse cone: its circles wave by a millimetre, a hundredth of its length."""
    cone = ShellObject(
        'cone', Cone((0.06, 0.084), 0.1), 3e-3, 1e6, 0.3, control_vertices=200,
        contacts=(Contact((0.036, 0.0, 0.0), 1e-3, 'pin'),),
    )  # fmt: skip
    model = build_model(cone)
    rim, _ = boundary_vertices(model.shell.mesh)
    points = model.surface.limit_positions(model.rest)
    below = points[rim, 2] < 0.0
    assert np.ptp(points[rim[below], 2]) > 0.2e-3
    for where, held in (('lower', rim[below]), ('upper', rim[~below]), ('ends', rim)):
        found, _ = building._where(model.shell.mesh, points, rim, where)
        assert found.tolist() == held.tolist()


def test_a_plane_names_the_rim_on_its_own_side_of_the_origin():
    points = np.array([[0.0, 0.0, -0.05], [0.01, 0.0, -0.05], [0.0, 0.0, 0.05], [0.02, 0.0, 0.0]])
    rim = np.arange(4)
    mesh = build_model(cup()).shell.mesh
    found, normal = building._where(mesh, points, rim, 'z = 0.05')
    assert found.tolist() == [2]
    assert normal.tolist() == [0.0, 0.0, 1.0]
