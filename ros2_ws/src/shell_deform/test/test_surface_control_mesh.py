# SPDX-License-Identifier: Apache-2.0
"""A control mesh is checked once and names what is wrong with it."""

import numpy as np
import pytest
import surface_shapes as shapes

from shell_deform.surface import MeshError, control_mesh, moved

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def test_three_triangles_at_one_edge_are_refused_by_name():
    points = np.vstack([SQUARE, [[0.5, 0.5, 1.0]]])
    with pytest.raises(MeshError, match=r'edge \(0, 2\) belongs to 3 triangles \[0, 1, 2\]'):
        control_mesh(points, [[0, 1, 2], [0, 2, 3], [0, 2, 4]])


def test_a_reversed_triangle_is_refused_by_name():
    with pytest.raises(MeshError, match='triangles 0 and 1 both run from vertex 2 to 0'):
        control_mesh(SQUARE, [[0, 1, 2], [3, 2, 0]])


def test_a_flat_triangle_is_refused_by_name():
    points = np.vstack([SQUARE[:2], [[2.0, 0, 0]]])
    with pytest.raises(MeshError, match=r'triangle 0 \[0, 1, 2\] is degenerate'):
        control_mesh(points, [[0, 1, 2]])


def test_two_pieces_are_refused():
    with pytest.raises(MeshError, match='2 separate pieces'):
        control_mesh(np.vstack([SQUARE, SQUARE + 5]), [[0, 1, 2], [4, 5, 6], [0, 2, 3], [4, 6, 7]])


def test_two_fans_that_meet_in_a_point_are_refused_by_name():
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [3, 3, 3.0]]
    faces = [[0, 1, 2], [0, 3, 4], [1, 5, 2], [3, 5, 4]]
    with pytest.raises(MeshError, match=r'vertex [05] joins 2 fans'):
        control_mesh(points, faces)


@pytest.mark.parametrize(
    ('points', 'faces', 'message'),
    [
        (SQUARE, [[0, 1, 2], [0, 2, 4]], r'triangle 1 \[0, 2, 4\] names a vertex outside 0..3'),
        (SQUARE, [[0, 1, 1], [0, 2, 3]], r'triangle 0 \[0, 1, 1\] names a vertex twice'),
        (SQUARE, [[0, 1, 2]], 'vertex 3 belongs to no triangle'),
        (SQUARE * [[np.nan]], [[0, 1, 2], [0, 2, 3]], 'vertex 0 is not finite'),
        (SQUARE[:, :2], [[0, 1, 2], [0, 2, 3]], r'shape \(4, 2\)'),
        (SQUARE, [[0.0, 1, 2], [0, 2, 3]], 'integers are needed'),
    ],
)
def test_malformed_arrays_are_refused(points, faces, message):
    with pytest.raises(MeshError, match=message):
        control_mesh(points, faces)


def test_a_crease_that_is_no_edge_is_refused_by_name():
    with pytest.raises(MeshError, match=r'crease edge \(1, 3\) is no edge'):
        control_mesh(SQUARE, [[0, 1, 2], [0, 2, 3]], crease_edges=[(1, 3)])


def test_an_interior_vertex_cannot_be_a_corner():
    mesh = shapes.sphere(1)
    with pytest.raises(MeshError, match='corner 5 lies neither on the boundary nor on a crease'):
        control_mesh(mesh.vertices, mesh.triangles, corners=[5])


def test_arrays_cannot_be_changed():
    mesh = shapes.sphere(1)
    with pytest.raises(ValueError, match='read-only'):
        mesh.vertices[0] = 0.0
    with pytest.raises(ValueError, match='read-only'):
        mesh.triangles[0] = 0


def test_the_callers_arrays_stay_free():
    points = SQUARE.copy()
    mesh = control_mesh(points, [[0, 1, 2], [0, 2, 3]])
    points[0] = 7.0
    assert mesh.vertices[0].tolist() == [0.0, 0.0, 0.0]


def test_corners_are_where_the_boundary_turns():
    points, faces = shapes.grid_arrays(4, 3)
    assert control_mesh(points, faces).corners.tolist() == [0, 3, 16, 19]
    assert len(control_mesh(points, faces, corners=[]).corners) == 0
    assert control_mesh(points, faces, corners=[3]).corners.tolist() == [3]


def test_closed_and_open_meshes_know_their_boundary():
    assert shapes.sphere(1).is_closed
    points, faces = shapes.grid_arrays(4, 3)
    mesh = control_mesh(points, faces)
    assert not mesh.is_closed
    assert len(mesh.boundary_edges) == 14
    assert sorted(mesh.boundary_vertices.tolist()) == sorted(np.unique(mesh.boundary_edges))


def test_valences_of_a_subdivided_icosahedron():
    mesh = shapes.sphere(2)
    assert sorted(np.unique(mesh.valence).tolist()) == [5, 6]
    assert (mesh.valence == 5).sum() == 12
    assert len(mesh.irregular_vertices) == 12
    assert len(mesh.neighbours(0)) == 5


def test_moved_keeps_topology_and_checks_the_points():
    mesh = shapes.sphere(1)
    assert moved(mesh, 2 * mesh.vertices).triangles is mesh.triangles
    with pytest.raises(MeshError, match='shape'):
        moved(mesh, mesh.vertices[:5])
