# SPDX-License-Identifier: Apache-2.0
"""The hand by its URDF: where its links are, whose meshes they show, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_view.hand_description import (
    DescriptionError,
    barrett_hand,
    joint_positions,
    package_file,
    read_description,
)
from grasp_view.hand_layer import pins_of, read_mesh
from grasp_view.poses import Pose
from grasp_view.scene_model import Contacts, Snapshot

HAND = barrett_hand()
CHAIN = """<robot name="r">
  <link name="b"/><link name="a"/><link name="c"/>
  <joint name="second" type="prismatic"><parent link="a"/><child link="c"/>
    <axis xyz="0 0 2"/></joint>
  <joint name="first" type="revolute"><parent link="b"/><child link="a"/>
    <origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ('finger', 'spread', 'base', 'tip', 'axis'),
    [
        (1, 0, 0, (-25, -142.868, 132.439), (0, 0.7929, 0.6093)),
        (3, 0, 0, (0, 142.868, 132.439), (0, -0.7929, 0.6093)),
        (1, 0, 60, (-25, -41.603, 176.542), (0, 0.7377, -0.6751)),
        (3, 0, 90, (0, -3.819, 151.079), (0, -0.1312, -0.9914)),
        (1, 90, 0, (-167.868, 0, 132.439), (0.7929, 0, 0.6093)),
        (2, 180, 45, (25, 69.446, 178.154), (0, -0.9241, -0.3820)),
    ],
)
def test_the_fingertip_is_where_the_hands_kinematics_puts_it(
    finger: int, spread: float, base: float, tip: tuple, axis: tuple
) -> None:
    assert HAND is not None
    angle = np.radians(base)
    joints = {'spread': np.radians(spread), **joint_positions([f'finger_{finger}_inner'], [angle])}
    frame = HAND.places('hand_base', joints)[f'finger_{finger}_tip']
    assert np.allclose(frame.translation * 1e3, tip, atol=2e-3)
    assert np.allclose(frame.rotation[:, 2], axis, atol=1e-4)


def test_every_link_of_the_barrett_hand_has_a_mesh_on_this_machine() -> None:
    assert HAND is not None
    assert len(HAND.visuals) == 10
    for visual in HAND.visuals:
        mesh = read_mesh(package_file(visual.address))
        assert mesh is not None and len(mesh[1]) > 100, visual.address


def test_links_behind_an_unknown_joint_are_left_out() -> None:
    assert HAND is not None
    places = HAND.places('hand_base', {'spread': 0.0, 'finger_1_inner': 0.3})
    assert 'finger_1_inner_link' in places and 'finger_1_outer_link' not in places
    assert 'finger_3_knuckle' in places and 'finger_3_inner_link' not in places


def test_a_finger_without_its_outer_joint_follows_the_gears() -> None:
    found = joint_positions(['finger_2_inner', 'other'], np.array([0.9, np.nan]))
    assert found == {'finger_2_inner': 0.9, 'finger_2_outer': pytest.approx(0.3)}


def test_joints_are_placed_parents_first_whatever_their_order_in_the_file() -> None:
    places = read_description(CHAIN).places('b', {'first': np.pi / 2, 'second': 0.5})
    assert np.allclose(places['c'].translation, [1.0, 0.0, 0.5])
    assert np.allclose(places['a'].rotation, -np.diag([1.0, 1.0, -1.0]), atol=1e-12)
    seen_from_a = read_description(CHAIN).places('a', {'first': np.pi / 2, 'second': 0.5})
    assert np.allclose(seen_from_a['c'].translation, [0.0, 0.0, 0.5])


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('<robot', 'no XML'),
        ('<robot><joint name="j" type="fixed"><child link="a"/></joint></robot>', 'lacks'),
        (CHAIN.replace('1 0 0', '1 0'), "xyz '1 0'"),
        (CHAIN.replace('1 0 0', '1 0 nan'), 'finite'),
        (CHAIN.replace('0 0 2', '0 0 0'), 'about no axis'),
        (CHAIN.replace('<parent link="b"/>', '<parent link="c"/>'), 'circle'),
    ],
)
def test_a_description_that_is_none_is_one_sentence(text: str, why: str) -> None:
    with pytest.raises(DescriptionError, match=why):
        read_description(text)


def test_a_robot_of_more_joints_than_a_page_can_draw_is_refused() -> None:
    joint = '<joint name="{0}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'
    chain = ''.join(joint.format(number, number + 1) for number in reversed(range(1001)))
    with pytest.raises(DescriptionError, match='1001 joints and 0 visuals; 1000 of each'):
        read_description(f'<robot>{chain}</robot>')


@given(st.text(max_size=60))
def test_no_text_ends_otherwise_than_read_or_refused(text: str) -> None:
    try:
        read_description(f'<robot><link name="{text}"/></robot>')
    except DescriptionError as error:
        assert 'robot_description' in str(error)


@pytest.mark.parametrize(
    'address',
    [
        'file:///etc/passwd',
        'package://',
        'package://barrett_hand_bridge/../parameters.py',
        'package://no_such_package_of_ours/mesh.stl',
        'package://os.path/mesh.stl',
        'package://barrett_hand_bridge//etc/passwd',
    ],
)
def test_only_data_of_packages_are_read(address: str) -> None:
    assert package_file(address) is None


def test_a_pin_joins_its_fingertip_to_the_contact_and_only_while_it_touches() -> None:
    def pressed(flags: int) -> Snapshot:
        one = np.array([[0.0, 0.0, 0.04]])
        contacts = Contacts(
            1.0, 'object', one, one, one, np.ones(1), np.full(1, np.nan), np.array([2]),
            np.array([flags]),
        )  # fmt: skip
        return Snapshot(contacts=contacts)

    places = {'left_finger_2_tip': Pose()}
    (pin,) = pins_of(pressed(1), places)
    assert pin.finger == 2 and np.allclose(pin.end, [0, 0, 0.04]) and np.isfinite(pin.radius)
    assert pins_of(pressed(0), places) == [] and pins_of(pressed(1), {}) == []
