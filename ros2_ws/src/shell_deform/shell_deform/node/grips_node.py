# SPDX-License-Identifier: Apache-2.0
"""The grips of the node's object: poses of arms in, forces and torques on the object out.

A grip NAME takes `grip/NAME/pose` (PoseStamped, in the frame of the contacts: where the point
about which it turns is, and how it has turned since it took hold), and what it does to the object
comes on `deformation/grip/NAME/wrench` (WrenchStamped, about that point).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from grasp_common.messages import nanoseconds
from shell_deform.live.grip_motion import GripPlan
from shell_deform.live.pose import Pose, PoseError
from shell_deform.node import messages

# As for other poses; the newest is what counts.
POSES = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
WRENCHES = QoSProfile(depth=100)

LATEST_NS = 1_000_000_000
"""A pose older than the newest one by less came late; by more, time was set back [ns]."""


class GripTopics:
    """Subscriptions and publishers of all grips of one object."""

    def __init__(self, node: Node, moved: Callable[[int, Pose, int, str], None]) -> None:
        """`moved` (number, pose, stamp [ns], frame) is called for every usable pose."""
        self._node = node
        self._moved = moved
        self._plan = GripPlan((), np.zeros((0, 3)), False)
        self._poses: list[object] = []
        self._wrenches: list[object] = []
        self._newest: list[int] = []
        self.refused = self.late = 0

    def take(self, plan: GripPlan) -> None:
        """The grips of another object, if they are others."""
        if plan.names == self._plan.names:
            self._plan = plan
            return
        for subscription in self._poses:
            self._node.destroy_subscription(subscription)  # type: ignore[arg-type]
        for publisher in self._wrenches:
            self._node.destroy_publisher(publisher)  # type: ignore[arg-type]
        self._plan, self._newest = plan, [0] * len(plan.names)
        heard = SubscriptionEventCallbacks(use_default_callbacks=False)
        told = PublisherEventCallbacks(use_default_callbacks=False)
        self._poses = [
            self._node.create_subscription(
                PoseStamped, f'grip/{name}/pose', partial(self._pose, number), POSES,
                event_callbacks=heard,
            )
            for number, name in enumerate(plan.topics)
        ]  # fmt: skip
        self._wrenches = [
            self._node.create_publisher(
                WrenchStamped, f'deformation/grip/{name}/wrench', WRENCHES, event_callbacks=told
            )
            for name in plan.topics
        ]

    def _pose(self, number: int, message: PoseStamped) -> None:
        topic = f'grip/{self._plan.topics[number]}/pose'
        stamp = nanoseconds(message.header.stamp)
        try:
            pose = messages.read_pose(message, f'pose of {topic}')
        except PoseError as error:
            self.refused += 1
            self._node.get_logger().error(f'{error}: not used', throttle_duration_sec=5.0)
            return
        if self._newest[number] - LATEST_NS < stamp < self._newest[number]:
            self.late += 1
            return
        self._newest[number] = stamp
        self._moved(number, pose, stamp, message.header.frame_id)

    def answer(self, wrenches: NDArray[np.float64], placed: Pose, stamp: int, frame: str) -> None:
        """What the grips do (g, 6) at an equilibrium; the object lies as `placed` in `frame`."""
        for wrench, publisher in zip(wrenches, self._wrenches, strict=True):
            turned = (placed.rotation @ wrench.reshape(2, 3).T).T.reshape(-1)
            publisher.publish(  # type: ignore[attr-defined]
                messages.wrench_message(turned, stamp, frame)
            )
