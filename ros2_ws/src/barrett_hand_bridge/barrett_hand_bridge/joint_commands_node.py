# SPDX-License-Identifier: Apache-2.0
"""`hand/joint_commands`: positions that a controller streams, as ros2_control's topic systems do.

A controller repeats what it holds; only what changes moves the hand. So closing to a force and
other motions go on beside one that holds, and after `hand/stop`, a torque limit or a lost link
nothing moves before the commands have stood still.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import JointState

from barrett_hand_bridge import messages
from barrett_hand_bridge.health import Health
from barrett_hand_bridge.motion import MotionError
from barrett_hand_bridge.observer import Observation
from barrett_hand_bridge.tracking import SETTLED_S, Tracking, far_from_hand
from barrett_hand_bridge.worker import HandWorker, Outcome
from grasp_common.messages import nanoseconds

SILENT_S = 2.0
"""After a pause as long as this somebody else may command."""


class JointCommands:
    """Follows the newest command while the node is active."""

    def __init__(
        self,
        node: LifecycleNode,
        worker: HandWorker,
        health: Health,
        *,
        values: Callable[[], dict[str, Any]],
        latest: Callable[[], Observation | None],
        active: Callable[[], bool],
    ) -> None:
        """Listen on `node`; `latest` is the newest observation."""
        self._node, self._worker, self._health = node, worker, health
        self._values, self._latest, self._active = values, latest, active
        self._motion: Tracking | None = None
        self._future: Future[Outcome] | None = None
        self._wanted: dict[int, float] = {}
        self._changed_s = self._heard_s = 0.0
        self._halted = False
        self._subscription = node.create_subscription(
            JointState, 'hand/joint_commands', self._on_command, 10
        )

    def end(self) -> None:
        """Take the subscription away."""
        self._node.destroy_subscription(self._subscription)

    def _on_command(self, message: JointState) -> None:
        # By the sender's clock: a bridge that finds no processor would see pauses that are none.
        stamp_s = 1e-9 * nanoseconds(message.header.stamp) or time.monotonic()
        if abs(stamp_s - self._heard_s) > SILENT_S:
            # Nobody has commanded meanwhile: whoever does now begins anew.
            self._wanted, self._halted = {}, False
        self._heard_s = stamp_s
        try:
            wanted = messages.commanded_positions(message, self._values()['joint_names'])
        except MotionError as error:
            self._refuse(str(error))
            return
        self._take_end()
        if wanted == self._wanted:
            if stamp_s - self._changed_s > SETTLED_S:
                self._halted = False
            return
        self._wanted, self._changed_s = wanted, stamp_s
        if self._motion is not None:
            self._motion.aim(wanted)
        elif wanted and not self._halted:
            self._begin(wanted)

    def _take_end(self) -> None:
        """See whether a motion has ended, and how."""
        if self._future is None or not self._future.done():
            return
        outcome, motion = self._future.result(), self._motion
        self._future = self._motion = None
        self._health.last_motion = outcome.message
        if not outcome.success:
            self._halted = True
            self._refuse(outcome.message)
        elif motion is not None and motion.arrived != self._wanted:
            # The last command came just when the motion ended.
            self._wanted = {}

    def _begin(self, wanted: dict[int, float]) -> None:
        observation, values = self._latest(), self._values()
        if observation is None or not self._active():
            self._refuse('the bridge is not active or has no hand: nothing moves')
            return
        refusal = far_from_hand(observation, wanted)
        if refusal:
            self._refuse(refusal)
            return
        self._motion = Tracking(
            wanted, fastest_rad_s=values['open_speed'], torque_limit_nm=values['torque_limit']
        )
        self._future = self._worker.submit('move', self._motion)

    def _refuse(self, why: str) -> None:
        self._health.last_motion = why
        self._node.get_logger().error(f'hand/joint_commands: {why}', throttle_duration_sec=5.0)
