# SPDX-License-Identifier: Apache-2.0
"""The page as a process of a test."""

from __future__ import annotations

import socket
from collections.abc import Callable

from tests.running import Running


def free_port() -> int:
    """A TCP port nobody uses."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return int(free.getsockname()[1])


def served(start: Callable[..., Running], port: int, *parameters: str) -> Running:
    """Start the page and wait until it serves; further ROS parameters as name:=value."""
    # A pose that keeps the palm's bodies out of the picture's middle.
    pose = 'object_pose:=[0.0, 0.0, 0.19, 0.0, 0.0, 0.0, 1.0]'
    given = [f'port:={port}', 'history:=100.0', pose, *parameters]
    running = start('grasp_view', '--ros-args', *(word for one in given for word in ('-p', one)))
    running.wait_for('page ready', 60)
    return running
