# SPDX-License-Identifier: Apache-2.0
"""Whatever arrives on a topic, a service or a parameter: no node ends, hangs or talks nonsense.

`make test` sends hundreds of generated messages to every topic of every node, `make soak` 10^5;
each run says how many were sent and how many the callbacks took (`tests/counted.py`). Messages go
out in bursts that a queue holds, and whoever took a burst is alive.
MESSAGES=N: so many to each topic, with -s for the counts; SEED: others.
"""

import importlib
import os
import subprocess
import threading
import time
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
import rclpy
import viser
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PoseStamped
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from scipy.spatial import ConvexHull
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Float64, String
from tests.counted import arrived
from tests.executables import executable
from tests.odd_messages import OddMessages
from tests.patience import Patience
from tests.service_calls import answer
from trajectory_msgs.msg import JointTrajectory
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from grasp_common.point_cloud import CloudReader

SOAK = bool(os.environ.get('SOAK'))
MESSAGES = int(os.environ.get('MESSAGES', 4_000 if SOAK else 60))
SEED = int(os.environ.get('SEED', 0))
REQUESTS = 40 if SOAK else 5
VALUES = 2_000 if SOAK else 60
PATIENCE_S = 20.0
# A burst of which so long nothing more arrives has lost the rest on the way.
QUIET_S = 0.1
# Every so many bursts the messages are damaged on the wire, and the node is asked a question.
DAMAGED = 10
# Latched topics take nothing from a publisher that is not.
REACHES_ALL = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# What every node listens to by itself.
NOT_OURS = '/parameter_events'
QUEUES_OF_ONE = ('/clock',)
# It ends the replay, as whoever calls it wants.
ENDS = '/replay/stop'
CAMERA = {
    'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [1.0, 0.0, 0.0],
    'fov': 1.0, 'near': 0.01, 'far': 10.0, 'image_height': 600, 'image_width': 800,
    'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0],
}  # fmt: skip
# Arguments, what it says when it is ready, and how many messages every queue of it holds.
NODES = {
    'deformation': (('--ros-args', '-p', 'theory:=koiter'), 'serving', 5),
    'hand_bridge': (
        (
            *('--ros-args', '-p', 'backend:=emulator', '-p', 'initialize_on_start:=true'),
            *('-p', 'arm:=pose', '-p', 'use_sim_time:=true'),
        ),
        'initialize: initialised',
        5,
    ),
    'scan_compare': (
        ('--ros-args', '-p', 'object:=tennis_ball', '-p', 'use_sim_time:=true'),
        'waiting for scans',
        1,
    ),
    'grasp_view': (('--ros-args', '-p', 'port:=8973', '-p', 'rate:=60.0'), 'page ready', 1),
    'replay': (('CAN', '--loop', '--start-paused'), '', 1),
    'record': (('-a', '--time', 'header', '-o', 'BAG'), 'recording', 5),
}
# A recorder listens to what somebody publishes.
RECORDED = {
    '/odd/cloud': PointCloud2, '/odd/joints': JointState, '/odd/path': JointTrajectory,
    '/odd/pose': PoseStamped, '/odd/told': DiagnosticArray, '/odd/mesh': Mesh,
    '/odd/text': String, '/odd/number': Float64,
}  # fmt: skip
FINITE = [f'{kind}{axis}' for kind in ('', 'n', 'f', 'u', 'o') for axis in 'xyz']
FINITE += ['displacement', 'sigma', 'distance', 'radius', 'sigma_n']


class Sender:
    """A node of the test that sends what a node listens to, and hears what it answers."""

    def __init__(self, wait_until):
        rclpy.init()
        self.node = rclpy.create_node('sender')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.wait_until = wait_until
        self.not_finite = []
        self.heard = 0

    def hear(self, name):
        """Keep every cloud and every joint state of a node that is not finite."""
        for topic, kinds in self.node.get_publisher_names_and_types_by_node(name, '/'):
            if kinds[0].endswith(('/PointCloud2', '/JointState')) and 'numbers' not in topic:
                package, _, kind = kinds[0].split('/')
                made = getattr(importlib.import_module(f'{package}.msg'), kind)
                self.node.create_subscription(
                    made, topic, partial(self._hear, topic), qos_profile_sensor_data
                )

    def _hear(self, topic, message):
        if isinstance(message, JointState):
            numbers = np.array(message.position)
        else:
            points = CloudReader(topic).read(message)
            names = [name for name in FINITE if name in points.dtype.names]
            numbers = np.array([points[name] for name in names])
        self.heard += 1
        if not np.isfinite(numbers).all():
            self.not_finite.append((topic, message))

    def spin(self, seconds=0.0):
        end = time.monotonic() + seconds
        self.executor.spin_once(timeout_sec=0.0)
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)

    def until(self, condition, timeout=PATIENCE_S, message=lambda: 'not in time'):
        def turn():
            self.spin(0.02)
            return condition()

        self.wait_until(turn, timeout, message)

    def topics(self, name):
        """Publishers to everything that a node listens to, with the type of each."""
        found = {}
        kinds = dict(RECORDED) if name == 'record' else {}
        if name not in self.node.get_node_names():
            return found
        for topic, names in self.node.get_subscriber_names_and_types_by_node(name, '/'):
            package, _, kind = names[0].split('/')
            if name != 'record' and not topic.startswith(NOT_OURS) and '/_action/' not in topic:
                kinds[topic] = getattr(importlib.import_module(f'{package}.msg'), kind)
        for topic, kind in kinds.items():
            found[topic] = self.node.create_publisher(kind, topic, REACHES_ALL), kind
        return found

    def services(self, name):
        """Clients of everything that a node can be asked, by name, the life cycle last."""
        found = {}
        for service, kinds in self.node.get_service_names_and_types_by_node(name, '/'):
            if service == ENDS:
                continue
            package, folder, kind = kinds[0].split('/')
            kind, _, part = kind.partition('_')
            made = getattr(importlib.import_module(f'{package}.{folder}'), kind)
            made = getattr(made.Impl, f'{part}Service') if part else made
            found[service] = self.node.create_client(made, service), made.Request
        return dict(sorted(found.items(), key=lambda one: one[0].endswith('/change_state')))

    def answers(self, name):
        """Whether a node answers a question about itself."""
        client = self.node.create_client(GetParameters, f'/{name}/get_parameters')
        unanswered = partial(self.until, message=lambda: f'{name} does not answer')
        answer(client, GetParameters.Request(names=['use_sim_time']), unanswered)
        self.node.destroy_client(client)

    def asked(self, client, requests):
        """Ask all at once, and wait while answers come; how many came."""
        futures = [client.call_async(request) for request in requests]
        seen, patience = -1, Patience(PATIENCE_S)
        while not all(future.done() for future in futures) and not patience.over:
            self.spin(0.002)
            if seen != (seen := sum(future.done() for future in futures)):
                patience = Patience(PATIENCE_S if seen == 0 else 5.0)
        return sum(future.done() for future in futures)

    def end(self):
        self.executor.remove_node(self.node)
        self.node.destroy_node()
        rclpy.try_shutdown()


def ball():
    """A mesh of as many vertices as odd surfaces often have: they are drawn."""
    number = np.arange(50)
    height, turn = 1.0 - (2 * number + 1) / 50, number * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    points = 0.03 * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    return Mesh(
        vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in points],
        triangles=[
            MeshTriangle(vertex_indices=one) for one in np.uint32(ConvexHull(points).simplices)
        ],
    )


@contextmanager
def looked_at(port):
    """A browser that looks at the page, and takes every picture."""
    with connect(
        f'ws://127.0.0.1:{port}', subprotocols=[f'viser-v{viser.__version__}'],
        origin=f'http://127.0.0.1:{port}', max_size=None,
    ) as page:  # fmt: skip
        page.send(msgspec.msgpack.encode(CAMERA))

        def take():
            with suppress(ConnectionClosed):
                for _ in page:
                    pass

        taking = threading.Thread(target=take)
        taking.start()
        yield
    taking.join()


@pytest.fixture
def sender(domain_id, wait_until):
    sender = Sender(wait_until)
    yield sender
    sender.end()


@pytest.fixture
def begin(start, sender, tmp_path):
    """Start a node that counts what arrives; also gives the folder of the counts."""
    counts = tmp_path / 'counts'
    counts.mkdir()

    def started(name):
        arguments, ready, _ = NODES[name]
        paths = {'BAG': tmp_path / 'bag', 'CAN': Path(__file__).parents[1] / 'bags/half_soda_can'}
        words = [str(paths.get(word, word)) for word in arguments]
        program = Path(__file__).with_name('counted.py')
        node = start('python', program, counts, executable(name), *words)
        if ready:
            node.wait_for(ready, 120.0)
        sender.until(lambda: name in sender.node.get_node_names(), 60.0)
        return node, counts

    return started


def lives(node, sender, name):
    """The node answers, has complained of nothing unforeseen, and steers no terminal."""
    sender.answers(name)
    assert node.process.poll() is None, node.text
    text = node.text
    assert 'Traceback' not in text, text[text.index('Traceback') - 3000 :][:6000]
    assert sender.not_finite == []
    assert '\x1b]0;' not in text


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', sorted(NODES))
def test_no_message_or_request_ends_a_node_or_makes_it_say_nonsense(begin, sender, name, tmp_path):
    node, counts = begin(name)
    sender.until(lambda: sender.topics(name) or name == 'replay', 60.0)
    topics = sender.topics(name)
    sender.until(lambda: all(one.get_subscription_count() for one, _ in topics.values()), 60.0)
    sender.hear(name)
    with looked_at(8973) if name == 'grasp_view' else nullcontext():
        flood(node, sender, name, topics, counts)
        ask(node, sender, name)
    if name == 'record':
        assert node.stop() == 0, node.text
        check = [executable('bag_check'), tmp_path / 'bag']
        told = subprocess.run(check, capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stdout + told.stderr
    else:
        lives(node, sender, name)


def flood(node, sender, name, topics, counts):
    """Send odd messages to all topics of a node, and between them a mesh that can be drawn."""
    odd = OddMessages([SEED, sorted(NODES).index(name)])
    burst, sent, damaged, began = NODES[name][2], 0, 0, time.monotonic()
    first = sum(arrived(counts, topic) for topic in topics)
    for number in range(MESSAGES // burst):
        before = sum(arrived(counts, topic) for topic in topics)
        spoiled = number % DAMAGED == DAMAGED - 1
        last = [
            (topic, odd.octets(kind) if spoiled else odd.message(kind))
            for topic, (_, kind) in topics.items()
            for _ in range(1 if topic in QUEUES_OF_ONE else burst)
        ]
        for topic, message in last:
            topics[topic][0].publish(message)
        if number % 10 == 0 and '/deformation/mesh' in topics:
            topics['/deformation/mesh'][0].publish(ball())
        new = take(sender, topics, counts, before, 0 if spoiled else len(last))
        if node.process.poll() is not None:
            told = '\n'.join(f'{topic}: {str(message)[:2000]}' for topic, message in last)
            pytest.fail(f'{told}\n{node.text[-5000:]}')
        if spoiled or not new:
            sender.answers(name)
        sent += len(last)
        damaged += len(last) if spoiled else 0
    sender.answers(name)
    taken = sum(arrived(counts, topic) for topic in topics) - first
    print(
        f'{name}: {sent} messages to {len(topics)} topics, {damaged} of them damaged on the wire; '
        f'{taken} arrived; {sender.heard} answers, {len(sender.not_finite)} of them not finite; '
        f'{time.monotonic() - began:.0f} s, load {os.getloadavg()[0]:.1f}'
    )
    assert taken >= 0.5 * (sent - damaged)


def take(sender, topics, counts, before, wanted):
    """Wait until a burst was taken, or no more of it comes; how many came."""
    seen, patience = -1, Patience(QUIET_S)
    while not patience.over:
        sender.spin()
        if seen != (seen := sum(arrived(counts, topic) for topic in topics) - before):
            patience = Patience(QUIET_S)
        if seen >= wanted:
            return seen
        time.sleep(0.0005)
    return seen


def ask(node, sender, name):
    """Ask odd things of all services of a node; whether it answers is another question."""
    odd = OddMessages([SEED, sorted(NODES).index(name)])
    sent = answered = 0
    services = sender.services(name)
    for service, (client, kind) in services.items():
        for _ in range(REQUESTS // 5):
            requests = [odd.message(kind) for _ in range(5)]
            answered += sender.asked(client, requests)
            sent += len(requests)
            told = f'{service}: {str(requests)[:5000]}\n{node.text[-5000:]}'
            assert node.process.poll() is None, told
    print(f'{name}: {sent} requests of {len(services)} services, {answered} answered')


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', sorted(set(NODES) - {'record'}))
def test_no_parameter_ends_a_node(begin, sender, name):
    node, _ = begin(name)
    client = sender.node.create_client(ListParameters, f'/{name}/list_parameters')
    names = answer(client, ListParameters.Request(), sender.until).result.names
    client = sender.node.create_client(GetParameters, f'/{name}/get_parameters')
    held = answer(client, GetParameters.Request(names=names), sender.until).values
    client = sender.node.create_client(SetParameters, f'/{name}/set_parameters')
    sender.until(client.service_is_ready)
    odd = OddMessages([SEED, 7])
    accepted = 0
    for _ in range(VALUES // 10):
        chosen = [int(odd.pick(range(len(names)))) for _ in range(10)]
        values = [Parameter(name=names[n], value=odd.value(held[n])) for n in chosen]
        # One that cannot be refuses all of its request.
        futures = [
            client.call_async(SetParameters.Request(parameters=[value])) for value in values
        ]
        told = partial(str, f'{name} hangs on {values}')
        sender.until(
            lambda futures=futures: all(one.done() for one in futures) or node.process.poll(),
            60.0,
            told,
        )
        assert node.process.poll() is None, f'{values}\n{node.text[-5000:]}'
        accepted += sum(one.result().results[0].successful for one in futures)
    print(f'{name}: {VALUES} values of {len(names)} parameters, {accepted} accepted')
    lives(node, sender, name)
