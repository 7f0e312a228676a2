# SPDX-License-Identifier: Apache-2.0
"""Two hands, in /left and /right, of real nodes: nothing of theirs merges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor


@pytest.fixture
def names(domain_id: int) -> Iterator[Callable[[], set[str]]]:
    """The names of all diagnostic statuses heard so far."""
    rclpy.init()
    node = rclpy.create_node('listener')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    heard: set[str] = set()

    def take(message: DiagnosticArray) -> None:
        heard.update(status.name for status in message.status)

    node.create_subscription(DiagnosticArray, '/diagnostics', take, 100)

    def spin() -> set[str]:
        executor.spin_once(timeout_sec=0.1)
        return heard

    yield spin
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize(
    ('program', 'arguments', 'part'),
    [
        ('hand_bridge', ('-p', 'backend:=emulator'), 'hand_bridge: hand'),
        ('scan_compare', (), 'scan_compare: comparison'),
        ('deformation', (), 'deformation: surface'),
    ],
)
def test_two_nodes_of_one_name_are_told_apart(
    start: Callable[..., Any],
    wait_until: Callable[..., None],
    names: Callable[[], set[str]],
    program: str,
    arguments: tuple[str, ...],
    part: str,
) -> None:
    for side in ('left', 'right'):
        start(program, '--ros-args', '-r', f'__ns:=/{side}', *arguments)
    wait_until(lambda: {f'left/{part}', f'right/{part}'} <= names(), 60.0)
