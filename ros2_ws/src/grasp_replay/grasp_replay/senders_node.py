# SPDX-License-Identifier: Apache-2.0
"""Publishers for the topics of a bag, so arranged that a large message costs no small one.

A participant of Fast DDS puts what it sends into one piece of shared memory, 512 KB by default.
A scan of 1 MB fills it, and what is sent best effort until its listeners have emptied it is lost:
15 of 15 001 contact samples while 1 201 scans crossed, none when the scans have a participant of
their own. So large messages leave through a second node in a context of its own.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.errors import BagError
from grasp_replay.messages import message_class, to_rclpy
from grasp_replay.qos import QosProfile, common_offer, parse_qos_text
from grasp_replay.replay_core import large_topics, refusal
from grasp_replay.replay_options import ReplayOptions
from grasp_replay.ros_types import type_differs
from grasp_replay.topic_selection import listed


class Senders:
    """One publisher for each topic that can be sent; topics by their name in the bag.

    Small topics are published by `node`. Topics that cannot be sent are named in its log. Raises
    BagError when none is left.
    """

    def __init__(
        self, node: Node, bag: Bag, options: ReplayOptions, ros_arguments: Sequence[str]
    ) -> None:
        self._node = node
        self._ros_arguments = ros_arguments
        self._large_node: Node | None = None
        self._publishers: dict[str, Publisher] = {}
        self.names: dict[str, str] = {}
        chosen = options.choice.topics(bag)
        if not chosen:
            there = f'it has {listed(bag.topics)}' if bag.topics else 'it has no topics at all'
            raise BagError(f'{bag.path} has none of the topics chosen; {there}')
        kinds = {}
        for name, topic in sorted(chosen.items()):
            reason = refusal(topic) or type_differs(
                topic.type_name, topic.type_hash, topic.definition, topic.definition_encoding
            )
            try:
                kinds[name] = message_class(topic.type_name)
            except BagError as error:
                reason = reason or str(error)
            if reason is not None:
                kinds.pop(name, None)
                self._refuse(name, reason)
        large = large_topics(bag, kinds)
        for name, kind in kinds.items():
            sent_name = options.choice.published_name(name)
            publisher_node = self._large() if name in large else node
            try:
                offer = _offer(chosen[name], options.qos_overrides.get(sent_name))
                self._publishers[name] = publisher_node.create_publisher(kind, sent_name, offer)
                self.names[name] = sent_name
            except (BagError, InvalidTopicNameException) as error:
                self._refuse(name, str(error).splitlines()[0])
        if not self.names:
            self.close()
            raise BagError(f'{bag.path} has no topic that can be replayed with these options')

    def _refuse(self, name: str, reason: str) -> None:
        self._node.get_logger().warning(f'{name} is not replayed: {reason}')

    def _large(self) -> Node:
        if self._large_node is None:
            context = Context()
            rclpy.init(
                args=['replay', *self._ros_arguments],
                context=context,
                domain_id=self._node.context.get_domain_id(),
            )
            self._large_node = Node(
                f'{self._node.get_name()}_large',
                context=context,
                start_parameter_services=False,
                enable_rosout=False,
            )
        return self._large_node

    def unmatched(self) -> set[str]:
        """The topics that nobody listens to, or that a known listener is not yet matched with."""
        return {
            name
            for name, publisher in self._publishers.items()
            if publisher.get_subscription_count()
            < max(1, self._node.count_subscribers(self.names[name]))
        }

    def send(self, message: Message) -> bool:
        """Publish stored bytes; False when the middleware refused them."""
        try:
            self._publishers[message.topic].publish(message.data)
        except rclpy_implementation.RCLError as error:
            if not self._node.context.ok():
                raise ExternalShutdownException from error
            return False
        return True

    def unacknowledged(self, seconds: float) -> list[str]:
        """The reliable topics whose messages were not all received within `seconds`."""
        deadline = time.monotonic() + seconds
        return [
            self.names[name]
            for name, publisher in self._publishers.items()
            if publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            and not publisher.wait_for_all_acked(
                Duration(seconds=max(0.0, deadline - time.monotonic()))
            )
        ]

    def close(self) -> None:
        """End the second node and its context."""
        if self._large_node is not None:
            context = self._large_node.context
            self._large_node.destroy_node()
            context.try_shutdown()
            self._large_node = None


def _offer(topic: Topic, override: QosProfile | None) -> QoSProfile:
    """The offer, keeping each message of a reliable stream until it is received.

    History is no part of matching; latched topics keep theirs, as it is what late joiners get.
    """
    offer = override or common_offer(parse_qos_text(topic.qos))
    profile = to_rclpy(offer)
    if offer.reliability == 'reliable' and offer.durability != 'transient_local':
        profile.history = HistoryPolicy.KEEP_ALL
    return profile
