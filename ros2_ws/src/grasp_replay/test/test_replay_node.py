# SPDX-License-Identifier: Apache-2.0
"""`replay` as a real process, against real subscribers."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest
from bag_samples import DATA
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from replay_observer import KEEP_ALL, LATCHED, Observer, wrench, write_wrenches
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float64, String

from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_writer import BagWriter
from grasp_replay.qos import QosProfile, qos_text


def forces(messages: list[WrenchStamped]) -> list[float]:
    return [message.wrench.force.x for message in messages]


def test_every_message_arrives_once_and_in_order(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 500)
    messages = observer.collect(WrenchStamped, '/w')
    replay = start('replay', bag, '--wait-for', '/w', '--wait', 20, '--json')
    observer.spin_until(lambda: replay.process.poll() is not None)
    observer.spin_until(lambda: len(messages) >= 500)
    assert forces(messages) == [float(index) for index in range(500)]
    report = json.loads(replay.text)
    assert (report['sent'], report['lost'], report['unacknowledged']) == (500, 0, [])
    assert replay.process.returncode == 0


def test_the_sent_bytes_are_the_stored_bytes(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag_path = write_wrenches(tmp_path / 'bag', 5)
    received: list[bytes] = []
    observer.node.create_subscription(WrenchStamped, '/w', received.append, KEEP_ALL, raw=True)
    start('replay', bag_path, '--wait-for', '/w', '--wait', 20)
    observer.spin_until(lambda: len(received) == 5)
    with open_bag(bag_path) as bag:
        assert [bytes(data) for data in received] == [message.data for message in bag.messages()]


def test_an_unknown_parameter_is_named_with_the_nearest(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 5)
    replay = start('replay', bag, '--ros-args', '-p', 'rat:=2.0', '-p', 'use_sim_time:=false')
    observer.spin_until(lambda: replay.process.poll() is not None)
    assert "there is no parameter 'rat'; did you mean rate?" in replay.text
    assert 'use_sim_time' not in replay.text


def test_clock_and_remap(start: Any, observer: Observer, tmp_path: Path) -> None:
    bag = write_wrenches(tmp_path / 'bag', 50)
    messages = observer.collect(WrenchStamped, '/left/w')
    clocks = observer.collect(Clock, '/clock')
    start('replay', bag, '--remap', 'w:=left/w', '--clock', '--wait-for', '/left/w', '--wait', 20)
    expected = {index * 4_000_000 for index in range(5, 50)}

    def times() -> list[int]:
        return [clock.clock.sec * 10**9 + clock.clock.nanosec for clock in clocks]

    observer.spin_until(lambda: len(messages) == 50 and expected <= set(times()))
    assert times() == sorted(times())


def test_pause_step_resume_and_stop(start: Any, observer: Observer, tmp_path: Path) -> None:
    bag = write_wrenches(tmp_path / 'bag', 2000)
    messages = observer.collect(WrenchStamped, '/w')
    replay = start('replay', bag, '--start-paused', '--wait-for', '/w', '--wait', 20, '--json')
    assert observer.call('/replay/step').success
    observer.spin_until(lambda: messages)
    # A step whose answer DDS lost is asked for again, and taken twice.
    stepped = len(messages)
    assert observer.call('/replay/step').success
    observer.spin_until(lambda: len(messages) > stepped)
    assert observer.call('/replay/resume').message == 'running'
    refused = observer.call('/replay/step')
    assert not refused.success
    assert 'call pause before step' in refused.message
    observer.spin_until(lambda: len(messages) > 10)
    assert observer.call('/replay/toggle_paused').message == 'paused'
    assert observer.call('/replay/stop').success
    observer.spin_until(lambda: replay.process.poll() is not None)
    assert replay.process.returncode == 0
    assert forces(messages) == [float(index) for index in range(len(messages))]
    assert json.loads(replay.text)['sent'] < 2000


def test_the_rate_is_a_parameter_while_it_runs(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 3000)
    messages = observer.collect(WrenchStamped, '/w')
    replay = start('replay', bag, '--rate', '0.01', '--wait-for', '/w', '--wait', 20)

    observer.spin_until(lambda: messages)
    assert not observer.set_parameter('rate', -1.0).successful
    assert observer.set_parameter('rate', 100.0).successful
    # At the first rate this bag would last 20 minutes.
    observer.spin_until(lambda: replay.process.poll() is not None)
    observer.spin_until(lambda: len(messages) == 3000)


def test_the_position_is_a_parameter_and_a_topic(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 2501)
    messages = observer.collect(WrenchStamped, '/w')
    positions = observer.collect(Float64, '/replay/position')
    durations = observer.collect(Float64, '/replay/duration', LATCHED)
    paused = observer.collect(Bool, '/replay/paused', LATCHED)
    start('replay', bag, '--start-paused', '--wait-for', '/w', '--wait', 20)
    observer.spin_until(lambda: durations and paused and positions)
    assert (durations[0].data, paused[-1].data, positions[-1].data) == (10.0, True, 0.0)

    beyond = observer.set_parameter('position_s', 10.5)
    assert not beyond.successful
    assert '10.0' in beyond.reason
    assert observer.set_parameter('position_s', 9.0).successful
    observer.spin_until(lambda: positions[-1].data == 9.0)
    assert observer.call('/replay/step').success
    observer.spin_until(lambda: messages)
    assert forces(messages) == [2250.0]

    assert observer.call('/replay/resume').success
    observer.spin_until(lambda: not paused[-1].data and forces(messages)[-1] > 2260.0)
    assert observer.set_parameter('position_s', 2.0).successful
    observer.spin_until(lambda: 500.0 in forces(messages))
    place = forces(messages).index(500.0)
    assert forces(messages)[:place] == [2250.0 + index for index in range(place)]
    observer.spin_until(lambda: 2.0 < positions[-1].data < 4.0)


def test_small_messages_are_not_lost_while_large_ones_cross(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    cloud = String(data='x' * 1_000_000)
    with BagWriter(tmp_path / 'bag', compression='none') as writer:
        numbers = [
            writer.add_topic(f'/{name}', kind, qos_text(QosProfile()))
            for name, kind in (
                ('w', 'geometry_msgs/msg/WrenchStamped'),
                ('s', 'std_msgs/msg/String'),
            )
        ]
        for index in range(1000):
            writer.write(numbers[0], bytes(serialize_message(wrench(index))), index * 4_000_000)
            if index % 20 == 0:
                writer.write(numbers[1], bytes(serialize_message(cloud)), index * 4_000_000)
    best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    messages = observer.collect(WrenchStamped, '/w', best_effort)
    clouds = start('record', '/s', '--output', tmp_path / 'again')
    replay = start('replay', tmp_path / 'bag', '--wait', 20, '--json')
    observer.spin_until(lambda: messages)

    def senders() -> list[str]:
        return [one.node_name for one in observer.node.get_publishers_info_by_topic('/s')]

    observer.spin_until(lambda: senders() == ['replay_large'])
    observer.spin_until(lambda: replay.process.poll() is not None)
    observer.spin_until(lambda: len(messages) == 1000)
    assert json.loads(replay.text)['topics'] == {'/s': 50, '/w': 1000}
    assert clouds.stop() == 0
    with open_bag(tmp_path / 'again') as bag:
        assert bag.message_count == 50


def test_a_latched_topic_reaches_who_comes_late(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    latched = QosProfile(depth=1, durability='transient_local')
    bag = write_wrenches(tmp_path / 'bag', 1, latched)
    replay = start('replay', bag, '--wait', 0, '--loop', '--rate', '0.001', '--start-paused')
    observer.call('/replay/step')
    replay.wait_for('nobody listens')
    messages = observer.collect(WrenchStamped, '/w', LATCHED)
    observer.spin_until(lambda: messages)


def test_its_health_is_told_once_a_second(start: Any, observer: Observer, tmp_path: Path) -> None:
    bag = write_wrenches(tmp_path / 'bag', 5000)
    arrays = observer.collect(DiagnosticArray, '/diagnostics')
    observer.collect(WrenchStamped, '/w')
    start('replay', bag, '--wait-for', '/w', '--wait', 20)
    observer.spin_until(lambda: len(arrays) >= 2)
    status = arrays[-1].status[0]
    values = {pair.key: pair.value for pair in status.values}
    assert (status.name, status.message) == ('replay', 'replaying')
    assert (values['rate'], values['lost']) == ('1.0', '0')


def test_qos_overrides_are_offered(start: Any, observer: Observer, tmp_path: Path) -> None:
    bag = write_wrenches(tmp_path / 'bag', 10)
    overrides = tmp_path / 'qos.yaml'
    overrides.write_text('/w: {reliability: best_effort, depth: 7}')
    start('replay', bag, '--start-paused', '--qos-profile-overrides-path', overrides)
    observer.spin_until(lambda: observer.node.get_publishers_info_by_topic('/w'))
    (endpoint,) = observer.node.get_publishers_info_by_topic('/w')
    assert endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


def test_lockstep_waits_for_each_answer(start: Any, observer: Observer, tmp_path: Path) -> None:
    bag = write_wrenches(tmp_path / 'bag', 100)
    answers = observer.node.create_publisher(WrenchStamped, '/answer', 10)
    questions: list[float] = []

    def answer(message: WrenchStamped) -> None:
        questions.append(message.wrench.force.x)
        answers.publish(message)

    observer.node.create_subscription(WrenchStamped, '/w', answer, KEEP_ALL)
    replay = start(
        'replay', bag, '--lockstep', 'w:=answer', '--wait-for', '/w', '--wait', 20, '--json'
    )
    observer.spin_until(lambda: replay.process.poll() is not None)
    assert replay.process.returncode == 0, replay.text
    assert questions == [float(index) for index in range(100)]


def test_lockstep_lets_those_who_answer_wait_for_their_best_answer(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 3)
    observer.node.declare_parameter('wait_for_take_up', 0.0)
    answers = observer.node.create_publisher(WrenchStamped, '/answer', 10)
    patience: list[float] = []

    def answer(message: WrenchStamped) -> None:
        patience.append(observer.node.get_parameter('wait_for_take_up').value)
        answers.publish(message)

    observer.node.create_subscription(WrenchStamped, '/w', answer, KEEP_ALL)
    replay = start(
        'replay', bag, '--lockstep', 'w:=answer', '--lockstep-timeout', 8, '--wait-for', '/w',
        '--wait', 20, '--json',
    )  # fmt: skip
    observer.spin_until(lambda: replay.process.poll() is not None)
    assert patience == [4.0, 4.0, 4.0]
    assert observer.node.get_parameter('wait_for_take_up').value == 0.0


def test_lockstep_without_answers_fails_with_their_number_and_the_first(
    start: Any, observer: Observer, tmp_path: Path
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 3)
    observer.node.create_publisher(WrenchStamped, '/answer', 10)
    observer.collect(WrenchStamped, '/w')
    replay = start(
        'replay', bag, '--lockstep', 'w:=answer', '--lockstep-timeout', '0.05', '--wait', 20
    )
    observer.spin_until(lambda: replay.process.poll() is not None)
    assert replay.process.returncode == 1
    assert '3 messages were not answered within 0.05 s each' in replay.text
    assert 'first: nothing on /answer for /w of 0.000 s' in replay.text


def test_a_bag_of_unknown_serialisation_is_refused(start: Any) -> None:
    replay = start('replay', DATA / 'wrong_rmw_test', '--wait', 0)
    assert replay.ended() == 1
    assert "serialised as 'wrong_format', not cdr" in replay.text
    assert 'Traceback' not in replay.text


def test_a_type_that_has_changed_since_is_named_and_left_out(start: Any) -> None:
    replay = start('replay', DATA / 'talker_sqlite3', '--wait', 0, '--rate', 100, '--json')
    assert replay.ended() == 0
    assert '/rosout is not replayed: its rcl_interfaces/msg/Log was defined' in replay.text


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (('-p', 'rate:=-1.0'), 'rate out of range Min: 0.001, Max: 1000.0, value: -1.0'),
        (('-p', 'position_s:=99.0'), 'position_s out of range Min: 0.0, Max: 0.016'),
        (('-p', 'rate:=fast'), "'rate' to 'fast' of type 'STRING', expecting type 'DOUBLE'"),
        (('--nonsense',), 'nonsense'),
    ],
)
def test_wrong_ros_arguments_are_one_sentence(
    start: Any, tmp_path: Path, arguments: tuple[str, ...], reason: str
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 5)
    replay = start('replay', bag, '--wait', 0, '--ros-args', *arguments)
    assert replay.ended() == 2
    assert reason in replay.text
    assert 'Traceback' not in replay.text


def test_topics_that_the_bag_lacks_are_refused_with_those_it_has(
    start: Any, tmp_path: Path
) -> None:
    replay = start('replay', write_wrenches(tmp_path / 'bag', 5), '--topics', '/v')
    assert replay.ended() == 1
    assert replay.text.endswith('has none of the topics chosen; it has /w\n')


def test_a_missing_bag_is_one_sentence(start: Any, tmp_path: Path) -> None:
    replay = start('replay', tmp_path / 'nothing')
    assert replay.ended() == 1
    assert replay.text == (
        f'replay: {tmp_path}/nothing does not exist; give a bag directory or an .mcap file\n'
    )


@pytest.mark.parametrize('sig', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_the_summary(
    start: Any, observer: Observer, tmp_path: Path, sig: int
) -> None:
    bag = write_wrenches(tmp_path / 'bag', 5000)
    messages = observer.collect(WrenchStamped, '/w')
    replay = start('replay', bag, '--wait-for', '/w', '--wait', 20)
    observer.spin_until(lambda: len(messages) > 5)
    assert replay.stop(sig) == 0
    assert 'stopped before the end' in replay.text
    assert 'Traceback' not in replay.text
