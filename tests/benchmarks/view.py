# SPDX-License-Identifier: Apache-2.0
"""Figures of the live page, of what-if and of the report. `python tests/benchmarks/view.py`.

The page is fed with 2 562 vertices 100 times a second and contacts 250 times a second; a client
that reads everything and renders nothing stands for the browser.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
import rclpy
import trimesh
import viser
import zstandard
from diagnostic_msgs.msg import DiagnosticArray
from figures import Row, show
from geometry_msgs.msg import Point
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle
from websockets.sync.client import connect

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
sys.path.append(str(ROOT / 'ros2_ws/src/grasp_view/test'))
from bags.processes import end_process  # noqa: E402
from view_grasp import RADIUS, SURFACE_FIELDS, cloud  # noqa: E402

from grasp_replay.report import RowScene, write_report  # noqa: E402

BINARIES = Path(sys.executable).parent
DOMAIN = '96'
WATCHED_S = 15.0
# The page counts a browser once it has told where it looks from.
CAMERA = {
    'type': 'ViewerCameraMessage',
    'wxyz': (1.0, 0.0, 0.0, 0.0),
    'position': (3.0, 0.0, 0.0),
    'fov': 1.0,
    'near': 0.01,
    'far': 1000.0,
    'image_height': 860,
    'image_width': 1280,
    'look_at': (0.0, 0.0, 0.0),
    'up_direction': (0.0, 0.0, 1.0),
}


def publish() -> None:
    """A squeezed ball's topics at full rate until interrupted."""
    rclpy.init()
    node = rclpy.create_node('squeeze')
    ball = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    rest = np.asarray(ball.vertices)
    normal = rest / RADIUS
    shape = np.exp(-((np.arccos(np.clip(np.abs(normal[:, :1]), -1, 1)) / 0.4) ** 2))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    mesh = node.create_publisher(Mesh, 'deformation/mesh', latched)
    mesh.publish(
        Mesh(
            vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in rest],
            triangles=[
                MeshTriangle(vertex_indices=np.asarray(t, dtype=np.uint32)) for t in ball.faces
            ],
        )
    )
    clouds = {
        name: node.create_publisher(PointCloud2, name, 10)
        for name in (
            'deformation/surface',
            'deformation/linear',
            'deformation/nonlinear',
            'hand/contacts',
        )
    }
    began = time.monotonic()

    def surfaces() -> None:
        stamp = node.get_clock().now().to_msg()
        moved = -normal * shape * 5e-3 * (1 - np.cos(2 * (time.monotonic() - began)))
        columns = np.column_stack(
            [rest + moved, moved, np.linalg.norm(moved, axis=1), np.full(len(moved), 1e-5)]
        )
        for name in ('surface', 'linear', 'nonlinear'):
            clouds[f'deformation/{name}'].publish(cloud(columns, SURFACE_FIELDS, stamp))

    def contacts() -> None:
        names = ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius')
        one = [RADIUS, 0, 0, -1, 0, 0, -5, 0, 0, 0.2, 0.001]
        stamp = node.get_clock().now().to_msg()
        clouds['hand/contacts'].publish(cloud(np.array([one]), names, stamp))

    node.create_timer(0.01, surfaces)
    node.create_timer(0.004, contacts)
    with contextlib.suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        rclpy.spin(node)


@contextlib.contextmanager
def process(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of the benchmark's domain, ended by SIGINT."""
    started = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield started
    finally:
        end_process(started, 10.0)


def free_port() -> int:
    """A TCP port nobody uses."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return int(free.getsockname()[1])


def answered(port: int) -> float:
    """Seconds until the page answers over HTTP."""
    began = time.monotonic()
    while time.monotonic() - began < 60:
        with (
            contextlib.suppress(urllib.error.URLError, ConnectionError),
            urllib.request.urlopen(f'http://127.0.0.1:{port}', timeout=5),
        ):
            return time.monotonic() - began
        time.sleep(0.01)
    raise RuntimeError('the page did not answer within 60 s')


def cpu_seconds(pid: int) -> float:
    """Processor time of a process with all its threads."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def drain(port: int, stop: threading.Event, read: list[bytes]) -> None:
    """Read everything the page sends, as a browser would."""
    protocol = f'viser-v{viser.__version__}'
    own = f'http://127.0.0.1:{port}'
    with connect(
        f'ws://127.0.0.1:{port}', subprotocols=[protocol], origin=own, max_size=None
    ) as page:
        page.send(msgspec.msgpack.encode(CAMERA))
        while not stop.is_set():
            with contextlib.suppress(TimeoutError):
                read.append(page.recv(timeout=0.5, decode=False))


def surfaces_in(window: bytes) -> int:
    """How many deformed surfaces came with one websocket message of viser.

    It begins with two lengths of 8 bytes, then a list of scene messages (msgpack in zstd); the
    vertices follow as they are.
    """
    length = int.from_bytes(window[8:16], 'little')
    told = msgspec.msgpack.decode(zstandard.decompress(window[16 : 16 + length]))
    return sum(
        one['type'] == 'SceneNodeUpdateMessage'
        and one['name'].startswith('/surface')
        and 'glb_data' in one['updates']
        for one in told['messages']
    )


def page_rows() -> Iterator[Row]:
    """Start, rate and load of the live page."""
    port = free_port()
    rclpy.init()
    node = rclpy.create_node('counter')
    counted: list[int] = []

    def diagnostics(message: DiagnosticArray) -> None:
        for status in message.status:
            for pair in status.values:
                if pair.key == 'surfaces drawn in the last second':
                    counted.append(int(pair.value))

    node.create_subscription(DiagnosticArray, '/diagnostics', diagnostics, 10)
    with (
        process(sys.executable, __file__, '--publish'),
        process(str(BINARIES / 'grasp_view'), '--ros-args', '-p', f'port:={port}') as page,
    ):
        start = answered(port)
        yield Row('page answers over HTTP after start', f'{start:.2f} s', '<= 3 s', start <= 3.0)
        stop, read = threading.Event(), list[bytes]()
        browser = threading.Thread(target=drain, args=(port, stop, read))
        browser.start()
        deadline = time.monotonic() + 5
        while time.monotonic() < deadline:
            rclpy.spin_once(node, timeout_sec=0.1)
        counted.clear()
        read.clear()
        used, began = cpu_seconds(page.pid), time.monotonic()
        while time.monotonic() - began < WATCHED_S:
            rclpy.spin_once(node, timeout_sec=0.1)
        seconds = time.monotonic() - began
        load = (cpu_seconds(page.pid) - used) / seconds
        received = list(read)
        stop.set()
        browser.join(5)
    node.destroy_node()
    rclpy.shutdown()
    drawn = float(np.median(counted)) if counted else 0.0
    delivered = sum(map(surfaces_in, received)) / seconds
    sent = sum(map(len, received)) / seconds
    what = 'surfaces drawn at 2 562 vertices, one browser (median)'
    yield Row(what, f'{drawn:.0f} /s', '>= 15 /s', drawn >= 15)
    what = 'of them read from the websocket by the browser'
    yield Row(what, f'{delivered:.1f} /s', '>= 15 /s', delivered >= 15)
    what = 'processor of the page meanwhile'
    yield Row(what, f'{100 * load:.0f} % of a core', '<= 30 %', load <= 0.3)
    yield Row('sent to the browser', f'{sent / 1e6:.2f} MB/s')


def what_if_rows() -> Iterator[Row]:
    """Answers of the placed fingers' own solver."""
    rclpy.init()
    node = rclpy.create_node('counter')
    counts = {'surface': 0, 'nonlinear': 0}

    def count(name: str) -> None:
        def add(_: PointCloud2) -> None:
            counts[name] += 1

        node.create_subscription(PointCloud2, f'/what_if/deformation/{name}', add, 100)

    for name in counts:
        count(name)
    with process(
        str(BINARIES / 'grasp_view'),
        '--ros-args', '-p', f'port:={free_port()}', '-p', 'what_if:=true',
    ):  # fmt: skip
        began = time.monotonic()
        while not counts['nonlinear'] and time.monotonic() - began < 120:
            rclpy.spin_once(node, timeout_sec=0.1)
        counts.update(surface=0, nonlinear=0)
        began = time.monotonic()
        while time.monotonic() - began < 10:
            rclpy.spin_once(node, timeout_sec=0.1)
        seconds = time.monotonic() - began
    node.destroy_node()
    rclpy.shutdown()
    for name, what in (('surface', 'surfaces served'), ('nonlinear', 'nonlinear answers')):
        rate = counts[name] / seconds
        yield Row(f'what-if: {what} for the ball', f'{rate:.0f} /s', '>= 10 /s', rate >= 10)


def report_rows(count: int = 5) -> Iterator[Row]:
    """Time and size of a report of five rows of 10 242 vertices and 60 000 scan points."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.0325)
    rest = np.asarray(ball.vertices)
    generator = np.random.default_rng(0)
    scan = generator.normal(size=(60_000, 3))
    scan *= 0.0325 / np.linalg.norm(scan, axis=1)[:, None]
    noise = generator.normal(scale=0.127e-3, size=len(scan))
    scenes = [
        RowScene(
            key=f'row_{k}',
            title=f'row {k}',
            kind='synthetic',
            force_n=1.0 + k,
            triangles=ball.faces,
            rest=rest,
            nonlinear=rest * (1 - 0.01 * k),
            linear=rest * (1 - 0.02 * k),
            scan_points=scan,
            nonlinear_error=noise,
            linear_error=noise * 3,
            contact_points=np.array([[0.0325, 0, 0]]),
            contact_forces=np.array([[-1.0, 0, 0]]),
        )
        for k in range(count)
    ]
    rows = [{'force_n': scene.force_n, 'theories': {}} for scene in scenes]
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        path = write_report({'rows': rows}, scenes, Path(folder), {})
        seconds = time.process_time() - began
        size = path.stat().st_size / 1e6
    what = f'report of {count} rows, processor time'
    yield Row(what, f'{seconds:.1f} s', '<= 20 s', seconds <= 20)
    yield Row('its size', f'{size:.1f} MB', '<= 5 MB', size <= 5)


PARTS = {'report': report_rows, 'page': page_rows, 'what_if': what_if_rows}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns 1 when a figure is short of its goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--publish', action='store_true', help='only publish (used by itself)')
    parser.add_argument('--parts', nargs='+', choices=PARTS, default=list(PARTS))
    options = parser.parse_args(arguments)
    os.environ['ROS_DOMAIN_ID'] = DOMAIN
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    if options.publish:
        publish()
        return 0
    return int(show(row for part in options.parts for row in PARTS[part]()) > 0)


if __name__ == '__main__':
    sys.exit(main())
