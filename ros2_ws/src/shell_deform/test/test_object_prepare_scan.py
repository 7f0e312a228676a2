# SPDX-License-Identifier: Apache-2.0
"""A scan becomes one clean piece, then even triangles, then a fitted control mesh."""

import numpy as np
import pytest
import scan_shapes as scans
import trimesh

from shell_deform.objects import ObjectError
from shell_deform.objects.scan_clean import boundary_loops, clean_scan, filled
from shell_deform.surface import LimitSurface, control_mesh, quadrature_basis

H = 0.0025


def prepared(*arguments, **options):
    pytest.importorskip('fast_simplification')
    from shell_deform.objects.prepare import prepare

    return prepare(*arguments, **options)


def outer_face(mesh, wall):
    basis = quadrature_basis(mesh, 6)
    found = LimitSurface(mesh).evaluate(
        mesh.vertices, basis.triangle[basis.element], basis.parameters
    )
    return found.position + 0.5 * wall * found.normal


def test_a_damaged_scan_becomes_one_oriented_manifold_piece():
    scan = clean_scan(*scans.damaged(*scans.potato(4, 0.0)))
    assert scan.report['pieces'] == 2
    mesh = control_mesh(scan.vertices, scan.triangles)
    assert len(boundary_loops(scan.triangles)) == 1
    assert LimitSurface(mesh).vertex_normals(mesh.vertices)[0] @ mesh.vertices[0] > 0


def test_the_inside_out_scan_of_a_closed_object_is_turned():
    points, faces = scans.potato(3, 0.0)
    scan = clean_scan(points, faces[:, ::-1])
    assert scan.report['triangles_turned'] == len(faces)


def test_an_open_scan_keeps_the_side_that_most_triangles_show():
    points, faces = scans.bowl(3, 0.0)
    few = faces.copy()
    few[:20] = few[:20, ::-1]
    assert clean_scan(points, few).report['triangles_turned'] == 20


def test_vertices_that_join_two_fans_are_split():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0], [1, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 3, 4], [1, 5, 2], [3, 1, 4]])
    scan = clean_scan(points, faces)
    control_mesh(scan.vertices, scan.triangles)


def test_a_moebius_strip_is_refused():
    angle = np.linspace(0, 2 * np.pi, 25)[:-1]
    rim = [
        np.column_stack(
            [
                (1 + s * np.cos(angle / 2)) * np.cos(angle),
                (1 + s * np.cos(angle / 2)) * np.sin(angle),
                s * np.sin(angle / 2),
            ]
        )
        for s in (-0.3, 0.3)
    ]
    i = np.arange(23)
    faces = np.concatenate(
        [
            np.column_stack([i, i + 1, i + 24]),
            np.column_stack([i + 1, i + 25, i + 24]),
            [[23, 24, 47], [24, 0, 47]],
        ]
    )
    with pytest.raises(ObjectError, match='one side only'):
        clean_scan(np.concatenate(rim), faces)


def test_scans_without_area_or_with_bad_points_are_refused():
    with pytest.raises(ObjectError, match='no triangle with an area'):
        clean_scan(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(ObjectError, match='vertex 1 of the scan is not finite'):
        clean_scan(np.array([[0, 0, 0], [np.inf, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def test_small_holes_are_closed_and_large_ones_stay():
    scan = clean_scan(*scans.damaged(*scans.bowl(4, 0.0)))
    assert len(boundary_loops(scan.triangles)) == 2
    points, faces, closed = filled(scan.vertices, scan.triangles, 0.05)
    assert closed == 1
    assert len(boundary_loops(faces)) == 1
    assert filled(points, faces, 1.0)[2] == 1


def test_even_triangles_have_six_neighbours_mostly():
    pytest.importorskip('fast_simplification')
    from shell_deform.objects.remesh import even_mesh

    even = even_mesh(clean_scan(*scans.potato(5, 2e-5)), 600, 0.01)
    mesh = control_mesh(even.vertices, even.triangles)
    assert abs(mesh.vertex_count / 600 - 1) < 0.08
    assert (mesh.valence == 6).mean() > 0.7
    assert mesh.valence.min() >= 4
    ends = mesh.vertices[mesh.edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert length.max() < 2.5 * length.min()


def test_of_two_edges_of_a_triangle_that_are_too_long_the_longer_is_halved_first():
    from shell_deform.objects.remesh import split_long

    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    points, faces = split_long(corners, np.array([[0, 1, 2]]), lambda _middle: 3.5)
    assert points[3:].tolist() == [[2.0, 1.5, 0.0], [2.0, 0.0, 0.0]]
    assert len(faces) == 3


def test_a_closed_noisy_damaged_scan_is_followed_far_below_its_noise():
    noise = 1.27e-4
    found = prepared(*scans.damaged(*scans.potato(6, noise)), H, control_vertices=600)
    error = scans.potato_distance(outer_face(found.fit.mesh, H))
    assert found.fit.mesh.is_closed
    assert found.report['holes_closed'] == 1
    assert np.sqrt(np.mean(error**2)) < 2.5e-5
    assert abs(found.fit.rms_m / noise - 1) < 0.03
    assert found.fit.systematic_m < 3e-5


def test_an_open_scan_keeps_its_rim():
    found = prepared(*scans.bowl(5, 5e-5), H, control_vertices=400)
    mesh = found.fit.mesh
    assert not mesh.is_closed
    points = outer_face(mesh, H)
    assert np.sqrt(np.mean((np.linalg.norm(points, axis=1) - 0.04) ** 2)) < 3e-5
    limit = LimitSurface(mesh).limit_positions(mesh.vertices)
    rim = limit[mesh.boundary_vertices]
    assert np.abs(rim[:, 2] - 0.0095).max() < 0.0015


def test_the_middle_surface_can_be_scanned_too():
    found = prepared(*scans.potato(5, 0.0), H, face='middle', control_vertices=400)
    error = scans.potato_distance(outer_face(found.fit.mesh, 0.0))
    assert np.sqrt(np.mean(error**2)) < 2e-5


def test_a_wanted_error_chooses_the_number_of_vertices():
    scan = scans.potato(5, 2e-5)
    coarse = prepared(*scan, H, error=1e-4).fit
    fine = prepared(*scan, H, error=4e-6).fit
    assert coarse.mesh.vertex_count < fine.mesh.vertex_count
    assert fine.systematic_m <= 4e-6


def test_a_wall_of_varying_thickness_is_halved_where_it_is():
    points, faces = scans.potato(5, 0.0)
    walls = np.column_stack([points[::7], 0.002 + 0.02 * points[::7, 2]])
    found = prepared(points, faces, walls, control_vertices=500)
    mesh = found.fit.mesh
    basis = quadrature_basis(mesh, 3)
    there = LimitSurface(mesh).evaluate(
        mesh.vertices, basis.triangle[basis.element], basis.parameters
    )
    wall = 0.002 + 0.02 * (there.position + 0.001 * there.normal)[:, 2]
    error = scans.potato_distance(there.position + 0.5 * wall[:, None] * there.normal)
    assert np.sqrt(np.mean(error**2)) < 3e-5


def test_contacts_are_refined():
    from shell_deform.objects.prepare import Refinement

    place = np.array([[0.0, 0.0, scans.potato_radius(np.array([[0, 0, 1.0]]))[0]]])
    found = prepared(
        *scans.potato(5, 2e-5),
        H,
        control_vertices=600,
        refinement=Refinement(place, lambda surface: 0.0016),
    )
    mesh = found.fit.mesh
    ends = mesh.vertices[mesh.edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    near = np.linalg.norm(ends.mean(axis=1) - place, axis=1) < 0.003
    assert length[near].mean() < 0.6 * length.mean()


def test_a_thick_wall_is_warned_about():
    thick = prepared(*scans.potato(4, 0.0), 0.0025, control_vertices=300)
    assert any('too stiff against a solid' in warning for warning in thick.warnings())
    thin = prepared(*scans.potato(4, 0.0), 0.0005, control_vertices=300)
    assert thin.warnings() == []


def test_any_soup_of_triangles_gives_a_clean_piece_or_an_object_error():
    random = np.random.default_rng(1)
    for _ in range(40):
        points = random.normal(size=(12, 3))
        faces = random.integers(0, 12, (random.integers(1, 30), 3))
        try:
            scan = clean_scan(points, faces)
        except ObjectError:
            continue
        control_mesh(scan.vertices, scan.triangles)


def test_the_speck_of_a_scan_is_left_out():
    points, faces = scans.potato(3, 0.0)
    speck = trimesh.creation.icosphere(1, radius=0.001)
    both = np.concatenate([np.array(speck.faces), faces + len(speck.vertices)])
    scan = clean_scan(np.concatenate([speck.vertices + 1, points]), both)
    assert len(scan.triangles) == len(faces)
