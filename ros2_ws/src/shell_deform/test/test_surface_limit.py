# SPDX-License-Identifier: Apache-2.0
"""Limit positions, normals and closest points."""

import numpy as np
import pytest
import surface_shapes as shapes
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.surface import control_mesh, quadrature_basis
from shell_deform.surface.limit import LimitSurface


@pytest.mark.parametrize('levels', [0, 2])
def test_limit_positions_are_what_repeated_subdivision_tends_to(levels):
    mesh = shapes.sphere(levels)
    found = LimitSurface(mesh).limit_positions(mesh.vertices)
    vertices, faces = mesh.vertices, mesh.triangles
    for _ in range(4):
        vertices, faces = trimesh.remesh.subdivide_loop(vertices, faces, iterations=1)
    moved = control_mesh(vertices, faces)
    limit = LimitSurface(moved).limit_positions(moved.vertices)
    distance = np.linalg.norm(limit[:, None] - found[None], axis=2).min(axis=0)
    assert distance.max() < 1e-12


def test_control_points_invert_limit_positions():
    for mesh in (shapes.random_ball(80, 1), control_mesh(*shapes.grid_arrays(5, 5, 0.2))):
        surface = LimitSurface(mesh)
        control = surface.control_points(mesh.vertices)
        np.testing.assert_allclose(surface.limit_positions(control), mesh.vertices, atol=1e-12)


def test_the_limit_matrix_agrees_with_evaluation_at_the_corners():
    points, faces = shapes.grid_arrays(6, 5, noise=0.3)
    meshes = [
        shapes.random_ball(50, 2),
        control_mesh(points, faces),
        control_mesh(points, faces, corners=[]),
        control_mesh(points, faces, crease_edges=[(14, 15), (15, 16)]),
    ]
    for mesh in meshes:
        surface = LimitSurface(mesh)
        limit = surface.limit_positions(mesh.vertices)
        for corner, parameters in enumerate(([0, 0], [1, 0], [0, 1])):
            triangle = np.arange(mesh.triangle_count)
            found = surface.evaluate(
                mesh.vertices, triangle, np.tile(parameters, (len(triangle), 1))
            )
            np.testing.assert_allclose(
                found.position, limit[mesh.triangles[:, corner]], atol=1e-12
            )


def test_normals_of_a_sphere_point_outward():
    mesh = shapes.sphere(3)
    surface = LimitSurface(mesh)
    control = surface.control_points(mesh.vertices)
    normals = surface.vertex_normals(control)
    assert np.einsum('ij,ij->i', normals, mesh.vertices).min() > 0.9999


def test_closest_points_of_a_sphere():
    mesh = shapes.sphere(3, radius=0.03125)
    surface = LimitSurface(mesh)
    control = surface.control_points(mesh.vertices)
    random = np.random.default_rng(0)
    direction = random.normal(size=(3000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    radius = random.uniform(0.02, 0.05, 3000)
    found = surface.closest_point(control, direction * radius[:, None], offset=0.00125)
    np.testing.assert_allclose(found.distance, radius - 0.0325, atol=3e-5)
    assert not found.on_boundary.any()
    np.testing.assert_allclose(np.linalg.norm(found.position, axis=1), 0.0325, atol=3e-5)
    assert np.einsum('ij,ij->i', found.normal, direction).min() > 0.999


@pytest.mark.parametrize('make', [lambda: shapes.random_ball(60, 4), lambda: shapes.torus(9, 7)])
def test_the_foot_of_a_raised_point_is_where_it_was_raised(make):
    mesh = make()
    surface = LimitSurface(mesh)
    random = np.random.default_rng(3)
    triangle = random.integers(0, mesh.triangle_count, 2000)
    parameters = random.dirichlet([1, 1, 1], 2000)[:, 1:]
    there = surface.evaluate(mesh.vertices, triangle, parameters)
    height = random.uniform(-0.01, 0.01, 2000)
    found = surface.closest_point(mesh.vertices, there.position + height[:, None] * there.normal)
    np.testing.assert_allclose(found.distance, height, atol=2e-8)
    np.testing.assert_allclose(found.position, there.position, atol=2e-5)


def graded_ball(seed):
    """Points thrown on a sphere, ever denser towards one pole: edges from 0.04 to 0.7."""
    random = np.random.default_rng(seed)
    height = 1.0 - 2.0 * random.uniform(size=150) ** 3
    around = random.uniform(-np.pi, np.pi, 150)
    across = np.sqrt(1.0 - height**2)
    points = np.column_stack([across * np.cos(around), across * np.sin(around), height])
    hull = trimesh.convex.convex_hull(points)
    return control_mesh(hull.vertices, hull.faces)


def bumpy_grid(seed, **sharp):
    return control_mesh(*shapes.grid_arrays(5, 5, 0.15, seed), **sharp)


SEARCHED = {
    'closed': lambda seed: shapes.random_ball(40, seed),
    'torus': lambda seed: shapes.torus(9, 7),
    'graded': graded_ball,
    'open': bumpy_grid,
    'creased': lambda seed: bumpy_grid(seed, crease_edges=[(7, 13), (13, 19)]),
}


def queries_beside(surface, random, height, count=60):
    """Points raised from inside, from edges and from corners of triangles; half of them shaken."""
    mesh = surface.mesh
    triangle = random.integers(0, mesh.triangle_count, count)
    parameters = random.dirichlet([1, 1, 1], count)[:, 1:]
    parameters[::3, 1] = 0.0
    parameters[::9] = 0.0, 1.0
    there = surface.evaluate(mesh.vertices, triangle, parameters)
    edge = np.sqrt(np.linalg.norm(np.cross(*there.first.swapaxes(0, 2).swapaxes(1, 2)), axis=1))
    queries = there.position + (height * edge)[:, None] * there.normal
    queries[::2] += 0.3 * np.abs(height) * edge[::2, None] * random.normal(size=(count, 3))[::2]
    return queries


@pytest.mark.parametrize('shape', SEARCHED)
@given(st.integers(0, 10**6), st.floats(0.01, 2.0), st.sampled_from([1.0, -1.0]))
@settings(max_examples=12, deadline=None, derandomize=True)
def test_no_search_from_anywhere_finds_a_nearer_foot(shape, seed, height, side):
    mesh = SEARCHED[shape](seed)
    surface = LimitSurface(mesh)
    queries = queries_beside(surface, np.random.default_rng(seed), side * height)
    found = surface.closest_point(mesh.vertices, queries)
    ours = np.linalg.norm(found.position - queries, axis=1)
    n = 6
    grid = np.array([(i / n, j / n) for i in range(n + 1) for j in range(n + 1 - i)])
    triangle = np.repeat(np.arange(mesh.triangle_count), len(grid))
    parameters = np.tile(grid, (mesh.triangle_count, 1))
    dense = surface.evaluate(mesh.vertices, triangle, parameters)
    gap = np.linalg.norm(dense.position[None] - queries[:, None], axis=2)
    start = np.argpartition(gap, 60, axis=1)[:, :60]
    again = surface.closest_point(
        mesh.vertices,
        np.repeat(queries, 60, axis=0),
        seeds=(triangle[start.ravel()], parameters[start.ravel()]),
    )
    theirs = np.linalg.norm(again.position - np.repeat(queries, 60, axis=0), axis=1)
    best = np.minimum(theirs.reshape(-1, 60).min(axis=1), gap.min(axis=1))
    # The last halving towards an irregular vertex is replaced by a plane: 1e-10 of an edge.
    assert np.all(ours <= best * (1.0 + 1e-9) + 1e-10), (ours / best - 1.0).max()


@pytest.mark.parametrize('shape', SEARCHED)
@pytest.mark.parametrize('height', [0.05, 0.3, 1.0])
def test_many_points_at_once_find_what_a_few_find(shape, height):
    mesh = SEARCHED[shape](1)
    surface = LimitSurface(mesh)
    queries = queries_beside(surface, np.random.default_rng(2), height, 4000)
    many = surface.closest_point(mesh.vertices, queries)
    few = [surface.closest_point(mesh.vertices, part) for part in np.array_split(queries, 40)]
    distance = np.concatenate([np.abs(part.distance) for part in few])
    # The last halving towards an irregular vertex is replaced by a plane: 1e-10 of an edge.
    np.testing.assert_allclose(np.abs(many.distance), distance, rtol=1e-9, atol=1e-10)


def test_points_beside_an_open_surface_are_flagged():
    points, faces = shapes.grid_arrays(6, 6)
    mesh = control_mesh(points, faces)
    queries = [[3.2, 2.7, 0.5], [-1.0, 3.3, 0.4], [7.0, 8.0, -0.3], [3.0, 6.2, 0.1]]
    found = LimitSurface(mesh).closest_point(mesh.vertices, queries)
    np.testing.assert_array_equal(found.on_boundary, [False, True, True, True])
    expected = [0.5, np.hypot(1.0, 0.4), -np.sqrt(1 + 4 + 0.09), np.hypot(0.2, 0.1)]
    np.testing.assert_allclose(found.distance, expected, atol=1e-9)
    np.testing.assert_allclose(
        found.position, [[3.2, 2.7, 0], [0, 3.3, 0], [6, 6, 0], [3, 6, 0]], atol=1e-8
    )


def test_threads_do_not_change_the_answer():
    mesh = shapes.random_ball(60, 6)
    surface = LimitSurface(mesh)
    queries = np.random.default_rng(5).normal(size=(5000, 3))
    one = surface.closest_point(mesh.vertices, queries, threads=1)
    three = surface.closest_point(mesh.vertices, queries, threads=3)
    np.testing.assert_array_equal(one.position, three.position)
    np.testing.assert_array_equal(one.triangle, three.triangle)


def test_the_last_answer_can_be_the_next_start():
    mesh = shapes.sphere(2)
    surface = LimitSurface(mesh)
    queries = np.random.default_rng(6).normal(size=(500, 3))
    cold = surface.closest_point(mesh.vertices, queries)
    warm = surface.closest_point(mesh.vertices, queries, seeds=(cold.triangle, cold.parameters))
    np.testing.assert_allclose(warm.position, cold.position, atol=1e-9)


def test_queries_must_be_finite():
    mesh = shapes.sphere(1)
    with pytest.raises(ValueError, match='query 1 is not finite'):
        LimitSurface(mesh).closest_point(mesh.vertices, [[0, 0, 2], [0, np.nan, 1]])


@pytest.mark.parametrize(
    'make',
    [
        lambda: shapes.random_ball(60, 4),
        lambda: shapes.tetrahedron(),
        lambda: control_mesh(*shapes.grid_arrays(5, 4, 0.3)),
        lambda: control_mesh(*shapes.grid_arrays(5, 4, 0.3), crease_edges=[(6, 7), (7, 8)]),
    ],
)
def test_the_compiled_search_and_the_plain_one_agree(make, monkeypatch):
    mesh = make()
    surface = LimitSurface(mesh)
    random = np.random.default_rng(8)
    triangle = random.integers(0, mesh.triangle_count, 400)
    parameters = random.dirichlet([1, 1, 1], 400)[:, 1:]
    there = surface.evaluate(mesh.vertices, triangle, parameters)
    queries = there.position + random.normal(size=(400, 3)) * 0.1
    compiled = surface.closest_point(mesh.vertices, queries, 0.02)
    monkeypatch.setattr('shell_deform.surface.closest_point.HAVE_NUMBA', False)
    plain = surface.closest_point(mesh.vertices, queries, 0.02)
    # The feet agree; a foot on a crease has two normals, and either search may take either.
    feet = [found.position - 0.02 * found.normal for found in (compiled, plain)]
    far = [np.linalg.norm(foot - queries, axis=1) for foot in feet]
    np.testing.assert_allclose(far[0], far[1], atol=1e-7)
    # Where two feet are equally near, either is right.
    same = np.linalg.norm(compiled.position - plain.position, axis=1) < 1e-6
    assert same.mean() > 0.99
    np.testing.assert_allclose(compiled.distance[same], plain.distance[same], atol=1e-7)
    np.testing.assert_array_equal(compiled.on_boundary[same], plain.on_boundary[same])


def test_inactive_triangles_carry_no_surface():
    points, faces = shapes.grid_arrays(6, 6)
    middle = points[faces].mean(axis=1)
    active = (np.abs(middle[:, :2] - 3) < 2).all(axis=1)
    mesh = control_mesh(points, faces, corners=[], active=active)
    found = LimitSurface(mesh).closest_point(mesh.vertices, [[0.2, 3.3, 0.1], [3.4, 2.7, 0.1]])
    np.testing.assert_array_equal(found.on_boundary, [True, False])
    np.testing.assert_allclose(found.position, [[1, 3.3, 0], [3.4, 2.7, 0]], atol=1e-9)
    assert len(quadrature_basis(mesh).triangle) == active.sum()
