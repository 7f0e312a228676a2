# SPDX-License-Identifier: Apache-2.0
"""`record`: topics to a crash-safe MCAP bag in rosbag2's layout."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from grasp_common.command_line import parse
from grasp_common.main_node import (
    WRONG_PARAMETERS,
    WRONG_ROS_ARGUMENTS,
    QuietExecutor,
    RosStartError,
    end_by_signals,
    made,
    start_ros,
    status_name,
)
from grasp_common.messages import diagnostics
from grasp_common.terminal import complain, status_line
from grasp_replay.arguments_node import split_ros_arguments
from grasp_replay.bag_writer import BagWriter
from grasp_replay.cdr import has_header, header_stamp
from grasp_replay.errors import BagError
from grasp_replay.losses import Losses
from grasp_replay.messages import from_endpoint, message_class, type_hash
from grasp_replay.qos import common_offer, qos_text
from grasp_replay.record_options import build_parser
from grasp_replay.topic_selection import TopicSelection, listed

DISCOVERY_PERIOD = 0.1
FLUSH_PERIOD = 0.5
DIAGNOSTICS_PERIOD = 1.0
SUBSCRIPTION_DEPTH = 1000
STANDSTILL_S = 0.5
"""So long without a turn of the loop, and queues below may have overflowed [s]."""


class RecordNode(Node):
    """Subscribes to the wanted topics as they appear and writes their bytes unread.

    Raises BagError when the bag `directory` cannot be made.
    """

    def __init__(
        self, directory: Path, selection: TopicSelection, options: argparse.Namespace
    ) -> None:
        sim_time = Parameter('use_sim_time', value=options.use_sim_time)
        super().__init__('record', parameter_overrides=[sim_time])
        self.writer = BagWriter(directory, compression=options.compression)
        self.unstamped = 0
        self.stood_still = 0.0
        self.failure: BagError | None = None
        self._selection = selection
        self._log_time_from = options.time
        self._refused: set[str] = set()
        self._topics: dict[str, int] = {}
        self._losses: dict[str, Losses] = {}
        self._unreliable: set[str] = set()
        self._looked = time.monotonic()
        try:
            self._begin()
        except Exception:
            # The context ended while it began: the bag is closed all the same.
            self.writer.close()
            raise

    def _begin(self) -> None:
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DISCOVERY_PERIOD, self._discover, clock=steady)
        self.create_timer(FLUSH_PERIOD, self._guarded(self.writer.flush), clock=steady)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)
        self._discover()

    @property
    def topic_count(self) -> int:
        """Topics found and subscribed so far."""
        return len(self._topics)

    @property
    def lost(self) -> int:
        """Messages that are known to have been published and not to have come."""
        return sum(losses.lost for losses in self._losses.values())

    @property
    def unknown(self) -> list[str]:
        """Topics that lost nobody knows how many: see `Losses`."""
        return sorted(topic for topic, losses in self._losses.items() if losses.unknown)

    def settle_losses(self) -> None:
        """Hold the numbers of messages against who has published them."""
        self._look_back()
        for topic, losses in self._losses.items():
            # After a signal nothing can be asked any more: nobody new has come, then.
            asked = self.get_publishers_info_by_topic(topic) if self.context.ok() else ()
            losses.settle(bytes(endpoint.endpoint_gid) for endpoint in asked)

    def _publish_diagnostics(self) -> None:
        self.settle_losses()
        now = self.get_clock().now().nanoseconds
        # Before the first /clock there is no time to stamp with, and a stamp of 0 would become
        # the beginning of a recording that takes its times from headers.
        if now == 0:
            return
        warning = f'{self.lost} messages were lost before they arrived' if self.lost else ''
        if self.unknown:
            warning += '; ' * bool(warning) + _standstill(self)
        values = {
            'bag': self.writer.directory.name,
            'topics': self.topic_count,
            'messages': self.writer.message_count,
            'bytes': self.writer.size,
            'lost': self.lost,
            'stood still [s]': round(self.stood_still, 1),
            'stamps before 1970, logged at their arrival': self.unstamped,
        }
        level = 'warn' if warning else 'ok'
        name = status_name(self)
        self._diagnostics.publish(diagnostics(now, name, level, warning or 'recording', values))

    def _look_back(self) -> None:
        """Notice that this process was stopped, or found no processor."""
        now = time.monotonic()
        if now - self._looked > STANDSTILL_S:
            self.stood_still += now - self._looked
            for topic in self._unreliable:
                self._losses[topic].stood_still(now)
        self._looked = now

    def _discover(self) -> None:
        self._look_back()
        for topic, types in self.get_topic_names_and_types():
            if topic in self._topics or topic in self._refused:
                continue
            if self._selection.accepts(topic) and self.get_publishers_info_by_topic(topic):
                self._subscribe(topic, types)

    def _subscribe(self, topic: str, types: Sequence[str]) -> None:
        publishers = self.get_publishers_info_by_topic(topic)
        type_name = publishers[0].topic_type
        try:
            kind = message_class(type_name)
        except BagError as error:
            self._refused.add(topic)
            self.get_logger().warning(f'{topic} is not recorded: {error}')
            return
        if len(types) > 1:
            self.get_logger().warning(
                f'{topic} carries the types {", ".join(types)}; only {type_name} is recorded'
            )
        offers = [from_endpoint(endpoint) for endpoint in publishers]
        unique = list(dict.fromkeys(offers))
        number = self.writer.add_topic(
            topic, type_name, qos_text(*unique), type_hash=type_hash(publishers[0])
        )
        self._topics[topic] = number
        common = common_offer(unique)
        losses = self._losses[topic] = Losses()
        losses.settle(bytes(endpoint.endpoint_gid) for endpoint in publishers)
        if common.reliability != 'reliable':
            self._unreliable.add(topic)
        self.create_subscription(
            kind,
            topic,
            self._taker(number, losses, has_header(type_name)),  # type: ignore[arg-type]
            QoSProfile(
                history=HistoryPolicy.KEEP_LAST,
                depth=SUBSCRIPTION_DEPTH,
                reliability=ReliabilityPolicy[common.reliability.upper()],
                durability=DurabilityPolicy[common.durability.upper()],
            ),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=_counting(losses)),
        )

    def _taker(
        self, number: int, losses: Losses, stamped: bool
    ) -> Callable[[bytes, dict[str, int]], None]:
        def take(data: bytes, info: dict[str, int]) -> None:
            losses.arrived(info['publication_sequence_number'], time.monotonic())
            published = max(info['source_timestamp'], 0)
            if stamped and self._log_time_from == 'header':
                stamp = self._header_time(data, info['received_timestamp'])
            elif self._log_time_from != 'received':
                stamp = self.get_clock().now().nanoseconds
            else:
                stamp = info['received_timestamp']
            self._guarded(lambda: self.writer.write(number, data, stamp, published))()

        return take

    def _header_time(self, data: bytes, received: int) -> int:
        """The stamp in the header; the time of arrival where it is none that a bag can hold."""
        try:
            stamp = header_stamp(data)
        except BagError:
            stamp = -1
        if stamp >= 0:
            return stamp
        self.unstamped += 1
        return received

    def _guarded(self, action: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            if self.failure is None:
                try:
                    action()
                except BagError as error:
                    self.failure = error

        return run


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `record`; returns the exit code."""
    own, ros = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parser = build_parser()
    options = parse('grasp_replay', parser, own)
    if not (options.topics or options.all or options.regex):
        parser.error('name topics, or give --all or --regex')
    if options.duration is not None and not options.duration > 0:
        parser.error('--duration must be a number of seconds > 0')
    try:
        selection = TopicSelection(
            topics=tuple(options.topics),
            everything=options.all,
            regex=options.regex,
            exclude_topics=tuple(options.exclude_topics),
            exclude_regex=options.exclude_regex,
        )
    except re.error as error:
        parser.error(f'{error.pattern!r} is no regular expression: {error}')
    directory = options.output or Path(time.strftime('bag_%Y_%m_%d-%H_%M_%S'))
    try:
        return _record(directory, selection, options, ros)
    except (BagError, RosStartError) as error:
        complain('record', error)
        return 1
    except (*WRONG_ROS_ARGUMENTS, *WRONG_PARAMETERS) as error:
        complain('record', error)
        return 2


def _record(
    directory: Path,
    selection: TopicSelection,
    options: argparse.Namespace,
    ros_arguments: list[str],
) -> int:
    end_by_signals()
    start_ros(['record', *ros_arguments])
    node: RecordNode | None = None
    executor: QuietExecutor | None = None
    try:
        node = made(lambda: RecordNode(directory, selection, options), ros_arguments)
        executor = QuietExecutor()
        executor.add_node(node)
        print(f'recording into {directory}', file=sys.stderr, flush=True)
        _spin(node, executor, options.duration)
    except (BagError, RosStartError):
        raise
    except Exception:
        # A signal came before it recorded anything: rclpy complains of whatever is made after it.
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            node.settle_losses()
            node.writer.close()
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    if node is None:
        return 0
    writer = node.writer
    summary = {
        'bag': str(directory),
        'topics': node.topic_count,
        'messages': writer.message_count,
        'lost': node.lost,
        'stood_still_s': round(node.stood_still, 3),
        'lost_unknown': node.unknown,
        'unstamped': node.unstamped,
        'bytes': writer.size,
    }
    if options.json:
        print(json.dumps(summary))
    else:
        print(
            f'recorded {writer.message_count} messages of {node.topic_count} topics into '
            f'{directory} ({node.lost} lost)'
            + (f'; {_standstill(node)}' if node.unknown else '')
            + (f'; {node.unstamped} stamps lie before 1970' if node.unstamped else ''),
            file=sys.stderr,
        )
    if node.failure is not None:
        raise node.failure
    return 0


def _counting(losses: Losses) -> Callable[[Any], None]:
    # rclpy's hints know the event by its type without its fields.
    return lambda event: losses.told(event.total_count_change)


def _standstill(node: RecordNode) -> str:
    return (
        f'it stood still for {node.stood_still:.1f} s, and how many were lost then is not known '
        f'where nothing came since: {listed(node.unknown)}'
    )


def _spin(node: RecordNode, executor: QuietExecutor, duration: float | None) -> None:
    """Record until a signal, a failure, or `duration` s are over."""
    start = time.monotonic()
    try:
        with status_line() as show:
            while node.failure is None and rclpy.ok():
                elapsed = time.monotonic() - start
                if duration is not None and elapsed >= duration:
                    break
                show(
                    f'{elapsed:7.1f} s  {node.topic_count} topics  '
                    f'{node.writer.message_count} messages  {node.writer.size / 1e6:.1f} MB'
                )
                executor.spin_once(timeout_sec=0.1)
    except ExternalShutdownException:
        pass
    except Exception:
        # Whatever is made or waited for after the signal complains.
        if rclpy.ok():
            raise


if __name__ == '__main__':
    sys.exit(main())
