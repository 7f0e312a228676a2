"""What-if: fingers on a surface, variants of an object, and the real solver behind the page."""

from __future__ import annotations

import io
import json
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2

from grasp_view.messages import read_contacts, read_surface
from grasp_view.scene_model import Mesh
from grasp_view.what_if import (
    Finger,
    Touch,
    contacts_of,
    hits,
    nearest,
    object_variant,
    opposite,
    vertex_normals,
)

RADIUS = 0.03
BALL = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
MESH = Mesh(np.asarray(BALL.faces), np.asarray(BALL.vertices))
NORMALS = vertex_normals(MESH)
directions = st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(
    lambda v: np.linalg.norm(v) > 0.1
)


def test_normals_of_a_ball_point_outward() -> None:
    assert np.allclose(NORMALS, MESH.rest / RADIUS, atol=0.02)


@settings(deadline=None)
@given(directions)
def test_a_ray_through_a_ball_meets_it_twice_nearest_first(towards: list[float]) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    found = hits(MESH, NORMALS, -3 * RADIUS * direction, direction)
    ends = np.array([touch.point for touch in found])
    assert np.allclose(ends[0], -RADIUS * direction, atol=1e-3 * RADIUS * 5)
    assert np.allclose(ends[-1], RADIUS * direction, atol=1e-3 * RADIUS * 5)
    assert np.allclose(found[0].outward, -direction, atol=0.02)


def test_a_ray_beside_the_body_meets_nothing() -> None:
    assert hits(MESH, NORMALS, np.array([0, 0, 2 * RADIUS]), np.array([1.0, 0, 0])) == []


@settings(deadline=None)
@given(directions)
def test_the_opposite_place_of_a_ball_is_its_antipode(towards: list[float]) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    here = hits(MESH, NORMALS, 3 * RADIUS * direction, -direction)[0]
    there = opposite(MESH, NORMALS, here)
    assert there is not None
    assert np.allclose(there.point, -here.point, atol=0.02 * RADIUS)


def test_an_open_edge_has_no_opposite_place() -> None:
    flat = Mesh(np.array([[0, 1, 2]]), np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    touch = Touch(np.array([0.2, 0.2, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert opposite(flat, vertex_normals(flat), touch) is None


def test_contacts_lie_on_the_outer_face_and_push_inward() -> None:
    touch = nearest(MESH, NORMALS, np.array([1.0, 0, 0]))
    contacts = contacts_of([Finger(1, touch, 7.0), Finger(2, touch, 0.0)], 0.002, 0.001)
    assert np.linalg.norm(contacts.points[0]) == pytest.approx(RADIUS + 0.001)
    assert np.allclose(contacts.forces[0], -7.0 * touch.outward)
    assert contacts.flags.tolist() == [1, 0] and contacts.frame == 'object'


def test_a_variant_keeps_what_it_does_not_change_and_drops_unknown_numbers() -> None:
    described = {
        'name': 'ball', 'surface': {'sphere': {'outer_diameter_m': 0.065}}, 'thickness_m': 0.0025,
        'young_modulus_pa': 1e6, 'poisson_ratio': 0.5, 'yield_stress_pa': None, 'supports': [],
        'gas': {'kind': 'sealed', 'gauge_pressure_pa': 0.0, 'ambient_pa': 101325.0},
        'mesh': {'vertices': 650},
    }  # fmt: skip
    variant = object_variant(described, 2e6, 5e4)
    assert variant['young_modulus_pa'] == 2e6
    assert variant['gas'] == {
        'kind': 'sealed', 'gauge_pressure_pa': 5e4, 'ambient_pa': 101325.0,
    }  # fmt: skip
    assert set(variant) == {
        'name', 'surface', 'thickness_m', 'young_modulus_pa', 'poisson_ratio', 'gas',
    }  # fmt: skip


def test_an_open_object_gets_no_pressure() -> None:
    described = {'name': 'can', 'gas': {'kind': 'none', 'gauge_pressure_pa': 0.0}}
    assert object_variant(described, 1e9, 5e4)['gas'] == {'kind': 'none'}


def test_a_variant_of_every_shipped_object_is_an_object_file(tmp_path: Path) -> None:
    program = str(Path(sys.executable).parent / 'shell_objects')
    listed = subprocess.run([program, '--json'], capture_output=True, check=True, timeout=60)
    for described in json.loads(listed.stdout)['objects']:
        path = tmp_path / f'{described["name"]}.yaml'
        path.write_text(json.dumps(object_variant(described, 3e6, 0.0)))
        read = subprocess.run(
            [program, str(path), '--json'], capture_output=True, check=False, timeout=60
        )
        assert read.returncode == 0, read.stderr.decode()
        assert json.loads(read.stdout)['objects'][0]['young_modulus_pa'] == 3e6


def test_an_unknown_object_is_one_sentence_and_exit_code_1(start) -> None:
    running = start(
        'grasp_view', '--ros-args', '-p', f'port:={free_port()}', '-p', 'what_if:=true',
        '-p', 'object:=teapot',
    )  # fmt: skip
    assert running.process.wait(90) == 1
    assert 'teapot' in running.text and 'Traceback' not in running.text


def free_port() -> int:
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return int(free.getsockname()[1])


@pytest.fixture
def heard(domain_id: int) -> Iterator[Callable[[str], PointCloud2 | None]]:
    """The newest message of a topic under /what_if, by its name; None while none came."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    newest: dict[str, PointCloud2] = {}
    for name in ('hand/contacts', 'deformation/surface'):
        node.create_subscription(
            PointCloud2, f'/what_if/{name}', lambda m, of=name: newest.update({of: m}), 10
        )

    def take(name: str) -> PointCloud2 | None:
        executor.spin_once(timeout_sec=0.1)
        return newest.get(name)

    yield take
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def largest_displacement(message: PointCloud2 | None) -> float:
    moved = np.zeros((1, 3)) if message is None else read_surface(message).moved
    return float(np.linalg.norm(moved, axis=1).max())


def test_the_placed_fingers_are_answered_by_the_real_solver(start, heard, wait_until) -> None:
    running = start(
        'grasp_view', '--ros-args', '-p', f'port:={free_port()}', '-p', 'what_if:=true'
    )
    wait_until(
        lambda: largest_displacement(heard('deformation/surface')) > 5e-4,
        110,
        lambda: running.text,
    )
    sent = read_contacts(heard('hand/contacts'))
    assert np.allclose(sent.forces.sum(axis=0), 0.0, atol=0.05)
    assert np.allclose(np.linalg.norm(sent.points, axis=1), 0.0325, atol=2e-4)
    assert running.stop(signal.SIGINT) == 0, running.text


@pytest.mark.chromium
def test_a_finger_dragged_in_the_browser_takes_its_opposite_along(
    start, heard, open_tab, wait_until
) -> None:
    port = free_port()
    running = start('grasp_view', '--ros-args', '-p', f'port:={port}', '-p', 'what_if:=true')
    running.wait_for('page ready', 60)
    tab = open_tab(1280, 860)
    tab.goto(f'http://127.0.0.1:{port}')

    def handle() -> np.ndarray:
        """Pixels (n, 2) of the blue ball that is finger 1: x, y."""
        tab.wait_for_timeout(150)
        shot = Image.open(io.BytesIO(tab.screenshot())).convert('RGB')
        red, _, blue = np.moveaxis(np.asarray(shot).astype(int)[:, 310:950], 2, 0)
        rows, columns = np.nonzero((blue > 150) & (red < 90) & (blue - red > 110))
        return np.column_stack([columns + 310, rows])

    wait_until(lambda: len(handle()) > 100, 110, lambda: running.text)
    x, y = handle().mean(axis=0)
    tab.mouse.move(x, y)
    tab.mouse.down()
    for k in range(1, 11):
        tab.mouse.move(x - 12 * k, y - 4 * k)
        tab.wait_for_timeout(50)
    tab.mouse.up()

    def moved() -> bool:
        message = heard('hand/contacts')
        points = np.array(
            [[0.0325, 0.0, 0.0]] if message is None else read_contacts(message).points
        )
        return bool(np.linalg.norm(points[0] - [0.0325, 0.0, 0.0]) > 0.01)

    wait_until(moved, 60)
    first, second = read_contacts(heard('hand/contacts')).points
    assert np.allclose(second, -first, atol=2e-3)
