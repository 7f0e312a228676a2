# SPDX-License-Identifier: Apache-2.0
"""Arm poses and touch cells."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.arm import (
    ArmError,
    ScaraLengths,
    gravity_in_hand,
    pose_from_numbers,
    quaternion_of,
    rotation_matrix,
    scara_flange,
)
from barrett_hand_bridge.kinematics import HandGeometry, finger_frames
from barrett_hand_bridge.touch import (
    PALM,
    finger_cells,
    palm_cells,
    touch_cells,
    touch_contacts,
)

components = st.floats(-1, 1)


def test_a_stretched_scara_reaches_600_mm():
    flange = scara_flange(ScaraLengths(), [0.0, 0.0, 0.0, 0.0])
    assert flange.position == pytest.approx([0.6, 0.0, 0.387])


def test_joint_3_moves_down_and_the_flange_looks_down():
    flange = scara_flange(ScaraLengths(), [0.0, 0.0, 0.1, 0.0])
    assert flange.position[2] == pytest.approx(0.287)
    assert flange.rotation[:, 2] == pytest.approx([0, 0, -1])


def test_a_bent_elbow_turns_the_forearm():
    flange = scara_flange(ScaraLengths(), [0.0, math.pi / 2, 0.0, 0.0])
    assert flange.position == pytest.approx([0.325, 0.275, 0.387])
    assert flange.rotation[:, 0] == pytest.approx([0, 1, 0], abs=1e-12)


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4))
def test_every_flange_is_a_proper_rotation(joints):
    rotation = scara_flange(ScaraLengths(), joints).rotation
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@given(st.tuples(components, components, components, components))
def test_quaternions_and_matrices_are_the_same_rotation(q):
    if np.linalg.norm(q) < 0.1:
        return
    rotation = rotation_matrix(q)
    again = rotation_matrix(quaternion_of(rotation))
    assert again == pytest.approx(rotation, abs=1e-9)


def test_gravity_follows_the_hand_upside_down():
    hand = scara_flange(ScaraLengths(), [0.3, 0.2, 0.0, 0.1])
    assert gravity_in_hand(hand) == pytest.approx([0, 0, 1])


@pytest.mark.parametrize('numbers', [[0.0] * 7, [0.0] * 6, [math.nan] + [0.0] * 5 + [1.0]])
def test_what_is_no_pose_is_refused(numbers):
    with pytest.raises(ArmError):
        pose_from_numbers(numbers)


def test_the_length_of_a_quaternion_does_not_matter_however_large():
    with np.errstate(over='raise'):
        pose = pose_from_numbers([0.0, 0.0, 0.0, 0.0, 0.0, 1e300, 1e300])
    assert pose.rotation @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0])


def test_three_joints_are_no_scara():
    with pytest.raises(ArmError, match='four finite numbers'):
        scara_flange(ScaraLengths(), [0.0, 0.0, 0.0])


def test_a_finger_has_24_cells_with_unit_normals_where_the_published_table_has_them():
    cells = finger_cells(0.0095)
    assert len(cells) == 24
    assert all(np.linalg.norm(cell.normal) == pytest.approx(1.0) for cell in cells)
    assert cells[0].centre == pytest.approx([0.02225, 0.0095, 0.0052])
    assert cells[10].centre == pytest.approx([0.0402349, 0.00905695, 0.0])
    assert cells[-2].centre == pytest.approx([0.0554163, 0.00213234, 0.0])


def test_the_rows_of_a_finger_bend_over_the_tip_without_a_step():
    cells = finger_cells(0.0095)[1::3]
    for one, following in zip(cells, cells[1:], strict=False):
        chord = following.centre - one.centre
        chord /= np.linalg.norm(chord)
        # A convex pad: the way to the next row falls below this row's plane, not below that one's.
        assert one.normal @ chord <= 1e-6 <= following.normal @ chord + 1e-3
        assert one.normal @ following.normal > 0.85


def test_the_palm_has_rows_of_5_7_7_and_5_cells_below_the_inner_joints_looking_outward():
    cells = palm_cells(0.084)
    assert len(cells) == 24
    rows = np.array([cell.centre[1] for cell in cells])
    assert np.unique(rows, return_counts=True)[1].tolist() == [5, 7, 7, 5]
    assert cells[0].centre == pytest.approx([-0.022, -0.0159, 0.0813034])
    assert sum(cell.centre for cell in cells)[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert all(cell.normal.tolist() == [0.0, 0.0, 1.0] for cell in cells)


def poses_of_a_half_closed_hand():
    return {f: finger_frames(HandGeometry(), f, 0.0, 0.5, 0.17).joint_3 for f in (1, 2, 3)}


def test_a_pressed_cell_is_a_contact_pushing_out_of_the_pad():
    pressures = {2: tuple(4.0 if cell == 4 else 0.1 for cell in range(24))}
    contacts = touch_contacts(
        pressures, poses_of_a_half_closed_hand(), touch_cells(HandGeometry()), 0.5
    )
    assert len(contacts) == 1
    contact = contacts[0]
    assert contact.finger == 2
    pad = finger_frames(HandGeometry(), 2, 0.0, 0.5, 0.17).tip[:3, 2]
    assert contact.normal == pytest.approx(pad, abs=1e-12)
    # 4 N/cm2 on 5.5 mm x 4.7 mm.
    assert contact.force @ contact.normal == pytest.approx(4e4 * 5.5e-3 * 4.7e-3)


def test_a_pressed_palm_cell_is_a_contact_of_finger_4_in_the_hand_frame():
    pressures = {PALM: tuple(2.0 if cell == 8 else 0.0 for cell in range(24))}
    contacts = touch_contacts(
        pressures, poses_of_a_half_closed_hand(), touch_cells(HandGeometry()), 0.5
    )
    assert [contact.finger for contact in contacts] == [4]
    # The middle of the second row; 2 N/cm2 on 10 mm x 9.7 mm.
    assert contacts[0].point == pytest.approx([0.0, -0.0053, 0.0813034])
    assert contacts[0].force == pytest.approx([0.0, 0.0, 2e4 * 10e-3 * 9.7e-3])
