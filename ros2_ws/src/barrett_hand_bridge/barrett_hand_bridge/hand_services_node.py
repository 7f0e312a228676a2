# SPDX-License-Identifier: Apache-2.0
"""The services of the bridge node and its trajectory topic: each asks the worker and waits."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleNode
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from barrett_hand_bridge import assembly, messages
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.health import Health
from barrett_hand_bridge.motion import Closing, Following, Motion, MotionError, Opening
from barrett_hand_bridge.worker import HandWorker, Outcome

PAUSE_S = 0.0005


class HandServices:
    """Answers `hand/tare`, `initialize`, `stop`, `open`, `close`; follows trajectories."""

    def __init__(
        self,
        node: LifecycleNode,
        worker: HandWorker,
        health: Health,
        *,
        values: Callable[[], dict[str, Any]],
        active: Callable[[], bool],
    ) -> None:
        """Offer the services on `node`; `values` are its parameters at the time of a call."""
        self._node = node
        self._worker = worker
        self._health = health
        self._values = values
        self._active = active
        actions: dict[str, Callable[[], Awaitable[Outcome]]] = {
            'tare': lambda: self._ask('tare'),
            'initialize': lambda: self._ask('initialize'),
            'stop': lambda: self._ask('stop'),
            'open': self._open,
            'close': self._close,
        }
        # A waiting service holds its callback group: reentrant, or it would block everything else.
        group = ReentrantCallbackGroup()
        self._services = [
            node.create_service(Trigger, f'hand/{name}', _trigger(action), callback_group=group)
            for name, action in actions.items()
        ]
        self._trajectories = node.create_subscription(
            JointTrajectory, 'hand/joint_trajectory', self._on_trajectory, 10
        )

    def end(self) -> None:
        """Take the services and the subscription away."""
        for service in self._services:
            self._node.destroy_service(service)
        self._node.destroy_subscription(self._trajectories)

    async def _finish(self, future: Future[Outcome]) -> Outcome:
        while not future.done():
            # An executor with an unfinished task spins without waiting; this keeps it gentle.
            time.sleep(PAUSE_S)
            await asyncio.sleep(0)
        return future.result()

    async def _ask(self, kind: str, motion: Motion | None = None) -> Outcome:
        if kind == 'move' and not self._active():
            return Outcome(False, 'the bridge is not active: nothing moves')
        outcome = await self._finish(self._worker.submit(kind, motion))
        if kind in ('move', 'initialize', 'stop'):
            self._health.last_motion = outcome.message
        return outcome

    async def _open(self) -> Outcome:
        return await self._ask('move', Opening(FINGERS, self._values()['open_speed']))

    async def _close(self) -> Outcome:
        values = self._values()
        fingers = tuple(values['close_fingers'])
        return await self._ask('move', Closing(fingers, assembly.close_settings(values)))

    def _on_trajectory(self, message: JointTrajectory) -> None:
        if self._node.executor is not None:
            self._node.executor.create_task(self._follow, message)

    async def _follow(self, message: JointTrajectory) -> None:
        values = self._values()
        try:
            motion = Following(
                messages.trajectory_points(message, values['joint_names']),
                fastest_rad_s=values['open_speed'],
                torque_limit_nm=values['torque_limit'],
            )
        except MotionError as error:
            self._node.get_logger().error(f'hand/joint_trajectory: {error}')
            self._health.last_motion = str(error)
            return
        outcome = await self._ask('move', motion)
        text = f'hand/joint_trajectory: {outcome.message}'
        # One call, one severity: rclpy refuses a call site that changes it.
        if outcome.success:
            self._node.get_logger().info(text)
        else:
            self._node.get_logger().error(text)


def _trigger(
    action: Callable[[], Awaitable[Outcome]],
) -> Callable[[Trigger.Request, Trigger.Response], Awaitable[Trigger.Response]]:
    async def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        outcome = await action()
        response.success = bool(outcome.success)
        response.message = outcome.message
        return response

    return answer
