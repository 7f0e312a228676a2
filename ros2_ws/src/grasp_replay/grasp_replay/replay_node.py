# SPDX-License-Identifier: Apache-2.0
"""`replay`: a bag to topics, as recorded, faster, stepwise, or as fast as it is answered."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from grasp_common.main_node import (
    WRONG_PARAMETERS,
    WRONG_ROS_ARGUMENTS,
    QuietExecutor,
    RosStartError,
    end_by_signals,
    made,
    start_ros,
)
from grasp_common.terminal import complain, progress_bar
from grasp_replay.arguments_node import split_ros_arguments
from grasp_replay.bag import Bag
from grasp_replay.bag_reader import open_bag
from grasp_replay.cdr import has_header
from grasp_replay.errors import BagError
from grasp_replay.lockstep import Lockstep
from grasp_replay.messages import clock_message, message_class
from grasp_replay.patience_node import Patience
from grasp_replay.player import Player
from grasp_replay.replay_core import Control, Pace
from grasp_replay.replay_options import ReplayOptions, parse_options
from grasp_replay.replay_panel_node import ReplayPanel
from grasp_replay.senders_node import Senders
from grasp_replay.topic_selection import listed

# The publishing thread takes turns with reading ahead and with the services at this period.
SWITCH_SECONDS = 0.0005


class ReplayNode(Node):
    """The `Stage` of a `Player`: publishers for the chosen topics of a bag, and what steers it."""

    def __init__(self, bag: Bag, options: ReplayOptions, ros_arguments: Sequence[str]) -> None:
        super().__init__('replay')
        pace = Pace(bag.start, time.monotonic(), options.rate, options.start_paused)
        self.control = Control(pace)
        self.changed = threading.Condition()
        self._clock_sender = self.create_publisher(Clock, '/clock', 10)
        self.senders = Senders(self, bag, options, ros_arguments)
        self.panel = ReplayPanel(self, bag, options, self.control, self.changed)

    def send_clock(self, nanoseconds: int) -> None:
        """Publish `/clock`."""
        self._clock_sender.publish(clock_message(nanoseconds))

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
                    f'nobody answers on {listed(missing)}: no publisher within {seconds:g} s'
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `replay`; returns the exit code."""
    own, ros = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    options = parse_options(own)
    try:
        with open_bag(options.bag) as bag:
            options.choice.span(bag)
            return _replay(bag, options, ros)
    except (BagError, RosStartError) as error:
        complain('replay', error)
        return 1
    except (*WRONG_ROS_ARGUMENTS, *WRONG_PARAMETERS) as error:
        complain('replay', error)
        return 2


def _replay(bag: Bag, options: ReplayOptions, ros_arguments: list[str]) -> int:
    sys.setswitchinterval(SWITCH_SECONDS)
    end_by_signals()
    start_ros(['replay', *ros_arguments])
    executor: QuietExecutor | None = None
    services: threading.Thread | None = None
    node: ReplayNode | None = None
    try:
        executor = QuietExecutor()
        node = made(lambda: ReplayNode(bag, options, ros_arguments), ros_arguments)
        executor.add_node(node)
        services = threading.Thread(target=_spin, args=(executor,), name='services', daemon=True)
        services.start()
        lockstep = None
        if options.lockstep:
            lockstep = Lockstep(list(options.lockstep), options.lockstep_timeout)
            node.listen(lockstep, options.wait)
        player = Player(node, bag, options, lockstep)
        node.panel.tally = player.tally
        topics = lockstep.answer_topics if lockstep else ()
        patience = Patience(node, topics, options.lockstep_timeout)
        try:
            return _play(player, options)
        finally:
            if rclpy.ok():
                patience.restore()
    finally:
        rclpy.try_shutdown()
        # The executor wakes and ends with the context; it must not lose its parts while it spins.
        if services is not None:
            services.join()
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.senders.close()
            node.destroy_node()


def _spin(executor: QuietExecutor) -> None:
    try:
        with suppress(ExternalShutdownException):
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
            print(f'replay: nobody listens to {listed(alone)}', file=sys.stderr)
        begin = time.monotonic() + options.delay
        while player.stage.alive() and time.monotonic() < begin:
            time.sleep(min(0.05, options.delay))
        with progress_bar('replay', 1.0) as show:
            player.run(show)
        if player.stage.alive():
            player.finish()
    except Exception:
        # Whatever is sent or asked for after the signal complains.
        if rclpy.ok():
            raise
        stopped = True
    _summarise(player, options, stopped or not player.stage.alive())
    if player.lockstep is not None and player.lockstep.unanswered:
        raise BagError(
            f'{len(player.lockstep.unanswered)} messages were not answered within '
            f'{options.lockstep_timeout:g} s each; first: {player.lockstep.unanswered[0]}'
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
