# SPDX-License-Identifier: Apache-2.0
"""URDF of the hand from its link constants; the shipped xacro macro is the same with a prefix.

Links and joints stand where the kinematics put them: modified Denavit-Hartenberg frames, every
joint about the z axis of its link. `python -m barrett_hand_bridge.description.urdf` writes the
macro again.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from barrett_hand_bridge.description.names import Names
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.kinematics import Array, HandGeometry, modified_dh
from barrett_hand_bridge.motion import FINGER_TRAVEL_RAD

MACRO = Path(__file__).parent / 'barrett_hand.urdf.xacro'
MESHES = 'package://barrett_hand_bridge/meshes'
OUTER_TRAVEL_RAD = 0.84
FASTEST_RAD_S = 2.5
# Of plausible size, for simulators that want some: the maker gives no masses of links.
MASSES_KG = {'palm': 0.7, 'knuckle': 0.1, 'inner_link': 0.1, 'outer_link': 0.1}
INERTIA_KG_M2 = 1e-4


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Angles in rad of a rotation matrix (3, 3): about x, then y, then z of the parent."""
    pitch = -math.asin(max(-1.0, min(1.0, float(rotation[2, 0]))))
    roll = math.atan2(float(rotation[2, 1]), float(rotation[2, 2]))
    return roll, pitch, math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def urdf(geometry: HandGeometry, called: Names, name: str = 'barrett_hand') -> str:
    """The whole description as XML."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{name}">', *elements(geometry, called)]
    return '\n'.join([*lines, '</robot>', ''])


def elements(geometry: HandGeometry, called: Names) -> list[str]:
    """Links and joints of the hand, without a root element."""
    lines = _link(called.hand_frame, 'palm')
    for finger in FINGERS:
        side = {1: -1.0, 2: 1.0, 3: 0.0}[finger]
        facing = {1: 1.0, 2: 1.0, 3: -1.0}[finger]
        g = geometry
        knuckle, inner, outer = called.knuckle(finger), called.inner(finger), called.outer(finger)
        place = modified_dh(side * g.palm_offset_m, 0.0, g.palm_height_m, -facing * math.pi / 2)
        lines += _link(knuckle, 'knuckle')
        lines += _spread(finger, called, knuckle, place)
        lines += _link(inner, 'inner_link')
        lines += _joint(
            called.inner_joint(finger),
            (knuckle, inner),
            modified_dh(g.link_1_m, math.pi / 2, 0.0, g.joint_2_offset_rad),
            FINGER_TRAVEL_RAD,
        )
        lines += _link(outer, 'outer_link')
        lines += _joint(
            called.outer_joint(finger),
            (inner, outer),
            modified_dh(g.link_2_m, 0.0, 0.0, g.joint_3_offset_rad),
            FINGER_TRAVEL_RAD / 3.0 + OUTER_TRAVEL_RAD,
        )
        lines.append(f'  <link name="{called.tip(finger)}"/>')
        tip = modified_dh(g.link_3_m, -math.pi / 2, g.pad_height_m, 0.0)
        lines += _fixed((outer, called.tip(finger)), tip)
    return lines


def _spread(finger: int, called: Names, knuckle: str, place: Array) -> list[str]:
    spread, pair = called.joint_names[0], (called.hand_frame, knuckle)
    if finger == 3:
        return _fixed(pair, place)
    if finger == 1:
        return _joint(spread, pair, place, math.pi, axis='0 0 -1')
    mimic = f'    <mimic joint="{spread}"/>'
    return _joint(f'{spread}_2', pair, place, math.pi, more=[mimic])


def _origin(place: Array) -> str:
    numbers = [*place[:3, 3], *roll_pitch_yaw(place[:3, :3])]
    words = [f'{round(float(number), 9) + 0.0:.9g}' for number in numbers]
    return f'<origin xyz="{" ".join(words[:3])}" rpy="{" ".join(words[3:])}"/>'


def _link(name: str, mesh: str) -> list[str]:
    shape = f'<geometry><mesh filename="{MESHES}/{mesh}.stl"/></geometry>'
    moment = ' '.join(
        f'{axis}="{INERTIA_KG_M2:g}"' if axis[1] == axis[2] else f'{axis}="0"'
        for axis in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
    )
    return [
        f'  <link name="{name}">',
        f'    <visual>{shape}</visual>',
        f'    <collision>{shape}</collision>',
        f'    <inertial><mass value="{MASSES_KG[mesh]:g}"/><inertia {moment}/></inertial>',
        '  </link>',
    ]


def _joint(
    name: str,
    pair: tuple[str, str],
    place: Array,
    highest_rad: float,
    *,
    axis: str = '0 0 1',
    more: Sequence[str] = (),
) -> list[str]:
    limit = f'lower="0" upper="{highest_rad:.4f}" effort="2" velocity="{FASTEST_RAD_S:g}"'
    return [
        f'  <joint name="{name}" type="revolute">',
        f'    <parent link="{pair[0]}"/><child link="{pair[1]}"/>',
        f'    {_origin(place)}<axis xyz="{axis}"/><limit {limit}/>',
        *more,
        '  </joint>',
    ]


def _fixed(pair: tuple[str, str], place: Array) -> list[str]:
    return [
        f'  <joint name="{pair[1]}_fixed" type="fixed">',
        f'    <parent link="{pair[0]}"/><child link="{pair[1]}"/>',
        f'    {_origin(place)}',
        '  </joint>',
    ]


def macro() -> str:
    """A xacro macro that hangs a hand with a prefix on a link of an arm."""
    before = '${prefix}'
    called = Names(
        f'{before}hand_base',
        (f'{before}finger_1_tip', f'{before}finger_2_tip', f'{before}finger_3_tip'),
        tuple(f'{before}{joint}' for joint in Names().joint_names),
        before,
    )
    body = [f'  {line}' for line in elements(HandGeometry(), called)]
    return '\n'.join(
        [
            '<?xml version="1.0"?>',
            '<!-- Written by barrett_hand_bridge.description.urdf. Use: <xacro:include ...>, then',
            '     <xacro:barrett_hand parent="flange" prefix="left_"/>; a node beside it has the',
            '     parameters link_prefix, hand_frame, tip_frames and joint_names to match. -->',
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro">',
            '  <xacro:macro name="barrett_hand" params="parent prefix:=\'\' *origin">',
            f'    <joint name="{before}hand_mount" type="fixed">',
            f'      <parent link="${{parent}}"/><child link="{before}hand_base"/>',
            '      <xacro:insert_block name="origin"/>',
            '    </joint>',
            *body,
            '  </xacro:macro>',
            '</robot>',
            '',
        ]
    )


def chain(
    geometry: HandGeometry, finger: int, spread: float, inner: float, joint_3: Array
) -> tuple[Array, Array, Array]:
    """Knuckle in the hand, inner link in the knuckle, outer link in the inner one, (4, 4) each.

    `joint_3`: the outer link in the hand frame, with its tendons stretched.
    """
    side = {1: -1.0, 2: 1.0, 3: 0.0}[finger]
    facing = {1: 1.0, 2: 1.0, 3: -1.0}[finger]
    g = geometry
    knuckle = modified_dh(
        side * g.palm_offset_m, 0.0, g.palm_height_m, side * spread - facing * math.pi / 2
    )
    second = modified_dh(g.link_1_m, math.pi / 2, 0.0, inner + g.joint_2_offset_rad)
    return knuckle, second, np.linalg.inv(knuckle @ second) @ joint_3


def main() -> int:
    """Write the macro again."""
    MACRO.write_text(macro(), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
