# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the `hand_bridge` node: name, default, range, and what it means."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from barrett_hand_bridge.arm import ArmError, pose_from_numbers
from barrett_hand_bridge.description.names import names
from barrett_hand_bridge.gcl.realtime import FEEDBACK
from grasp_common import parameter_table
from grasp_common.parameter_table import Parameter, ParameterError
from grasp_common.terminal import printable


def _length_m(name: str, default: float, description: str, highest: float = 0.5) -> Parameter:
    return Parameter(name, default, description + ' (m)', 0.0, highest)


_DECLARED = (
    Parameter(
        'backend',
        'serial',
        'serial: BH8-262 on RS-232; can: BH8-280/282 on CAN; emulator: an emulated BH8-262 '
        'started by the node itself',
        choices=('serial', 'can', 'emulator'),
    ),
    Parameter(
        'port',
        '/dev/ttyUSB0',
        'serial port of the hand; a name in /dev/serial/by-id stays when it is plugged in again',
    ),
    Parameter('baud', 38400, 'line speed (bit/s): 9600, 19200 or 38400', 9600, 38400),
    Parameter('interface', 'socketcan', 'python-can interface of the CAN bus'),
    Parameter('channel', 'can0', 'python-can channel of the CAN bus'),
    Parameter('can_port', 43113, 'UDP port when interface is udp_multicast', 1024, 65535),
    Parameter(
        'can_nodes',
        [11, 12, 13, 14],
        'nodes of fingers 1, 2, 3 and the spread of a BH8-280, for two hands on one bus',
        1,
        31,
        length=4,
    ),
    Parameter(
        'can_group',
        5,
        'group of the four motors of a BH8-280: 5, or from 13 on another one for each further '
        'hand on the bus',
        5,
        31,
    ),
    Parameter(
        'inner_encoders',
        True,
        'believe the inner-link encoders of a BH8-280; false where they do not work',
    ),
    Parameter(
        'motor_torque',
        2200,
        'MT, highest torque of a motor of a BH8-280 in its own units; bounds every squeeze, also '
        'when this process is late',
        100,
        5000,
    ),
    Parameter(
        'hottest',
        65.0,
        'temperature of a motor or its controller at which holding and moving end (degrees C)',
        40.0,
        80.0,
    ),
    Parameter(
        'touch',
        'none',
        'touch cells of a BH8-280, fingers and palm: none, top10 or full; each pressed cell '
        'becomes a contact',
        choices=('none', 'top10', 'full'),
    ),
    Parameter(
        'touch_threshold', 0.5, 'pressure from which a touch cell is a contact (N/cm2)', 0.0, 16.0
    ),
    Parameter('calibration', '', 'calibration file of this hand (YAML, from hand_calibrate)'),
    Parameter('emulator_object', '', 'object file for backend emulator; empty: nothing to grasp'),
    Parameter('emulator_seed', 1, 'seed of the emulated gauges', 0, 2**31 - 1),
    Parameter('autostart', True, 'configure and activate the node when it starts'),
    Parameter('wait_for_hand', False, 'keep trying when no hand answers at start'),
    Parameter(
        'initialize_on_start', False, 'initialise the hand when it is found: ITS FINGERS MOVE'
    ),
    Parameter('tare_on_start', False, 'take the zeros when the first samples come'),
    Parameter(
        'poll_period', 0.0, 'time between cycles in ROS time (s); 0: as fast as the link', 0.0, 1.0
    ),
    Parameter(
        'state_rate',
        100.0,
        'highest rate of joint states, wrenches and gauge counts (Hz); contacts come every cycle',
        1.0,
        1000.0,
    ),
    Parameter('hand_frame', 'hand_base', 'frame of contacts: the palm of the hand'),
    Parameter(
        'link_prefix',
        '',
        'before the names of the links between them in robot_description and TF',
    ),
    Parameter(
        'publish_tf',
        True,
        'publish TF of the fingers (and of the hand, with arm); false beside a '
        'robot_state_publisher',
    ),
    Parameter(
        'tip_frames',
        ['finger_1_tip', 'finger_2_tip', 'finger_3_tip'],
        'frames of the three wrenches',
        length=3,
    ),
    Parameter(
        'joint_names',
        [
            'spread',
            'finger_1_inner',
            'finger_1_outer',
            'finger_2_inner',
            'finger_2_outer',
            'finger_3_inner',
            'finger_3_outer',
        ],
        'names in hand/joint_states: spread, then inner and outer joint of each finger',
        length=7,
    ),
    _length_m('palm_offset', 0.025, 'Aw: spread axes of fingers 1 and 2 from the palm centre'),
    _length_m('palm_height', 0.084, 'Dw: inner joints above the base frame'),
    _length_m('link_1', 0.050, 'A1: spread axis to inner joint'),
    _length_m('link_2', 0.070, 'A2: inner to outer joint'),
    _length_m('link_3', 0.050, 'A3: outer joint to the fingertip frame'),
    _length_m('pad_height', 0.0095, 'D3: pad surface above the line of the outer link'),
    Parameter(
        'joint_2_offset',
        math.radians(2.46),
        'Phi2: built-in angle of the inner joint (rad)',
        -1.0,
        1.0,
    ),
    Parameter(
        'joint_3_offset',
        math.radians(50.0),
        'Phi3: built-in angle of the outer joint (rad)',
        0.0,
        1.5,
    ),
    Parameter('outer_link_mass', 0.1, 'mass of an outer link with its pin (kg)', 0.0, 1.0),
    _length_m('outer_link_centre', 0.025, 'centre of that mass from the outer joint'),
    Parameter(
        'gravity',
        [0.0, 0.0, -1.0],
        'direction of gravity in the hand frame; zeros: unknown, weights are not taken off',
        -1.0,
        1.0,
        length=3,
    ),
    Parameter('pin_length', [0.040] * 3, 'length of each pin (m)', 0.0, 0.2, length=3),
    Parameter('pin_radius', [0.001] * 3, 'radius of each pin end (m)', 1e-5, 0.05, length=3),
    Parameter(
        'pin_forward',
        [0.020] * 3,
        'foot of each pin beyond the tip (m)',
        -0.1,
        0.1,
        length=3,
    ),
    Parameter(
        'pin_sideways', [0.0] * 3, 'foot of each pin across the link (m)', -0.1, 0.1, length=3
    ),
    Parameter(
        'pin_lean',
        [math.radians(30.75)] * 3,
        'lean of each pin from the pad normal towards the fingertip (rad)',
        -1.6,
        1.6,
        length=3,
    ),
    Parameter('pin_position_sigma', 0.0005, 'how well a pin end is placed (m)', 0.0, 0.01),
    Parameter('pin_direction_sigma', math.radians(3.0), 'how well a pin points (rad)', 0.0, 0.5),
    Parameter(
        'opposed_fingers',
        [1, 2],
        'fingers that face each other: their normals lie on the line between their pins; [0]: '
        'every normal is the direction of its pin',
        0,
        3,
    ),
    Parameter(
        'tendon_compliance', 0.02, 'stretch of the tendons at joint 3 (rad per N m)', 0.0, 0.2
    ),
    Parameter('tendon_sigma', 0.004, 'its standard deviation (rad per N m)', 0.0, 0.2),
    Parameter(
        'tendon_play',
        0.0035,
        'play of the tendons to be expected either way until the release of a hard squeeze has '
        'shown it (rad)',
        0.0,
        0.1,
    ),
    Parameter('follow_drift', True, 'follow the gauge zeros while the fingers are free'),
    Parameter('servo_sample_time', 0.01, 'servo sample of the BH8-262 (s)', 0.001, 0.1),
    Parameter(
        'feedback',
        ['strain', 'position'],
        'what a RealTime block of the BH8-262 brings: strain, position or delta (its change, one '
        'byte less per motor), breakaway (positions, firmware 4.4 on), temperature',
        choices=FEEDBACK,
    ),
    Parameter(
        'arm',
        'none',
        'where hand_pose comes from: none; pose: arm/pose (PoseStamped of the flange); cobra_600: '
        'arm/joint_states of an Adept Cobra 600',
        choices=('none', 'pose', 'cobra_600'),
    ),
    Parameter('world_frame', 'world', 'frame of hand_pose when it comes from arm joints'),
    Parameter(
        'arm_joint_names',
        ['joint_1', 'joint_2', 'joint_3', 'joint_4'],
        'the four joints of the SCARA in arm/joint_states; joint 3 in m, positive down',
        length=4,
    ),
    _length_m('arm_link_1', 0.325, 'first link of the SCARA', 2.0),
    _length_m('arm_link_2', 0.275, 'second link of the SCARA', 2.0),
    _length_m('arm_height', 0.387, 'flange above the base of the SCARA at joint 3 = 0', 2.0),
    Parameter(
        'hand_mount',
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        'hand frame in the flange frame: x y z (m) and quaternion x y z w',
        -2.0,
        2.0,
        length=7,
    ),
    Parameter('close_fingers', [1, 2], 'fingers that hand/close closes', 1, 3),
    Parameter('close_force', 5.0, 'force at which hand/close stops (N)', 0.1, 25.0),
    Parameter('torque_limit', 1.0, 'torque that ends any motion (N m)', 0.01, 1.5),
    Parameter('approach_speed', 0.3, 'joint 2 speed before touch (rad/s)', 0.005, 2.5),
    Parameter('squeeze_speed', 0.02, 'joint 2 speed after touch (rad/s)', 0.001, 0.5),
    Parameter('open_speed', 0.8, 'joint 2 speed of hand/open (rad/s)', 0.005, 2.5),
)
LIVE = ('close_force', 'torque_limit', 'approach_speed', 'squeeze_speed', 'open_speed')
"""May change while the hand is connected; all others take effect at configure."""

PARAMETERS: tuple[Parameter, ...] = tuple(
    parameter if parameter.name in LIVE else replace(parameter, settable='configure')
    for parameter in _DECLARED
)
BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


def check_all(values: Mapping[str, Any]) -> None:
    """Check all values together.

    Raises:
        ParameterError: the first that is wrong.
    """
    parameter_table.check_known(PARAMETERS, values)
    if not 13 <= values['can_group'] <= 31 and values['can_group'] != 5:
        raise ParameterError(
            f'parameter can_group is {values["can_group"]}, must be 5 or 13 to 31: the others '
            'belong to the arm and to answers'
        )
    if len(set(values['can_nodes'])) != 4:
        raise ParameterError(f'parameter can_nodes is {values["can_nodes"]}: one node per motor')
    gravity = values['gravity']
    size = math.sqrt(sum(g * g for g in gravity))
    if size > 1e-9 and abs(size - 1.0) > 1e-3:
        raise ParameterError(f'parameter gravity has length {size:.4f}, must be 1 (or all zeros)')
    try:
        pose_from_numbers(values['hand_mount'])
    except ArmError as error:
        raise ParameterError(f'parameter hand_mount: {error}') from error
    called = names(values)
    _check_names(
        'hand_frame, tip_frames, world_frame and link_prefix',
        [*called.frames, str(values['world_frame'])],
    )
    _check_names('joint_names', called.joint_names)
    opposed = list(values['opposed_fingers'])
    if opposed != [0] and (len(opposed) != 2 or opposed[0] == opposed[1] or 0 in opposed):
        raise ParameterError(
            f'parameter opposed_fingers is {opposed}, must be two different fingers or [0]'
        )


def _check_names(parameters: str, given: Sequence[str]) -> None:
    """TF is a tree: a frame that is its own parent, or has no name, is in none."""
    for name in given:
        if not name.strip() or name.startswith('/') or not name.isprintable():
            raise ParameterError(
                f'{printable(repr(name), 80)} is no name (parameters {parameters}): printable '
                'ones without a leading slash are'
            )
        if given.count(name) > 1:
            raise ParameterError(
                f'{printable(repr(name), 80)} is the name of two things (parameters '
                f'{parameters}): give each its own'
            )


def usage() -> str:
    """What `hand_bridge --help` prints: every parameter with its unit, range and default."""
    return parameter_table.usage(
        'hand_bridge',
        'A BarrettHand on its topics: joint states, wrenches, contacts, gauge counts.',
        PARAMETERS,
    )
