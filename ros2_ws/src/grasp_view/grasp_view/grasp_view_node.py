"""`grasp_view`: a browser page that listens to topics and calls services, nothing else."""

from __future__ import annotations

import queue
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh as MeshMessage
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from . import messages
from .page import BUTTONS, Page, PageError
from .parameters import PARAMETERS, usage
from .plot_panel import SERIES
from .poses import Pose, PoseError
from .scene_model import CONTACT, Snapshot
from .time_series import History, TimeSeries
from .what_if_node import NAMESPACE, WhatIf, WhatIfError

NUMBERS = {
    **{
        f'deformation/{name}': name
        for name in (
            'max_displacement',
            'linearity',
            'strain_energy',
            'nonlinear_age',
            'snap_margin',
            'contradiction',
        )
    },
    **{f'scan/{name}': name for name in ('mean_error', 'max_error', 'noise_floor')},
}
SCAN_POINTS = 30_000
SERVICE_TIMEOUT_S = 5.0
HISTORY_PERIOD_S = 0.19
DISCOVERY_S = 2.0
PLAUSIBLE_LATENCY_S = 60.0


class PolledGroup(CallbackGroup):
    """Subscriptions that the executor leaves alone.

    The page shows 15 pictures a second of topics that come 250 times a second: waking up for
    each message would cost a core. The middleware keeps the newest message of each topic and the
    node's one timer takes it.
    """

    def can_execute(self, entity: object) -> bool:
        """Never by the executor."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Never by the executor."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Nothing was begun."""


@dataclass
class Asked:
    """A service call that a button began."""

    name: str
    client: Client
    since: float
    future: Future | None = None


def _qos(latched: bool, reliable: bool) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class GraspView(Node):
    """Takes the newest messages at the page's rate, hands them over, forwards the buttons."""

    def __init__(self) -> None:
        super().__init__('grasp_view')
        self._declare()
        self._rate = float(self.get_parameter('rate').value)
        span = float(self.get_parameter('history').value)
        self._snapshot = Snapshot(
            object_pose=Pose.of(self.get_parameter('object_pose').value),
            hand_frame=str(self.get_parameter('hand_frame').value),
        )
        self._series = TimeSeries(SERIES, span, int(span * self._rate) + 1)
        self._history: History[Snapshot] = History(span, int(span / HISTORY_PERIOD_S) + 1)
        self._commands: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._start = time.monotonic()
        self._latency = float('nan')
        self._surface_at = float('nan')
        self._polled: list[tuple[Any, Callable[[Any, float], None]]] = []
        self._asked: list[Asked] = []
        self._callers: dict[str, Client] = {}
        self._updates = 0
        self._subscribe()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.page = Page(
            str(self.get_parameter('host').value),
            int(self.get_parameter('port').value),
            self._commands.put,
            self._series,
            self._history,
            () if self.get_parameter('what_if').value else tuple(BUTTONS),
        )
        self.what_if: WhatIf | None = None
        if self.get_parameter('what_if').value:
            try:
                self.what_if = WhatIf(self, self.page, str(self.get_parameter('object').value))
            except WhatIfError:
                self.page.close()
                raise
        self.create_timer(1.0 / self._rate, self._tick)
        self.create_timer(1.0, self._diagnose)
        self.add_on_set_parameters_callback(self._set)
        host, port = self.page.server.get_host(), self.page.server.get_port()
        self.get_logger().info(f'page ready on http://{host}:{port}')

    def _declare(self) -> None:
        for one in PARAMETERS:
            described = ParameterDescriptor(description=one.description, read_only=one.fixed)
            if one.lowest is not None and one.highest is not None:
                if isinstance(one.default, int):
                    described.integer_range = [
                        IntegerRange(from_value=int(one.lowest), to_value=int(one.highest), step=1)
                    ]
                else:
                    described.floating_point_range = [
                        FloatingPointRange(from_value=one.lowest, to_value=one.highest)
                    ]
            self.declare_parameter(one.name, one.default, described)

    def _set(self, parameters: list[Parameter]) -> SetParametersResult:
        changes: dict[str, Any] = {}
        for parameter in parameters:
            if parameter.name == 'object_pose':
                try:
                    changes['object_pose'] = Pose.of(parameter.value)
                except PoseError as error:
                    return SetParametersResult(successful=False, reason=str(error))
            elif parameter.name == 'hand_frame':
                changes['hand_frame'] = str(parameter.value)
        self._snapshot = replace(self._snapshot, **changes)
        return SetParametersResult(successful=True)

    def _subscribe(self) -> None:
        group = PolledGroup()
        prefix = f'{NAMESPACE}/' if self.get_parameter('what_if').value else ''

        def listen(
            topic: str,
            kind: type,
            take: Callable[[Any, float], None],
            *,
            latched: bool = False,
            reliable: bool = False,
        ) -> None:
            subscription = self.create_subscription(
                kind,
                prefix + topic,
                lambda _: None,
                _qos(latched, latched or reliable),
                callback_group=group,
            )
            self._polled.append((subscription, take))

        def keep(name: str, read: Callable[[Any], object]) -> Callable[[Any, float], None]:
            return lambda message, _: self._keep(**{name: read(message)})

        listen('deformation/mesh', MeshMessage, keep('mesh', messages.read_mesh), latched=True)
        listen('deformation/state', String, keep('state', lambda m: str(m.data)), latched=True)
        listen('deformation/surface', PointCloud2, self._take_surface)
        for name in ('linear', 'nonlinear'):
            listen(f'deformation/{name}', PointCloud2, keep(name, messages.read_surface))
        listen('hand/contacts', PointCloud2, keep('contacts', messages.read_contacts))
        listen('hand/joint_states', JointState, keep('fingers', messages.read_joints))
        listen('object_pose', PoseStamped, keep('object_pose', messages.read_pose))
        for name, topic in (('scan', 'scan/points'), ('scan_error', 'scan/error')):
            listen(
                topic,
                PointCloud2,
                keep(name, lambda m: messages.read_cloud(m, SCAN_POINTS)),
                reliable=True,
            )
        for topic, name in NUMBERS.items():
            listen(topic, Float64, self._number(name))

    def _keep(self, **changes: Any) -> None:
        self._snapshot = replace(self._snapshot, **changes)

    def _number(self, name: str) -> Callable[[Float64, float], None]:
        def take(message: Float64, _: float) -> None:
            self._keep(numbers={**self._snapshot.numbers, name: float(message.data)})

        return take

    def _take_surface(self, message: PointCloud2, sent: float) -> None:
        surface = messages.read_surface(message)
        latency = sent - surface.stamp
        self._latency = latency if abs(latency) < PLAUSIBLE_LATENCY_S else float('nan')
        self._surface_at = time.monotonic()
        self._keep(served=surface, time=surface.stamp)
        # What one looks back at must not run out at its old end meanwhile.
        last = self._history.ends[1]
        due = surface.stamp < last or surface.stamp - last >= HISTORY_PERIOD_S
        if self.page.live and self._snapshot.mesh is not None and due:
            self._history.add(surface.stamp, self._snapshot)

    def _poll(self) -> None:
        for subscription, take in self._polled:
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, False)
            if taken is None:
                continue
            message, about = taken
            try:
                take(message, 1e-9 * float(about['source_timestamp']))
            except (messages.MessageError, PoseError, ValueError) as error:
                self.get_logger().warning(
                    f'{subscription.topic_name} is left out: {error}', throttle_duration_sec=5.0
                )

    def _tick(self) -> None:
        self._poll()
        if self.what_if is not None:
            self.what_if.tick(self._snapshot.mesh)
        self._remember()
        self._run_commands()
        if self.page.watched:
            self.page.update(self._snapshot)
            self._updates += 1

    def _remember(self) -> None:
        snapshot = self._snapshot
        now = time.monotonic()
        values = {name: snapshot.numbers[name] for name in SERIES if name in snapshot.numbers}
        values['surface_age'] = now - self._surface_at
        values['latency'] = self._latency
        contacts = snapshot.contacts
        if contacts is not None:
            size = np.linalg.norm(contacts.forces, axis=1)
            for finger in (1, 2, 3):
                of = (contacts.finger == finger) & (contacts.flags & CONTACT > 0)
                values[f'force_{finger}'] = float(size[of].sum())
        self._series.add(now - self._start, values)

    def _run_commands(self) -> None:
        while not self._commands.empty():
            self._ask(self._commands.get())
        self._asked = [call for call in self._asked if not self._settled(call)]

    def _ask(self, name: str) -> None:
        replay = str(self.get_parameter('replay_node').value)
        service = {'tare': 'hand/tare', 'compare': 'scan/compare'}.get(name, f'{replay}/{name}')
        client = self._callers.get(service)
        if client is None:
            client = self._callers[service] = self.create_client(Trigger, service)
        self._asked.append(Asked(name, client, time.monotonic()))
        self.page.answer(f'{name}: asked')

    def _settled(self, call: Asked) -> bool:
        """Bring one call forward; True once it was answered or given up."""
        waited = time.monotonic() - call.since
        if call.future is None:
            if call.client.service_is_ready():
                call.future = call.client.call_async(Trigger.Request())
            elif waited > DISCOVERY_S:
                self.page.answer(f'{call.name}: nobody offers {call.client.srv_name}')
                return True
            return False
        if call.future.done():
            answer = call.future.result()
            verdict = 'done' if answer.success else 'refused'
            self.page.answer(
                f'{call.name}: {verdict}{", " * bool(answer.message)}{answer.message}'
            )
            return True
        if waited > SERVICE_TIMEOUT_S:
            call.future.cancel()
            self.page.answer(f'{call.name}: no answer within {SERVICE_TIMEOUT_S:g} s')
            return True
        return False

    def _diagnose(self) -> None:
        clients = len(self.page.server.get_clients())
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK,
            name=f'{self.get_fully_qualified_name()}: page',
            message='serving',
            hardware_id='',
            values=[
                KeyValue(key='browsers', value=str(clients)),
                KeyValue(key='pictures in the last second', value=str(self._updates)),
                KeyValue(key='pictures kept', value=str(len(self._history))),
            ],
        )
        self._updates = 0
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def close(self) -> None:
        """End the what-if solver and the page."""
        if self.what_if is not None:
            self.what_if.close()
        self.page.close()


def main(arguments: list[str] | None = None) -> int:
    """Run the page until it is told to stop; 1 if it cannot be served."""
    if {'-h', '--help'} & set(sys.argv[1:] if arguments is None else arguments):
        print(usage())
        return 0
    rclpy.init(args=arguments)
    node: GraspView | None = None
    code = 0
    try:
        node = GraspView()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (PageError, PoseError, WhatIfError) as error:
        print(f'grasp_view: {error}', file=sys.stderr)
        code = 1
    finally:
        if node is not None:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()
    return code


if __name__ == '__main__':
    sys.exit(main())
