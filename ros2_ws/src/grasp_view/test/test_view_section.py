# SPDX-License-Identifier: Apache-2.0
"""The section through a dent and the probe: what they read is what the answer has there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp_view.probe import hit
from grasp_view.scene_model import Cloud, Contacts, Mesh, Snapshot, Surface
from grasp_view.section import axis_of, deepest, rest_arcs, section_of
from grasp_view.section_svg import section_html
from grasp_view.smooth_faces import SmoothFaces

RADIUS = 0.03
BALL = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
MESH = Mesh(np.asarray(BALL.faces), np.asarray(BALL.vertices))
FACES = SmoothFaces(MESH.triangles, len(MESH.rest))


def squeezed(depth: float, weaker: float = 0.5) -> Snapshot:
    """A ball pressed by 10 N at +x, and `weaker` times as deep by 12 N at -x."""
    moved = np.zeros_like(MESH.rest)
    for side, share in ((1.0, 1.0), (-1.0, weaker)):
        near = np.linalg.norm(MESH.rest - [side * RADIUS, 0, 0], axis=1)
        moved[:, 0] -= side * share * depth * np.exp(-((near / 6e-3) ** 2))
    surface = Surface(5.0, 'object', MESH.rest + moved, moved, np.full(len(moved), 2e-4))
    tips = np.array([[RADIUS - depth, 0, 0], [weaker * depth - RADIUS, 0, 0]])
    inward = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    contacts = Contacts(
        5.0, 'object', tips, inward, inward * np.array([[10.0], [12.0]]), np.full(2, 0.2),
        np.full(2, 1e-3), np.array([1, 2]), np.array([1, 1]),
    )  # fmt: skip
    return Snapshot(mesh=MESH, served=surface, contacts=contacts, state='CONTACT')


@pytest.mark.parametrize('depth', [0.5e-3, 4e-3, 9e-3])
def test_the_depth_of_the_section_is_that_of_the_dent(depth: float) -> None:
    section = section_of(squeezed(depth), FACES)
    assert section is not None and section.finger == 1
    assert section.depth == pytest.approx(1e3 * depth, rel=0.03)
    assert np.allclose(section.band, 0.2)
    assert np.allclose(np.hypot(section.rest[:, 0], section.rest[:, 1] + 30.0), 30.0, atol=0.05)


def test_the_section_goes_through_the_deepest_dent_not_the_largest_force() -> None:
    touch = deepest(squeezed(4e-3, weaker=1.4))
    assert touch is not None and touch.finger == 2
    assert deepest(replace(squeezed(4e-3), contacts=None)) is None
    assert section_of(Snapshot(mesh=MESH), FACES) is None


def test_an_old_scan_says_its_age() -> None:
    scan = Cloud(2.0, 'object', MESH.rest)
    section = section_of(replace(squeezed(4e-3), scan=scan), FACES)
    assert section is not None and len(section.scan) > 5
    assert 'scan, outer face, as placed, 3.0 s old' in section_html(section)
    fitted = replace(scan, stamp=5.0)
    now = section_html(section_of(replace(squeezed(4e-3), scan_error=fitted), FACES))
    assert 'scan, outer face<' in now


def test_the_drawing_names_its_depth_for_those_who_do_not_see_it() -> None:
    html = section_html(section_of(squeezed(4e-3), FACES))
    assert 'aria-label="Section: depth 4' in html and 'under finger 1' in html
    assert 'drawn when a finger presses' in section_html(None)


def test_rest_arcs_lie_on_the_rest_shape_above_the_dent_only() -> None:
    snapshot = squeezed(4e-3)
    assert snapshot.served is not None
    touch = deepest(snapshot)
    assert touch is not None
    arcs = rest_arcs(snapshot.served, MESH.triangles, touch, 2e-3)
    assert len(arcs) > 5 and (arcs[..., 0] > 0.6 * RADIUS).all()
    assert np.allclose(np.linalg.norm(arcs, axis=2), RADIUS, atol=2e-4)
    axis = axis_of(touch, snapshot.served)
    assert np.allclose(axis.origin, [RADIUS, 0, 0], atol=2e-4)


@settings(deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.hypot(*v[:2]) > 0.1))
def test_a_ray_at_the_ball_hits_its_near_side_where_it_says(towards: list[float]) -> None:
    eye = np.array(towards) / np.linalg.norm(towards) * 0.2
    found = hit(eye, -eye, MESH.rest, MESH.triangles)
    assert found is not None
    corners, weights = found
    place = weights @ MESH.rest[corners]
    assert np.linalg.norm(np.cross(place, eye)) < 1e-9 and place @ eye > 0
    assert weights.sum() == pytest.approx(1.0) and (weights >= -1e-9).all()


def test_a_ray_past_the_ball_hits_nothing() -> None:
    away, ahead = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    assert hit(away, ahead, MESH.rest, MESH.triangles) is None
