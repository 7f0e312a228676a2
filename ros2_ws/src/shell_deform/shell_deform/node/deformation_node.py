# SPDX-License-Identifier: Apache-2.0
"""The `deformation` node: contacts in, deformed surface out, at every sample."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from grasp_common.main_node import beside_others, declare, run_node
from grasp_common.messages import nanoseconds
from grasp_common.parameter_table import ParameterError
from grasp_common.point_cloud import MessageError
from shell_deform.live.background.worker_link import (
    Build,
    WorkerError,
    WorkerLink,
    WorkerProcess,
    empty_request,
)
from shell_deform.live.exchange import Slot
from shell_deform.live.pose import Pose, PoseError, pose_of
from shell_deform.live.tick import diagnosis
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.contact_cloud import ContactReader
from shell_deform.live.tick.estimator import Estimator, Served
from shell_deform.live.tick.finger_path import FingerPath
from shell_deform.live.tick.first_touch import FirstTouch
from shell_deform.live.tick.grasp import GraspTick, contacts_of
from shell_deform.live.tick.grip_told import WrenchMemory, grip_rows
from shell_deform.live.tick.health import Arrival, Figures, process_age
from shell_deform.live.tick.hold import ForceMemory
from shell_deform.live.tick.mesh_following import MeshFollower
from shell_deform.live.tick.modulus import ModulusFilter
from shell_deform.live.tick.sample import (
    FLAG_STALE,
    ContactSample,
    SampleError,
    check,
    check_served,
    no_contacts,
)
from shell_deform.live.tick.states import LiveState, Watch
from shell_deform.node import messages, parameters
from shell_deform.node.grips_node import GripTopics
from shell_deform.node.tactile_node import Tactile
from shell_deform.node.topics_node import DeformationTopics
from shell_deform.objects import load_object

CONTACTS = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
# Trackers publish best effort, a player of bags reliably: this meets both.
POSES = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
TEND_PERIOD_S = 0.02
MARKER_PERIOD_S = 0.5
POSE_CHANGE = 1e-3
WAIT_S = 1e-3
REBUILD_PARAMETERS = frozenset(
    {'object', 'theory', 'control_vertices', 'background_niceness', 'finger_body', 'load_shape'}
)


class DeformationNode(Node):
    """Answers every sample of `hand/contacts` with the surface; see the package README."""

    def __init__(self, ahead: WorkerProcess | None = None, **options: Any) -> None:
        """`ahead`: a background process started before, which waits for what to build."""
        super().__init__('deformation', **options)
        declare(self, parameters.PARAMETERS)
        values = self._values()
        parameters.validate(values)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)

        self.link = WorkerLink(_build(values), ahead)
        self.estimator: Estimator | None = None
        self.modulus: ModulusFilter | None = None
        self.watch = Watch()
        self._follower = MeshFollower()
        self.figures = Figures()
        self.served: Served | None = None
        self.failure = ''
        self._unusable = ''
        self._topic_pose: Pose | None = None
        self._pose_frame = self._contacts_frame = ''
        self._frame = ''
        self._resets = self._jumps = 0
        self._somebody_publishes = True
        self._marker_stamp = 0
        self._request = empty_request()
        self._reader = ContactReader()
        self._topics = DeformationTopics(self)
        self._grasp = GraspTick()
        self._grips = GripTopics(self, self._grip_moved)
        self._wrenches = WrenchMemory(None)
        self._touching: ContactSample | None = None
        self._path = FingerPath()
        self._tactile = Tactile(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._silence = self.create_timer(self.watch.deadline, self._listen, clock=steady)
        self._marker_timer = self.create_timer(MARKER_PERIOD_S, self._show_marker, clock=steady)
        self.create_timer(TEND_PERIOD_S, self._tend, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self._configure(values)
        # Default event callbacks cost something at every wake-up; the publisher warns on its side.
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        self.create_subscription(
            PointCloud2,
            'hand/contacts',
            self._contacts,  # type: ignore[arg-type]  # the hints forget callbacks with info
            CONTACTS,
            event_callbacks=silent,
        )
        self.create_subscription(
            PoseStamped, 'object_pose', self._pose_message, POSES, event_callbacks=silent
        )
        self.create_service(Trigger, 'deformation/reset', self._reset)
        self._topics.state(self.watch.state)
        # The first line of a log is slow: while the shell is built it delays nothing.
        self.get_logger().info(f'building {values["object"]}')

    # ---- parameters

    def _values(self) -> dict[str, Any]:
        return {p.name: self.get_parameter(p.name).value for p in parameters.PARAMETERS}

    def _validate(self, changes: list[RosParameter]) -> SetParametersResult:
        try:
            parameters.validate({change.name: change.value for change in changes})
        except ParameterError as error:
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
            self._follower.forget()
            self._path.clear()
            self.link.rebuild(_build(values))

    def _configure(self, values: dict[str, Any]) -> None:
        self._settings = parameters.settings(values)
        if self.estimator is not None:
            self.estimator.settings = self._settings
        if self.modulus is not None:
            self.modulus.errors = self._settings.errors
        self.watch.periods = float(values['stale_periods'])
        self.watch.floor = float(values['stale_floor'])
        self._parameter_pose = (
            pose_of(list(values['object_pose'])) if values['placement'] == 'given' else None
        )
        carried = str(values['finger_body']), float(values['path_step']), _by_cells(values)
        if carried != self._path.options:
            self._path = FingerPath(*carried)
            self._tactile.bodies, self._tactile.shapes = self._path.carried, carried[2]
        self._patience = float(values['wait_for_take_up'])
        # In lockstep the states of bodies do not depend on when a new mesh would be ready.
        waits = self._path.active and self._patience > 0.0
        self._follower.active = bool(values['follow_contacts']) and not waits
        self._grasp.task = parameters.grasp_task(values)
        self._learns = bool(values['estimate_modulus'])
        self._given_frame = str(values['frame'])
        self._marker_rate = float(values['marker_rate'])
        if self._marker_rate > 0:
            self._marker_timer.timer_period_ns = int(1e9 / self._marker_rate)

    # ---- the fast loop

    def _contacts(self, message: PointCloud2, info: dict[str, int]) -> None:
        began, now = time.perf_counter(), time.monotonic()
        figures = self.figures
        figures.arrivals += 1
        figures.losses.arrived(info['publication_sequence_number'])
        try:
            sample = self._reader.read(message, nanoseconds(message.header.stamp))
            check(sample)
            self._path.check(sample)
        except (MessageError, SampleError) as error:
            self._refuse(error, now)
            return
        arrival = figures.stamps.arrived(sample.stamp, 1e-9 * info['source_timestamp'] or now)
        if arrival is Arrival.REPEATED:
            # A stale copy repeats the stamp of what it copies: it says how things stand, no more.
            if sample.flags.size and (sample.flags & FLAG_STALE).any():
                self._topics.state(self.watch.sample(sample, now))
            return
        if arrival is Arrival.JUMPED:
            self.get_logger().info('time has jumped: the contacts are taken up anew')
            self._jumps += 1
            self._disown()
        self._use_frame(message.header.frame_id)
        state = self.watch.sample(sample, now)
        self._topics.state(state)
        estimator, self._touching = self.estimator, sample
        if estimator is None or not state.is_served:
            return
        if self._serve(estimator, sample, sample.stamp, now):
            figures.ticks.add(time.perf_counter() - began)
            figures.answers.add(1e-9 * (time.time_ns() - info['source_timestamp']))

    def _grip_moved(self, number: int, pose: Pose, stamp: int, frame: str) -> None:
        """A grip is somewhere else: answer its pose, with what touches as it was seen last."""
        estimator, now = self.estimator, time.monotonic()
        if estimator is None or estimator.grips is None:
            return
        if self._other_frame(frame, f'the pose of grip {estimator.grips.plan.names[number]}'):
            return
        estimator.grips.take(number, pose, self._given_pose or estimator.pose_in_use)
        state = self.watch.look(now, self._somebody_publishes)
        if state is LiveState.NO_HAND:
            self._touching, self._frame = None, self._given_frame or frame
        elif not state.is_served:
            return
        self._serve(estimator, self._touching or no_contacts(stamp), stamp, now)

    def _serve(self, estimator: Estimator, sample: ContactSample, stamp: int, now: float) -> bool:
        """Answer `sample` under `stamp` [ns]; False where it cannot be used."""
        estimator.pose = self._given_pose
        served = None
        try:
            served, new_result = self._answer(estimator, sample)
            check_served(served.packed, served.max_displacement, estimator.widest)
        except (SampleError, ArithmeticError, LookupError, ValueError) as error:
            # Whatever a sample does to the numbers, the next one finds the node as it was.
            self._refuse(error, now)
            if served is not None and not self._path.active:
                # It is solved all the same: only a new equilibrium leads away from this one.
                self._post(estimator)
            return False
        served = replace(served, stamp=stamp)
        self._topics.answer(served.answer)
        self._topics.cloud('surface', served.packed, served.stamp, self._frame)
        self.served = served
        if not self._path.active:
            self._post(estimator)
        self._publish_more(estimator, served, new_result)
        if not self.figures.first_surface:
            self.figures.first_surface = process_age()
        return True

    def _refuse(self, error: Exception, now: float) -> None:
        """Say why a sample is not used: log, diagnostics, state."""
        self.figures.refused += 1
        self._unusable = f'{error}' or type(error).__name__
        self.get_logger().error(self._unusable, throttle_duration_sec=5.0)
        self._topics.state(self.watch.refused(now))

    def _use_frame(self, contacts_frame: str) -> None:
        """Answer in the frame of the contacts, and mind a pose that was given in another one."""
        self._frame = self._given_frame or contacts_frame
        if contacts_frame == self._contacts_frame:
            return
        self._contacts_frame = contacts_frame
        if self._topic_pose is not None and self._other_frame(self._pose_frame):
            self._topic_pose = None

    def _other_frame(self, pose_frame: str, what: str = 'object_pose') -> bool:
        """Whether a pose is given in another frame than the contacts; says so."""
        ours = self._contacts_frame
        if not pose_frame or not ours or pose_frame == ours:
            return False
        self.get_logger().error(
            f'{what} is given in frame {pose_frame!r}, the contacts in {ours!r}: not used; '
            'publish it in the frame of the contacts',
            throttle_duration_sec=5.0,
        )
        return True

    def _answer(self, estimator: Estimator, sample: ContactSample) -> tuple[Served, bool]:
        """The answer to a sample, and whether a new equilibrium has come meanwhile.

        A node that plays in lockstep waits until no contact is being taken up any more.
        """
        new_result = self._adopt(estimator)
        served = estimator.tick(sample)
        deadline = time.monotonic() + self._patience
        if self._path.active:
            answered = self._post(estimator)
            while not answered and time.monotonic() < deadline and not self.link.is_lost:
                time.sleep(WAIT_S)
                answered = self._path.feed(self.link.worker)
            if self._adopt(estimator):
                new_result = True
                served = estimator.tick(sample)
            self._path.refuse(estimator.adopted)
            return served, new_result
        while served.taking_up and time.monotonic() < deadline and not self.link.is_lost:
            self._post(estimator)
            while time.monotonic() < deadline and not self._adopt(estimator):
                time.sleep(WAIT_S)
            new_result = True
            served = estimator.tick(sample)
        return served, new_result

    def _adopt(self, estimator: Estimator) -> bool:
        """Take the newest result of the background process, if there is one."""
        slot = self.link.worker.newer_result()
        if slot is None:
            return False
        estimator.adopt(slot)
        self.figures.refreshed(int(slot.record['answers']))
        return True

    def _post(self, estimator: Estimator) -> bool:
        """Post the load case of the last tick; whether all that must be answered are."""
        record = self._request[0]
        record['resets'] = self._resets
        record['jumps'] = self._jumps
        if self._path.active:
            friction = self._grasp.task.friction
            return self._path.take(estimator, self._request, self.link.worker, friction)
        estimator.fill_request(record)
        self._tactile.shape(record)
        self.link.worker.post(self._request)
        if self.link.candidate is not None:
            # It knows neither the other's contacts nor what their displacements count from.
            record['generation'] = 0
            record['touch']['displacement'] = math.nan
            self.link.candidate.post(self._request)
        return True

    def _publish_more(self, estimator: Estimator, served: Served, new_result: bool) -> None:
        topics = self._topics
        topics.numbers(served)
        if new_result and estimator.adopted is not None:
            self._tell_grips(estimator, estimator.adopted)
        if topics.wanted('linear'):
            topics.cloud('linear', estimator.linear(), served.stamp, self._frame)
        if new_result and topics.wanted('nonlinear'):
            packed = estimator.nonlinear()
            if packed is not None and estimator.adopted is not None:
                topics.cloud('nonlinear', packed, estimator.adopted.stamp, self._frame)
        if new_result and self._path.active and estimator.adopted is not None:
            taxels = estimator.adopted.taxels(estimator.pose_in_use)
            topics.taxels(taxels, estimator.adopted.stamp, self._frame)
            self._tactile.judge(estimator.adopted)
        if topics.grasp_wanted:
            topics.grasp(self._grasp.rows(estimator), served.stamp, self._frame)
            if self._grasp.why:
                self.get_logger().info(f'grasp {self._grasp.told}', throttle_duration_sec=5.0)
        if topics.later_wanted and estimator.hold is not None:
            topics.later(estimator.hold.later(), served.stamp, self._frame)
        if self._learns and self.modulus is not None:
            self._learn(estimator, self.modulus)

    def _tell_grips(self, estimator: Estimator, adopted: Adopted) -> None:
        """What the grips do at a new equilibrium, as a wrist would feel it now."""
        grips = estimator.grips
        if grips is None:
            return
        wrench = self._wrenches.felt(adopted)
        self._grips.answer(wrench, estimator.pose_in_use, adopted.stamp, self._frame)
        if self._topics.grips_wanted:
            seen = contacts_of(estimator, self._grasp.task) if len(adopted.fingers) else None
            rows = grip_rows(
                adopted, wrench, grips.plan.origins, estimator.pose_in_use,
                None if seen is None else seen.grasp,
            )  # fmt: skip
            self._topics.grips(rows, adopted.stamp, self._frame)

    def _learn(self, estimator: Estimator, modulus: ModulusFilter) -> None:
        """Young's modulus from this sample, published when the sample said something."""
        adopted, posterior, measured = estimator.adopted, estimator.posterior, estimator.measured
        if adopted is None or posterior is None or measured is None:
            modulus.release()
        elif adopted.share == 1.0 and modulus.update(adopted.response, posterior.inputs, measured):
            self._topics.modulus(modulus.estimate)

    @property
    def _given_pose(self) -> Pose | None:
        """The pose from the topic, else the parameter; None if it is to be inferred."""
        return self._topic_pose or self._parameter_pose

    def _pose_message(self, message: PoseStamped) -> None:
        try:
            pose = messages.read_pose(message)
        except PoseError as error:
            self.get_logger().error(f'object_pose: {error}', throttle_duration_sec=5.0)
            return
        self._pose_frame = message.header.frame_id
        if not self._other_frame(self._pose_frame):
            self._topic_pose = pose

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._resets += 1
        self._disown()
        response.success = True
        response.message = 'the next sample starts from the undeformed shell'
        return response

    def _disown(self) -> None:
        """Answers to samples so far are not taken any more."""
        self.link.worker.disown()
        self._path.clear()
        self._tactile.forget()
        self._wrenches.forget()
        self.served = None
        if self.estimator is not None:
            self.estimator.forget()

    # ---- slow things

    def _look(self) -> None:
        self._topics.state(self.watch.look(time.monotonic(), self._somebody_publishes))

    def _listen(self) -> None:
        """Look when the newest sample's time is up; resetting the timer at each would wake us."""
        self._look()
        self._silence.timer_period_ns = int(1e9 * self.watch.remaining(time.monotonic()))
        self._silence.reset()

    def _tend(self) -> None:
        self._look()
        try:
            ready = self.link.tend(time.monotonic())
        except WorkerError as error:
            if str(error) != self.failure:
                self.failure = str(error)
                self.get_logger().error(self.failure)
            return
        if ready:
            self.failure = ''
            self._take_over()
        self._path.feed(self.link.worker)
        rest = self.link.worker.handed_over()
        if rest is not None and self.estimator is not None:
            self.estimator.first_touch = FirstTouch(rest)
        if self.estimator is not None:
            self._follow_contacts(self.estimator)

    def _take_over(self) -> None:
        """A background process has built the shell: serve it from now on."""
        memory = self.link.worker.memory
        assert memory is not None
        previous = self.estimator
        plan = self.link.worker.plan
        self.estimator = Estimator(
            memory.rest, memory.rest_normals, self._settings, memory.rest_outer,
            (plan, memory.rest_grips) if plan.names else None,
        )  # fmt: skip
        self.estimator.pose = self._given_pose
        self._grips.take(plan)
        if previous is not None and self.estimator.grips is not None:
            self.estimator.grips.goes_on_from(previous.grips)
        if previous is not None and previous.rest.shape == memory.rest.shape:
            # The same shell again after a restart: its last good state is still the best known.
            self.estimator.adopted = previous.adopted
            self.estimator.first_touch = previous.first_touch
            self.estimator.hold = previous.hold
            return
        name = self.get_parameter('object').value
        shell_object = load_object(name)
        young = shell_object.modulus(self.link.worker.theory)
        self.modulus = ModulusFilter(young, self._settings.errors)
        self._grasp.yield_stress = shell_object.yield_stress_pa or 0.0
        self._wrenches = WrenchMemory(shell_object.relaxation)
        if shell_object.relaxation is not None:
            self.estimator.hold = ForceMemory(shell_object.relaxation)
        self._topics.resize(len(memory.rest), memory.rest_outer is not None)
        self._publish_mesh()
        # What is there now stays: the collector need not walk through it beside the fast loop.
        gc.collect()
        gc.freeze()
        worker = self.link.worker
        why = f' ({worker.theory_reason})' if worker.theory_reason else ''
        self.get_logger().info(
            f'{name}: theory {worker.theory}{why}, {len(memory.rest)} vertices, serving'
        )

    def _follow_contacts(self, estimator: Estimator) -> None:
        """Have the mesh graded anew where fingers rest, and change to it once it answers."""
        found = self._follower.follow(self.link, estimator, self._path, time.monotonic())
        if found is not None:
            self._change_mesh(*found)

    def _change_mesh(self, slot: Slot, first: FirstTouch) -> None:
        """Serve from the candidate, whose first equilibrium is in `slot`."""
        self.link.promote()
        memory = self.link.worker.memory
        assert memory is not None and self.estimator is not None
        grips = self.estimator.grips
        changed = Estimator(
            memory.rest, memory.rest_normals, self._settings, memory.rest_outer,
            None if grips is None else (self.link.worker.plan, memory.rest_grips),
        )  # fmt: skip
        if changed.grips is not None:
            changed.grips.goes_on_from(grips)
        changed.pose, changed.first_touch = self.estimator.pose, first
        changed.sample, changed.hold = self.estimator.sample, self.estimator.hold
        changed.adopt(slot)
        self.estimator = changed
        self._topics.resize(len(memory.rest), memory.rest_outer is not None)
        self._publish_mesh()
        self.get_logger().info(f'{len(memory.rest)} vertices, graded where the fingers are')

    def _publish_mesh(self) -> None:
        memory = self.link.worker.memory
        if memory is not None and self.estimator is not None:
            pose = self.estimator.pose_in_use
            self._mesh_pose = pose.numbers
            self._topics.mesh(memory.triangles, pose.from_object(memory.rest))

    def _show_marker(self) -> None:
        served, memory = self.served, self.link.worker.memory
        if served is None or memory is None or not self._marker_rate:
            return
        if served.stamp != self._marker_stamp and len(served.packed) == len(memory.rest):
            self._marker_stamp = served.stamp
            self._topics.marker(memory.triangles, served.packed, served.stamp, self._frame)

    def _diagnose(self) -> None:
        publishers = self.count_publishers('hand/contacts')
        self.figures.losses.settle(publishers)
        self._somebody_publishes = publishers > 0
        if self.estimator is not None:
            moved = self.estimator.pose_in_use.numbers - self._mesh_pose
            if abs(moved).max() > POSE_CHANGE:
                self._publish_mesh()
        learned = self.modulus.estimate if self._learns and self.modulus is not None else None
        condition = diagnosis.Condition(
            self.watch.state, self.figures, self.link, self.estimator,
            self.served, learned, self.failure, self._unusable,
        )  # fmt: skip
        chosen = {name: self.get_parameter(name).value for name in ('object', 'theory', 'drive')}
        chosen['grasp'] = self._grasp.told if self._topics.grasp_wanted else ''
        told = diagnosis.values(condition, time.monotonic())
        values = {**chosen, **told, **self._path.figures, **self._tactile.figures}
        judged = beside_others(
            self, diagnosis.judge(condition), 'hand/contacts', 'deformation/surface'
        )
        self._topics.diagnostics(*judged, values)

    def close(self) -> None:
        """End the background process."""
        self.link.stop()


def _build(values: dict[str, Any]) -> Build:
    return Build(
        str(values['object']),
        str(values['theory']),
        int(values['control_vertices']),
        int(values['background_niceness']),
        bodies=str(values['finger_body']),
        by_cells=_by_cells(values),
        pins_slide=bool(values['pins_slide']),
    )


def _by_cells(values: dict[str, Any]) -> bool:
    return bool(values['load_shape'] == 'cells')


def run(arguments: Sequence[str], ahead: WorkerProcess | None = None) -> int:
    """Spin the node until it is told to stop; returns the exit code. `ahead`: see the node."""
    return run_node('deformation', lambda: DeformationNode(ahead), arguments)
