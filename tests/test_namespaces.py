# SPDX-License-Identifier: Apache-2.0
"""Two hands and two objects, in /left and /right, of real nodes: nothing of theirs merges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String


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


SIDES = ('left', 'right')
OBJECTS = {'left': 'tennis_ball', 'right': 'half_soda_can'}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Cell:
    """What one node hears of two hands and two objects on one machine."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node('cell')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.states: dict[str, str] = {}
        self.surfaces: dict[str, list[tuple[str, int]]] = {side: [] for side in SIDES}
        self.links: set[tuple[str, str]] = set()
        listen = self.node.create_subscription
        for side in SIDES:
            listen(
                String,
                f'{side}/deformation/state',
                lambda told, side=side: self.states.update({side: told.data}),
                LATCHED,
            )
            listen(
                PointCloud2,
                f'{side}/deformation/surface',
                lambda cloud, side=side: self.surfaces[side].append(
                    (cloud.header.frame_id, cloud.width)
                ),
                qos_profile_sensor_data,
            )
        listen(pytest.importorskip('tf2_msgs.msg').TFMessage, '/tf', self._linked, 100)

    def _linked(self, told: Any) -> None:
        self.links |= {(one.header.frame_id, one.child_frame_id) for one in told.transforms}

    def hear(self) -> Cell:
        """Take what has come."""
        self.executor.spin_once(timeout_sec=0.1)
        return self

    def end(self) -> None:
        """Leave."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def cell(domain_id: int) -> Iterator[Cell]:
    """See `Cell`."""
    found = Cell()
    yield found
    found.end()


def test_two_hands_feel_two_objects_at_once_and_hear_nothing_of_each_other(
    start: Callable[..., Any], wait_until: Callable[..., None], cell: Cell
) -> None:
    def hand(side: str) -> Any:
        fingers = [f'finger_{number}' for number in (1, 2, 3)]
        joints = ['spread', *(f'{one}_{part}' for one in fingers for part in ('inner', 'outer'))]
        words = (
            'backend:=emulator', 'initialize_on_start:=true', f'link_prefix:={side}_',
            f'hand_frame:={side}_hand_base',
            f'tip_frames:=[{", ".join(f"{side}_{one}_tip" for one in fingers)}]',
            f'joint_names:=[{", ".join(f"{side}_{joint}" for joint in joints)}]',
        )  # fmt: skip
        given = [word for one in words for word in ('-p', one)]
        return start('hand_bridge', '--ros-args', '-r', f'__ns:=/{side}', *given)

    for side, shell in OBJECTS.items():
        start(
            'deformation', '--ros-args', '-r', f'__ns:=/{side}', '-p', f'object:={shell}',
            '-p', 'theory:=koiter',
        )  # fmt: skip
    left = hand('left')
    wait_until(lambda: cell.hear().surfaces['left'], 60.0, lambda: left.text)
    # The other object is there and has no hand yet: nothing of the first one reaches it.
    wait_until(lambda: cell.hear().states.get('right') == 'NO_HAND', 60.0)
    assert cell.surfaces['right'] == []
    right = hand('right')
    wait_until(lambda: cell.hear().surfaces['right'], 60.0, lambda: right.text)
    answered = {side: set(found) for side, found in cell.surfaces.items()}
    ((frame_left, width_left),) = answered['left']
    ((frame_right, width_right),) = answered['right']
    assert (frame_left, frame_right) == ('left_hand_base', 'right_hand_base')
    assert width_left != width_right
    # Every link hangs on one of its own hand, and no link on two.
    wait_until(lambda: len(cell.hear().links) == 24, 30.0, lambda: str(cell.links))
    assert all(parent.split('_')[0] == child.split('_')[0] for parent, child in cell.links)
    assert len({child for _, child in cell.links}) == len(cell.links)
    # One hand dies; the other one goes on.
    left.process.kill()
    wait_until(lambda: cell.hear().states['left'] in ('STALE', 'NO_HAND'), 30.0)
    seen = len(cell.surfaces['right'])
    wait_until(lambda: len(cell.hear().surfaces['right']) > seen + 20, 30.0)
    wait_until(lambda: cell.hear().states['right'] == 'FREE', 30.0)
