# SPDX-License-Identifier: Apache-2.0
"""`grasp_view`: a browser page that listens to topics and calls services, nothing else."""

from __future__ import annotations

import queue
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import (
    SetParametersResult,
)
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh as MeshMessage
from std_msgs.msg import Bool, Float64, String

from grasp_common.main_node import declare, run_node, status_name
from grasp_common.messages import diagnostics
from grasp_common.point_cloud import LARGEST_NUMBER

from . import messages
from .curves import Curves
from .hand_description import barrett_hand, read_description
from .page import BUTTONS, Page, PageError
from .parameters import PARAMETERS, usage
from .plot_panel import SERIES, STAMP
from .poses import Pose, PoseError
from .replay_panel import ReplayState
from .scene_model import CONTACT, Snapshot
from .service_calls_node import ServiceCalls
from .solver_process import WhatIfError
from .time_series import History, TimeSeries
from .what_if_node import NAMESPACE, WhatIf

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
HISTORY_PERIOD_S = 0.19
# A replay that has not told its position for so long is gone.
REPLAY_GONE_S = 2.0
# A surface so much older than the one before is another time, not a late sample.
JUMP_S = 0.5
# Contact messages between two pictures, so that the one which a surface answers is among them.
CONTACTS_KEPT = 40


Take = Callable[[Any, float], None]


class PolledGroup(CallbackGroup):
    """Subscriptions that the executor leaves alone.

    The page shows 20 pictures a second of topics that come 250 times a second: waking up for
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


def _qos(latched: bool, reliable: bool, depth: int) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class GraspView(Node):
    """Takes the newest messages at the page's rate, hands them over, forwards the buttons."""

    def __init__(self) -> None:
        super().__init__('grasp_view')
        declare(self, PARAMETERS)
        self._rate = float(self.get_parameter('rate').value)
        span = float(self.get_parameter('history').value)
        self._snapshot = Snapshot(
            object_pose=Pose.of(self.get_parameter('object_pose').value),
            hand_frame=str(self.get_parameter('hand_frame').value),
            hand=barrett_hand(),
        )
        self._series = TimeSeries((*SERIES, STAMP), span, int(span * self._rate) + 1)
        self._history: History[Snapshot] = History(span, int(span / HISTORY_PERIOD_S) + 1)
        self._curves = Curves()
        self._commands: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._start = time.monotonic()
        self._latency = float('nan')
        self._surface_at = self._reset_at = float('nan')
        self._sent: dict[float, float] = {}
        self._replay = ReplayState(0.0, float('nan'))
        self._replay_at = float('-inf')
        self._polled: list[tuple[Any, Take, Take]] = []
        self._drawn = self._left_out = self._unusable = 0
        self._subscribe()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.page = Page(
            str(self.get_parameter('host').value),
            int(self.get_parameter('port').value),
            self._commands.put,
            self._series,
            self._history,
            self._curves,
            () if self.get_parameter('what_if').value else tuple(BUTTONS),
        )
        self._calls = ServiceCalls(self, self.page.answer)
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
            take: Take,
            *,
            latched: bool = False,
            reliable: bool = False,
            depth: int = 1,
            note: Take = lambda _message, _sent: None,
        ) -> None:
            subscription = self.create_subscription(
                kind,
                prefix + topic,
                lambda _: None,
                _qos(latched, latched or reliable, depth),
                callback_group=group,
            )
            self._polled.append((subscription, take, note))

        def keep(name: str, read: Callable[[Any], object]) -> Take:
            return lambda message, _: self._keep(**{name: read(message)})

        listen('deformation/mesh', MeshMessage, keep('mesh', messages.read_mesh), latched=True)
        for name in ('state', 'answer'):
            listen(f'deformation/{name}', String, keep(name, lambda m: str(m.data)), latched=True)
        # Before the surface, so that the sample which it answers is known.
        listen(
            'hand/contacts',
            PointCloud2,
            self._take_contacts,
            depth=CONTACTS_KEPT,
            note=self._note_contacts,
        )
        listen('deformation/surface', PointCloud2, self._take_surface)
        for name in ('linear', 'nonlinear'):
            listen(f'deformation/{name}', PointCloud2, keep(name, messages.read_surface))
        listen('deformation/grasp', PointCloud2, keep('grasp', messages.read_grasp))
        listen('deformation/later_force', PointCloud2, self._take_later)
        listen('deformation/grips', PointCloud2, self._take_grips)
        listen('hand/joint_states', JointState, keep('joints', messages.read_joints))
        read_hand = keep('hand', lambda m: read_description(str(m.data)))
        listen('robot_description', String, read_hand, latched=True)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._take_facts, 10)
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
        if not prefix:
            listen(f'{self._replay_node}/position', Float64, self._take_position)
            recording = keep('recording', lambda m: str(m.data))
            listen(f'{self._replay_node}/recording', String, recording, latched=True)
            for name, kind in (('duration', Float64), ('paused', Bool)):
                listen(f'{self._replay_node}/{name}', kind, self._of_replay(name), latched=True)

    @property
    def _replay_node(self) -> str:
        return str(self.get_parameter('replay_node').value)

    def _of_replay(self, name: str) -> Take:
        def take(message: Float64 | Bool, _: float) -> None:
            self._replay = replace(self._replay, **{name: message.data})

        return take

    def _take_position(self, message: Float64, _: float) -> None:
        self._replay = replace(self._replay, position=float(message.data))
        self._replay_at = time.monotonic()

    def _keep(self, **changes: Any) -> None:
        self._snapshot = replace(self._snapshot, **changes)

    def _take_facts(self, message: DiagnosticArray) -> None:
        facts = messages.read_facts(message, NAMESPACE, self.what_if is not None)
        if facts is not None:
            self._keep(**vars(facts))

    def _number(self, name: str) -> Take:
        def take(message: Float64, _: float) -> None:
            # What no float32 holds measures nothing, and overflows in millimetres.
            told = float(message.data)
            value = told if abs(told) <= LARGEST_NUMBER else float('nan')
            self._keep(numbers={**self._snapshot.numbers, name: value})

        return take

    def _take_contacts(self, message: PointCloud2, _: float) -> None:
        contacts = messages.read_contacts(message)
        self._keep(contacts=contacts)
        self._curves.hold.add(contacts)

    def _take_later(self, message: PointCloud2, _: float) -> None:
        self._curves.hold.later = messages.read_later(message)

    def _take_grips(self, message: PointCloud2, _: float) -> None:
        self._curves.turn.add(messages.read_grips(message))

    def _note_contacts(self, message: PointCloud2, sent: float) -> None:
        self._sent[messages.seconds(message.header.stamp)] = sent
        while len(self._sent) > CONTACTS_KEPT:
            del self._sent[next(iter(self._sent))]

    def _take_surface(self, message: PointCloud2, sent: float) -> None:
        surface = messages.read_surface(message)
        # Both times are the middleware's, so that a replay of old stamps has a latency too.
        asked = self._sent.get(surface.stamp)
        if asked is not None:
            self._latency = sent - asked
        self._surface_at = time.monotonic()
        if surface.stamp < self._snapshot.time - JUMP_S:
            self._reset_at = self._surface_at
        self._keep(served=surface, time=surface.stamp)
        # What one looks back at must not run out at its old end meanwhile.
        last = self._history.ends[1]
        due = surface.stamp < last or surface.stamp - last >= HISTORY_PERIOD_S
        if self.page.live and self._snapshot.mesh is not None and due:
            self._history.add(surface.stamp, self._snapshot)

    def _poll(self) -> None:
        """Take what came of each topic: `note` sees every message kept, `take` the newest."""
        for subscription, take, note in self._polled:
            newest: tuple[Any, float] | None = None
            for _ in range(subscription.qos_profile.depth):
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, False)
                if taken is None:
                    break
                newest = taken[0], 1e-9 * float(taken[1]['source_timestamp'])
                note(*newest)
            if newest is None:
                continue
            try:
                take(*newest)
            except (ArithmeticError, LookupError, ValueError) as error:
                self._unusable += 1
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
            now = time.monotonic()
            replay = self._replay if now - self._replay_at < REPLAY_GONE_S else None
            try:
                self.page.update(
                    self._snapshot, replay, now - self._surface_at, now - self._reset_at
                )
            except (ArithmeticError, LookupError, ValueError) as error:
                # Whatever cannot be drawn of what came, the next one finds the page as it was.
                self._left_out += 1
                self.get_logger().warning(
                    f'a picture is left out: {type(error).__name__}: {error}',
                    throttle_duration_sec=5.0,
                )

    def _remember(self) -> None:
        snapshot = self._snapshot
        now = time.monotonic()
        values = {name: snapshot.numbers[name] for name in SERIES if name in snapshot.numbers}
        values['surface_age'] = now - self._surface_at
        values['latency'] = self._latency
        values[STAMP] = snapshot.time
        contacts = snapshot.contacts
        if contacts is not None:
            size = np.linalg.norm(contacts.forces, axis=1)
            for finger in (1, 2, 3):
                of = (contacts.finger == finger) & (contacts.flags & CONTACT > 0)
                values[f'force_{finger}'] = float(size[of].sum())
        self._series.add(now - self._start, values)

    def _run_commands(self) -> None:
        while not self._commands.empty():
            name = self._commands.get()
            service = {'tare': 'hand/tare', 'compare': 'scan/compare'}.get(name)
            self._calls.trigger(name, service or f'{self._replay_node}/{name}')
        wanted = self.page.replay.take_wanted()
        if wanted is not None:
            place = Parameter('position_s', value=wanted)
            self._calls.set_parameter(f'go to {wanted:.2f} s', self._replay_node, place)
        self._calls.tick()

    def _diagnose(self) -> None:
        clients, drawn = len(self.page.server.get_clients()), self.page.scene.drawn
        values = {
            'browsers': clients,
            'surfaces drawn in the last second': drawn - self._drawn,
            'pictures kept': len(self._history),
            'pictures left out': self._left_out,
            'messages left out': self._unusable,
        }
        self._drawn = drawn
        now, name = self.get_clock().now().nanoseconds, status_name(self, 'page')
        self._diagnostics.publish(diagnostics(now, name, 'ok', 'serving', values))

    def close(self) -> None:
        """End the what-if solver and the page."""
        if self.what_if is not None:
            self.what_if.close()
        self.page.close()


def main(arguments: list[str] | None = None) -> int:
    """Run the page until it is told to stop; 1 if it cannot be served."""
    return run_node(
        'grasp_view', GraspView, arguments, usage=usage, errors=(PageError, PoseError, WhatIfError)
    )


if __name__ == '__main__':
    sys.exit(main())
