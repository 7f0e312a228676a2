# SPDX-License-Identifier: Apache-2.0
"""A test node that hears what `replay` sends and sends what `record` hears."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger
from tests.patience import Patience
from tests.service_calls import answer

from grasp_replay.bag_writer import BagWriter
from grasp_replay.qos import QosProfile, qos_text

KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Observer:
    """A node in this process that the test spins itself."""

    def __init__(self, domain_id: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.node = Node('observer', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def spin_until(self, condition: Callable[[], object], timeout: float = 30.0) -> None:
        patience = Patience(timeout)
        while not condition():
            assert not patience.over, 'condition not met in time'
            self.executor.spin_once(timeout_sec=0.02)

    def collect(self, kind: type, topic: str, qos: QoSProfile = KEEP_ALL) -> list[Any]:
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def call(self, service: str, kind: type = Trigger, request: Any = None) -> Any:
        client = self.node.create_client(kind, service)
        return answer(client, request or kind.Request(), self.spin_until)

    def set_parameter(self, name: str, value: float) -> Any:
        parameter = Parameter(
            name=name,
            value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value),
        )
        request = SetParameters.Request(parameters=[parameter])
        return self.call('/replay/set_parameters', SetParameters, request).results[0]

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def wrench(index: int) -> WrenchStamped:
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(index * 4_000_000, 10**9)
    message.header.frame_id = 'hand_base'
    message.wrench.force.x = float(index)
    return message


def write_wrenches(path: Path, count: int, qos: QosProfile | None = None) -> Path:
    with BagWriter(path) as writer:
        topic = writer.add_topic(
            '/w', 'geometry_msgs/msg/WrenchStamped', qos_text(qos or QosProfile())
        )
        for index in range(count):
            writer.write(topic, bytes(serialize_message(wrench(index))), index * 4_000_000)
    return path
