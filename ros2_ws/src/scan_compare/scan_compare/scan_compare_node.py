# SPDX-License-Identifier: Apache-2.0
"""The `scan_compare` node: scans and surfaces in, errors with their noise floor out."""

from __future__ import annotations

import json
import sys
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from grasp_common.main_node import beside_others, declare, run_node, status_name
from grasp_common.messages import diagnostics, named_numbers, nanoseconds, number, raw_stamp
from grasp_common.parameter_table import ParameterError
from grasp_common.point_cloud import CloudReader, MessageError
from scan_compare import messages, parameters
from scan_compare.pairing import CONTACT_FIELDS, finger_forces, remarks, start_pose
from scan_compare.surface_history import SPACING_NS, StampedSurface, SurfaceHistory
from scan_compare.worker import Cloud, Job, Result, Worker

TEND_PERIOD_S = 0.02
SURFACE_DEPTH = 50
SURFACE_FIELDS = ('x', 'y', 'z', 'ux', 'uy', 'uz')
OUTER_FIELDS = ('ox', 'oy', 'oz')
UNDEFORMED_SHARE = 3.0
"""A model displaced by less than this many scanner sigmas counts as undeformed."""

SCALARS = {
    'mean_error': 'mean_error_m',
    'max_error': 'max_error_m',
    'noise_floor': 'noise_floor_m',
}


@dataclass
class Pending:
    """A scan that waits for a surface of its time; `forces` [N] by finger when it arrived."""

    cloud: Cloud
    stamp_ns: int
    frame: str
    arrived: float
    forces: dict[int, float]
    future: Future | None = None


class ScanCompareNode(Node):
    """Compares every scan with the surface of its time; see the package README."""

    def __init__(self, **options: Any) -> None:
        super().__init__('scan_compare', **options)
        declare(self, parameters.PARAMETERS)
        parameters.validate(self._values())
        self.add_on_set_parameters_callback(self._validate)
        self.history = SurfaceHistory(float(self._value('history')))
        self.worker = Worker()
        self._triangles: np.ndarray | None = None
        self._pending: deque[Pending] = deque()
        self._last: Pending | None = None
        self._undeformed: Cloud | None = None
        self._futures: dict[int, Future] = {}
        self._jobs = 0
        self._scans = self._done = self._refused = self._dropped = 0
        self._contacts = self._surface = b''
        self._surface_read_ns = -SPACING_NS
        self._surfaces = CloudReader('deformation/surface')
        self._grips = CloudReader('hand/contacts')
        self._clouds = CloudReader('scan/points')
        self._seconds = 0.0
        self._result: Result | None = None
        self._failure = ''

        reliable = QoSProfile(depth=10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        best_effort = ReliabilityPolicy.BEST_EFFORT
        self._error = self.create_publisher(PointCloud2, 'scan/error', latched)
        self._scalars = {
            name: self.create_publisher(Float64, f'scan/{name}', reliable) for name in SCALARS
        }
        self._numbers = self.create_publisher(JointState, 'scan/numbers', reliable)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', reliable)
        self.create_subscription(
            PointCloud2,
            'scan/points',
            self._scan_message,
            reliable,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._lacking),
        )
        self.create_subscription(
            PointCloud2,
            'deformation/surface',
            self._surface_message,
            QoSProfile(depth=SURFACE_DEPTH, reliability=best_effort),
            raw=True,
        )
        self.create_subscription(
            PointCloud2,
            'hand/contacts',
            self._contacts_message,
            QoSProfile(depth=1, reliability=best_effort),
            raw=True,
        )
        self.create_subscription(Mesh, 'deformation/mesh', self._mesh_message, latched)
        # a group of its own: while the answer is awaited, timers and topics go on
        self.create_service(
            Trigger, 'scan/compare', self._compare, callback_group=ReentrantCallbackGroup()
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TEND_PERIOD_S, self._tend, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self.get_logger().info('waiting for scans')

    # ---- parameters

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _values(self) -> dict[str, Any]:
        return {p.name: self._value(p.name) for p in parameters.PARAMETERS}

    def _validate(self, changes: list[RosParameter]) -> SetParametersResult:
        try:
            parameters.validate({change.name: change.value for change in changes})
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        for change in changes:
            if change.name == 'history':
                self.history.seconds = float(change.value)
        return SetParametersResult(successful=True)

    # ---- inputs

    def _lacking(self, _: QoSRequestedIncompatibleQoSInfo) -> None:
        self._refuse(
            'somebody publishes scan/points BEST_EFFORT: of a scan all parts must arrive, so none '
            'of theirs is taken; publish it RELIABLE'
        )

    def _mesh_message(self, message: Mesh) -> None:
        try:
            self._triangles = messages.triangles(message)
        except MessageError as error:
            self._refuse(str(error))

    # Contacts and surfaces come hundreds of times a second, scans every few minutes: what comes
    # stays as it came until it is wanted.

    def _surface_message(self, message: bytes) -> None:
        self._surface = message
        if abs(raw_stamp(message) - self._surface_read_ns) >= SPACING_NS:
            self._read_surface()

    def _read_surface(self) -> None:
        """Take the newest surface into the history."""
        waiting, self._surface = self._surface, b''
        if not waiting:
            return
        self._surface_read_ns = raw_stamp(waiting)
        try:
            message = messages.cloud_of(waiting, 'deformation/surface')
        except MessageError as error:
            self._refuse(str(error))
            return
        fields: tuple[str, ...] = SURFACE_FIELDS
        if any(field.name == OUTER_FIELDS[0] for field in message.fields):
            fields = (*SURFACE_FIELDS, *OUTER_FIELDS)
        try:
            rows = self._surfaces.read_columns(message, fields)
        except MessageError as error:
            self._refuse(str(error))
            return
        if len(rows) == 0 or not np.all(np.isfinite(rows)):
            self._refuse('deformation/surface is empty or holds numbers that are not finite')
            return
        # As precise as they came: of these there are thousands.
        rows = rows.astype(np.float32)
        stamp = nanoseconds(message.header.stamp)
        frame = message.header.frame_id
        outer = rows[:, 6:] if len(fields) > 6 else None
        self.history.add(StampedSurface(stamp, rows[:, :3], rows[:, 3:6], frame, outer))

    def _contacts_message(self, message: bytes) -> None:
        self._contacts = message

    def _forces(self) -> dict[int, float]:
        if not self._contacts:
            return {}
        try:
            message = messages.cloud_of(self._contacts, 'hand/contacts')
            rows = self._grips.read_columns(message, CONTACT_FIELDS)
        except MessageError as error:
            self._refuse(str(error))
            return {}
        return finger_forces(rows)

    def _scan_message(self, message: PointCloud2) -> None:
        self._scans += 1
        try:
            points = self._clouds.read_columns(message, ('x', 'y', 'z'))
        except MessageError as error:
            self._refuse(str(error))
            return
        stamp = nanoseconds(message.header.stamp)
        cloud = Cloud('scan/points', points, str(self._value('scan_unit')))
        frame = message.header.frame_id
        self._make_room(cloud.size)
        self._last = Pending(cloud, stamp, frame, time.monotonic(), self._forces())
        self._pending.append(self._last)

    def _make_room(self, size: int) -> None:
        """Drop the scans that have waited longest until `size` bytes more can wait."""
        room = 1e6 * float(self._value('waiting_memory')) - size
        while self.worker.waiting_size + sum(p.cloud.size for p in self._pending) > room:
            job = self.worker.drop_oldest()
            if job is None and not self._pending:
                return
            stamp_ns = self._pending.popleft().stamp_ns if job is None else job.stamp_ns
            self._dropped += 1
            reason = (
                f'the scan of {1e-9 * stamp_ns:.3f} s was dropped unjudged: scans come faster '
                'than they are compared; raise waiting_memory, or replay more slowly'
            )
            if job is None:
                self._refuse(reason)
            else:
                self._publish(Result(job.number, stamp_ns, '', reason))

    def _refuse(self, reason: str) -> None:
        self._refused += 1
        self._failure = reason
        self.get_logger().error(reason, throttle_duration_sec=5.0)

    async def _compare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Compare the last scan, or the scan file, with the newest surface."""
        path = str(self._value('scan_file'))
        future = Future()
        if self._last is not None:
            wanted = replace(self._last, future=future)
        elif path:
            cloud = Cloud(path, None, None)
            wanted = Pending(cloud, 0, '', time.monotonic(), self._forces(), future)
        else:
            response.success = False
            response.message = (
                'no scan has arrived on scan/points and the parameter scan_file is empty'
            )
            return response
        self._submit(wanted)
        result: Result = await future
        response.success = not result.error
        response.message = result.error or json.dumps(result.statistics, sort_keys=True)
        return response

    # ---- comparisons

    def _tend(self) -> None:
        # in their order: an early stamp may not overtake one that still waits for its surface
        while self._pending and self._surface_is_due(self._pending[0]):
            self._submit(self._pending.popleft())
        result = self.worker.poll()
        if result is not None:
            self._publish(result)

    def _surface_is_due(self, pending: Pending) -> bool:
        self._read_surface()
        newest = self.history.newest
        if newest is not None and newest.stamp_ns >= pending.stamp_ns:
            return self._triangles is not None or self._waited(pending)
        return self._waited(pending)

    def _waited(self, pending: Pending) -> bool:
        return time.monotonic() - pending.arrived >= float(self._value('surface_wait'))

    def _submit(self, pending: Pending) -> None:
        self._read_surface()
        surface = self.history.at(pending.stamp_ns) if self._triangles is not None else None
        self._jobs += 1
        values = self._values()
        sigma, outlier = float(values['scanner_sigma']), float(values['outlier_distance'])
        undeformed = self._undeformed_cloud()
        if surface is None or surface.max_displacement < UNDEFORMED_SHARE * sigma:
            self._undeformed = pending.cloud
            undeformed = None
        job = Job(
            number=self._jobs,
            cloud=pending.cloud,
            object=str(values['object']),
            triangles=None if surface is None else self._triangles,
            rest=None if surface is None else surface.rest,
            deformed=None if surface is None else surface.position.astype(np.float64),
            outer=None
            if surface is None or surface.outer is None
            else surface.outer.astype(np.float64),
            start=start_pose(values, pending.frame, surface),
            scanner_sigma_m=sigma,
            outlier_m=outlier or None,
            undeformed=undeformed,
            report_directory=str(values['report_directory']),
            stamp_ns=pending.stamp_ns,
            frame=surface.frame if surface is not None else str(values['object_frame']),
            notes=remarks(
                pending.stamp_ns, surface, float(values['surface_tolerance']), pending.forces
            ),
        )
        if pending.future is not None:
            self._futures[job.number] = pending.future
        self.worker.submit(job)

    def _undeformed_cloud(self) -> Cloud | None:
        path = str(self._value('undeformed_scan_file'))
        return Cloud(path, None, None) if path else self._undeformed

    def _publish(self, result: Result) -> None:
        self._answer(result)
        if result.error:
            self._refuse(result.error)
            return
        self._done += 1
        self._seconds = result.seconds
        self._failure = ''
        self._result = result
        self._error.publish(
            messages.error_cloud(result.points, result.distance, result.stamp_ns, result.frame)
        )
        known = {
            name: value
            for name, key in SCALARS.items()
            if isinstance(value := result.statistics[key], float)
        }
        for name, value in known.items():
            self._scalars[name].publish(number(value))
        self._numbers.publish(named_numbers(known, result.stamp_ns, result.frame))
        self.get_logger().info(result.sentence)

    def _answer(self, result: Result) -> None:
        future = self._futures.pop(result.number, None)
        if future is not None:
            future.set_result(result)

    # ---- health

    def _diagnose(self) -> None:
        level, summary, values = self._health()
        level, summary = beside_others(self, (level, summary), 'deformation/surface', 'scan/error')
        self._diagnostics.publish(
            diagnostics(
                self.get_clock().now().nanoseconds,
                status_name(self, 'comparison'),
                level,
                summary,
                values,
            )
        )

    def _health(self) -> tuple[str, str, dict[str, object]]:
        values: dict[str, object] = {
            'object': self._value('object'),
            'scans': self._scans,
            'comparisons': self._done,
            'refused': self._refused,
            'waiting': len(self._pending) + self.worker.waiting,
            'dropped': self._dropped,
            'process restarts': self.worker.restarts,
            'surfaces kept': len(self.history),
            'busy': self.worker.busy,
            'last comparison [s]': self._seconds,
        }
        if self._result is not None:
            statistics = self._result.statistics
            for key in ('mean_error_m', 'max_error_m', 'dent_mean_error_m', 'noise_floor_m'):
                value = statistics[key]
                if isinstance(value, float):
                    values[key.removesuffix('_m') + ' [mm]'] = 1e3 * value
            registration = statistics['registration']
            if isinstance(registration, dict):
                values['registration'] = registration['text']
            values['verdict'] = self._result.sentence
        if self._failure:
            return 'error', self._failure, values
        if self._result is None:
            return 'ok', 'comparing' if self.worker.busy else 'waiting for a scan', values
        return 'ok', self._result.sentence, values

    def close(self) -> None:
        """End the comparing process."""
        self.worker.close()


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is told to stop; returns the exit code."""
    return run_node('scan_compare', ScanCompareNode, arguments, usage=parameters.usage)


if __name__ == '__main__':
    sys.exit(main())
