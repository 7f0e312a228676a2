# SPDX-License-Identifier: Apache-2.0
"""What-if: fingers on a surface and variants of an object, as numbers."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.executables import executable

from grasp_view.scene_model import Mesh
from grasp_view.what_if import (
    Finger,
    Touch,
    contacts_of,
    hits,
    nearest,
    object_variant,
    opposite,
    pointed,
    vertex_normals,
)

RADIUS = 0.03
BALL = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
MESH = Mesh(np.asarray(BALL.faces), np.asarray(BALL.vertices))
NORMALS = vertex_normals(MESH)
directions = st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(
    lambda v: np.linalg.norm(v) > 0.1
)


def test_normals_of_a_ball_point_outward_however_it_is_meshed() -> None:
    assert np.allclose(NORMALS, MESH.rest / RADIUS, atol=1e-9)
    graded = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS).subdivide([5, 6, 7, 300])
    graded.vertices *= RADIUS / np.linalg.norm(graded.vertices, axis=1)[:, None]
    hull = graded.convex_hull
    mesh = Mesh(np.asarray(hull.faces), np.asarray(hull.vertices))
    assert np.allclose(vertex_normals(mesh), mesh.rest / RADIUS, atol=1e-6)


@settings(deadline=None)
@given(directions)
def test_a_ray_through_a_ball_meets_it_twice_nearest_first(towards: list[float]) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    found = hits(MESH, NORMALS, -3 * RADIUS * direction, direction)
    ends = np.array([touch.point for touch in found])
    assert np.allclose(ends[0], -RADIUS * direction, atol=1e-3 * RADIUS * 5)
    assert np.allclose(ends[-1], RADIUS * direction, atol=1e-3 * RADIUS * 5)
    assert np.allclose(found[0].outward, -direction, atol=0.02)


def test_a_ray_beside_the_body_meets_nothing() -> None:
    assert hits(MESH, NORMALS, np.array([0, 0, 2 * RADIUS]), np.array([1.0, 0, 0])) == []


@settings(deadline=None)
@given(directions, st.floats(0.0, 2.0), st.floats(0.0, 6.28))
def test_a_pointer_takes_a_finger_to_what_it_is_over_or_to_the_outline_beside_it(
    towards: list[float], off: float, turn: float
) -> None:
    ahead = -np.array(towards) / np.linalg.norm(towards)
    eye = -5 * RADIUS * ahead
    right = np.cross(ahead, np.eye(3)[np.abs(ahead).argmin()])
    right /= np.linalg.norm(right)
    beside = np.cos(turn) * right + np.sin(turn) * np.cross(ahead, right)
    found = pointed(MESH, NORMALS, eye, off * RADIUS * beside - eye)
    # Of all that the eye sees, nothing is nearer to the ray: never on the side turned away.
    assert found.outward @ (eye - found.point) > -0.05 * RADIUS
    ray = off * RADIUS * beside - eye
    ray /= np.linalg.norm(ray)
    seen = MESH.rest[np.einsum('ij,ij->i', NORMALS, eye - MESH.rest) > 0.0] - eye
    away = np.linalg.norm(seen - np.outer(seen @ ray, ray), axis=1).min()
    arm = found.point - eye
    assert np.linalg.norm(arm - (arm @ ray) * ray) < away + 1e-6
    # The way there does not matter: it follows the pointer's angle around the outline.
    if off > 1.2:
        assert found.point @ beside > 0.9 * RADIUS


@settings(deadline=None)
@given(directions)
def test_a_finger_keeps_its_place_on_another_mesh_of_the_same_body(towards: list[float]) -> None:
    """A mesh graded elsewhere is coarse here: its vertices are 4 mm apart."""
    coarse = trimesh.creation.icosphere(subdivisions=2, radius=RADIUS)
    mesh = Mesh(np.asarray(coarse.faces), np.asarray(coarse.vertices))
    direction = np.array(towards) / np.linalg.norm(towards)
    found = nearest(mesh, vertex_normals(mesh), RADIUS * direction)
    assert np.allclose(found.point, RADIUS * direction, atol=0.02 * RADIUS)


@settings(deadline=None)
@given(directions)
def test_the_opposite_place_of_a_ball_is_its_antipode(towards: list[float]) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    here = hits(MESH, NORMALS, 3 * RADIUS * direction, -direction)[0]
    there = opposite(MESH, NORMALS, here)
    assert there is not None
    assert np.allclose(there.point, -here.point, atol=0.02 * RADIUS)


def test_an_open_edge_has_no_opposite_place() -> None:
    flat = Mesh(np.array([[0, 1, 2]]), np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    touch = Touch(np.array([0.2, 0.2, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert opposite(flat, vertex_normals(flat), touch) is None


def test_contacts_lie_on_the_outer_face_and_push_inward() -> None:
    touch = nearest(MESH, NORMALS, np.array([1.0, 0, 0]))
    contacts = contacts_of([Finger(1, touch, 7.0), Finger(2, touch, 0.0)], 0.002, 0.001)
    assert np.linalg.norm(contacts.points[0]) == pytest.approx(RADIUS + 0.001)
    assert np.allclose(contacts.forces[0], -7.0 * touch.outward)
    assert contacts.flags.tolist() == [1, 0] and contacts.frame == 'object'


def test_a_variant_keeps_what_it_does_not_change_and_drops_unknown_numbers() -> None:
    described = {
        'name': 'ball', 'surface': {'sphere': {'outer_diameter_m': 0.065}}, 'thickness_m': 0.0025,
        'young_modulus_pa': 1e6, 'poisson_ratio': 0.5, 'yield_stress_pa': None, 'supports': [],
        'gas': {'kind': 'sealed', 'gauge_pressure_pa': 0.0, 'ambient_pa': 101325.0},
        'mesh': {'vertices': 650},
    }  # fmt: skip
    variant = object_variant(described, 2e6, 5e4)
    assert variant['young_modulus_pa'] == 2e6
    assert variant['gas'] == {
        'kind': 'sealed', 'gauge_pressure_pa': 5e4, 'ambient_pa': 101325.0,
    }  # fmt: skip
    assert set(variant) == {
        'name', 'surface', 'thickness_m', 'young_modulus_pa', 'poisson_ratio', 'gas',
    }  # fmt: skip


def test_an_open_object_gets_no_pressure() -> None:
    described = {'name': 'can', 'gas': {'kind': 'none', 'gauge_pressure_pa': 0.0}}
    assert object_variant(described, 1e9, 5e4)['gas'] == {'kind': 'none'}


def test_a_variant_of_every_shipped_object_is_an_object_file(tmp_path: Path) -> None:
    program = executable('shell_objects')
    listed = subprocess.run([program, '--json'], capture_output=True, check=True, timeout=600)
    paths = []
    for described in json.loads(listed.stdout)['objects']:
        paths.append(tmp_path / f'{described["name"]}.yaml')
        paths[-1].write_text(json.dumps(object_variant(described, 3e6, 0.0)))
    read = subprocess.run(
        [program, *map(str, paths), '--json'], capture_output=True, check=False, timeout=600
    )
    assert read.returncode == 0, read.stderr.decode()
    told = json.loads(read.stdout)['objects']
    assert [one['name'] for one in told] == [path.stem for path in paths]
    assert all(one['young_modulus_pa'] == 3e6 for one in told)
