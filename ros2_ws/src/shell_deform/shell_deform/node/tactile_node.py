# SPDX-License-Identifier: Apache-2.0
"""Measured touch cells, `hand/tactile`, beside those that the equilibrium expects."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from grasp_common.messages import nanoseconds, number
from grasp_common.point_cloud import MessageError
from shell_deform.contact.body_file import FingerBody
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.contact_cloud import CellReader
from shell_deform.live.tick.sample import SampleError
from shell_deform.live.tick.touch_check import (
    TouchCells,
    TouchJudgement,
    check_cells,
    judged,
    write_shapes,
)

CELLS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Tactile:
    """Keeps the newest cells of `hand/tactile`: fields `finger`, `cell` and `force` [N]."""

    def __init__(self, node: Node) -> None:
        """Listen on `node`."""
        self._node = node
        self._reader = CellReader()
        self._cells: TouchCells | None = None
        self._judgement: TouchJudgement | None = None
        self._unusable = ''
        self.bodies: Mapping[int, FingerBody] = {}
        self.shapes = False
        """Whether the cells say where the fingers press."""
        self._shaped: dict[int, str] = {}
        node.create_subscription(
            PointCloud2,
            'hand/tactile',
            self._take,
            CELLS,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._publisher = node.create_publisher(
            Float64,
            'deformation/touch_contradiction',
            10,
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        )

    def forget(self) -> None:
        """Time has jumped."""
        self._cells = self._judgement = None

    def _take(self, message: PointCloud2) -> None:
        try:
            cells = self._reader.read(message, nanoseconds(message.header.stamp))
            check_cells(cells, self.bodies)
        except (MessageError, SampleError) as error:
            # The last good ones stay.
            self._unusable = str(error)
            self._node.get_logger().error(self._unusable, throttle_duration_sec=5.0)
            return
        self._cells, self._unusable = cells, ''

    def judge(self, adopted: Adopted) -> None:
        """Compare the newest cells with those of an equilibrium."""
        if self._cells is None or not adopted.carries:
            return
        taxels = adopted.slot.taxels[: int(adopted.slot.record['taxels'])]
        self._judgement = judged(self._cells, taxels, self.bodies)
        self._publisher.publish(number(self._judgement.value))

    def shape(self, request: np.void) -> None:
        """Give the touching fingers of a load case the shapes that their cells felt."""
        if self.shapes:
            self._shaped = write_shapes(request, self._cells, self.bodies)

    @property
    def figures(self) -> dict[str, object]:
        """What /diagnostics says of it."""
        told: dict[str, object] = {}
        if self.shapes:
            by_cells = [str(finger) for finger, why in self._shaped.items() if not why]
            told['load by the cells of fingers'] = ', '.join(by_cells) or 'none'
            for finger, why in self._shaped.items():
                if why:
                    told[f'cells of finger {finger} not used'] = f'it {why}'
        if self._unusable:
            told['hand/tactile'] = self._unusable
        if self._judgement is not None:
            told['touch contradiction'] = self._judgement.value
            told['touch suspect'] = self._judgement.suspect
        return told
