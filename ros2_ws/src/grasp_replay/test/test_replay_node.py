"""`replay` and `record` as real processes, against real subscribers and publishers."""

from __future__ import annotations

import json
import signal
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from bag_samples import DATA
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import Trigger

from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_writer import BagWriter
from grasp_replay.commands.bag_check import check
from grasp_replay.qos import QosProfile, qos_text

KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Observer:
    """A node in this process that the test spins itself."""

    def __init__(self, domain_id: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.node = Node('observer', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def spin_until(self, condition: Callable[[], object], timeout: float = 30.0) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, 'condition not met in time'
            self.executor.spin_once(timeout_sec=0.02)

    def collect(self, kind: type, topic: str, qos: QoSProfile = KEEP_ALL) -> list[Any]:
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def call(self, service: str, kind: type = Trigger, request: Any = None) -> Any:
        client = self.node.create_client(kind, service)
        self.spin_until(client.service_is_ready)
        future = client.call_async(request or kind.Request())
        self.spin_until(future.done)
        return future.result()

    def set_parameter(self, name: str, value: float) -> Any:
        parameter = Parameter(
            name=name,
            value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value),
        )
        request = SetParameters.Request(parameters=[parameter])
        return self.call('/replay/set_parameters', SetParameters, request).results[0]

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def observer(domain_id: int) -> Iterator[Observer]:
    observer = Observer(domain_id)
    yield observer
    observer.close()


def wrench(index: int) -> WrenchStamped:
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(index * 4_000_000, 10**9)
    message.header.frame_id = 'hand_base'
    message.wrench.force.x = float(index)
    return message


def write_wrenches(path: Path, count: int, qos: QosProfile | None = None) -> Path:
    with BagWriter(path) as writer:
        topic = writer.add_topic(
            '/w', 'geometry_msgs/msg/WrenchStamped', qos_text(qos or QosProfile())
        )
        for index in range(count):
            writer.write(topic, bytes(serialize_message(wrench(index))), index * 4_000_000)
    return path


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
    observer.spin_until(lambda: len(messages) == 1)
    assert observer.call('/replay/step').success
    observer.spin_until(lambda: len(messages) == 2)
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
    assert replay.process.wait(30) == 1
    assert "serialised as 'wrong_format', not cdr" in replay.text
    assert 'Traceback' not in replay.text


def test_a_type_that_has_changed_since_is_named_and_left_out(start: Any) -> None:
    replay = start('replay', DATA / 'talker_sqlite3', '--wait', 0, '--rate', 100, '--json')
    assert replay.process.wait(30) == 0
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
    assert replay.process.wait(30) == 2
    assert reason in replay.text
    assert 'Traceback' not in replay.text


def test_a_recording_that_cannot_begin_leaves_nothing_behind(start: Any, tmp_path: Path) -> None:
    record = start('record', '/w', '--output', tmp_path / 'bag', '--ros-args', '--nonsense')
    assert record.process.wait(30) == 2
    assert 'Traceback' not in record.text
    assert not (tmp_path / 'bag').exists()


def test_topics_that_the_bag_lacks_are_refused_with_those_it_has(
    start: Any, tmp_path: Path
) -> None:
    replay = start('replay', write_wrenches(tmp_path / 'bag', 5), '--topics', '/v')
    assert replay.process.wait(30) == 1
    assert replay.text.endswith('has none of the topics chosen, but /w\n')


def test_a_missing_bag_is_one_sentence(start: Any, tmp_path: Path) -> None:
    replay = start('replay', tmp_path / 'nothing')
    assert replay.process.wait(30) == 1
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
    record.process.wait(10)
    report = check(file, tmp_path / 'saved')
    assert not report['sound']
    assert sent - report['recovered']['messages'] <= 250
    assert check(tmp_path / 'saved')['sound']


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


def test_recording_into_an_existing_directory_is_refused(start: Any, tmp_path: Path) -> None:
    record = start('record', '--all', '--output', tmp_path)
    assert record.process.wait(30) == 1
    assert 'a bag is never overwritten' in record.text


def test_recording_nothing_is_a_wrong_argument(start: Any) -> None:
    record = start('record')
    assert record.process.wait(30) == 2
    assert 'name topics, or give --all or --regex' in record.text
