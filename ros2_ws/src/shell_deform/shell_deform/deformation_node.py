"""The `deformation` node: contacts in, deformed surface out, at every sample."""

from __future__ import annotations

import sys
import time
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from shell_deform import messages, parameters
from shell_deform.live.estimator import Estimator, Served
from shell_deform.live.health import Latencies, StampWatch
from shell_deform.live.modulus import ModulusFilter
from shell_deform.live.pose import Pose, PoseError, pose_of
from shell_deform.live.sample import SampleError, check
from shell_deform.live.serve_kernel import NONLINEAR_FIELDS
from shell_deform.live.states import LiveState, Watch
from shell_deform.live.worker_link import Build, WorkerError, WorkerLink, empty_request
from shell_deform.objects import load_object

CONTACTS_DEPTH = 500
# Answers a slow listener may fall behind before one is overwritten.
ANSWERS_DEPTH = 100
WATCH_PERIOD_S = 0.005
CONTRADICTION_LIMIT = 3.0
POSE_CHANGE = 1e-3
SCALARS = (
    'max_displacement',
    'linearity',
    'strain_energy',
    'nonlinear_age',
    'snap_margin',
    'contradiction',
)
REBUILD_PARAMETERS = frozenset({'object', 'theory', 'control_vertices', 'background_niceness'})


class DeformationNode(Node):
    """Answers every sample of `hand/contacts` with the surface; see the package README."""

    def __init__(self, **options: Any) -> None:
        super().__init__('deformation', **options)
        for parameter in parameters.PARAMETERS:
            self.declare_parameter(
                parameter.name, parameter.default, messages.descriptor(parameter)
            )
        values = self._values()
        parameters.validate(values)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)

        self.estimator: Estimator | None = None
        self.modulus: ModulusFilter | None = None
        self.watch = Watch()
        self.stamps = StampWatch()
        self.ticks = Latencies()
        self.refused = 0
        self.results = 0
        self.served: Served | None = None
        self.failure = ''
        self._unusable = ''
        self._topic_pose: Pose | None = None
        self._frame = ''
        self._reset_asked = False
        self._somebody_publishes = True
        self._published_state: LiveState | None = None
        self._marker_stamp = 0
        self._request = empty_request()
        self._reader = messages.ContactReader()
        self._settings = parameters.settings(values)
        self._configure(values)
        self.link = WorkerLink(_build(values))

        reliable = QoSProfile(depth=ANSWERS_DEPTH)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._clouds = {
            name: self.create_publisher(PointCloud2, f'deformation/{name}', reliable)
            for name in ('surface', 'linear', 'nonlinear')
        }
        self._scalars = {
            name: self.create_publisher(Float64, f'deformation/{name}', reliable)
            for name in SCALARS
        }
        self._modulus = {
            name: self.create_publisher(Float64, f'deformation/{name}', reliable)
            for name in ('modulus', 'modulus_sigma')
        }
        self._mesh = self.create_publisher(Mesh, 'deformation/mesh', latched)
        self._marker = self.create_publisher(Marker, 'deformation/marker', latched)
        self._state = self.create_publisher(String, 'deformation/state', latched)
        self._diagnostics = self.create_publisher(
            messages.DiagnosticArray, '/diagnostics', reliable
        )
        best_effort = QoSProfile(depth=CONTACTS_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(PointCloud2, 'hand/contacts', self._contacts, best_effort)
        self.create_subscription(PoseStamped, 'object_pose', self._pose_message, reliable)
        self.create_service(Trigger, 'deformation/reset', self._reset)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(WATCH_PERIOD_S, self._look, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self._marker_timer = self.create_timer(0.5, self._publish_marker, clock=steady)
        self._publish_state(self.watch.state)

    # ---- parameters

    def _values(self) -> dict[str, Any]:
        return {p.name: self.get_parameter(p.name).value for p in parameters.PARAMETERS}

    def _validate(self, changes: list[RosParameter]) -> SetParametersResult:
        try:
            parameters.validate({change.name: change.value for change in changes})
        except parameters.ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[RosParameter]) -> None:
        values = self._values()
        self._configure(values)
        if REBUILD_PARAMETERS & {change.name for change in changes}:
            self.get_logger().info(f'building {values["object"]} anew')
            self.estimator = None
            self.served = None
            self.failure = ''
            self.link.rebuild(_build(values))

    def _configure(self, values: dict[str, Any]) -> None:
        self._settings = parameters.settings(values)
        if self.estimator is not None:
            self.estimator.settings = self._settings
        self.watch.periods = float(values['stale_periods'])
        self.watch.floor = float(values['stale_floor'])
        self._parameter_pose = (
            pose_of(list(values['object_pose'])) if values['placement'] == 'given' else None
        )
        if self.modulus is not None:
            self.modulus.errors = self._settings.errors
        self._learns = bool(values['estimate_modulus'])
        self._given_frame = str(values['frame'])
        self._marker_rate = float(values['marker_rate'])
        if hasattr(self, '_marker_timer') and self._marker_rate > 0:
            self._marker_timer.timer_period_ns = int(1e9 / self._marker_rate)

    # ---- the fast loop

    def _contacts(self, message: PointCloud2) -> None:
        began = time.perf_counter()
        now = time.monotonic()
        try:
            sample = self._reader.read(message)
            check(sample)
        except (messages.MessageError, SampleError) as error:
            self.refused += 1
            self._unusable = str(error)
            self.get_logger().error(str(error), throttle_duration_sec=5.0)
            self._publish_state(self.watch.refused(now))
            return
        backwards = self.stamps.backwards
        if not self.stamps.arrived(sample.stamp):
            return
        if self.stamps.backwards > backwards:
            self.get_logger().info('time went back: starting from the undeformed shell')
            self._start_anew()
        self._frame = self._given_frame or message.header.frame_id
        state = self.watch.sample(sample, now)
        self._publish_state(state)
        estimator = self.estimator
        if estimator is None or not state.is_served:
            return
        slot = self.link.worker.newer_result()
        if slot is not None:
            estimator.adopt(slot)
            self.results += 1
        estimator.pose = self._given_pose
        served = estimator.tick(sample)
        self._publish('surface', served.packed, served.stamp)
        self.ticks.add(time.perf_counter() - began)
        self.served = served
        self._post(estimator)
        self._publish_more(estimator, served, slot is not None)

    def _post(self, estimator: Estimator) -> None:
        record = self._request[0]
        estimator.fill_request(record)
        record['reset'] = int(self._reset_asked)
        self._reset_asked = False
        self.link.worker.post(self._request)

    def _publish(self, name: str, packed: Any, stamp: int) -> None:
        writer = self._nonlinear_writer if name == 'nonlinear' else self._writer
        self._clouds[name].publish(writer.message(packed, stamp, self._frame))

    def _publish_more(self, estimator: Estimator, served: Served, new_result: bool) -> None:
        for name, publisher in self._scalars.items():
            if publisher.get_subscription_count():
                publisher.publish(messages.number(getattr(served, name)))
        if self._clouds['linear'].get_subscription_count():
            self._publish('linear', estimator.linear(), served.stamp)
        if new_result and self._clouds['nonlinear'].get_subscription_count():
            packed = estimator.nonlinear()
            if packed is not None and estimator.adopted is not None:
                stamp = estimator.adopted.stamp
                self._publish('nonlinear', packed, stamp)
        if self._learns and self.modulus is not None:
            self._learn(estimator, self.modulus)

    def _learn(self, estimator: Estimator, modulus: ModulusFilter) -> None:
        """Young's modulus from this sample, published when the sample said something."""
        adopted, posterior, measured = estimator.adopted, estimator.posterior, estimator.measured
        if adopted is None or posterior is None or measured is None:
            modulus.release()
        elif modulus.update(adopted.response, posterior.inputs, measured):
            found = modulus.estimate
            self._modulus['modulus'].publish(messages.number(found.value))
            self._modulus['modulus_sigma'].publish(messages.number(found.sigma))

    @property
    def _given_pose(self) -> Pose | None:
        """The pose from the topic, else the parameter; None if it is to be inferred."""
        return self._topic_pose or self._parameter_pose

    def _pose_message(self, message: PoseStamped) -> None:
        try:
            self._topic_pose = messages.read_pose(message)
        except PoseError as error:
            self.get_logger().error(f'object_pose: {error}', throttle_duration_sec=5.0)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._start_anew()
        response.success = True
        response.message = 'the next sample starts from the undeformed shell'
        return response

    def _start_anew(self) -> None:
        """Forget contacts and equilibria, here and in the background."""
        self._reset_asked = True
        self.link.worker.disown()
        self.served = None
        if self.estimator is not None:
            self.estimator.forget()

    # ---- slow things

    def _look(self) -> None:
        now = time.monotonic()
        self._publish_state(self.watch.look(now, self._somebody_publishes))
        try:
            ready = self.link.tend(now)
        except WorkerError as error:
            if str(error) != self.failure:
                self.failure = str(error)
                self.get_logger().error(self.failure)
            return
        if ready:
            self._take_over()

    def _take_over(self) -> None:
        """A background process has built the shell: serve it from now on."""
        memory = self.link.worker.memory
        assert memory is not None
        previous = self.estimator
        self.estimator = Estimator(memory.rest, memory.rest_normals, self._settings)
        self.estimator.pose = self._given_pose
        self.estimator.warm_up()
        if previous is not None and previous.rest.shape == memory.rest.shape:
            # The same shell again after a restart: its last good state is still the best known.
            self.estimator.adopted = previous.adopted
            return
        young = load_object(self.get_parameter('object').value).young_modulus_pa
        self.modulus = ModulusFilter(young, self._settings.errors)
        self._writer = messages.SurfaceWriter(len(memory.rest))
        self._nonlinear_writer = messages.SurfaceWriter(len(memory.rest), NONLINEAR_FIELDS)
        self._publish_mesh()
        self.get_logger().info(
            f'{self.get_parameter("object").value}: {len(memory.rest)} vertices, serving'
        )

    def _publish_mesh(self) -> None:
        """Topology and rest positions, in the same frame as the surface."""
        memory = self.link.worker.memory
        if memory is not None and self.estimator is not None:
            pose = self.estimator.pose_in_use
            self._mesh_pose = pose.numbers
            self._mesh.publish(
                messages.mesh_message(memory.triangles, pose.from_object(memory.rest))
            )

    def _publish_state(self, state: LiveState) -> None:
        if state is not self._published_state:
            self._published_state = state
            self._state.publish(messages.text(state.value))

    def _publish_marker(self) -> None:
        served, memory = self.served, self.link.worker.memory
        if served is None or memory is None or not self._marker_rate:
            return
        if served.stamp == self._marker_stamp or not self._marker.get_subscription_count():
            return
        if len(served.packed) != len(memory.rest):
            return
        self._marker_stamp = served.stamp
        self._marker.publish(
            messages.marker_message(memory.triangles, served.packed, served.stamp, self._frame)
        )

    def _diagnose(self) -> None:
        self._somebody_publishes = self.count_publishers('hand/contacts') > 0
        if self.estimator is not None:
            moved = self.estimator.pose_in_use.numbers - self._mesh_pose
            if abs(moved).max() > POSE_CHANGE:
                self._publish_mesh()
        level, summary, values = self._health()
        self._diagnostics.publish(
            messages.diagnostics(
                self.get_clock().now().nanoseconds,
                f'{self.get_fully_qualified_name()[1:]}: surface',
                level,
                summary,
                values,
            )
        )

    def _health(self) -> tuple[str, str, dict[str, object]]:
        state, served = self.watch.state, self.served
        estimator = self.estimator
        adopted = estimator.adopted if estimator is not None else None
        values: dict[str, object] = {
            'state': state.value,
            'object': self.get_parameter('object').value,
            'drive': self.get_parameter('drive').value,
            'samples': self.stamps.samples,
            'lost': self.stamps.lost,
            'refused': self.refused,
            'backward stamps': self.stamps.backwards,
            'input rate [Hz]': 1.0 / self.watch.period if self.watch.period else 0.0,
            'tick median [ms]': 1e3 * self.ticks.percentile(50),
            'tick p99 [ms]': 1e3 * self.ticks.percentile(99),
            'background restarts': self.link.restarts,
            'background alive': self.link.worker.alive,
            'background results': self.results,
        }
        if adopted is not None:
            record = adopted.slot.record
            values['load cases overtaken'] = int(record['dropped'])
            values['background solve [ms]'] = 1e3 * float(record['seconds'])
            values['load carried'] = adopted.share
            values['stable'] = adopted.stable
            values['object pose'] = ' '.join(f'{v:.5g}' for v in adopted.pose.numbers)
            values['background says'] = adopted.message
        if served is not None:
            values['nonlinear age [s]'] = served.nonlinear_age
            values['error of the linear step [mm]'] = 1e3 * served.extrapolation
            values['contradiction'] = served.contradiction
            values['suspect'] = served.suspect
            values['unbalanced force [N]'] = estimator.unbalance if estimator is not None else 0.0
            values['snap margin'] = served.snap_margin
        if self._learns and self.modulus is not None:
            found = self.modulus.estimate
            values["Young's modulus [Pa]"] = found.value
            values["Young's modulus, sigma [Pa]"] = found.sigma
        if self.failure:
            return 'error', self.failure, values
        if state is LiveState.FAULT:
            return 'error', self._unusable or 'a finger reports a fault', values
        if state is LiveState.STALE:
            return 'stale', 'no fresh contacts', values
        if estimator is None:
            return 'warn', 'the background process is building the shell', values
        if not self.link.worker.alive:
            return 'warn', 'the background process ended and is started again', values
        if served is not None and served.contradiction > CONTRADICTION_LIMIT:
            return 'warn', f'force and motion contradict: {served.suspect}', values
        if adopted is not None and adopted.share < 1.0:
            return 'warn', f'the last load case is not carried: {adopted.message}', values
        if state is LiveState.SATURATED:
            return 'warn', 'a gauge is saturated', values
        return 'ok', state.value, values

    def close(self) -> None:
        """End the background process."""
        self.link.stop()


def _build(values: dict[str, Any]) -> Build:
    return Build(
        str(values['object']),
        str(values['theory']),
        int(values['control_vertices']),
        int(values['background_niceness']),
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is told to stop; returns the exit code."""
    given = remove_ros_args(sys.argv[1:] if arguments is None else arguments)
    if {'-h', '--help'} & set(given):
        print(parameters.usage())
        return 0
    if given:
        print(f'deformation: unknown argument {given[0]!r}; see --help', file=sys.stderr)
        return 2
    rclpy.init(args=arguments)
    try:
        node = DeformationNode()
    except (
        parameters.ParameterError,
        InvalidParameterTypeException,
        InvalidParameterValueException,
    ) as error:
        print(f'deformation: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        executor.shutdown()
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
