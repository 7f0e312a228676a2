# SPDX-License-Identifier: Apache-2.0
"""The scene: from messages' numbers to touches, cones, lines and files of bodies."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp_view.level_lines import level_lines
from grasp_view.poses import Pose, PoseError, quaternion_wxyz, rotation_of
from grasp_view.scene_model import (
    DIFFERENCE,
    DISPLACEMENT,
    ENERGY,
    QUANTITIES,
    SCAN_ERROR,
    Cloud,
    Contacts,
    Mesh,
    Snapshot,
    Surface,
    deformed,
    friction_cones,
    touches,
    values_of,
)
from grasp_view.unlit_mesh import Body, unlit_glb

RADIUS = 0.03
BALL = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
MESH = Mesh(np.asarray(BALL.faces), np.asarray(BALL.vertices))


def pushed(depth: float) -> Surface:
    moved = np.zeros_like(MESH.rest)
    moved[MESH.rest[:, 0] > 0.9 * RADIUS, 0] = -depth
    return Surface(1.0, 'object', MESH.rest + moved, moved, np.full(len(moved), 1e-4))


def contacts(frame: str = 'object', flags: int = 1) -> Contacts:
    return Contacts(
        1.0,
        frame,
        np.array([[RADIUS, 0.0, 0.0]]),
        np.array([[-1.0, 0.0, 0.0]]),
        np.array([[-12.0, 0.0, 0.0]]),
        np.array([0.25]),
        np.array([0.002]),
        np.array([1]),
        np.array([flags]),
    )


def test_displacement_is_shown_in_millimetres() -> None:
    values = values_of(Snapshot(mesh=MESH, served=pushed(0.004)), DISPLACEMENT, 'served')
    assert values is not None and values.max() == pytest.approx(4.0)


def test_exaggeration_starts_from_the_rest_shape_of_the_answer() -> None:
    surface = pushed(0.002)
    assert np.allclose(deformed(surface, 0.0), MESH.rest)
    assert np.allclose(deformed(surface, 3.0) - MESH.rest, 3 * surface.moved)


def test_linear_minus_nonlinear_needs_both() -> None:
    alone = Snapshot(mesh=MESH, served=pushed(0.0), linear=pushed(0.003))
    assert values_of(alone, DIFFERENCE, 'served') is None
    both = replace(alone, nonlinear=pushed(0.004))
    values = values_of(both, DIFFERENCE, 'served')
    assert values is not None and values.max() == pytest.approx(1.0)


def test_energy_is_unknown_unless_it_is_published() -> None:
    snapshot = Snapshot(mesh=MESH, served=pushed(0.001))
    assert values_of(snapshot, ENERGY, 'served') is None
    dense = replace(pushed(0.001), energy=np.full(len(MESH.rest), 3.0))
    values = values_of(replace(snapshot, served=dense), ENERGY, 'served')
    assert values is not None and (values == 3.0).all()


def test_the_served_answer_takes_the_energy_of_the_nonlinear_one() -> None:
    nonlinear = replace(pushed(0.001), energy=np.full(len(MESH.rest), 2.0))
    snapshot = Snapshot(mesh=MESH, served=pushed(0.001), nonlinear=nonlinear)
    values = values_of(snapshot, ENERGY, 'served')
    assert values is not None and (values == 2.0).all()


def test_scan_error_is_known_only_where_the_scanner_saw() -> None:
    seen = MESH.rest[MESH.rest[:, 2] > 0.3 * RADIUS]
    scan = Cloud(1.0, 'object', seen, np.full(len(seen), -0.0005))
    snapshot = Snapshot(mesh=MESH, served=pushed(0.0), scan_error=scan)
    values = values_of(snapshot, SCAN_ERROR, 'served')
    assert values is not None
    assert np.allclose(values[MESH.rest[:, 2] > 0.4 * RADIUS], -0.5)
    assert np.isnan(values[MESH.rest[:, 2] < -0.2 * RADIUS]).all()


def test_an_answer_of_another_mesh_is_not_drawn() -> None:
    other = replace(pushed(0.001), position=np.zeros((5, 3)), moved=np.zeros((5, 3)))
    snapshot = Snapshot(mesh=MESH, served=other)
    assert all(values_of(snapshot, q, 'served') is None for q in QUANTITIES.values())


def test_a_touch_tells_its_force_sigma_and_flags() -> None:
    (touch,) = touches(Snapshot(contacts=contacts()))
    assert np.allclose(touch.point, [RADIUS, 0, 0]) and np.allclose(touch.force, [-12, 0, 0])
    assert touch.label == 'F1  12.0 ± 0.2 N'
    (flagged,) = touches(Snapshot(contacts=contacts(flags=1 | 2 | 8)))
    assert flagged.label.endswith('N saturated, not tared') and flagged.touching


def test_contacts_of_the_hand_frame_are_moved_into_the_objects() -> None:
    pose = Pose.of([0.0, 0.0, 0.1, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    snapshot = Snapshot(contacts=contacts('hand_base'), object_pose=pose)
    (touch,) = touches(snapshot)
    assert np.allclose(touch.point, [0.0, -RADIUS, -0.1])


def test_a_surface_in_the_hands_frame_leaves_contacts_where_they_are() -> None:
    pose = Pose.of([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    served = replace(pushed(0.0), frame='hand_base')
    snapshot = Snapshot(contacts=contacts('hand_base'), object_pose=pose, served=served)
    assert np.allclose(touches(snapshot)[0].point, [RADIUS, 0, 0])
    assert np.allclose(snapshot.in_scene('object').translation, [0, 0, 0.1])


def test_a_contact_with_nan_is_left_out() -> None:
    broken = replace(contacts(), forces=np.array([[np.nan, 0.0, 0.0]]))
    assert touches(Snapshot(contacts=broken)) == []


def test_a_friction_cone_opens_outward_by_its_coefficient() -> None:
    segments = friction_cones(Snapshot(contacts=contacts()), 0.5, 0.02)
    rim = segments[:16, 1] - np.array([RADIUS, 0, 0])
    assert np.allclose(rim[:, 0], 0.02)
    assert np.allclose(np.linalg.norm(rim[:, 1:], axis=1), 0.01)
    assert len(friction_cones(Snapshot(contacts=contacts(flags=0)), 0.5, 0.02)) == 0


@settings(deadline=None)
@given(st.floats(0.05, 0.9))
def test_level_lines_lie_on_multiples_of_the_step(step: float) -> None:
    height = (MESH.rest[:, 2] / RADIUS) * 0.5 + 0.5
    found = level_lines(MESH.rest, MESH.triangles, height, step)
    assert [level for level, _ in found] == list(range(1, len(found) + 1))
    for level, segments in found:
        assert np.allclose((segments[..., 2] / RADIUS * 0.5 + 0.5) / step, level, atol=1e-6)


def test_a_level_line_round_a_ball_is_closed() -> None:
    ((_, segments),) = level_lines(MESH.rest, MESH.triangles, MESH.rest[:, 2] + RADIUS, 0.041)
    ends = np.round(segments.reshape(-1, 3) * 1e9).astype(np.int64)
    _, count = np.unique(ends, axis=0, return_counts=True)
    assert (count == 2).all()


quaternions = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda q: np.linalg.norm(q) > 0.1
)


@settings(deadline=None)
@given(quaternions)
def test_a_rotation_survives_its_quaternion(numbers: list[float]) -> None:
    rotation = rotation_of(numbers)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    w, x, y, z = quaternion_wxyz(rotation)
    assert np.allclose(rotation_of([x, y, z, w]), rotation, atol=1e-9)


def test_the_length_of_a_quaternion_does_not_matter_however_large() -> None:
    with np.errstate(over='raise'):
        rotation = rotation_of([0.0, 0.0, 1e300, 1e300])
    assert np.allclose(rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


@settings(deadline=None)
@given(quaternions, st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_a_pose_and_its_inverse_cancel(numbers: list[float], place: list[float]) -> None:
    pose = Pose.of([*place, *numbers])
    both = pose.after(pose.inverse)
    assert np.allclose(both.rotation, np.eye(3)) and np.allclose(both.translation, 0)


@pytest.mark.parametrize('numbers', [[0] * 7, [0, 0, 0, 1], [0, 0, np.nan, 0, 0, 0, 1]])
def test_seven_numbers_that_are_no_pose_are_refused(numbers: list[float]) -> None:
    with pytest.raises(PoseError):
        Pose.of(numbers)


def test_the_surface_file_reads_back_as_it_was() -> None:
    colours = np.random.default_rng(0).uniform(0, 2, (len(MESH.rest), 3))
    data = unlit_glb([Body(MESH.rest, MESH.triangles, colours)])
    magic, version, length = struct.unpack_from('<4sII', data)
    assert (magic, version, length) == (b'glTF', 2, len(data))
    size = struct.unpack_from('<I', data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    assert 'KHR_materials_unlit' in document['materials'][0]['extensions']
    read = trimesh.load(
        trimesh.util.wrap_as_stream(data), file_type='glb', force='mesh', process=False
    )
    assert np.allclose(read.vertices, MESH.rest, atol=1e-7)
    assert np.array_equal(read.faces, MESH.triangles)
    start = document['bufferViews'][1]['byteOffset'] + 20 + size + 8
    kept = np.frombuffer(data, '<f4', colours.size, start).reshape(colours.shape)
    assert np.allclose(kept, colours)


def test_a_surface_of_more_than_65535_vertices_keeps_its_indices() -> None:
    count = 70_000
    far = np.array([[0, 1, count - 1]])
    data = unlit_glb([Body(np.zeros((count, 3)), far, np.zeros((count, 3)))])
    assert np.frombuffer(data[-12:], '<u4').tolist() == [0, 1, count - 1]


def test_a_body_of_one_colour_is_seen_from_one_side_where_it_says_so() -> None:
    hull = Body(MESH.rest, MESH.triangles[:, ::-1], np.array([0.1, 0.2, 0.3]), both=False)
    data = unlit_glb([hull])
    document = json.loads(data[20 : 20 + struct.unpack_from('<I', data, 12)[0]])
    (material,) = document['materials']
    assert not material['doubleSided']
    assert material['pbrMetallicRoughness']['baseColorFactor'] == [0.1, 0.2, 0.3, 1.0]
