# SPDX-License-Identifier: Apache-2.0
"""Whatever arrives on a topic, a service or a parameter: no node ends, hangs or talks nonsense.

`make test` sends hundreds of generated messages to every topic of every node, `make soak` 10^5.
MESSAGES=N: so many to each topic; SEED: others.
"""

import importlib
import os
import threading
import time
from contextlib import contextmanager, nullcontext, suppress
from functools import partial

import msgspec
import numpy as np
import pytest
import rclpy
import viser
from geometry_msgs.msg import Point
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from scipy.spatial import ConvexHull
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle
from tests.odd_messages import NUMBERS, TEXTS, OddMessages
from tests.service_calls import answer
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

SOAK = bool(os.environ.get('SOAK'))
MESSAGES = int(os.environ.get('MESSAGES', 4_000 if SOAK else 60))
SEED = int(os.environ.get('SEED', 0))
REQUESTS = 200 if SOAK else 5
PATIENCE_S = 20.0
# Latched topics take nothing from a publisher that is not.
REACHES_ALL = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# What every node listens to by itself, and what only a player of bags sends.
NOT_OURS = ('/parameter_events', '/clock')
CAMERA = {
    'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [1.0, 0.0, 0.0],
    'fov': 1.0, 'near': 0.01, 'far': 10.0, 'image_height': 600, 'image_width': 800,
    'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0],
}  # fmt: skip
NODES = {
    'deformation': (('theory:=koiter',), 'serving'),
    'hand_bridge': (('backend:=emulator', 'arm:=pose'), 'connected'),
    'scan_compare': (('object:=tennis_ball',), ''),
    'grasp_view': (('port:=8973',), 'page ready'),
}


class Sender:
    """A node of the test that sends what a node listens to, and hears what it answers."""

    def __init__(self, wait_until):
        rclpy.init()
        self.node = rclpy.create_node('sender')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.wait_until = wait_until
        self.not_finite = []

    def hear_surfaces(self):
        """Keep every answer that is not finite."""
        self.node.create_subscription(
            PointCloud2, 'deformation/surface', self._hear, qos_profile_sensor_data
        )

    def _hear(self, cloud):
        if not np.isfinite(np.frombuffer(cloud.data, np.float32)).all():
            self.not_finite.append(cloud)

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
        if name not in self.node.get_node_names():
            return found
        for topic, kinds in self.node.get_subscriber_names_and_types_by_node(name, '/'):
            package, _, kind = kinds[0].split('/')
            if topic not in NOT_OURS and not topic.endswith('/_action/feedback'):
                made = getattr(importlib.import_module(f'{package}.msg'), kind)
                found[topic] = self.node.create_publisher(made, topic, REACHES_ALL), made
        return found

    def services(self, name):
        """Clients of everything that a node can be asked, by name, the life cycle last."""
        found = {}
        for service, kinds in self.node.get_service_names_and_types_by_node(name, '/'):
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

    def set(self, name, parameter, value):
        """Set a parameter to whatever it is; says whether it was accepted."""
        client = self.node.create_client(SetParameters, f'/{name}/set_parameters')
        self.until(client.service_is_ready)
        request = SetParameters.Request(
            parameters=[Parameter(parameter, value=value).to_parameter_msg()]
        )
        future = client.call_async(request)
        self.until(future.done, 60.0, lambda: f'{name} hangs on {parameter} = {value!r}')
        self.node.destroy_client(client)
        return future.result().results[0].successful

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
        triangles=[MeshTriangle(vertex_indices=one) for one in ConvexHull(points).simplices],
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


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', sorted(NODES))
def test_no_message_or_request_ends_a_node_or_makes_it_say_nonsense(start, sender, name):
    parameters, ready = NODES[name]
    arguments = [word for parameter in parameters for word in ('-p', parameter)]
    node = start(name, '--ros-args', *arguments)
    if ready:
        node.wait_for(ready, 120.0)
    sender.until(lambda: sender.topics(name), 60.0)
    topics = sender.topics(name)
    if name == 'deformation':
        sender.hear_surfaces()
    with looked_at(8973) if name == 'grasp_view' else nullcontext():
        flood(node, sender, name, topics)
        ask(node, sender, name)
    sender.answers(name)
    assert node.process.poll() is None, node.text
    assert 'Traceback' not in node.text, node.text
    assert sender.not_finite == []
    assert '\x1b]0;' not in node.text


def flood(node, sender, name, topics):
    """Send odd messages to all topics of a node, and between them a mesh that can be drawn."""
    odd = OddMessages([SEED, sorted(NODES).index(name)])
    for number in range(MESSAGES):
        for topic, (publisher, kind) in topics.items():
            message = odd.message(kind)
            publisher.publish(message)
            sender.spin()
            assert node.process.poll() is None, f'{topic}: {str(message)[:2000]}\n{node.text}'
        if number % 10 == 0 and 'deformation/mesh' in topics:
            topics['deformation/mesh'][0].publish(ball())
        if number % 50 == 0:
            sender.answers(name)
    print(f'{name}: {MESSAGES * len(topics)} messages, load {os.getloadavg()[0]:.1f}')


def ask(node, sender, name):
    """Ask odd things of all services of a node; whether it answers is another question."""
    odd = OddMessages([SEED, sorted(NODES).index(name)])
    for service, (client, kind) in sender.services(name).items():
        for _ in range(REQUESTS):
            request = odd.message(kind)
            client.call_async(request)
            sender.spin(0.01)
            assert node.process.poll() is None, f'{service}: {str(request)[:2000]}\n{node.text}'


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', ['deformation', 'hand_bridge'])
def test_no_parameter_ends_a_node(start, sender, name):
    parameters = importlib.import_module(
        'shell_deform.node.parameters'
        if name == 'deformation'
        else 'barrett_hand_bridge.parameters'
    ).PARAMETERS
    given, ready = NODES[name]
    arguments = [word for parameter in given for word in ('-p', parameter)]
    node = start(name, '--ros-args', *arguments)
    node.wait_for(ready, 120.0)
    odd = OddMessages([SEED, 7])
    for parameter in parameters:
        values = list(NUMBERS) if isinstance(parameter.default, float) else []
        values += [-1, 2**62] if isinstance(parameter.default, int) else []
        values += list(TEXTS) if isinstance(parameter.default, str) else []
        values += [[float('nan')] * 7, [1e300] * 3] if isinstance(parameter.default, list) else []
        for value in values if SOAK else [odd.pick(values)] if values else []:
            sender.set(name, parameter.name, value)
            assert node.process.poll() is None, f'{parameter.name} = {value!r}\n{node.text}'
    sender.answers(name)
    assert 'Traceback' not in node.text, node.text
