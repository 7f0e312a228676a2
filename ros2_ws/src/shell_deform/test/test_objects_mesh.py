"""Control meshes of objects: their limit surface is the middle surface."""

import numpy as np
import pytest

from shell_deform.objects import ObjectError, load_object, object_fit_report, object_mesh


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
        assert length[near].max() < 0.0011
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
