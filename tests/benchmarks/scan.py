# SPDX-License-Identifier: Apache-2.0
"""Figures of the scan comparison: speed, pose errors, recovered errors, damaged files.

`python tests/benchmarks/scan.py`, or some parts of it: `scan.py speed peers`; `--long` makes a
million mutations instead of ten thousand.
Peers (small_gicp, libigl, Open3D) are timed beside it where the interpreter named by PEER_PYTHON
(or this one) has them; see requirements/bench.txt.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from figures import show

sys.path.insert(0, str(Path(__file__).parents[2] / 'ros2_ws/src/scan_compare/test'))

from scan_mutations import read_or_refuse, run_fast, seeds  # noqa: E402
from scan_shells import ball, occlude, odd_body, scan_points, two_dents  # noqa: E402

from scan_compare.comparison import Setup, compare  # noqa: E402
from scan_compare.registration import Registration, register  # noqa: E402
from scan_compare.rigid import (  # noqa: E402
    Pose,
    rotation_from_quaternion,
    rotation_from_vector,
)
from scan_compare.scan import Scan  # noqa: E402

Row = tuple[str, str, str]
PEERS = Path(__file__).parent / 'peers' / 'scan_tools.py'
GRASP = two_dents(0.006, bulge=0.0003)
START = Pose(
    rotation_from_vector(np.deg2rad(5.0) * np.array([0.6, 0.8, 0.0])),
    np.array([3e-3, -3e-3, 2e-3]),
)


def grasped_scan(count: int, seed: int = 1) -> Scan:
    """`count` points of the grasped ball, 40 % occluded, 5 degrees and 5 mm off."""
    points = occlude(scan_points(ball(GRASP), round(count / 0.6), seed=seed), 0.4, np.eye(3)[0])
    return Scan(START.inverse().apply(points), None, 'm', False, 'planted')


def speed() -> Iterator[Row]:
    """Registration, distances and statistics of half a million and a million points."""
    model = ball(two_dents(0.007, bulge=0.0003))
    compare(grasped_scan(5_000), model)
    for count, goal in ((500_000, '<= 3 s'), (1_000_000, '<= 5 s')):
        scan = grasped_scan(count)
        began, processor = time.perf_counter(), time.process_time()
        compare(scan, model)
        seconds, used = time.perf_counter() - began, time.process_time() - processor
        yield (
            f'{count} points: register, distances, statistics',
            f'{seconds:.2f} s ({used:.2f} s processor)',
            goal,
        )


def poses() -> Iterator[Row]:
    """Worst pose errors over planted offsets at 0.127 mm noise, 40 % occluded."""
    turns, shifts = [], []
    body = odd_body(two_dents(0.004))
    for seed in range(10):
        generator = np.random.default_rng(200 + seed)
        truth = Pose(
            rotation_from_quaternion(generator.standard_normal(4)),
            0.1 * generator.standard_normal(3),
        )
        points = occlude(scan_points(body, 100_000, seed=seed), 0.4, generator.standard_normal(3))
        found = register(truth.inverse().apply(points), body, start=None)
        turn, shift = _pose_error(found, truth, found.centre)
        turns.append(np.linalg.norm(turn))
        shifts.append(np.linalg.norm(shift))
    yield 'body without symmetry, any rotation, 10 seeds', _worst(turns, shifts), _POSE_GOAL
    turns, shifts = [], []
    for seed in range(10):
        generator = np.random.default_rng(300 + seed)
        axis, move = generator.standard_normal((2, 3))
        truth = Pose(
            rotation_from_vector(np.deg2rad(5.0) * axis / np.linalg.norm(axis)),
            5e-3 * move / np.linalg.norm(move),
        )
        surface = ball(GRASP)
        points = occlude(
            scan_points(surface, 100_000, seed=seed), 0.4, generator.standard_normal(3)
        )
        found = register(truth.inverse().apply(points), surface)
        turn, shift = _pose_error(found, truth, np.zeros(3))
        turns.append(np.linalg.norm(turn[:2]))
        shifts.append(np.linalg.norm(shift))
    yield 'ball with dents, 5 degrees and 5 mm, 10 seeds', _worst(turns, shifts), _POSE_GOAL


_POSE_GOAL = '<= 0.05 deg, 0.05 mm'


def _worst(turns: list[float], shifts: list[float]) -> str:
    return f'{np.rad2deg(max(turns)):.3f} deg, {1e3 * max(shifts):.3f} mm'


def _pose_error(
    found: Registration, truth: Pose, about: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    left = found.pose.after(truth.inverse())
    skew = 0.5 * (left.rotation - left.rotation.T)
    turn = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    return turn, left.apply(about[None])[0] - about


def errors() -> Iterator[Row]:
    """Planted errors recovered from one noisy, occluded scan, and the null test."""
    scan = grasped_scan(100_000)
    null = compare(scan, ball(GRASP))
    ratio = null.vertex.mean_m / null.noise_floor_m - 1.0
    yield 'null test: mean against the noise floor', f'{100 * ratio:+.1f} %', 'within 10 %'
    yield 'null test: verdict', 'given' if null.beyond_noise else 'none', 'none'
    perfect = Scan(
        occlude(scan_points(ball(GRASP), 166_667, 0.0), 0.4, np.eye(3)[0]), None, 'm', False, 'p'
    )
    true_pose = compare(perfect, ball(GRASP)).registration
    for name, field in (
        ('dent 0.8 mm deeper', two_dents(0.0068, bulge=0.0003)),
        ('dent 1 mm shallower', two_dents(0.005, bulge=0.0003)),
        ('dent 2 mm wider', two_dents(0.006, 0.010, bulge=0.0003)),
    ):
        found = compare(scan, ball(field))
        planted = compare(perfect, ball(field), setup=Setup(registration=true_pose))
        assert found.max_error_m is not None and planted.max_error_m is not None
        assert found.dent is not None and planted.dent is not None
        gaps = (
            found.mean_error_noise_free_m - planted.vertex.mean_m,
            found.max_error_m - planted.max_error_m,
            found.dent.signed_mean_m - planted.dent.signed_mean_m,
        )
        value = ', '.join(f'{1e3 * gap:+.3f}' for gap in gaps) + ' mm'
        yield f'{name}: mean, max, dent error off by', value, 'within 0.05 mm'


def damage(count: int) -> Iterator[Row]:
    """Cut and mutated scan files: only typed errors, bounded memory (asserted inside)."""
    cuts = [(suffix, data[:end]) for suffix, data in seeds().values() for end in range(len(data))]
    readable = sum(read_or_refuse(data, suffix) for suffix, data in cuts)
    yield (
        f'{len(cuts)} cuts, small files of {len(seeds())} kinds at every byte',
        f'0 untyped errors, {readable} still read',
        'typed error only',
    )
    began = time.perf_counter()
    cores = os.cpu_count() or 1
    shares = [count * (k + 1) // cores - count * k // cores for k in range(cores)]
    with ProcessPoolExecutor(cores) as pool:
        done = list(pool.map(run_fast, shares, range(11, 11 + cores)))
    read, largest = sum(part[0] for part in done), max(part[1] for part in done)
    seconds = time.perf_counter() - began
    yield (
        f'{count} mutated scan files',
        f'0 untyped errors, {read} still read, peak +{largest / 2**20:.1f} MB, {seconds:.0f} s',
        'typed error only',
    )


def peers() -> Iterator[Row]:
    """The same half million points through other tools, in the interpreter PEER_PYTHON."""
    model = ball(GRASP)
    outer = model.limit.limit_positions(model.deformed) + model.offset * (
        model.limit.vertex_normals(model.deformed)
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'scan.npz'
        np.savez(
            path,
            points=grasped_scan(500_000).points,
            rotation=START.rotation,
            translation=START.translation,
            samples=model.samples.position,
            outer=outer,
            triangles=np.asarray(model.mesh.triangles),
        )
        answer = subprocess.run(
            [os.environ.get('PEER_PYTHON', sys.executable), PEERS, path],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    lines = [line for line in answer.stdout.splitlines() if line.startswith('[[')]
    if not lines:
        yield 'small_gicp, libigl, Open3D', f'did not run: {answer.stderr.strip()[-120:]}', ''
        return
    for what, value in json.loads(lines[-1]):
        yield what, value, ''


PARTS: dict[str, Callable[[int], Iterator[Row]]] = {
    'speed': lambda _: speed(),
    'poses': lambda _: poses(),
    'errors': lambda _: errors(),
    'peers': lambda _: peers(),
    'damage': damage,
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('parts', nargs='*', help=f'of {", ".join(PARTS)} (default: all)')
    parser.add_argument('--long', action='store_true', help='a million mutations')
    options = parser.parse_args()
    unknown = sorted(set(options.parts) - set(PARTS))
    if unknown:
        parser.error(f'no part {", ".join(unknown)}; there are {", ".join(PARTS)}')
    mutations = 1_000_000 if options.long else 10_000
    show(row for name in options.parts or PARTS for row in PARTS[name](mutations))


if __name__ == '__main__':
    main()
