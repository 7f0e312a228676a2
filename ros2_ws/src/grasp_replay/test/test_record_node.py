# SPDX-License-Identifier: Apache-2.0
"""`record` as a real process, against real publishers."""

from __future__ import annotations

import itertools
import json
import re
import signal
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from replay_observer import KEEP_ALL, Observer, wrench

from grasp_replay.bag_reader import open_bag
from grasp_replay.commands.bag_check import check
from grasp_replay.record_node import STANDSTILL_S


def _publish_until(observer: Observer, done: Callable[[], object]) -> int:
    publisher = observer.node.create_publisher(WrenchStamped, '/w', KEEP_ALL)
    count = 0

    def send() -> None:
        nonlocal count
        if publisher.get_subscription_count():
            publisher.publish(wrench(count))
            count += 1

    observer.node.create_timer(0.004, send)
    observer.spin_until(done)
    return count


def test_record_writes_a_sound_bag_with_qos_and_hash(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    record = start('record', '/w', '--output', tmp_path / 'bag', '--json')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    sent = _publish_until(observer, lambda: file.exists() and file.stat().st_size > 20_000)
    assert record.stop() == 0
    report = check(tmp_path / 'bag')
    assert report['sound']
    with open_bag(tmp_path / 'bag') as bag:
        received = [bag.decode(message).wrench.force.x for message in bag.messages()]
        assert bag.topics['/w'].type_hash.startswith('RIHS01_8dc3deaf')
        assert 'reliability: reliable' in bag.topics['/w'].qos
    assert received == [float(index) for index in range(len(received))]
    assert 0 <= sent - len(received) <= 50


def test_a_killed_recording_loses_at_most_the_last_second(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    record = start('record', '/w', '--output', tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    sent = _publish_until(observer, lambda: file.exists() and file.stat().st_size > 20_000)
    record.process.send_signal(signal.SIGKILL)
    record.ended()
    report = check(file, tmp_path / 'saved')
    assert not report['sound']
    assert sent - report['recovered']['messages'] <= 250
    assert check(tmp_path / 'saved')['sound']


@pytest.mark.parametrize('reliable', [True, False])
def test_a_recording_that_was_stopped_tells_every_message_that_it_lost(
    start: Any, observer: Observer, tmp_path: Path, reliable: bool
) -> None:
    qos = QoSProfile(
        depth=5000,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
    )
    publisher = observer.node.create_publisher(WrenchStamped, '/w', qos)
    record = start('record', '/w', '--output', tmp_path / 'bag', '--json')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    sent = itertools.count()
    observer.spin_until(publisher.get_subscription_count)
    empty = file.stat().st_size
    publisher.publish(wrench(next(sent)))
    observer.spin_until(lambda: file.stat().st_size > empty)
    record.process.send_signal(signal.SIGSTOP)
    for _ in range(3000):
        publisher.publish(wrench(next(sent)))
    record.process.send_signal(signal.SIGCONT)
    # What came before shows only in what comes after it.
    taken = file.stat().st_size
    observer.node.create_timer(0.05, lambda: publisher.publish(wrench(next(sent))))
    observer.spin_until(lambda: file.stat().st_size > taken)
    assert record.stop() == 0
    told = json.loads(record.text.splitlines()[-1])
    with open_bag(tmp_path / 'bag') as bag:
        forces = [int(bag.decode(message).wrench.force.x) for message in bag.messages()]
    assert told['messages'] == len(forces)
    assert told['lost'] == max(forces) - min(forces) + 1 - len(forces)


def test_after_a_standstill_a_publisher_that_fell_silent_leaves_its_losses_unknown(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = observer.node.create_publisher(WrenchStamped, '/w', qos)
    record = start('record', '/w', '--output', tmp_path / 'bag', '--json')
    observer.spin_until(publisher.get_subscription_count)
    record.process.send_signal(signal.SIGSTOP)
    for number in range(3000):
        publisher.publish(wrench(number))
    time.sleep(2.0 * STANDSTILL_S)
    record.process.send_signal(signal.SIGCONT)
    assert record.stop() == 0
    told = json.loads(record.text.splitlines()[-1])
    assert told['lost_unknown'] == ['/w'] and told['stood_still_s'] > STANDSTILL_S


def test_header_times_make_the_log_times_of_a_recording(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    record = start('record', '--all', '--time', 'header', '--output', tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    _publish_until(observer, lambda: file.exists() and file.stat().st_size > 5_000)
    assert record.stop() == 0
    with open_bag(tmp_path / 'bag') as bag:
        assert '/diagnostics' in bag.topics
        for message in bag.messages(['/w']):
            assert message.log_time == struct.unpack_from('<iI', message.data, 4)[1]


def test_a_stamp_that_no_bag_holds_is_logged_at_its_arrival_and_told(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    record = start('record', '/w', '--time', 'header', '--output', tmp_path / 'bag', '--json')
    publisher = observer.node.create_publisher(WrenchStamped, '/w', KEEP_ALL)
    observer.spin_until(publisher.get_subscription_count)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    empty = file.stat().st_size
    before_1970 = wrench(0)
    before_1970.header.stamp.sec = -1
    for message in (wrench(1), before_1970, wrench(2)):
        publisher.publish(message)
    assert publisher.wait_for_all_acked()
    observer.spin_until(lambda: file.stat().st_size > empty)
    assert record.stop() == 0
    assert '"unstamped": 1' in record.text
    report = check(tmp_path / 'bag')
    assert report['sound']
    with open_bag(tmp_path / 'bag') as bag:
        forces = sorted(bag.decode(message).wrench.force.x for message in bag.messages())
    assert forces == [0.0, 1.0, 2.0]


@pytest.mark.parametrize('seconds', [0.1, 0.4, 0.8, 1.2, 1.8])
def test_an_interrupt_while_it_starts_ends_it_without_a_traceback(
    start: Any, tmp_path: Path, seconds: float
) -> None:
    record = start('record', '/w', '--output', tmp_path / 'bag')
    time.sleep(seconds)
    record.process.send_signal(signal.SIGINT)
    record.ended()
    if 'Traceback' in record.text or 'Fatal Python error: init' in record.text:
        # It came before the first line of ours ran: Python's own start complains, of its own main.
        assert not re.search(r'command_line\.py", line \d+, in main', record.text)
    else:
        assert record.process.returncode in (0, -signal.SIGINT)


def test_a_closed_terminal_ends_a_recording_like_any_signal(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    record = start('record', '/w', '--output', tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    _publish_until(observer, lambda: file.exists() and file.stat().st_size > 5_000)
    assert record.stop(signal.SIGHUP) == 0
    assert check(tmp_path / 'bag')['sound']


def test_recording_into_an_existing_directory_is_refused(start: Any, tmp_path: Path) -> None:
    record = start('record', '--all', '--output', tmp_path)
    assert record.ended() == 1
    assert 'a bag is never overwritten' in record.text


def test_recording_nothing_is_a_wrong_argument(start: Any) -> None:
    record = start('record')
    assert record.ended() == 2
    assert 'name topics, or give --all or --regex' in record.text


def test_a_recording_that_cannot_begin_leaves_nothing_behind(start: Any, tmp_path: Path) -> None:
    record = start('record', '/w', '--output', tmp_path / 'bag', '--ros-args', '--nonsense')
    assert record.ended() == 2
    assert 'Traceback' not in record.text
    assert not (tmp_path / 'bag').exists()
