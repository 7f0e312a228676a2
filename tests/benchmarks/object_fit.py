# SPDX-License-Identifier: Apache-2.0
"""Scan to control mesh, and the limit surface behind it. `python tests/benchmarks/object_fit.py`.

A free-form closed shell is scanned with 0.127 mm noise and 500 000 points; the fitted limit
surface, moved out by half the wall, is compared with the noiseless shape. Processor times are of
all threads; on an idle machine the wall-clock time is shorter.
"""

from __future__ import annotations

import os

for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(variable, '1')

import argparse  # noqa: E402
import json  # noqa: E402
import signal  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import TypeVar  # noqa: E402

import numpy as np  # noqa: E402
import trimesh  # noqa: E402
from figures import HEADING, show  # noqa: E402
from scipy.spatial import ConvexHull  # noqa: E402

TESTS = Path(__file__).parents[2] / 'ros2_ws/src/shell_deform/test'
sys.path.insert(0, str(TESTS))

from scan_shapes import potato_distance, potato_radius  # noqa: E402

from shell_deform.objects import load_object, object_fit_report, object_mesh  # noqa: E402
from shell_deform.objects.prepare import prepare  # noqa: E402
from shell_deform.surface import LimitSurface, control_mesh, quadrature_basis  # noqa: E402

Row = tuple[str, str, str]
Result = TypeVar('Result')
NOISE_M = 1.27e-4
WALL_M = 0.0025


def timed(work: Callable[[], Result]) -> tuple[Result, float, float]:
    """Result, wall-clock and processor seconds of one call."""
    wall, processor = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - processor


def scan(points: int) -> tuple[np.ndarray, np.ndarray]:
    """About `points` scan points on evenly spread directions, with their triangles."""
    number = np.arange(points) + 0.5
    polar = np.arccos(1 - 2 * number / points)
    turn = np.pi * (1 + np.sqrt(5)) * number
    direction = np.column_stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)]
    )
    faces = ConvexHull(direction).simplices.astype(np.int64)
    corners = direction[faces]
    inward = np.einsum('ti,ti->t', corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0
    faces[inward] = faces[inward][:, ::-1]
    exact = direction * potato_radius(direction)[:, None]
    normals = trimesh.Trimesh(exact, faces, process=False).vertex_normals
    noise = np.random.default_rng(0).normal(size=(points, 1)) * NOISE_M
    return exact + noise * normals, faces


def scan_rows(points: int) -> Iterator[Row]:
    """Time and truth of fitting a large scan."""
    vertices, faces = scan(points)
    for count in (640, 2560):
        found, wall, processor = timed(
            lambda count=count: prepare(vertices, faces, WALL_M, control_vertices=count)
        )
        mesh = found.fit.mesh
        basis = quadrature_basis(mesh, 6)
        there = LimitSurface(mesh).evaluate(
            mesh.vertices, basis.triangle[basis.element], basis.parameters
        )
        error = potato_distance(there.position + 0.5 * WALL_M * there.normal)
        what = f'scan of {points} points, {mesh.vertex_count} control vertices'
        yield (
            f'{what}: RMS from the truth',
            f'{1e3 * np.sqrt(np.mean(error**2)):.4f} mm',
            '0.05 mm',
        )
        yield f'{what}: greatest distance', f'{1e3 * np.abs(error).max():.4f} mm', ''
        yield f'{what}: time', f'{wall:.1f} s, {processor:.1f} s of processors', '20 s'


def primitive_rows() -> Iterator[Row]:
    """The shipped objects' control meshes."""
    for name in ('tennis_ball', 'tennis_ball_as_printed', 'half_soda_can'):
        shell = load_object(name)
        mesh, wall, _ = timed(lambda shell=shell: object_mesh(shell))
        report = object_fit_report(shell, mesh)
        thickness = shell.thickness_m
        value = f'{report.maximum_error_m / thickness:.1e} h'
        yield f'{name}, {report.vertices} vertices: greatest error', value, '1e-3 h (sphere)'
        yield f'{name}: time', f'{wall:.2f} s', ''


def surface_rows() -> Iterator[Row]:
    """Basis and closest points of limit surfaces."""
    ball = trimesh.creation.icosphere(4, radius=0.03125)
    mesh = control_mesh(ball.vertices, ball.faces)
    _, wall, _ = timed(lambda: quadrature_basis(mesh, 3))
    yield '5120 triangles, 3 points: basis', f'{1e3 * wall:.0f} ms', '1 s'
    random = np.random.default_rng(0)
    for level in (3, 4):
        ball = trimesh.creation.icosphere(level, radius=0.03125)
        surface = LimitSurface(control_mesh(ball.vertices, ball.faces))
        control = surface.control_points(ball.vertices)
        queries = random.normal(size=(500_000, 3))
        queries *= 0.0325 / np.linalg.norm(queries, axis=1, keepdims=True)
        queries += NOISE_M * random.normal(size=queries.shape)
        surface.closest_point(control, queries[:2000], WALL_M / 2)
        for threads in (1, 2):
            _, wall, processor = timed(
                lambda threads=threads, surface=surface, control=control, queries=queries: (
                    surface.closest_point(control, queries, WALL_M / 2, threads=threads)
                )
            )
            what = f'500 000 closest points, {len(ball.vertices)} vertices, {threads} threads'
            value = f'{wall:.2f} s, {processor:.2f} s of processors'
            yield what, value, '1 to 2 s on two cores'


def first_surface_rows(points: int) -> Iterator[Row]:
    """From the scan file to the first live surface, as a user does it: three commands."""
    import live_hand
    from tests.running import own_domain

    programs = Path(sys.executable).parent
    height = float(potato_radius(np.array([[0.0, 0.0, 1.0]]))[0])
    vertices, faces = scan(points)
    with tempfile.TemporaryDirectory() as folder, own_domain():
        file = Path(folder) / 'scan.ply'
        trimesh.Trimesh(1e3 * vertices, faces, process=False).export(file)
        start = time.perf_counter()
        subprocess.run(
            [programs / 'object_prepare', file, '--unit', 'mm', '--thickness', '0.001',
             '--young', '2e6', '--poisson', '0.45',
             '--contact', f'0,0,{height},0.002', '--out', folder],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        prepared = time.perf_counter()
        node = subprocess.Popen(
            [programs / 'deformation', '--ros-args', '-p', f'object:={folder}/scan.yaml'],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        observer = live_hand.Observer()
        try:
            # the third command: any source of contacts
            observer.stream(
                lambda i: live_hand.sample(
                    [[0.0, 0.0, height]], [[0.0, 0.0, -1.0]], [0.3], [1e-4],
                    stamp=(i + 1) * 10_000_000, radius=2e-3,
                ),
                lambda: bool(observer.surfaces) and bool(observer.nonlinear),
                timeout=300.0,
            )  # fmt: skip
            done = time.perf_counter()
        finally:
            observer.close()
            node.send_signal(signal.SIGINT)
            node.wait(30.0)
    what = f'scan file of {points} points: '
    yield what + 'object_prepare', f'{prepared - start:.1f} s', ''
    yield what + 'first nonlinear surface after that', f'{done - prepared:.1f} s', ''
    yield what + 'three commands', f'{done - start:.1f} s', '120 s'


def rows(points: int) -> Iterator[Row]:
    """All figures."""
    yield from surface_rows()
    yield from primitive_rows()
    yield from scan_rows(points)
    yield from first_surface_rows(points)


def main() -> None:
    """Print (what, value, goal), one row per figure as it is measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--points', type=int, default=500_000, help='points of the scan')
    parser.add_argument('--json', action='store_true', help='print one JSON document')
    options = parser.parse_args()
    found = rows(options.points)
    if options.json:
        print(json.dumps([dict(zip(HEADING, row, strict=True)) for row in found], indent=2))
    else:
        show(found)


if __name__ == '__main__':
    main()
