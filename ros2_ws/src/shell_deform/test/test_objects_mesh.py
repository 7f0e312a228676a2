# SPDX-License-Identifier: Apache-2.0
"""Control meshes of objects: their limit surface is the middle surface."""

import numpy as np
import pytest
import trimesh

from shell_deform.objects import (
    ObjectError,
    ShellObject,
    load_object,
    middle_surface,
    object_fit_report,
    object_mesh,
)
from shell_deform.objects.file_mesh import read_points
from shell_deform.objects.grid_mesh import HeightFieldTarget
from shell_deform.objects.rings import ring_mesh, row_height
from shell_deform.objects.shell_object import (
    Cone,
    Cylinder,
    Ellipsoid,
    HalfCylinder,
    HeightField,
    MeshFile,
    Revolution,
)
from shell_deform.surface import LimitSurface


@pytest.fixture(scope='module')
def ball():
    return load_object('tennis_ball_as_printed')


def test_the_limit_surface_of_the_ball_is_its_middle_surface(ball):
    report = object_fit_report(ball, object_mesh(ball))
    assert report.maximum_error_m < 1e-3 * ball.thickness_m
    assert report.rms_error_m < 2e-4 * ball.thickness_m


def test_the_ball_is_fine_at_its_contacts_and_coarse_between(ball):
    mesh = object_mesh(ball, 700)
    assert mesh.vertex_count <= 735
    edge = mesh.vertices[mesh.edges]
    length = np.linalg.norm(edge[:, 0] - edge[:, 1], axis=1)
    middle = edge.mean(axis=1)
    for contact in ball.contacts:
        near = np.linalg.norm(middle - contact.at_m, axis=1) < 0.0025
        assert length[near].max() < 1.2 * contact.radius_m
    equator = np.abs(middle[:, 0]) < 0.003
    assert 0.005 < length[equator].mean() < 0.0095


def test_the_ball_has_twelve_irregular_vertices_and_none_under_a_pin(ball):
    mesh = object_mesh(ball)
    assert len(mesh.irregular_vertices) == 12
    for contact in ball.contacts:
        distance = np.linalg.norm(mesh.vertices - contact.at_m, axis=1)
        assert mesh.valence[np.argmin(distance)] == 6
        assert distance[mesh.irregular_vertices].min() > contact.radius_m
    assert object_fit_report(ball, mesh).smallest_angle_deg > 40.0


def test_the_vertex_count_follows_the_request(ball):
    for count in (160, 360, 640, 1280, 2560):
        assert abs(object_mesh(ball, count).vertex_count / count - 1.0) < 0.06


def test_without_contacts_all_triangles_have_about_one_size(ball):
    mesh = object_mesh(ball, 640, refine_at=[])
    report = object_fit_report(ball, mesh)
    assert report.longest_edge_m < 2.0 * report.shortest_edge_m


def test_impossible_requests_are_refused(ball):
    with pytest.raises(ObjectError, match='7 control vertices; at least 12'):
        object_mesh(ball, 7)
    with pytest.raises(ObjectError, match='refine_radius is -1'):
        object_mesh(ball, refine_radius=-1)
    with pytest.raises(ObjectError, match='not finite'):
        object_mesh(ball, refine_at=[[np.nan, 0, 0]])


def shell(surface, thickness=0.001):
    return ShellObject('test', surface, thickness, 1e6, 0.3)


def arc(radius, first, last, count):
    angle = np.linspace(first, last, count)
    r = radius * np.sin(angle)
    r[np.abs(r) < 1e-12] = 0.0
    return tuple(zip(r.tolist(), (-radius * np.cos(angle)).tolist(), strict=True))


PRIMITIVES = {
    'ellipsoid': (Ellipsoid((0.06, 0.05, 0.08)), 2e-6, True),
    'open cylinder': (Cylinder(0.066, 0.12, 'open'), 2e-5, False),
    'closed cylinder': (Cylinder(0.066, 0.12, 'closed'), 2e-5, True),
    'half cylinder': (HalfCylinder(0.066, 0.12), 2e-5, False),
    'cone': (Cone((0.05, 0.08), 0.1), 2e-5, False),
    'sphere as a profile': (Revolution(arc(0.03, 0.0, np.pi, 15)), 5e-6, True),
    'bowl': (Revolution(arc(0.04, 0.0, np.pi / 2, 9)), 1e-5, False),
    'cup': (
        Revolution(((0.0, 0.0), (0.03, 0.0), (0.032, 0.03), (0.035, 0.06), (0.04, 0.09))),
        2e-5,
        False,
    ),
}


@pytest.mark.parametrize('name', PRIMITIVES)
def test_every_primitive_is_followed_by_its_limit_surface(name):
    surface, tolerance, closed = PRIMITIVES[name]
    thing = shell(surface)
    coarse, fine = object_mesh(thing, 300), object_mesh(thing, 900)
    assert fine.is_closed is closed
    assert abs(fine.vertex_count / 900 - 1) < 0.2
    report = object_fit_report(thing, fine)
    assert report.maximum_error_m < tolerance
    assert report.smallest_angle_deg > 25.0
    assert report.rms_error_m < 0.6 * object_fit_report(thing, coarse).rms_error_m


@pytest.mark.parametrize('name', PRIMITIVES)
def test_normals_point_outward(name):
    thing = shell(PRIMITIVES[name][0])
    mesh = object_mesh(thing, 300)
    points = LimitSurface(mesh).limit_positions(mesh.vertices)
    _, normal = middle_surface(thing).project(points)
    found = LimitSurface(mesh).vertex_normals(mesh.vertices)
    smooth = np.setdiff1d(np.arange(mesh.vertex_count), mesh.crease_edges)
    assert np.einsum('ij,ij->i', found, normal)[smooth].min() > 0.95


def test_the_middle_surface_lies_half_the_wall_inside():
    middle = middle_surface(shell(Ellipsoid((0.06, 0.05, 0.08)), 0.004))
    foot, normal = middle.project(np.array([[0.05, 0, 0], [0, -0.001, 0.05]]))
    np.testing.assert_allclose(foot[0], [0.028, 0, 0], atol=1e-12)
    np.testing.assert_allclose(normal[0], [1, 0, 0], atol=1e-12)
    outer = foot + 0.002 * normal
    np.testing.assert_allclose(((outer / [0.03, 0.025, 0.04]) ** 2).sum(axis=1), 1, atol=1e-9)
    cup = middle_surface(shell(PRIMITIVES['cup'][0], 0.002))
    np.testing.assert_allclose(cup.project(np.array([[0.01, 0, 0.0]]))[0], [[0.01, 0, 0.001]])


def test_any_place_of_any_surface_can_be_refined():
    ball = load_object('tennis_ball_as_printed')
    places = np.array([[0.0325, 0, 0], [-0.01, 0.0309, 0], [-0.01, -0.0309, 0]])
    for thing, at in (
        (ball, places),
        (load_object('half_soda_can'), [[0, 0.033, 0]]),
        (shell(Cylinder(0.066, 0.12, 'open')), [[0.033, 0, 0], [-0.033, 0, 0.01]]),
    ):
        mesh = object_mesh(thing, 700, refine_at=at, refine_radius=0.002)
        for place in at:
            distance = np.linalg.norm(mesh.vertices - place, axis=1)
            nearest = int(np.argmin(distance))
            assert mesh.valence[nearest] == 6
            edges = np.linalg.norm(
                mesh.vertices[mesh.neighbours(nearest)] - mesh.vertices[nearest], axis=1
            )
            assert edges.max() < 0.003
        assert object_fit_report(thing, mesh).smallest_angle_deg > 15.0


def test_a_pole_of_a_profile_can_be_refined():
    bowl = shell(PRIMITIVES['bowl'][0])
    mesh = object_mesh(bowl, 700, refine_at=[[0, 0, -0.04]], refine_radius=0.002)
    pole = int(np.argmin(mesh.vertices[:, 2]))
    edges = np.linalg.norm(mesh.vertices[mesh.neighbours(pole)] - mesh.vertices[pole], axis=1)
    assert mesh.valence[pole] == 6
    assert edges.max() < 0.0026


def test_height_fields(tmp_path):
    x, y = np.meshgrid(np.linspace(-1, 1, 31), np.linspace(-1, 1, 21), indexing='ij')
    np.save(tmp_path / 'dome.npy', 0.01 * (1 - x**2) * (1 - 0.5 * y**2))
    dome = shell(HeightField(tmp_path / 'dome.npy', 0.002))
    mesh = object_mesh(dome, 600)
    assert not mesh.is_closed
    points = LimitSurface(mesh).limit_positions(mesh.vertices)[
        np.unique(mesh.triangles[mesh.active])
    ]
    np.testing.assert_allclose(np.ptp(points[:, :2], axis=0), [0.06, 0.04], atol=1e-3)
    assert object_fit_report(dome, mesh).maximum_error_m < 1e-5
    np.savetxt(tmp_path / 'short.csv', np.zeros((2, 5)), delimiter=',')
    with pytest.raises(ObjectError, match=r'heights have shape \(2, 5\)'):
        object_mesh(shell(HeightField(tmp_path / 'short.csv', 0.002)))


def test_four_columns_of_heights_are_enough_for_a_cubic():
    x = np.linspace(-0.03, 0.03, 4)
    field = HeightFieldTarget(np.repeat(40.0 * x[:, None] ** 3, 6, axis=1), 0.02, 0.0)
    between = np.array([[0.013, 0.004], [-0.022, -0.03]])
    np.testing.assert_allclose(field.place(between)[:, 2], 40.0 * between[:, 0] ** 3, atol=1e-15)


def test_a_row_of_its_own_height_has_equilateral_triangles():
    mesh = ring_mesh(24, 8, row_height(24), lower_cap=False, upper_cap=False)
    corners = np.exp(1j * mesh.longitude[mesh.triangles]), mesh.height[mesh.triangles]
    turn = np.angle(corners[0] / np.roll(corners[0], 1, axis=1))
    edges = np.hypot(turn, corners[1] - np.roll(corners[1], 1, axis=1))
    np.testing.assert_allclose(edges, 2.0 * np.pi / 24, rtol=1e-12)


def test_a_control_mesh_from_a_file_is_taken_as_it_is(tmp_path):

    ball = trimesh.creation.icosphere(2, 31.25)
    ball.export(tmp_path / 'ball.ply')
    thing = shell(MeshFile(tmp_path / 'ball.ply', 'mm', 'control'))
    mesh = object_mesh(thing)
    np.testing.assert_allclose(mesh.vertices, ball.vertices / 1000, atol=1e-8)
    walls = ShellObject('test', thing.surface, 1e-3, 1e6, 0.3, vertex_thickness_m=np.full(5, 1e-3))
    with pytest.raises(ObjectError, match='thickness_m lists 5 values; .* has 162 vertices'):
        object_mesh(walls)


def test_a_scanned_face_from_a_file_is_fitted(tmp_path):
    pytest.importorskip('fast_simplification')
    trimesh.creation.icosphere(5, 32.5).export(tmp_path / 'ball.stl')
    thing = shell(MeshFile(tmp_path / 'ball.stl', 'mm', 'outer'), 0.0025)
    mesh = object_mesh(thing, 400)
    assert abs(mesh.vertex_count / 400 - 1) < 0.1
    limit = LimitSurface(mesh).limit_positions(mesh.vertices)
    np.testing.assert_allclose(np.linalg.norm(limit, axis=1), 0.03125, atol=2e-5)


def test_profiles_that_no_wall_can_follow_are_refused():
    tip = Revolution(((0.0, 0.0), (0.01, 0.03), (0.02, 0.06)))
    with pytest.raises(ObjectError, match='test: the profile reaches the axis in a tip'):
        object_mesh(shell(tip))
    tight = Revolution(arc(0.001, 0.0, np.pi, 9))
    with pytest.raises(ObjectError, match='test: the (profile is rounded|wall is thicker)'):
        object_mesh(shell(tight, 0.003))


def test_one_point_is_a_scan_and_none_is_refused(tmp_path):
    (tmp_path / 'one.xyz').write_text('1 2 3\n')
    assert read_points(tmp_path / 'one.xyz', 'mm').tolist() == [[1e-3, 2e-3, 3e-3]]
    (tmp_path / 'none.ply').write_text(
        'ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n'
        'property float z\nend_header\n'
    )
    with pytest.raises(ObjectError, match='none.ply'):
        read_points(tmp_path / 'none.ply', 'mm')
