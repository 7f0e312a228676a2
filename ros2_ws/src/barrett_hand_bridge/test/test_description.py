# SPDX-License-Identifier: Apache-2.0
"""URDF and meshes of the hand: one tree, the frames of the kinematics, files as they are made."""

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.description import meshes, urdf
from barrett_hand_bridge.description.names import Names
from barrett_hand_bridge.kinematics import HandGeometry, finger_frames

ROOT = ElementTree.fromstring(urdf.urdf(HandGeometry(), Names()))
ANGLES = st.floats(0.0, 1.0)


def turn(axis, angle):
    x, y, z = axis
    c, s, d = math.cos(angle), math.sin(angle), 1.0 - math.cos(angle)
    place = np.eye(4)
    place[:3, :3] = [
        [c + x * x * d, x * y * d - z * s, x * z * d + y * s],
        [y * x * d + z * s, c + y * y * d, y * z * d - x * s],
        [z * x * d - y * s, z * y * d + x * s, c + z * z * d],
    ]
    return place


def numbers(element, name):
    return [float(word) for word in element.get(name).split()]


def origin(joint):
    element = joint.find('origin')
    roll, pitch, yaw = numbers(element, 'rpy')
    place = turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)
    place[:3, 3] = numbers(element, 'xyz')
    return place


def pose(link, angles):
    """Pose of a link in the hand frame, from the XML alone."""
    for joint in ROOT.findall('joint'):
        if joint.find('child').get('link') != link:
            continue
        place = pose(joint.find('parent').get('link'), angles) @ origin(joint)
        if joint.get('type') == 'revolute':
            mimic = joint.find('mimic')
            name = joint.get('name') if mimic is None else mimic.get('joint')
            place = place @ turn(numbers(joint.find('axis'), 'xyz'), angles[name])
        return place
    return np.eye(4)


@pytest.mark.parametrize('finger', [1, 2, 3])
@given(spread=ANGLES, inner=ANGLES, outer=ANGLES)
def test_every_tip_stands_where_the_kinematics_put_it(finger, spread, inner, outer):
    angles = {
        'spread': spread,
        f'finger_{finger}_inner': inner,
        f'finger_{finger}_outer': outer,
    }
    frames = finger_frames(HandGeometry(), finger, spread, inner, outer)
    assert pose(f'finger_{finger}_tip', angles) == pytest.approx(frames.tip, abs=1e-8)
    assert pose(f'finger_{finger}_outer_link', angles) == pytest.approx(frames.joint_3, abs=1e-8)


def test_the_description_is_one_tree_with_the_joints_of_joint_states():
    links = {link.get('name') for link in ROOT.findall('link')}
    children = [joint.find('child').get('link') for joint in ROOT.findall('joint')]
    assert len(children) == len(set(children))
    assert links - set(children) == {'hand_base'}
    moving = {j.get('name') for j in ROOT.findall('joint') if j.get('type') == 'revolute'}
    assert moving == {*Names().joint_names, 'spread_2'}


@given(spread=ANGLES, inner=ANGLES, outer=ANGLES)
def test_the_links_of_tf_multiply_to_the_outer_link(spread, inner, outer):
    frames = finger_frames(HandGeometry(), 1, spread, inner, outer)
    parts = urdf.chain(HandGeometry(), 1, spread, inner, frames.joint_3)
    assert parts[0] @ parts[1] @ parts[2] == pytest.approx(frames.joint_3, abs=1e-12)


def _volume(triangles):
    """Of a closed body, m^3."""
    return float(np.einsum('ij,ij->', triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])))


@pytest.mark.parametrize(('link', 'side'), [('outer_link', 0.0095), ('inner_link', 0.012)])
def test_rounding_leaves_the_extent_of_a_link(link, side):
    corners = meshes.bodies()[link].reshape(-1, 3)
    assert corners[:, 1].max() == pytest.approx(side, abs=5e-4)


def test_the_meshes_are_closed_and_as_they_are_made():
    for name, triangles in meshes.bodies().items():
        file = meshes.FOLDER / f'{name}.stl'
        rows = np.frombuffer(file.read_bytes()[84:], meshes.STL_ROW)
        made, kept = (_volume(t) for t in (triangles, rows['corners'].astype(float)))
        assert made == pytest.approx(kept, rel=1e-5) and kept > 0.0
        # The signed volume of a closed body with outward faces: positive wherever it stands.
        for shift in (0.0, 1.0):
            moved = triangles + shift
            volume = np.einsum('ij,ij->i', moved[:, 0], np.cross(moved[:, 1], moved[:, 2])).sum()
            assert 1e-5 < volume / 6.0 < 1e-3


def test_the_xacro_macro_is_as_it_is_made_and_carries_its_prefix():
    text = urdf.MACRO.read_text()
    assert text == urdf.macro()
    macro = ElementTree.fromstring(text).find('{http://www.ros.org/wiki/xacro}macro')
    named = [e.get('name') for e in macro if e.tag in ('link', 'joint')]
    assert all(name.startswith('${prefix}') for name in named)
