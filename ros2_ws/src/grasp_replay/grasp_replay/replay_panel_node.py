# SPDX-License-Identifier: Apache-2.0
"""What a replay is steered by and tells of itself: services, parameters, status topics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import Trigger

from grasp_common.main_node import status_name, warn_of_unknown
from grasp_common.messages import diagnostics
from grasp_replay.bag import Bag
from grasp_replay.errors import BagError
from grasp_replay.experiment import read_experiment
from grasp_replay.replay_core import HIGHEST_RATE, Control, Tally
from grasp_replay.replay_options import ReplayOptions

DIAGNOSTICS_PERIOD = 1.0
POSITION_PERIOD = 0.1


def recording_text(bag: Path) -> str:
    """Name of a recording, and what it says of where its numbers come from: `name: label`."""
    try:
        known = read_experiment(bag)
    except BagError:
        # A damaged description is no reason not to replay; the report says what is wrong.
        return bag.stem
    return f'{known.name}: {known.label}' if known.label else known.name


class ReplayPanel:
    """Services, parameters and status of the node that replays `bag`.

    All that acts on `control` happens under the lock `changed` and is announced by it. Give it
    the `tally` of the replay once there is one.
    """

    def __init__(
        self,
        node: Node,
        bag: Bag,
        options: ReplayOptions,
        control: Control,
        changed: threading.Condition,
    ) -> None:
        self.control = control
        self.changed = changed
        self.tally: Tally | None = None
        self._node = node
        self._origin = bag.start
        self._start, self._stop = options.choice.span(bag)
        self._told_paused: bool | None = None
        self._declare_parameters(options.rate)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._position = node.create_publisher(Float64, '~/position', 10)
        self._duration = node.create_publisher(Float64, '~/duration', latched)
        self._paused = node.create_publisher(Bool, '~/paused', latched)
        self._recording = node.create_publisher(String, '~/recording', latched)
        self._recording.publish(String(data=recording_text(options.bag)))
        self._duration.publish(Float64(data=float(bag.duration)))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)
        node.create_timer(POSITION_PERIOD, self._publish_position, clock=steady)
        for name, action in (
            ('pause', self._pause),
            ('resume', self._resume),
            ('toggle_paused', self._toggle),
            ('step', self._step),
            ('stop', self._stop_replay),
        ):
            node.create_service(Trigger, f'~/{name}', self._service(action))
        self._publish_position()

    def _declare_parameters(self, rate: float) -> None:
        self._node.add_on_set_parameters_callback(self._set_parameters)
        for name, value, description, lowest, highest in (
            ('rate', rate, 'bag seconds per second', 1e-3, HIGHEST_RATE),
            (
                'position_s',
                self._seconds(self._start),
                'setting it goes on from so many seconds after the start of the bag',
                self._seconds(self._start),
                self._seconds(self._stop - 1),
            ),
        ):
            span = [FloatingPointRange(from_value=lowest, to_value=highest, step=0.0)]
            self._node.declare_parameter(
                name,
                value,
                ParameterDescriptor(description=description, floating_point_range=span),
            )
        warn_of_unknown(self._node, ('rate', 'position_s'))

    def _set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        with self.changed:
            try:
                for parameter in parameters:
                    if parameter.name == 'rate':
                        self.control.pace.set_rate(parameter.value, time.monotonic())
                    elif parameter.name == 'position_s':
                        self.control.target = self._origin + round(parameter.value * 1e9)
            except BagError as error:
                return SetParametersResult(successful=False, reason=str(error))
            self.changed.notify_all()
        return SetParametersResult(successful=True)

    def _seconds(self, log_time: int) -> float:
        return (log_time - self._origin) / 1e9

    def _service(self, action: Callable[[], str]) -> Callable[..., Trigger.Response]:
        def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            with self.changed:
                try:
                    response.message, response.success = action(), True
                except BagError as error:
                    response.message, response.success = str(error), False
                self.changed.notify_all()
            self._publish_position()
            return response

        return serve

    def _pause(self) -> str:
        self.control.pace.pause(time.monotonic())
        return 'paused'

    def _resume(self) -> str:
        self.control.pace.resume(time.monotonic())
        return 'running'

    def _toggle(self) -> str:
        return self._resume() if self.control.pace.paused else self._pause()

    def _step(self) -> str:
        if not self.control.step():
            raise BagError('the replay is not paused: call pause before step')
        return 'one message follows'

    def _stop_replay(self) -> str:
        self.control.stopped = True
        return 'stopping'

    def _publish_position(self) -> None:
        with self.changed:
            place = self.control.place(time.monotonic())
            paused = self.control.pace.paused
        place = min(max(place, self._start), self._stop - 1)
        self._position.publish(Float64(data=self._seconds(place)))
        if paused != self._told_paused:
            self._told_paused = paused
            self._paused.publish(Bool(data=paused))

    def _publish_diagnostics(self) -> None:
        tally, pace = self.tally, self.control.pace
        if tally is None:
            return
        warning = f'{tally.lost} messages were lost' if tally.lost else None
        values = {
            'rate': str(pace.rate),
            'paused': pace.paused,
            'sent': tally.total,
            'late': tally.late,
            'lost': tally.lost,
            'lateness_p99_s': f'{tally.quantile(0.99):.6f}',
        }
        now = self._node.get_clock().now().nanoseconds
        text = 'paused' if pace.paused else 'replaying'
        level = 'ok' if warning is None else 'warn'
        name = status_name(self._node)
        self._diagnostics.publish(diagnostics(now, name, level, warning or text, values))
