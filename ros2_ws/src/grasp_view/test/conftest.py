# SPDX-License-Identifier: Apache-2.0
"""A page with its free port, its browser tab, and who publishes to it or listens beside it."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

# Lets the tests import what they share.
sys.path.insert(0, str(Path(__file__).parent))
from view_grasp import Grasp  # noqa: E402


@pytest.fixture
def grasp(domain_id: int) -> Iterator[Callable[..., Grasp]]:
    """A squeezed ball on the topics, by the subdivisions of its mesh."""
    made: list[Grasp] = []

    def make(subdivisions: int = 3) -> Grasp:
        made.append(Grasp(subdivisions))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def heard(domain_id: int) -> Iterator[Callable[[type, str], Any]]:
    """The newest message of a topic, by type and name; None while none came."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    newest: dict[str, Any] = {}

    def take(kind: type, topic: str) -> Any:
        if topic not in newest:
            newest[topic] = None
            node.create_subscription(kind, topic, lambda m: newest.update({topic: m}), 10)
        executor.spin_once(timeout_sec=0.1)
        return newest[topic]

    yield take
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def port() -> int:
    """A TCP port nobody uses."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return int(free.getsockname()[1])


@pytest.fixture
def tab(open_tab):
    """A browser's tab in which both panels and the object have room."""
    return open_tab(1000, 640)


@pytest.fixture
def view(start, port: int):
    """Start the page and wait until it serves; further ROS parameters as name:=value."""

    def begin(*parameters: str):
        # A pose that keeps the palm's bodies out of the picture's middle.
        pose = 'object_pose:=[0.0, 0.0, 0.19, 0.0, 0.0, 0.0, 1.0]'
        given = [f'port:={port}', 'history:=100.0', pose, *parameters]
        arguments = [word for one in given for word in ('-p', one)]
        running = start('grasp_view', '--ros-args', *arguments)
        running.wait_for('page ready', 60)
        return running

    return begin
