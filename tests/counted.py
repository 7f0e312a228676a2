# SPDX-License-Identifier: Apache-2.0
"""Runs an executable and counts what its subscriptions take: `counted.py FOLDER PATH ARGUMENTS`.

FOLDER gets one file a topic, eight octets that are mapped into memory: whoever sends sees at once
how much has arrived. What the middleware lost on the way is not counted as tried.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np


def file_of(folder: Path, topic: str) -> Path:
    """Where the messages of a topic are counted."""
    return folder / quote(topic, safe='')


def arrived(folder: Path, topic: str) -> int:
    """How many messages of a topic were taken so far."""
    file = file_of(folder, topic)
    return int(np.fromfile(file, np.int64)[0]) if file.exists() else 0


def counting(folder: Path, topic: str, callback: Callable[..., Any]) -> Callable[..., Any]:
    """`callback`, every call of which counts."""
    file = file_of(folder, topic)
    if not file.exists():
        file.write_bytes(bytes(8))
    count = np.memmap(file, np.int64, 'r+')

    @wraps(callback)
    def counts(*given: Any) -> Any:
        count[0] += 1
        return callback(*given)

    return counts


def count_subscriptions(folder: Path) -> None:
    """Count the messages of every subscription that is made from now on."""
    from rclpy.node import Node

    create = Node.create_subscription

    def counted(self: Node, kind: Any, topic: str, callback: Any, *more: Any, **named: Any) -> Any:
        name = self.resolve_topic_name(topic)
        return create(self, kind, name, counting(folder, name, callback), *more, **named)

    Node.create_subscription = counted  # type: ignore[method-assign, assignment]


def count_polled(folder: Path) -> None:
    """The page's node takes its messages itself: count those, too."""
    from grasp_view.grasp_view_node import GraspView

    subscribe = GraspView._subscribe

    def counted(self: GraspView) -> None:
        subscribe(self)
        self._polled = [
            (subscription, take, counting(folder, subscription.topic_name, note))
            for subscription, take, note in self._polled
        ]

    GraspView._subscribe = counted  # type: ignore[method-assign]


if __name__ == '__main__':
    counts, program = Path(sys.argv[1]), sys.argv[2]
    sys.argv = sys.argv[2:]
    count_subscriptions(counts)
    if Path(program).name == 'grasp_view':
        count_polled(counts)
    runpy.run_path(program, run_name='__main__')
