# SPDX-License-Identifier: Apache-2.0
"""The publishers of the bridge node: contacts every cycle, everything else at its own rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64

from barrett_hand_bridge import messages
from barrett_hand_bridge.contacts import FLAG_STALE
from barrett_hand_bridge.hand import FINGERS, HandFacts
from barrett_hand_bridge.health import Level
from barrett_hand_bridge.observer import Observation
from grasp_common.main_node import beside_others, status_name
from grasp_common.messages import diagnostics, named_numbers, number

STREAM = QoSProfile(depth=100)


class HandTopics:
    """Publishes observations; silent while the node is inactive, as lifecycle publishers are."""

    def __init__(self, node: LifecycleNode, values: Mapping[str, Any]) -> None:
        """Make the publishers on `node`."""
        self._node = node
        self._values = values
        self._states_ns = 0
        self.published = 0
        make = node.create_lifecycle_publisher
        self._contacts = make(PointCloud2, 'hand/contacts', STREAM)
        self._joints = make(JointState, 'hand/joint_states', STREAM)
        self._wrenches = {
            finger: make(WrenchStamped, f'hand/finger_{finger}/wrench', STREAM)
            for finger in FINGERS
        }
        self._counts = {
            finger: make(Float64, f'hand/finger_{finger}/gauge_counts', STREAM)
            for finger in FINGERS
        }
        self._numbers = make(JointState, 'hand/numbers', STREAM)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def end(self) -> None:
        """Take the publishers away."""
        for publisher in (
            self._contacts,
            self._joints,
            *self._wrenches.values(),
            *self._counts.values(),
            self._numbers,
            self._diagnostics,
        ):
            self._node.destroy_publisher(publisher)

    def contacts(self, observation: Observation) -> None:
        """One observation's contacts: a pin per finger, then the pressed touch cells."""
        contacts = [observation.fingers[finger].contact for finger in FINGERS]
        self._publish(
            messages.contacts_message(
                [*contacts, *observation.cells], observation.stamp_ns, self._values['hand_frame']
            )
        )

    def stale(self, observation: Observation) -> None:
        """The last contacts again with their own stamp, flagged as no longer true.

        A late sample carries the time of its first byte: a copy stamped now would overtake it.
        """
        contacts = [observation.fingers[finger].contact for finger in FINGERS]
        self._publish(
            messages.contacts_message(
                contacts, observation.stamp_ns, self._values['hand_frame'], FLAG_STALE
            )
        )

    def _publish(self, contacts: PointCloud2) -> None:
        if self._contacts.is_activated:
            self.published += 1
        self._contacts.publish(contacts)

    def states(self, observation: Observation) -> bool:
        """Joint states, wrenches and counts, not faster than parameter `state_rate`.

        Returns whether it was their turn.
        """
        stamp = observation.stamp_ns
        if 0 < stamp - self._states_ns < 0.95e9 / self._values['state_rate']:
            return False
        self._states_ns = stamp
        readings = observation.fingers
        torques = {finger: readings[finger].torque_nm for finger in FINGERS}
        self._joints.publish(
            messages.joint_states_message(
                observation.angles, torques, self._values['joint_names'], stamp
            )
        )
        numbers = {}
        for index, finger in enumerate(FINGERS):
            reading = readings[finger]
            self._wrenches[finger].publish(
                messages.wrench_message(reading, stamp, self._values['tip_frames'][index])
            )
            counts = math.nan if reading.gauge_counts is None else reading.gauge_counts
            self._counts[finger].publish(number(counts))
            numbers[f'finger_{finger}_gauge_counts'] = counts
        self._numbers.publish(named_numbers(numbers, stamp))
        return True

    def diagnostics(
        self,
        level: Level,
        text: str,
        values: Mapping[str, str],
        facts: HandFacts | None,
        stamp_ns: int,
    ) -> None:
        """What /diagnostics says."""
        hardware = 'no hand yet' if facts is None else f'{facts.model} {facts.serial_number}'
        name = status_name(self._node, 'hand')
        judged = beside_others(self._node, (level.value, text), 'hand/contacts')
        self._diagnostics.publish(diagnostics(stamp_ns, name, *judged, values, hardware))
