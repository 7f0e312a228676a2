# SPDX-License-Identifier: Apache-2.0
"""Nodes that answer in lockstep are asked to wait for their own best answer.

A live estimator answers the first sample of a new contact at once, by a simpler theory, and better
a moment later. In lockstep nothing is gained by that haste, and what is answered would depend on
the machine. A node that publishes an answer and declares the parameter `wait_for_take_up` gets it
for the length of the replay.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

PARAMETER = 'wait_for_take_up'

SHARE = 0.5
"""Of the patience of the lockstep: an answer that comes late is still an answer."""

UNKNOWN = '_NODE_NAME_UNKNOWN_'
"""What the graph calls a node whose endpoints it discovered before its name."""

ANSWER_SECONDS = 2.0
"""How long a node may take to say whether it knows the parameter."""


class Patience:
    """Sets `wait_for_take_up` of the nodes behind answer topics, and sets it back."""

    def __init__(self, node: Node, topics: Iterable[str], seconds: float) -> None:
        """`node` is spun by another thread; `seconds`: the patience of the lockstep [s]."""
        self._before: list[tuple[AsyncParameterClient, ParameterValue]] = []
        for name in _publishers(node, set(topics)):
            client = AsyncParameterClient(node, name)
            if not client.wait_for_services(ANSWER_SECONDS):
                continue
            answer = _result(client.get_parameters([PARAMETER]))
            if answer is None or not answer.values:
                continue
            value = answer.values[0]
            if (
                value.type == ParameterType.PARAMETER_DOUBLE
                and value.double_value < SHARE * seconds
            ):
                self._before.append((client, value))
                _set(client, SHARE * seconds)

    def restore(self) -> None:
        """Give every node back what it had."""
        for client, value in self._before:
            _set(client, value.double_value)
        self._before.clear()


def _publishers(node: Node, topics: set[str]) -> list[str]:
    """Full names of the nodes that publish on the topics, once the graph knows who they are."""
    deadline = time.monotonic() + ANSWER_SECONDS
    while True:
        infos = [info for topic in topics for info in node.get_publishers_info_by_topic(topic)]
        known = [info for info in infos if info.node_name != UNKNOWN]
        if len(known) == len(infos) or time.monotonic() > deadline:
            return sorted({f'{i.node_namespace.rstrip("/")}/{i.node_name}' for i in known})
        time.sleep(0.02)


def _set(client: AsyncParameterClient, seconds: float) -> None:
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=seconds)
    _result(client.set_parameters([Parameter(name=PARAMETER, value=value)]))


def _result(future: Any) -> Any:
    """What a call answers; None where nobody does in time."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    return future.result() if done.wait(ANSWER_SECONDS) else None
