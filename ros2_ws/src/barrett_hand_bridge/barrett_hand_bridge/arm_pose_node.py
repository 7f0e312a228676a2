# SPDX-License-Identifier: Apache-2.0
"""The arm's part of the bridge node: `hand_pose`, and gravity as the arm turns the hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from barrett_hand_bridge import messages
from barrett_hand_bridge.arm import (
    ArmError,
    Pose,
    ScaraLengths,
    gravity_in_hand,
    pose_from_numbers,
    quaternion_of,
    scara_flange,
)
from barrett_hand_bridge.description.names import names
from barrett_hand_bridge.kinematics import Array
from grasp_common.messages import nanoseconds
from grasp_common.terminal import printable


class ArmPose:
    """Publishes `hand_pose` from the arm's own pose or joints; tells gravity's direction."""

    def __init__(
        self,
        node: LifecycleNode,
        values: Mapping[str, Any],
        tell_gravity: Callable[[Array], None],
        tell_pose: Callable[[str, Array, int], None],
    ) -> None:
        """Listen to `arm/pose` or `arm/joint_states`, as parameter `arm` says.

        Raises:
            ArmError: the mounting pose is no pose.
        """
        self._node = node
        self._values = values
        self._tell_gravity = tell_gravity
        self._tell_pose = tell_pose
        self._mount = pose_from_numbers(values['hand_mount'])
        self._own_frames = names(values).frames
        self._publisher = node.create_publisher(PoseStamped, 'hand_pose', 10)
        self._subscription = (
            node.create_subscription(
                PoseStamped, 'arm/pose', self._on_pose, qos_profile_sensor_data
            )
            if values['arm'] == 'pose'
            else node.create_subscription(
                JointState, 'arm/joint_states', self._on_joints, qos_profile_sensor_data
            )
        )

    def end(self) -> None:
        """Stop listening and publishing."""
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_publisher(self._publisher)

    def _on_pose(self, message: PoseStamped) -> None:
        try:
            flange = pose_from_numbers(messages.pose_numbers(message))
        except ArmError as error:
            self._complain(f'arm/pose: {error}')
            return
        frame = message.header.frame_id
        if not frame or frame in self._own_frames:
            # As a parent of the hand in TF it would be its own.
            self._complain(
                f'arm/pose: {printable(repr(frame), 80)} is no frame outside the hand: not used'
            )
            return
        self._publish(flange, nanoseconds(message.header.stamp), frame)

    def _on_joints(self, message: JointState) -> None:
        positions = messages.joint_positions(message)
        names = self._values['arm_joint_names']
        missing = [name for name in names if name not in positions]
        if missing:
            self._complain(f'arm/joint_states: joint {missing[0]!r} is missing')
            return
        lengths = ScaraLengths(
            self._values['arm_link_1'], self._values['arm_link_2'], self._values['arm_height']
        )
        try:
            flange = scara_flange(lengths, [positions[name] for name in names])
        except ArmError as error:
            self._complain(f'arm/joint_states: {error}')
            return
        self._publish(flange, nanoseconds(message.header.stamp), self._values['world_frame'])

    def _publish(self, flange: Pose, stamp_ns: int, frame: str) -> None:
        hand = flange.then(self._mount)
        self._tell_gravity(gravity_in_hand(hand))
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = hand.rotation, hand.position
        self._tell_pose(frame, place, stamp_ns)
        self._publisher.publish(
            messages.pose_message(hand.position, quaternion_of(hand.rotation), stamp_ns, frame)
        )

    def _complain(self, text: str) -> None:
        self._node.get_logger().warning(text, throttle_duration_sec=5.0)
