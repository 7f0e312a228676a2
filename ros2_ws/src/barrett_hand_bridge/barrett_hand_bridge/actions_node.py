# SPDX-License-Identifier: Apache-2.0
"""The actions of the bridge node, where control_msgs is installed: with feedback and cancel.

`hand/follow_joint_trajectory` moves the spread and the inner joints; `hand/gripper_command` opens
or closes `close_fingers` to a distance between their pins, or to a force.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleNode

from barrett_hand_bridge import assembly, messages
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.hand_services_node import PAUSE_S
from barrett_hand_bridge.health import Health
from barrett_hand_bridge.motion import Closing, Following, Motion, MotionError, Opening, ToGap
from barrett_hand_bridge.observer import Observation
from barrett_hand_bridge.worker import HandWorker, Outcome

try:
    from control_msgs.action import FollowJointTrajectory, GripperCommand
except ImportError:
    # Environments of wheels have no control_msgs, unless it was built for them.
    FollowJointTrajectory = GripperCommand = None

FEEDBACK_PERIOD_S = 0.05


class HandActions:
    """Offers both actions, one goal at a time: a new motion ends the one before, and says so."""

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
        """Offer them on `node`; `latest` is the newest observation."""
        self._worker, self._health = worker, health
        self._values, self._latest, self._active = values, latest, active
        self._node = node
        self._servers: list[ActionServer] = []
        if FollowJointTrajectory is None:
            node.get_logger().info('no actions: the package control_msgs is not installed here')
            return
        # A goal under way holds its callback group: reentrant, as for the services.
        group = ReentrantCallbackGroup()
        for kind, name, execute in (
            (FollowJointTrajectory, 'follow_joint_trajectory', self._follow),
            (GripperCommand, 'gripper_command', self._grip),
        ):
            self._servers.append(
                ActionServer(
                    node,
                    kind,
                    f'hand/{name}',
                    execute,
                    callback_group=group,
                    goal_callback=self._on_goal,
                    cancel_callback=lambda handle: CancelResponse.ACCEPT,
                )
            )

    def end(self) -> None:
        """Take the actions away."""
        for server in self._servers:
            server.destroy()

    def _on_goal(self, goal: Any) -> GoalResponse:
        ready = self._active() and self._latest() is not None
        if not ready:
            self._node.get_logger().warning(
                'a goal is refused: the hand does not cycle (hand/initialize) or is not active',
                throttle_duration_sec=5.0,
            )
        return GoalResponse.ACCEPT if ready else GoalResponse.REJECT

    async def _run(
        self, handle: ServerGoalHandle, motion: Motion, tell: Callable[[Observation], Any]
    ) -> Outcome:
        """Run a motion to its end; feedback on the way, stopped when the goal is cancelled."""
        future = self._worker.submit('move', motion)
        told_s, stopped = -math.inf, False
        while not future.done():
            if handle.is_cancel_requested and not stopped:
                stopped = True
                self._worker.submit('stop')
            observation, now_s = self._latest(), time.monotonic()
            if observation is not None and now_s - told_s > FEEDBACK_PERIOD_S:
                told_s = now_s
                handle.publish_feedback(tell(observation))
            time.sleep(PAUSE_S)
            await asyncio.sleep(0)
        outcome = future.result()
        self._health.last_motion = outcome.message
        if stopped and not outcome.success:
            handle.canceled()
        elif outcome.success:
            handle.succeed()
        else:
            handle.abort()
        return outcome

    async def _follow(self, handle: ServerGoalHandle) -> Any:
        values = self._values()
        joint_names = values['joint_names']
        result = FollowJointTrajectory.Result()
        try:
            points = messages.trajectory_points(handle.request.trajectory, joint_names)
            path, goal, patience_s = messages.tolerances(handle.request, joint_names)
            motion = Following(
                points,
                fastest_rad_s=values['open_speed'],
                torque_limit_nm=values['torque_limit'],
                path_tolerance_rad=path,
                **({'tolerance_rad': goal} if goal else {}),
                **({'patience_s': patience_s} if patience_s else {}),
            )
        except MotionError as error:
            handle.abort()
            self._health.last_motion = result.error_string = str(error)
            result.error_code = FollowJointTrajectory.Result.INVALID_GOAL
            return result

        def tell(observation: Observation) -> Any:
            return messages.trajectory_feedback(observation, motion, joint_names)

        outcome = await self._run(handle, motion, tell)
        result.error_string = outcome.message
        result.error_code = FollowJointTrajectory.Result.SUCCESSFUL
        if not outcome.success:
            result.error_code = (
                FollowJointTrajectory.Result.GOAL_TOLERANCE_VIOLATED
                if motion.missed_its_goal
                else FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED
            )
        return result

    async def _grip(self, handle: ServerGoalHandle) -> Any:
        values = self._values()
        command = handle.request.command
        try:
            motion = ToGap(
                command.position,
                Closing(
                    tuple(values['close_fingers']),
                    assembly.close_settings(values, messages.wanted_force(command)),
                ),
                Opening(FINGERS, values['open_speed']),
            )
        except MotionError as error:
            handle.abort()
            self._health.last_motion = str(error)
            self._node.get_logger().error(f'hand/gripper_command: {error}')
            return GripperCommand.Result()

        def state(message: Any, observation: Observation) -> Any:
            message.position = float(motion.gap_m(observation))
            message.effort = float(motion.force_n(observation))
            message.reached_goal = motion.reached
            message.stalled = motion.stalled
            return message

        await self._run(handle, motion, lambda seen: state(GripperCommand.Feedback(), seen))
        observation = self._latest()
        result = GripperCommand.Result()
        return result if observation is None else state(result, observation)
