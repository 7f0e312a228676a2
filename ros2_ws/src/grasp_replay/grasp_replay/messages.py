# SPDX-License-Identifier: Apache-2.0
"""The border to ROS: type classes, QoS profiles, clocks and stamps, in both directions."""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock

from grasp_replay.errors import BagError
from grasp_replay.qos import FOREVER, QosProfile


def message_class(type_name: str) -> Any:
    """The Python class of a message type or service event type; raises BagError."""
    package, kind, name = (type_name.split('/') + ['', ''])[:3]
    if not (package and kind and name):
        raise BagError(f'{type_name!r} is not the name of a type such as std_msgs/msg/String')
    try:
        module = importlib.import_module(f'{package}.{kind}')
        if kind == 'srv' and name.endswith('_Event'):
            return getattr(module, name.removesuffix('_Event')).Event
        return getattr(module, name)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagError(
            f'the type {type_name} is not installed here; install the package {package!r}'
        ) from error


def from_endpoint(endpoint: TopicEndpointInfo) -> QosProfile:
    """The QoS profile that a discovered publisher offers."""
    profile = endpoint.qos_profile
    history = profile.history.name.lower()
    return QosProfile(
        # Discovery does not tell history and depth; rosbag2 writes the same.
        'unknown' if history in ('unknown', 'system_default') else history,
        profile.depth,
        profile.reliability.name.lower(),
        profile.durability.name.lower(),
        _nanoseconds(profile.deadline),
        _nanoseconds(profile.lifespan),
        profile.liveliness.name.lower(),
        _nanoseconds(profile.liveliness_lease_duration),
    )


def to_rclpy(profile: QosProfile) -> QoSProfile:
    """A stored profile as rclpy takes it; what it leaves open becomes keep last."""
    history = 'keep_last' if profile.history == 'unknown' else profile.history
    return QoSProfile(
        history=_policy(HistoryPolicy, history),
        depth=profile.depth or 10,
        reliability=_policy(ReliabilityPolicy, profile.reliability),
        durability=_policy(DurabilityPolicy, profile.durability),
        deadline=Duration(nanoseconds=profile.deadline),
        lifespan=Duration(nanoseconds=profile.lifespan),
        liveliness=_policy(LivelinessPolicy, profile.liveliness),
        liveliness_lease_duration=Duration(nanoseconds=profile.liveliness_lease_duration),
    )


def type_hash(endpoint: TopicEndpointInfo) -> str:
    """The RIHS01 hash a publisher announces; empty when it announces none."""
    text = str(endpoint.topic_type_hash)
    return text if text.startswith('RIHS01_') else ''


def clock_message(nanoseconds: int) -> Clock:
    """A `/clock` message."""
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(int(nanoseconds), 1_000_000_000)
    return message


def _policy(policy: Any, name: str) -> Any:
    try:
        return policy[name.upper()]
    except KeyError as error:
        raise BagError(f'the QoS choice {name!r} cannot be offered here') from error


def _nanoseconds(duration: Duration) -> int:
    return duration.nanoseconds if 0 < duration.nanoseconds < FOREVER else FOREVER
