"""`replay`: a bag to topics, as recorded, faster, stepwise, or as fast as it is answered."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.bag_reader import open_bag
from grasp_replay.cdr import has_header
from grasp_replay.errors import BagError
from grasp_replay.lockstep import Lockstep
from grasp_replay.messages import clock_message, diagnostics, message_class, to_rclpy
from grasp_replay.player import Player
from grasp_replay.progress import progress_bar
from grasp_replay.qos import QosProfile, common_offer, parse_qos_text
from grasp_replay.replay_core import HIGHEST_RATE, Control, Pace, Tally, refusal
from grasp_replay.replay_options import ReplayOptions, parse_options
from grasp_replay.ros_arguments import split_ros_arguments
from grasp_replay.ros_types import type_differs

# The publishing thread takes turns with reading ahead and with the services at this period.
SWITCH_SECONDS = 0.0005
DIAGNOSTICS_PERIOD = 1.0
# Bytes from which a message fills the transport, and the longest wait for its receipt (s).
LARGE_MESSAGE = 200_000
LARGE_MESSAGE_PATIENCE = 0.25


class ReplayNode(Node):
    """Publishers for the chosen topics of a bag, and the services that steer the replay.

    It is the `Stage` of a `Player`; services and parameters act under the lock `changed`.
    """

    def __init__(self, bag: Bag, options: ReplayOptions) -> None:
        super().__init__('replay')
        pace = Pace(bag.start, time.monotonic(), options.rate, options.start_paused)
        self.control = Control(pace)
        self.changed = threading.Condition()
        self._names: dict[str, str] = {}
        self._senders: dict[str, Publisher] = {}
        self._clock_sender = self.create_publisher(ClockMessage, '/clock', 10)
        for name, topic in sorted(options.choice.topics(bag).items()):
            self._open(name, topic, options.choice.published_name(name), options.qos_overrides)
        if not self._names:
            raise BagError(f'{bag.path} has no topic that can be replayed with these options')
        self.add_on_set_parameters_callback(self._set_parameters)
        self.declare_parameter(
            'rate',
            options.rate,
            ParameterDescriptor(
                description='bag seconds per second',
                floating_point_range=[
                    FloatingPointRange(from_value=1e-3, to_value=HIGHEST_RATE, step=0.0)
                ],
            ),
        )
        self.tally: Tally | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)
        for name, action in (
            ('pause', self._pause),
            ('resume', self._resume),
            ('toggle_paused', self._toggle),
            ('step', self._step),
            ('stop', self._stop),
        ):
            self.create_service(Trigger, f'~/{name}', self._service(action))

    def _publish_diagnostics(self) -> None:
        tally, pace = self.tally, self.control.pace
        if tally is None:
            return
        warning = f'{tally.lost} messages were lost' if tally.lost else None
        values = {
            'rate': pace.rate,
            'paused': pace.paused,
            'sent': tally.total,
            'late': tally.late,
            'lost': tally.lost,
            'lateness_p99_s': f'{tally.quantile(0.99):.6f}',
        }
        now = self.get_clock().now().nanoseconds
        text = 'paused' if pace.paused else 'replaying'
        self._diagnostics.publish(diagnostics('replay', warning, text, values, now))

    def _open(
        self, name: str, topic: Topic, sent_name: str, overrides: dict[str, QosProfile]
    ) -> None:
        reason = refusal(topic) or type_differs(
            topic.type_name, topic.type_hash, topic.definition, topic.definition_encoding
        )
        if reason is None:
            try:
                kind = message_class(topic.type_name)
                offer = overrides.get(sent_name) or common_offer(parse_qos_text(topic.qos))
                self._senders[name] = self.create_publisher(kind, sent_name, _lossless(offer))
                self._names[name] = sent_name
            except (BagError, InvalidTopicNameException) as error:
                reason = str(error).splitlines()[0]
        if reason is not None:
            self.get_logger().warning(f'{name} is not replayed: {reason}')

    def topics(self) -> dict[str, str]:
        """The topics that can be sent, by their name in the bag, and the names they get."""
        return dict(self._names)

    def unmatched(self) -> set[str]:
        """The topics that nobody listens to, or that a known listener is not yet matched with."""
        return {
            name
            for name, sender in self._senders.items()
            if sender.get_subscription_count() < max(1, self.count_subscribers(self._names[name]))
        }

    def send(self, message: Message) -> bool:
        """Publish stored bytes; False when the middleware refused them.

        A large message is let through before the next: listeners that take best effort lose what
        is sent while it crosses.
        """
        try:
            sender = self._senders[message.topic]
            sender.publish(message.data)
            if len(message.data) > LARGE_MESSAGE:
                sender.wait_for_all_acked(Duration(seconds=LARGE_MESSAGE_PATIENCE))
        except rclpy_implementation.RCLError as error:
            if not self.alive():
                raise ExternalShutdownException from error
            return False
        return True

    def send_clock(self, nanoseconds: int) -> None:
        """Publish `/clock`."""
        self._clock_sender.publish(clock_message(nanoseconds))

    def unacknowledged(self, seconds: float) -> list[str]:
        """The reliable topics whose messages were not all received within `seconds`."""
        deadline = time.monotonic() + seconds
        return [
            self._names[name]
            for name, sender in self._senders.items()
            if sender.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            and not sender.wait_for_all_acked(
                Duration(seconds=max(0.0, deadline - time.monotonic()))
            )
        ]

    def alive(self) -> bool:
        """False once ROS was shut down."""
        return self.context.ok()

    def listen(self, lockstep: Lockstep, seconds: float) -> None:
        """Subscribe to the topics that answer, once they exist; raises BagError."""
        missing = set(lockstep.answer_topics)
        deadline = time.monotonic() + seconds
        while missing and self.alive():
            for topic in sorted(missing):
                publishers = self.get_publishers_info_by_topic(topic)
                if publishers:
                    self._listen(lockstep, topic, publishers[0].topic_type)
                    missing.discard(topic)
            if missing and time.monotonic() > deadline:
                raise BagError(
                    f'nobody answers on {", ".join(sorted(missing))}: no publisher within '
                    f'{seconds:g} s'
                )
            time.sleep(0.01)

    def _listen(self, lockstep: Lockstep, topic: str, type_name: str) -> None:
        stamped = has_header(type_name)
        self.create_subscription(
            message_class(type_name),
            topic,
            lambda data: lockstep.answer(topic, data, stamped),  # type: ignore[arg-type]
            QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE),
            raw=True,
        )

    def _service(self, action: Callable[[], str]) -> Callable[..., Trigger.Response]:
        def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            with self.changed:
                try:
                    response.message, response.success = action(), True
                except BagError as error:
                    response.message, response.success = str(error), False
                self.changed.notify_all()
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

    def _stop(self) -> str:
        self.control.stopped = True
        return 'stopping'

    def _set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == 'rate':
                with self.changed:
                    try:
                        self.control.pace.set_rate(parameter.value, time.monotonic())
                    except BagError as error:
                        return SetParametersResult(successful=False, reason=str(error))
                    self.changed.notify_all()
        return SetParametersResult(successful=True)


def _lossless(offer: QosProfile) -> QoSProfile:
    """The offer, keeping each message of a reliable stream until it is received.

    History is no part of matching; latched topics keep theirs, as it is what late joiners get.
    """
    profile = to_rclpy(offer)
    if offer.reliability == 'reliable' and offer.durability != 'transient_local':
        profile.history = HistoryPolicy.KEEP_ALL
    return profile


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `replay`; returns the exit code."""
    own, ros = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    options = parse_options(own)
    try:
        with open_bag(options.bag) as bag:
            options.choice.span(bag)
            return _replay(bag, options, ros)
    except BagError as error:
        print(f'replay: {error}', file=sys.stderr)
        return 1


def _replay(bag: Bag, options: ReplayOptions, ros_arguments: list[str]) -> int:
    sys.setswitchinterval(SWITCH_SECONDS)
    rclpy.init(args=['replay', *ros_arguments])
    executor = SingleThreadedExecutor()
    services = threading.Thread(target=_spin, args=(executor,), name='services', daemon=True)
    node: ReplayNode | None = None
    try:
        node = ReplayNode(bag, options)
        executor.add_node(node)
        services.start()
        lockstep = None
        if options.lockstep:
            lockstep = Lockstep(list(options.lockstep), options.lockstep_timeout)
            node.listen(lockstep, options.wait)
        player = Player(node, bag, options, lockstep)
        node.tally = player.tally
        return _play(player, options)
    finally:
        rclpy.try_shutdown()
        executor.shutdown()
        if services.is_alive():
            services.join()
        if node is not None:
            node.destroy_node()


def _spin(executor: SingleThreadedExecutor) -> None:
    try:
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            executor.spin()
    except rclpy_implementation.RCLError:
        # A wait set asked for between the shutdown and its notice.
        if rclpy.ok():
            raise


def _play(player: Player, options: ReplayOptions) -> int:
    stopped = False
    try:
        alone = player.wait_for_listeners()
        if alone:
            print(f'replay: nobody listens to {", ".join(alone)}', file=sys.stderr)
        if options.delay:
            time.sleep(options.delay)
        with progress_bar('replay', 1.0) as show:
            player.run(show)
        if player.stage.alive():
            player.finish()
    except (KeyboardInterrupt, ExternalShutdownException):
        stopped = True
    _summarise(player, options, stopped or not player.stage.alive())
    if player.lockstep is not None and player.lockstep.unanswered:
        raise BagError(
            f'{player.lockstep.unanswered} messages were not answered within '
            f'{options.lockstep_timeout:g} s each'
        )
    return 0


def _summarise(player: Player, options: ReplayOptions, stopped: bool) -> None:
    tally = player.tally
    report = {
        **tally.report(),
        'unacknowledged': player.unacknowledged,
        'stopped': stopped,
    }
    if options.json:
        print(json.dumps(report))
        return
    print(
        f'sent {tally.total}, late {tally.late} (more than {tally.late_after * 1e3:g} ms; median '
        f'{tally.quantile(0.5) * 1e3:.2f} ms, 99 % {tally.quantile(0.99) * 1e3:.2f} ms), '
        f'lost {tally.lost}' + (', stopped before the end' if stopped else '')
    )
    if player.unacknowledged:
        print(f'not all acknowledged: {", ".join(player.unacknowledged)}')


if __name__ == '__main__':
    sys.exit(main())
