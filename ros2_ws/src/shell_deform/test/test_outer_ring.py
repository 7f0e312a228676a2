# SPDX-License-Identifier: Apache-2.0
"""The ring of control points beyond the edge of an open surface."""

import numpy as np
import pytest
from surface_shapes import fan, grid_arrays, sphere

from shell_deform.building import build_model, object_contacts
from shell_deform.objects import load_object, object_mesh
from shell_deform.solve.equilibrium import forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.surface.control_mesh import MeshError, control_mesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import basis_rows, quadrature_basis
from shell_deform.surface.outer_ring import extended, with_outer_ring


def tube(around, rows):
    """An open tube whose edge vertices all have three triangles."""
    i, j = np.meshgrid(np.arange(around), np.arange(rows + 1), indexing='ij')
    angle = 2 * np.pi * (i + 0.5 * j) / around
    points = np.stack([np.cos(angle), np.sin(angle), 0.5 * j], -1).reshape(-1, 3)
    number = i * (rows + 1) + j
    right = np.roll(number, -1, axis=0)
    a, b, c, d = number[:, :-1], right[:, :-1], right[:, 1:], number[:, 1:]
    faces = [np.stack([a, b, d], -1), np.stack([b, c, d], -1)]
    return control_mesh(points, np.concatenate([f.reshape(-1, 3) for f in faces]))


def points_of(mesh, triangles):
    places = np.array([[0.2, 0.1], [0.0, 0.5], [0.5, 0.5], [0.6, 0.0]])
    there = basis_rows(mesh, np.repeat(triangles, 4), np.tile(places, (len(triangles), 1)))
    values = np.zeros((4 * len(triangles), 3))
    row = np.repeat(np.arange(len(values)), np.diff(there.node_offsets))
    np.add.at(values, row, there.values[:, None] * mesh.vertices[there.nodes])
    return values


def test_the_ring_leaves_the_surface_exactly_where_it_was():
    mesh = tube(12, 5)
    ringed = with_outer_ring(mesh)
    every = np.arange(mesh.triangle_count)
    np.testing.assert_allclose(points_of(ringed, every), points_of(mesh, every), atol=1e-14)
    np.testing.assert_array_equal(ringed.vertices[: mesh.vertex_count], mesh.vertices)
    np.testing.assert_array_equal(ringed.triangles[ringed.active], mesh.triangles)
    assert not ringed.is_closed


@pytest.mark.parametrize('open_mesh', [tube(9, 4), control_mesh(*grid_arrays(6, 4, 0.1)), fan(7)])
def test_edge_vertices_get_six_neighbours(open_mesh):
    ringed = with_outer_ring(open_mesh)
    np.testing.assert_array_equal(ringed.valence[open_mesh.boundary_vertices], 6)
    basis = quadrature_basis(ringed, 3)
    assert set(basis.triangle.tolist()) == set(range(open_mesh.triangle_count))


def test_a_closed_mesh_has_no_ring():
    ball = sphere(1)
    assert with_outer_ring(ball) is ball


def test_a_crease_that_meets_the_edge_is_refused():
    points, faces = grid_arrays(4, 4)
    mesh = control_mesh(points, faces, [[2, 7], [7, 12]])
    with pytest.raises(MeshError, match='a crease meets the edge of the surface at vertex 2'):
        with_outer_ring(mesh)


def test_vertices_beyond_the_edge_are_shown_at_it_and_can_be_recovered():
    mesh = with_outer_ring(tube(12, 5))
    surface = LimitSurface(mesh)
    shown = surface.limit_positions(mesh.vertices)
    assert shown[:, 2].max() < 2.5 + 0.06 and shown[:, 2].min() > -0.06
    np.testing.assert_allclose(surface.control_points(shown), mesh.vertices, atol=1e-12)


def test_a_wall_per_vertex_goes_on_beyond_the_edge():
    mesh = with_outer_ring(tube(12, 5))
    inside = int(mesh.triangles[mesh.active].max()) + 1
    wall = extended(mesh.vertices[:inside, 2], mesh)
    assert len(wall) == mesh.vertex_count
    assert set(wall[inside:].tolist()) == {0.0, 2.5}


def test_every_open_object_has_the_ring():
    mesh = object_mesh(load_object('half_soda_can'), 300)
    inside = int(mesh.triangles[mesh.active].max()) + 1
    assert inside < mesh.vertex_count
    assert not mesh.active[mesh.triangles.max(axis=1) >= inside].any()


def test_half_can_under_a_narrow_pin_yields_as_an_independent_shell_under_a_point():
    # Kratos, thin corotational quadrilaterals, quarter model of 24 x 24: 0.726 mm (linear).
    can = load_object('half_soda_can')
    model = build_model(can, 'linear', 2400, refine_radius=0.5e-3)
    state = EquilibriumSolver(model).solve(forced(object_contacts(can, model, 0.5e-3), [0.756]))
    assert state.displacement[0] == pytest.approx(0.726e-3, rel=7.5e-3)
