# SPDX-License-Identifier: Apache-2.0
"""The `hand_bridge` node: a BarrettHand on its wire, its contacts on topics."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from barrett_hand_bridge import assembly, parameters
from barrett_hand_bridge.actions_node import HandActions
from barrett_hand_bridge.arm_pose_node import ArmPose
from barrett_hand_bridge.calibration import CalibrationError, HandCalibration
from barrett_hand_bridge.description_node import HandDescription
from barrett_hand_bridge.gcl.port import PortName
from barrett_hand_bridge.hand import HandError, HandFacts, HandSample
from barrett_hand_bridge.hand_services_node import HandServices
from barrett_hand_bridge.hand_topics_node import HandTopics
from barrett_hand_bridge.health import Health, Level, LinkState
from barrett_hand_bridge.joint_commands_node import JointCommands
from barrett_hand_bridge.kinematics import Array
from barrett_hand_bridge.observer import HandObserver, Observation
from barrett_hand_bridge.own_emulator import OwnEmulator
from barrett_hand_bridge.worker import (
    Connected,
    Disturbed,
    Event,
    GuardRestarted,
    HandWorker,
    Late,
    Lost,
    NotReady,
    Observed,
    Outcome,
)
from grasp_common.main_node import declare, run_node
from grasp_common.parameter_table import ParameterError, check

LOOKED_AFTER_S = 0.2
"""How often the emulated hand of the node's own is looked after [s]."""


class BridgeError(RuntimeError):
    """The node cannot do its work; the message says why."""


class HandBridge(LifecycleNode):
    """Publishes what the hand feels; obeys the hand services."""

    def __init__(self) -> None:
        """Declare parameters; nothing is opened before `configure`."""
        super().__init__('hand_bridge')
        declare(self, parameters.PARAMETERS)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.failure: str | None = None
        self._worker: HandWorker | None = None
        self._emulator: OwnEmulator | None = None
        self._calibration: HandCalibration | None = None
        self._events: deque[Event] = deque(maxlen=2000)
        self._guard = self.create_guard_condition(self._on_events)
        self._latest: Observation | None = None
        self._sample: HandSample | None = None
        self._health = Health()
        self._arm: ArmPose | None = None
        self._active = False
        self._starting = False

    def values(self) -> dict[str, Any]:
        """All parameter values by name, arrays as lists."""
        found = {}
        for parameter in parameters.PARAMETERS:
            value = self.get_parameter(parameter.name).value
            found[parameter.name] = list(value) if hasattr(value, 'typecode') else value
        return found

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the calibration, make publishers and services, start talking to the hand."""
        try:
            values = self.values()
            parameters.check_all(values)
            port = PortName(values['port']).now
            if values['backend'] == 'emulator':
                self._emulator = OwnEmulator(values['emulator_object'], values['emulator_seed'])
                port = self._emulator.now
            if self._emulator is not None and not values['calibration']:
                self._calibration = self._emulator.calibration
            else:
                self._calibration = assembly.load_calibration(values['calibration'])
            simulated = bool(self.get_parameter('use_sim_time').value)
            hand = assembly.make_hand(values, port, self._now_ns, simulated_time=simulated)
        except (ParameterError, CalibrationError, HandError) as error:
            self._fail(str(error))
            self._release()
            return TransitionCallbackReturn.FAILURE
        self._values = values
        # What it is about to do by itself is no reason to warn.
        self._starting = bool(values['initialize_on_start'])
        self._health = Health(calibration=self._calibration, hottest_c=values['hottest'])
        self._worker = HandWorker(
            hand,
            self._make_observer,
            self._tell,
            paced_by_ticks=values['poll_period'] > 0.0,
            hottest_c=values['hottest'],
        )
        self._make_interfaces(self._worker)
        where = (
            port() if values['backend'] != 'can' else f'{values["interface"]} {values["channel"]}'
        )
        self.get_logger().info(f'looking for a hand on {where}')
        self._worker.start()
        return TransitionCallbackReturn.SUCCESS

    def _make_interfaces(self, worker: HandWorker) -> None:
        self._topics = HandTopics(self, self._values)
        self._hand_services = HandServices(
            self, worker, self._health, values=self.values, active=lambda: self._active
        )
        self._hand_actions, self._joint_commands = (
            kind(
                self,
                worker,
                self._health,
                values=self.values,
                latest=lambda: self._latest,
                active=lambda: self._active,
            )
            for kind in (HandActions, JointCommands)
        )
        self._description = HandDescription(self, self._values)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers = [self.create_timer(1.0, self._on_diagnostics, clock=steady)]
        if self._emulator is not None:
            self._timers.append(
                self.create_timer(LOOKED_AFTER_S, self._emulator.look_after, clock=steady)
            )
        if self._values['arm'] != 'none':
            self._arm = ArmPose(self, self._values, self._on_gravity, self._description.hand)
        if self._values['poll_period'] > 0.0:
            self._timers.append(self.create_timer(self._values['poll_period'], worker.tick))

    def _on_gravity(self, direction: Array) -> None:
        if self._worker is not None and self._worker.observer is not None:
            self._worker.observer.set_gravity(direction)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to publish."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop every motion and fall silent."""
        self._active = False
        if self._worker is not None:
            self._worker.submit('stop')
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the hand and of all topics."""
        self._release()
        self._topics.end()
        self._hand_services.end()
        self._hand_actions.end()
        self._joint_commands.end()
        self._description.end()
        arm, self._arm = self._arm, None
        if arm is not None:
            arm.end()
        for timer in self._timers:
            self.destroy_timer(timer)
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the hand."""
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _release(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.end()
        emulator, self._emulator = self._emulator, None
        if emulator is not None:
            emulator.stop()
        self._latest = None

    def close(self) -> None:
        """Stop the hand and leave nothing running, whatever state the node is in."""
        self._active = False
        self._release()

    def _fail(self, reason: str) -> None:
        self.failure = reason
        self.get_logger().error(reason)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _make_observer(self, facts: HandFacts) -> HandObserver:
        assert self._calibration is not None
        return assembly.make_observer(self._values, self._calibration, facts)

    def _on_set_parameters(self, changed: Sequence[Parameter]) -> SetParametersResult:
        for parameter in changed:
            declared = parameters.BY_NAME.get(parameter.name)
            if declared is None:
                continue
            try:
                check(declared, parameter.value)
            except ParameterError as error:
                return SetParametersResult(successful=False, reason=str(error))
            if self._worker is not None and declared.settable != 'running':
                return SetParametersResult(
                    successful=False,
                    reason=f'parameter {parameter.name} takes effect at configure: clean up first',
                )
        return SetParametersResult(successful=True)

    # Events come from the worker's thread; the guard condition brings them into the executor.
    def _tell(self, event: Event) -> None:
        self._events.append(event)
        self._guard.trigger()

    def _on_events(self) -> None:
        while self._events:
            event = self._events.popleft()
            if isinstance(event, Observed):
                self._on_observed(event)
            elif isinstance(event, Late):
                self._health.late_cycles += 1
                self._on_stale()
            elif isinstance(event, Connected):
                self._on_connected(event)
            elif isinstance(event, Lost):
                self._on_lost(event.reason)
            elif isinstance(event, NotReady):
                self._on_not_ready(event.reason)
            elif isinstance(event, Disturbed):
                self._health.disturbances += 1
                self.get_logger().warning(event.reason)
                self._on_stale()
            elif isinstance(event, GuardRestarted):
                self._health.guard_restarts += 1
                self.get_logger().warning('the stop guard had died: started again')

    def _on_connected(self, event: Connected) -> None:
        self._health.facts = event.facts
        facts = event.facts
        assert self._calibration is not None
        try:
            assembly.check_calibration(self._calibration, facts)
        except CalibrationError as error:
            self._fail(str(error))
            return
        word = 'again ' if event.again else ''
        self.get_logger().info(
            f'{word}connected to a {facts.model}, firmware {facts.firmware}, number '
            f'{facts.serial_number}; up to {facts.ceiling_hz:.0f} cycles per second'
        )
        for text in facts.warnings:
            self.get_logger().warning(text)
        assert self._worker is not None
        if not event.again:
            for kind in ('initialize', 'tare'):
                if self._values[f'{kind}_on_start']:
                    self._worker.submit(kind).add_done_callback(partial(self._report, kind))

    def _report(self, kind: str, future: Future[Outcome]) -> None:
        outcome = future.result()
        self._starting = False
        if not self.context.ok():
            # The node is ending, and with it what it could have told.
            return
        # One call, one severity: rclpy refuses a call site that changes it.
        if outcome.success:
            self.get_logger().info(f'{kind}: {outcome.message}')
        else:
            self.get_logger().warning(f'{kind}: {outcome.message}')

    def _on_lost(self, reason: str) -> None:
        if self._health.facts is None and not self._values['wait_for_hand']:
            self._fail(reason)
            return
        if self._health.state is not LinkState.LOST:
            self._health.losses += 1
            self.get_logger().error(f'{reason}; trying again')
        self._set_state(LinkState.LOST, reason)
        self._on_stale()

    def _on_not_ready(self, reason: str) -> None:
        if self._health.state is not LinkState.NOT_INITIALISED:
            if self._starting:
                self.get_logger().info('initialising the hand: its fingers move')
            else:
                self.get_logger().warning(reason)
            self._on_stale()
        self._set_state(LinkState.NOT_INITIALISED, reason)

    def _set_state(self, state: LinkState, reason: str) -> None:
        self._health.state, self._health.reason = state, reason

    def _on_observed(self, event: Observed) -> None:
        self._latest, self._sample = event.observation, event.sample
        self._set_state(LinkState.CYCLING, '')
        self._health.take(event.sample, event.complete_ns * 1e-9)
        if not self._active:
            return
        self._topics.contacts(event.observation)
        self._health.delays.add((time.monotonic_ns() - event.complete_ns) * 1e-9)
        if self._topics.states(event.observation):
            self._description.links(event.observation)

    def _on_stale(self) -> None:
        """Say at once that the last contacts are no longer true."""
        if self._latest is not None and self._active:
            self._topics.stale(self._latest)

    def _on_diagnostics(self) -> None:
        health = self._health
        observer = None if self._worker is None else self._worker.observer
        now_s = time.monotonic()
        level, text = health.judge(self._latest, self._sample, now_s)
        if self._now_ns() <= 0:
            level, text = Level.WARN, 'parameter use_sim_time is true, but no /clock comes'
        values = health.values(self._latest, self._sample, observer, now_s)
        values['contacts published'] = str(self._topics.published)
        self._topics.diagnostics(level, text, values, health.facts, self._now_ns())


def main(arguments: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; returns the exit code."""
    return run_node(
        'hand_bridge',
        HandBridge,
        arguments,
        usage=parameters.usage,
        errors=(BridgeError,),
        serve=_serve,
    )


def _serve(node: HandBridge, executor: Executor) -> None:
    """Start as the parameters say, then go on until the context ends; raises BridgeError."""
    if node.get_parameter('autostart').value:
        node.trigger_configure()
        if node.failure is None:
            node.trigger_activate()
    while rclpy.ok() and node.failure is None:
        executor.spin_once(timeout_sec=0.5)
    if node.failure is not None:
        raise BridgeError(node.failure)


if __name__ == '__main__':
    sys.exit(main())
