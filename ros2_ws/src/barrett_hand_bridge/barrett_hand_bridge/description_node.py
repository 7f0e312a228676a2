# SPDX-License-Identifier: Apache-2.0
"""The hand's description on its topics: `robot_description`, and TF of every frame it stamps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from barrett_hand_bridge import assembly, messages
from barrett_hand_bridge.description import urdf
from barrett_hand_bridge.description.names import names
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.kinematics import Array, modified_dh
from barrett_hand_bridge.observer import Observation

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    # Environments of wheels have no tf2_msgs, unless it was built for them.
    TFMessage = None

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class HandDescription:
    """Publishes `robot_description` once and, where tf2_msgs is, the pose of every link."""

    def __init__(self, node: LifecycleNode, values: Mapping[str, Any]) -> None:
        """Describe the hand that the parameters `values` describe."""
        self._node = node
        self._geometry = assembly.geometry(values)
        self._names = names(values)
        self._description = node.create_publisher(String, 'robot_description', LATCHED)
        self._description.publish(String(data=urdf.urdf(self._geometry, self._names)))
        self._tf = None
        if values['publish_tf'] and TFMessage is None:
            node.get_logger().info('no TF: the package tf2_msgs is not installed here')
        elif values['publish_tf']:
            self._tf = node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100))

    def end(self) -> None:
        """Take the publishers away."""
        for publisher in (self._description, self._tf):
            if publisher is not None:
                self._node.destroy_publisher(publisher)

    def links(self, observation: Observation) -> None:
        """The pose of every link, each in the one before it."""
        if self._tf is None:
            return
        g, called = self._geometry, self._names
        tip = modified_dh(g.link_3_m, -math.pi / 2, g.pad_height_m, 0.0)
        transforms: list[TransformStamped] = []

        def add(parent: str, child: str, place: Array) -> None:
            transforms.append(
                messages.transform_message(place, parent, child, observation.stamp_ns)
            )

        for finger in FINGERS:
            knuckle, inner, outer = urdf.chain(
                g,
                finger,
                observation.angles.spread,
                observation.angles.inner[finger],
                observation.fingers[finger].frames.joint_3,
            )
            add(called.hand_frame, called.knuckle(finger), knuckle)
            add(called.knuckle(finger), called.inner(finger), inner)
            add(called.inner(finger), called.outer(finger), outer)
            add(called.outer(finger), called.tip(finger), tip)
        self._tf.publish(TFMessage(transforms=transforms))

    def hand(self, parent: str, place: Array, stamp_ns: int) -> None:
        """The hand in the world, (4, 4)."""
        if self._tf is not None:
            message = messages.transform_message(place, parent, self._names.hand_frame, stamp_ns)
            self._tf.publish(TFMessage(transforms=[message]))
