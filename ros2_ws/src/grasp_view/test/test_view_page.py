"""The live page in a real browser, fed over real topics by another participant."""

from __future__ import annotations

import io
import signal
import socket
import threading
import time
import urllib.request
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
import rclpy
import trimesh
from geometry_msgs.msg import Point
from PIL import Image
from rcl_interfaces.msg import SetParametersResult
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import Trigger

from grasp_view.colour_map import TABLE, colour_index
from grasp_view.messages import contacts_message
from grasp_view.scene_model import Contacts

RADIUS = 0.03125
SURFACE_FIELDS = ('x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma')


def cloud(columns: np.ndarray, names: tuple[str, ...], stamp: object) -> PointCloud2:
    data = np.ascontiguousarray(columns, dtype='<f4')
    message = PointCloud2(
        height=1,
        width=len(data),
        point_step=4 * len(names),
        row_step=data.nbytes,
        fields=[
            PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
            for k, name in enumerate(names)
        ],
        data=array('B', data.tobytes()),
    )
    message.header.stamp = stamp
    message.header.frame_id = 'object'
    return message


class Grasp:
    """The other nodes of a grasp in one: a squeezed ball's topics and the services."""

    def __init__(self, subdivisions: int = 3) -> None:
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
        self.rest = np.asarray(ball.vertices)
        self.depth = 0.0
        self.sigma = 1e-4
        self.energy: float | None = None
        self.called: list[str] = []
        self.position = float('nan')
        self.paused = False
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('grasp', context=self._context)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        make = self._node.create_publisher
        self._clouds = {
            name: make(PointCloud2, name, 10)
            for name in (
                'deformation/surface',
                'deformation/linear',
                'deformation/nonlinear',
                'hand/contacts',
                'scan/error',
            )
        }
        self._joints = make(JointState, 'hand/joint_states', 10)
        self._numbers = {
            name: make(Float64, f'deformation/{name}', 10)
            for name in ('max_displacement', 'linearity')
        }
        self._mesh = make(Mesh, 'deformation/mesh', latched)
        self._state = make(String, 'deformation/state', latched)
        self._mesh.publish(
            Mesh(
                vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in self.rest],
                triangles=[
                    MeshTriangle(vertex_indices=np.asarray(t, dtype=np.uint32)) for t in ball.faces
                ],
            )
        )
        self.state('CONTACT')
        for name in ('hand/tare', 'scan/compare'):
            self._node.create_service(Trigger, name, self._serve(name))
        self._node.create_timer(1 / 30, self._publish)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def replay(self, duration: float) -> None:
        """Tell of a replay of `duration` s from now on, and take its commands."""
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._player = rclpy.create_node('replay', context=self._context)
        for name in ('pause', 'resume', 'step'):
            self._player.create_service(Trigger, f'~/{name}', self._serve(f'replay/{name}'))
        self._player.create_publisher(Float64, '~/duration', latched).publish(
            Float64(data=duration)
        )
        paused = self._player.create_publisher(Bool, '~/paused', latched)
        position = self._player.create_publisher(Float64, '~/position', 10)

        def tell() -> None:
            paused.publish(Bool(data=self.paused))
            position.publish(Float64(data=self.position))

        self._player.declare_parameter('position_s', 0.0)
        self._player.add_on_set_parameters_callback(self._go)
        self._player.create_timer(0.1, tell)
        self._executor.add_node(self._player)

    def _go(self, parameters: list[Parameter]) -> SetParametersResult:
        self.position = float(parameters[0].value)
        return SetParametersResult(successful=True)

    def end_replay(self) -> None:
        self._executor.remove_node(self._player)
        self._player.destroy_node()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _serve(self, name: str) -> Callable[..., Trigger.Response]:
        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.called.append(name)
            response.success, response.message = name != 'hand/tare', 'the hand is loaded'
            return response

        return serve

    def state(self, name: str) -> None:
        self._state.publish(String(data=name))

    def _moved(self, depth: float) -> np.ndarray:
        normal = self.rest / RADIUS
        angle = np.arccos(np.clip(np.abs(normal[:, 0]), -1, 1))
        return -normal * (depth * np.exp(-((angle / 0.4) ** 2)))[:, None]

    def _publish(self) -> None:
        stamp = self._node.get_clock().now().to_msg()
        depth, sigma = self.depth, self.sigma
        for name, share in (('surface', 1.0), ('nonlinear', 1.0), ('linear', 0.5)):
            moved = self._moved(share * depth)
            columns = np.column_stack(
                [
                    self.rest + moved,
                    moved,
                    np.linalg.norm(moved, axis=1),
                    np.full(len(moved), sigma),
                ]
            )
            fields = SURFACE_FIELDS
            if name == 'nonlinear' and self.energy is not None:
                columns = np.column_stack([columns, np.full(len(moved), self.energy)])
                fields = (*fields, 'energy_density')
            self._clouds[f'deformation/{name}'].publish(cloud(columns, fields, stamp))
        at = np.array([[RADIUS - depth, 0, 0], [depth - RADIUS, 0, 0]])
        inward = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
        self._clouds['hand/contacts'].publish(
            contacts_message(
                Contacts(
                    0.0,
                    'object',
                    at,
                    inward,
                    2000 * depth * inward,
                    np.full(2, 0.2),
                    np.full(2, 1e-3),
                    np.array([1, 3]),
                    np.array([1, 1]),
                ),
                stamp,
            )
        )
        self._joints.publish(
            JointState(name=['finger_1_inner', 'finger_1_outer'], position=array('d', [0.4, 0.1]))
        )
        self._numbers['max_displacement'].publish(Float64(data=float(depth)))
        self._numbers['linearity'].publish(Float64(data=float(30 * depth)))

    def scan(self, error: float) -> None:
        """A compared scan whose every point is `error` m off."""
        columns = np.column_stack([self.rest * 1.02, np.full(len(self.rest), error)])
        stamp = self._node.get_clock().now().to_msg()
        self._clouds['scan/error'].publish(cloud(columns, ('x', 'y', 'z', 'distance'), stamp))

    def close(self) -> None:
        if not self._thread.is_alive():
            return
        self._executor.shutdown()
        self._thread.join(10)
        self._node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def grasp(domain_id: int) -> Iterator[Callable[..., Grasp]]:
    made: list[Grasp] = []

    def make(subdivisions: int = 3) -> Grasp:
        made.append(Grasp(subdivisions))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def port() -> int:
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return int(free.getsockname()[1])


@pytest.fixture
def tab(open_tab):
    return open_tab(1000, 640)


def view(start, port: int):
    # A pose that keeps the palm's bodies out of the picture's middle.
    arguments = ('-p', f'port:={port}', '-p', 'history:=100.0')
    pose = 'object_pose:=[0.0, 0.0, 0.19, 0.0, 0.0, 0.0, 1.0]'
    running = start('grasp_view', '--ros-args', *arguments, '-p', pose)
    running.wait_for('page ready', 60)
    return running


def picture(tab) -> np.ndarray:
    """The pixels between the two panels, below the notice of software rendering, (h, w, 3)."""
    # Software rendering and the test share the processor: let the page work in between.
    tab.wait_for_timeout(150)
    shot = tab.screenshot()
    scene = Image.open(io.BytesIO(shot)).convert('RGB').crop((310, 200, 670, 640))
    return np.asarray(scene).astype(int)


def share_of(image: np.ndarray, colour: np.ndarray, off: int = 2) -> float:
    """Which share of the picture's pixels is `colour`, up to `off` of 255."""
    return float((np.abs(image - colour.astype(int)).max(axis=2) <= off).mean())


def legend(tab) -> list[float]:
    return [float(text) for text in tab.locator('.grasp-legend-numbers span').all_inner_texts()]


def numbers(tab) -> str:
    return ' '.join(tab.locator('.grasp-numbers').inner_text().split())


def choose(tab, label: str, option: str) -> None:
    tab.get_by_label(label, exact=True).click()
    tab.get_by_role('option', name=option, exact=True).click()


def test_the_page_answers_before_anybody_publishes(start, port: int) -> None:
    running = view(start, port)
    with urllib.request.urlopen(f'http://127.0.0.1:{port}', timeout=10) as answer:
        assert answer.status == 200 and b'<html' in answer.read()
    assert running.stop(signal.SIGINT) == 0


def test_a_termination_signal_ends_it_cleanly(start, port: int) -> None:
    running = view(start, port)
    assert running.stop(signal.SIGTERM) == 0, running.text
    assert 'Traceback' not in running.text


def test_a_port_in_use_is_one_sentence_and_exit_code_1(start, port: int) -> None:
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', port))
        taken.listen()
        running = start('grasp_view', '--ros-args', '-p', f'port:={port}')
        assert running.process.wait(60) == 1
    assert f'port {port}' in running.text and 'Traceback' not in running.text


def test_a_pose_that_is_none_is_refused_at_start(start, port: int) -> None:
    pose = 'object_pose:=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]'
    running = start('grasp_view', '--ros-args', '-p', f'port:={port}', '-p', pose)
    assert running.process.wait(60) == 1
    assert 'has no direction' in running.text and 'Traceback' not in running.text


@pytest.mark.chromium
def test_the_colours_of_the_surface_are_those_of_the_legend(
    start, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    squeezed.sigma = 0.6e-4
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    choose(tab, 'Colour', 'uncertainty')
    wait_until(lambda: 'uncertainty (mm)' in tab.locator('.grasp-legend').inner_text(), 60)
    for sigma in (0.6e-4, 0.95e-4):
        squeezed.sigma = sigma
        top = 0.1
        index = colour_index(np.array([sigma * 1e3]), 0.0, top)
        wait_until(
            lambda wanted=TABLE[index][0]: (
                legend(tab)[-1] == 0.1 and share_of(picture(tab), wanted) > 0.02
            ),
            60,
        )


@pytest.mark.chromium
def test_the_picture_and_the_numbers_follow_the_squeeze(
    start, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    dark, light = TABLE[0], TABLE[250]
    wait_until(lambda: share_of(picture(tab), dark) > 0.02, 60)
    squeezed.depth = 4.8e-3
    wait_until(lambda: legend(tab) == [0.0, 1.25, 2.5, 3.75, 5.0], 60)
    wait_until(lambda: 'displacement 4.8 mm' in numbers(tab), 60)
    wait_until(lambda: share_of(picture(tab), light, 60) > 0.0005, 60)
    assert '14.4 %' in numbers(tab)
    squeezed.state('SATURATED')
    wait_until(lambda: tab.locator('.grasp-state').inner_text() == 'SATURATED', 60)


@pytest.mark.chromium
def test_every_button_calls_its_service_and_shows_the_answer(
    start, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    squeezed.position = 0.0
    squeezed.replay(20.0)
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    for label, service, answer in (
        ('Tare gauges', 'hand/tare', 'tare: refused, the hand is loaded'),
        ('Compare scan', 'scan/compare', 'compare: done'),
        ('Pause', 'replay/pause', 'pause: done'),
        ('Step', 'replay/step', 'step: done'),
        ('Resume', 'replay/resume', 'resume: done'),
    ):
        tab.get_by_role('button', name=label).click()
        wait_until(lambda name=service: name in squeezed.called, 60)
        wait_until(lambda text=answer: text in tab.locator('.grasp-answer').inner_text(), 60)
    with tab.expect_download() as download:
        tab.get_by_role('button', name='Screenshot').click()
    with Image.open(download.value.path()) as saved:
        assert saved.format == 'PNG' and saved.size == (1200, 900)


@pytest.mark.chromium
def test_a_button_without_a_service_says_so(
    start, tab, port: int, domain_id: int, wait_until
) -> None:
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    tab.get_by_role('button', name='Tare gauges').click()
    wait_until(lambda: 'nobody offers' in tab.locator('.grasp-answer').inner_text(), 60)


@pytest.mark.chromium
def test_nodes_may_go_and_come_back_with_another_mesh(
    start, grasp, tab, port: int, wait_until
) -> None:
    first = grasp(2)
    running = view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: share_of(picture(tab), TABLE[0]) > 0.02, 60)
    first.close()
    second = grasp(3)
    second.depth = 4.8e-3
    wait_until(lambda: 'displacement 4.8 mm' in numbers(tab), 60)
    wait_until(lambda: share_of(picture(tab), TABLE[250], 60) > 0.0005, 60)
    assert running.process.poll() is None and 'Traceback' not in running.text


@pytest.mark.chromium
def test_a_replay_is_followed_steered_and_forgotten_when_it_ends(
    start, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    running = view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    assert not tab.get_by_role('button', name='Pause').is_visible()
    squeezed.position = 5.0
    squeezed.replay(20.0)
    slider = tab.get_by_role('slider').nth(1)
    wait_until(lambda: tab.get_by_role('button', name='Pause').is_visible(), 60)
    wait_until(lambda: slider.get_attribute('aria-valuenow') == '5', 60)
    assert slider.get_attribute('aria-valuemax') == '20'
    slider.focus()
    slider.press('End')
    wait_until(lambda: squeezed.position == 20.0, 60)
    wait_until(lambda: 'go to 20.00 s: done' in tab.locator('.grasp-answer').inner_text(), 60)
    squeezed.position, squeezed.paused = 7.5, True
    wait_until(lambda: slider.get_attribute('aria-valuenow') == '7.5', 60)
    wait_until(lambda: tab.get_by_text('paused', exact=True).is_visible(), 60)
    squeezed.end_replay()
    wait_until(lambda: not tab.get_by_role('button', name='Pause').is_visible(), 60)
    assert running.process.poll() is None and 'Traceback' not in running.text


@pytest.mark.chromium
def test_strain_energy_is_grey_until_it_is_published_and_then_on_the_scale(
    start, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    choose(tab, 'Colour', 'strain energy density')
    told = 'grey: no energy density published'
    wait_until(lambda: told in tab.locator('.grasp-legend').inner_text(), 60)
    wait_until(lambda: share_of(picture(tab), TABLE[256]) > 0.02, 60)
    squeezed.energy = 1500.0
    wait_until(lambda: legend(tab) == [0.0, 500.0, 1000.0, 1500.0, 2000.0], 60)
    wanted = TABLE[colour_index(np.array([1500.0]), 0.0, 2000.0)][0]
    wait_until(lambda: share_of(picture(tab), wanted) > 0.02, 60)
    assert 'grey' not in tab.locator('.grasp-legend').inner_text()


@pytest.mark.chromium
def test_every_switch_of_the_page_takes_its_body_away_and_brings_it_back(
    start, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    squeezed.depth = 4.8e-3
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: share_of(picture(tab), TABLE[250], 60) > 0.0005, 60)
    tab.get_by_text('Show', exact=True).click()
    for label in (
        'Rest shape', 'Lines of equal displacement', 'Mesh lines', 'Forces', 'Hand',
        'Friction cones',
    ):  # fmt: skip
        box = tab.get_by_label(label, exact=True)
        for _ in range(2):
            before, was = picture(tab), box.is_checked()
            box.set_checked(not was)
            wait_until(lambda old=before: np.abs(picture(tab) - old).max() > 20, 60)


@pytest.mark.chromium
def test_a_tablet_held_upright_keeps_room_for_the_object(
    start, grasp, open_tab, port: int, wait_until
) -> None:
    grasp().depth = 4.8e-3
    view(start, port)
    tablet = open_tab(820, 1180, has_touch=True)
    tablet.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: 'displacement 4.8 mm' in numbers(tablet), 60)
    wait_until(lambda: not tablet.get_by_text('force (N)').is_visible(), 60)
    tablet.get_by_role('button', name='Screenshot').tap()


@pytest.mark.chromium
def test_the_scan_is_coloured_by_its_error(start, grasp, tab, port: int, wait_until) -> None:
    squeezed = grasp()
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    choose(tab, 'Colour', 'scan error')
    wait_until(lambda: share_of(picture(tab), TABLE[256]) > 0.02, 60)
    wanted = TABLE[colour_index(np.array([0.3]), 0.0, 0.5)][0]

    def shown() -> bool:
        squeezed.scan(-0.3e-3)
        return share_of(picture(tab), wanted) > 0.02

    wait_until(shown, 60)
    assert legend(tab)[-1] == 0.5


@pytest.mark.chromium
def test_the_slider_looks_back(start, grasp, tab, port: int, wait_until) -> None:
    squeezed = grasp()
    view(start, port)
    tab.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: share_of(picture(tab), TABLE[0]) > 0.02, 60)
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 3.0)
    squeezed.depth = 4.8e-3
    wait_until(lambda: share_of(picture(tab), TABLE[250], 60) > 0.0005, 60)
    tab.get_by_text('Look back', exact=True).click()
    tab.get_by_label('Live', exact=True).uncheck()
    slider = tab.get_by_role('slider').nth(1)
    wait_until(lambda: float(slider.get_attribute('aria-valuemin')) < -3.0, 60)
    slider.focus()
    slider.press('Home')
    wait_until(lambda: share_of(picture(tab), TABLE[250], 60) == 0.0, 60)
    tab.get_by_label('Live', exact=True).check()
    wait_until(lambda: share_of(picture(tab), TABLE[250], 60) > 0.0005, 60)
