# SPDX-License-Identifier: Apache-2.0
"""The basis functions of the limit surface, at any point of any triangle."""

import numpy as np
import pytest
import surface_shapes as shapes
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.surface import basis_rows, control_mesh, moved, quadrature_basis
from shell_deform.surface.limit import LimitSurface


def creased_grid():
    points, faces = shapes.grid_arrays(6, 5, noise=0.3)
    return control_mesh(points, faces, crease_edges=[(12 + i, 13 + i) for i in range(5)])


def dart_grid():
    points, faces = shapes.grid_arrays(6, 5, noise=0.3)
    return control_mesh(points, faces, crease_edges=[(14, 15), (15, 16)])


def open_grid(corners=None):
    points, faces = shapes.grid_arrays(5, 4, noise=0.3)
    return control_mesh(points, faces, corners=corners)


MESHES = {
    'icosphere': lambda: shapes.sphere(2),
    'icosahedron, three irregular corners': lambda: shapes.sphere(0),
    'tetrahedron, valence three': shapes.tetrahedron,
    'random ball, any valence': lambda: shapes.random_ball(60, 3),
    'torus': lambda: shapes.torus(8, 6),
    'grid with corners': open_grid,
    'grid without corners': lambda: open_grid([]),
    'crease from side to side': creased_grid,
    'crease that ends inside': dart_grid,
    'valence 3 disc': lambda: shapes.fan(3),
    'valence 9 disc': lambda: shapes.fan(9),
    'valence 15 disc': lambda: shapes.fan(15),
}


@pytest.fixture(params=MESHES, scope='module')
def mesh(request):
    return MESHES[request.param]()


def some_points(mesh, count=300, seed=1, inset=0.0):
    random = np.random.default_rng(seed)
    triangle = random.integers(0, mesh.triangle_count, count)
    parameters = random.dirichlet([1, 1, 1], count)[:, 1:]
    return triangle, inset / 3 + (1 - inset) * parameters


def sums(rows, weights):
    return np.add.reduceat(weights, rows.node_offsets[:-1], axis=0)


def test_weights_add_up_to_one_and_their_derivatives_to_zero(mesh):
    rows = basis_rows(mesh, *some_points(mesh))
    np.testing.assert_allclose(sums(rows, rows.values), 1.0, atol=1e-13)
    assert np.abs(sums(rows, rows.first)).max() < 1e-11
    assert np.abs(sums(rows, rows.second)).max() < 1e-9


def test_an_affine_map_of_the_control_points_is_one_of_the_surface(mesh):
    random = np.random.default_rng(5)
    matrix, shift = random.normal(size=(3, 3)), random.normal(size=3)
    surface, points = LimitSurface(mesh), some_points(mesh)
    plain = surface.evaluate(mesh.vertices, *points)
    mapped = surface.evaluate(mesh.vertices @ matrix.T + shift, *points)
    np.testing.assert_allclose(mapped.position, plain.position @ matrix.T + shift, atol=1e-12)
    np.testing.assert_allclose(
        mapped.first, np.einsum('ij,pjk->pik', matrix, plain.first), atol=1e-10
    )


def test_derivatives_agree_with_differences(mesh):
    triangle, parameters = some_points(mesh, inset=0.05)
    surface, step = LimitSurface(mesh), 1e-4
    # Differences hold only where no polynomial pieces meet between the two points.
    pieces = np.column_stack([parameters, 1 - parameters.sum(axis=1)])[:, :, None]
    seams = np.arange(1, 16) / 16
    clear = (np.abs(pieces - seams) > 4 * step).all(axis=(1, 2)) & (pieces > 1 / 16).all((1, 2))
    triangle, parameters = triangle[clear], parameters[clear]
    exact = surface.evaluate(mesh.vertices, triangle, parameters)

    def first(shift):
        return surface.evaluate(mesh.vertices, triangle, parameters + shift).first

    def position(shift):
        return surface.evaluate(mesh.vertices, triangle, parameters + shift).position

    for axis in range(2):
        shift = np.eye(2)[axis] * step
        slope = (position(shift) - position(-shift)) / (2 * step)
        np.testing.assert_allclose(exact.first[:, :, axis], slope, atol=2e-6)
        bend = (first(shift) - first(-shift)) / (2 * step)
        np.testing.assert_allclose(exact.second[:, :, axis], bend[:, :, 0], atol=5e-5)
        np.testing.assert_allclose(exact.second[:, :, axis + 1], bend[:, :, 1], atol=5e-5)


def test_repeated_subdivision_converges_to_the_same_surface(mesh):
    """The limit positions of a subdivided mesh are points of the surface of the coarse one."""
    fine = shapes.subdivided(shapes.subdivided(mesh))
    fine_surface, surface = LimitSurface(fine), LimitSurface(mesh)
    triangle = np.arange(fine.triangle_count)
    parameters = np.full((len(triangle), 2), 1 / 3)
    expected = fine_surface.evaluate(fine.vertices, triangle, parameters).position
    for level in (1, 2):
        piece = triangle // 4 ** (level - 1) % 4
        scale = np.array([0.5, 0.5, 0.5, -0.5])[piece][:, None]
        start = np.array([[0, 0], [0.5, 0], [0, 0.5], [0.5, 0.5]])[piece]
        parameters = start + scale * parameters
    found = surface.evaluate(mesh.vertices, triangle // 16, parameters).position
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_neighbours_share_position_and_tangent_plane_along_smooth_edges(mesh):
    half = np.flatnonzero(~mesh.sharp)
    along = np.random.default_rng(2).uniform(0.02, 0.98, len(half))

    def place(half_edge, share):
        corner = half_edge % 3
        start = np.array([[0, 0], [1, 0], [0, 1]])[corner]
        end = np.array([[1, 0], [0, 1], [0, 0]])[corner]
        return half_edge // 3, start + share[:, None] * (end - start)

    surface = LimitSurface(mesh)
    here = surface.evaluate(mesh.vertices, *place(half, along))
    there = surface.evaluate(mesh.vertices, *place(mesh.twins[half], 1 - along))
    np.testing.assert_allclose(here.position, there.position, atol=1e-12)
    np.testing.assert_allclose(here.normal, there.normal, atol=1e-9)
    # Away from irregular vertices the curvature is continuous too.
    special = np.zeros(mesh.vertex_count, dtype=bool)
    special[mesh.irregular_vertices] = True
    near = special[mesh.triangles].any(axis=1)
    plain = ~near[half // 3] & ~near[mesh.twins[half] // 3]
    mean, gauss = here.curvatures()
    other_mean, other_gauss = there.curvatures()
    np.testing.assert_allclose(mean[plain], other_mean[plain], atol=1e-8)
    np.testing.assert_allclose(gauss[plain], other_gauss[plain], atol=1e-8)


def test_normals_converge_at_an_irregular_vertex():
    for valence in (3, 4, 5, 7, 9, 12):
        mesh = shapes.fan(valence)
        surface = LimitSurface(mesh)
        at_vertex = surface.vertex_normals(mesh.vertices)[0]
        triangle = np.flatnonzero((mesh.triangles == 0).any(axis=1))
        error = []
        for distance in 0.5 ** np.array([3, 6, 9, 12, 30]):
            parameters = np.full((len(triangle), 2), 0.5 * distance)
            normals = surface.evaluate(mesh.vertices, triangle, parameters).normal
            error.append(np.abs(normals - at_vertex).max())
        assert error[3] < 0.2 * error[0]
        assert error[-1] < 2e-3, (valence, error)


@given(
    coefficients=st.lists(st.floats(-2, 2), min_size=6, max_size=6),
    place=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
@settings(max_examples=25, deadline=None)
def test_quadratics_are_reproduced_on_regular_meshes(coefficients, place):
    """Control heights q(x, y) - (q_xx + q_xy + q_yy) / 6 ... of a lattice give the limit q."""
    points, faces = shapes.grid_arrays(9, 9)
    mesh = control_mesh(points, faces)
    a, b, c, d, e, f = coefficients

    def quadratic(x, y):
        return a + b * x + c * y + d * x * x + e * x * y + f * y * y

    heights = quadratic(points[:, 0], points[:, 1])
    mesh = moved(mesh, np.column_stack([points[:, :2], heights]))
    inner = np.flatnonzero(
        (points[mesh.triangles][:, :, :2] > 2.5).all((1, 2))
        & (points[mesh.triangles][:, :, :2] < 6.5).all((1, 2))
    )
    u, v = place[0] * (1 - place[1]), place[1]
    surface = LimitSurface(mesh).evaluate(mesh.vertices, inner, np.tile([u, v], (len(inner), 1)))
    x, y, z = surface.position.T
    # Averaging over the box spline's own spread shifts the surface by a constant.
    shift = z - quadratic(x, y)
    np.testing.assert_allclose(shift, shift[0], atol=1e-10)
    assert abs(shift[0] - (2 * d + e + 2 * f) / 6) < 1e-9


def test_the_curvature_of_a_torus_converges_with_the_square_of_the_edge():
    error = []
    for refinement in (1, 2, 4):
        mesh = shapes.torus(24 * refinement, 12 * refinement)
        surface = LimitSurface(mesh)
        control = surface.control_points(mesh.vertices)
        triangle = np.arange(mesh.triangle_count)
        found = surface.evaluate(control, triangle, np.full((len(triangle), 2), 1 / 3))
        _, gauss = found.curvatures()
        axis = np.linalg.norm(found.position[:, :2], axis=1)
        error.append(np.abs(gauss - (axis - 3) / axis).max())
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert (rates > 1.8).all(), error


@pytest.mark.parametrize('points', [1, 3, 6, 7, 12])
def test_integration_weights_fill_every_triangle(mesh, points):
    for levels in (0, 3):
        basis = quadrature_basis(mesh, points, levels)
        total = np.bincount(basis.element, basis.weight)
        np.testing.assert_allclose(total, 0.5, rtol=1e-12)


def test_integration_basis_equals_the_basis_at_its_points(mesh):
    basis = quadrature_basis(mesh, 3, 2)
    rows = basis_rows(mesh, basis.triangle[basis.element], basis.parameters)
    np.testing.assert_array_equal(np.diff(rows.node_offsets), np.diff(basis.row_offsets))
    np.testing.assert_allclose(rows.values, basis.values, atol=1e-14)
    np.testing.assert_allclose(rows.first, basis.first, atol=1e-11)
    np.testing.assert_allclose(rows.second, basis.second, atol=1e-9)
    for element in (0, mesh.triangle_count - 1):
        point = np.flatnonzero(basis.element == element)[0]
        own = slice(*rows.node_offsets[[point, point + 1]])
        shared = slice(*basis.node_offsets[[element, element + 1]])
        np.testing.assert_array_equal(rows.nodes[own], basis.nodes[shared])


def area(mesh, vertices, points, levels):
    basis = quadrature_basis(mesh, points, levels)
    rows = basis_rows(mesh, basis.triangle[basis.element], basis.parameters)
    first = [
        np.add.reduceat(rows.first[:, [k]] * vertices[rows.nodes], rows.node_offsets[:-1])
        for k in (0, 1)
    ]
    return basis.weight @ np.linalg.norm(np.cross(*first), axis=1)


def test_the_area_of_a_sphere_converges():
    error = []
    for levels in (2, 3, 4):
        mesh = shapes.sphere(levels)
        control = LimitSurface(mesh).control_points(mesh.vertices)
        error.append(abs(area(mesh, control, 6, 4) / (4 * np.pi) - 1))
    assert error[-1] < 1e-5
    assert (np.log2(np.array(error[:-1]) / error[1:]) > 1.9).all(), error


def test_too_many_points_are_refused():
    with pytest.raises(ValueError, match=r'4 integration points per triangle; allowed are'):
        quadrature_basis(shapes.sphere(0), 4)
