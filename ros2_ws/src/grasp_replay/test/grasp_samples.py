# SPDX-License-Identifier: Apache-2.0
"""A small recorded grasp for tests: a ball, a few loads, scans of our own koiter solution."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from grasp_replay.bag_writer import BagWriter
from grasp_replay.ros_types import standard_types
from grasp_replay.theories import TheorySet, theory_set

YOUNG_PA = 11e6
FORCES_N = (10.0, 16.0)
POLES = np.array([[0.0, 0.0, 0.0325], [0.0, 0.0, -0.0325]])
START_NS = 1_600_000_000_000_000_000
PERIOD_NS = 20_000_000
SAMPLES_PER_HOLD = 30
CONTACT_FIELDS = (
    *('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz'),
    *('sigma_n', 'radius', 'sigma_t', 'travel', 'sigma_travel'),
)


@cache
def small_ball() -> TheorySet:
    """The tennis ball on a coarse mesh with the true modulus of the samples."""
    return theory_set(
        'tennis_ball', POLES, 1e-3, {'control_vertices': 200, 'young_modulus_pa': YOUNG_PA}
    )


def header(stamp: int, frame: str = 'hand_base') -> Any:
    """A std_msgs/Header."""
    types = standard_types().types
    time = types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9)
    return types['std_msgs/msg/Header'](time, frame)


def cloud(stamp: int, columns: dict[str, np.ndarray]) -> bytes:
    """A PointCloud2 of float32 columns, integers as uint8."""
    types = standard_types().types
    dtype = np.dtype(
        [(name, '<f4' if v.dtype.kind == 'f' else 'u1') for name, v in columns.items()]
    )
    points = np.zeros(len(next(iter(columns.values()))), dtype)
    for name, values in columns.items():
        points[name] = values
    fields = [
        types['sensor_msgs/msg/PointField'](
            name, dtype.fields[name][1], 7 if dtype[name].kind == 'f' else 2, 1
        )
        for name in dtype.names
    ]
    message = types['sensor_msgs/msg/PointCloud2'](
        header(stamp), 1, len(points), fields, False, dtype.itemsize,
        dtype.itemsize * len(points), points.view(np.uint8).ravel(), True,
    )  # fmt: skip
    return bytes(standard_types().serialize_cdr(message, 'sensor_msgs/msg/PointCloud2'))


def contacts(
    stamp: int, point: np.ndarray, inward: np.ndarray, force: float, travel: float
) -> bytes:
    """hand/contacts of two fingers."""
    count = len(point)
    columns: dict[str, np.ndarray] = {}
    for names, values in (('xyz', point), (('nx', 'ny', 'nz'), inward)):
        columns.update({name: values[:, i] for i, name in enumerate(names)})
    columns.update({f'f{axis}': force * inward[:, i] for i, axis in enumerate('xyz')})
    for name, value in zip(CONTACT_FIELDS[9:], (0.05, 1e-3, np.inf, travel, 1e-5), strict=True):
        columns[name] = np.full(count, value)
    columns['finger'] = np.arange(1, count + 1)
    columns['flags'] = np.full(count, 1 if force > 0 else 0)
    return cloud(stamp, columns)


def scan_points(
    positions: np.ndarray, seed: int, count: int = 4000, noise: float = 1e-4
) -> np.ndarray:
    """Points spread over the outer face of the ball at control positions, with noise."""
    surface = small_ball().deformed(positions)
    generator = np.random.default_rng(seed)
    chosen = generator.choice(len(surface.samples.position), count, replace=False)
    offset = noise * generator.standard_normal(count)
    return surface.samples.position[chosen] + offset[:, None] * surface.samples.normal[chosen]


def write_grasp(
    directory: Path, forces: tuple[float, ...] = FORCES_N, scan_unit: float = 1.0
) -> Path:
    """An undeformed scan, then every load held for 0.6 s and scanned.

    `scan_unit` other than 1 makes scans whose numbers are no metres.
    """
    ball = small_ball()
    patches = tuple(ball.model.contact(pole, 1e-3) for pole in POLES)
    scans, holds = [], []
    with BagWriter(directory) as writer:
        touching = writer.add_topic('/hand/contacts', 'sensor_msgs/msg/PointCloud2')
        scanning = writer.add_topic('/scan/points', 'sensor_msgs/msg/PointCloud2')
        state, now = None, START_NS
        for number, force in enumerate((0.0, *forces)):
            positions, depth = ball.model.rest, 0.0
            if force > 0.0:
                solved = ball.solve('koiter', patches, np.full(2, force), state)
                state, positions = solved.state, solved.state.positions
                depth = float(state.displacement.mean())
            inward = -POLES / 0.0325
            begin = now
            for _ in range(SAMPLES_PER_HOLD):
                data = contacts(now, POLES + depth * inward, inward, force, depth)
                writer.write(touching, data, now)
                now += PERIOD_NS
            points = scan_unit * scan_points(positions, number)
            data = cloud(now, {axis: points[:, i] for i, axis in enumerate('xyz')})
            writer.write(scanning, data, now)
            entry: dict[str, Any] = {
                'kind': 'held' if force > 0.0 else 'undeformed',
                'scan_stamp_ns': now,
            }
            if force > 0.0:
                entry['hold'] = {
                    'from_s': (begin - START_NS) * 1e-9, 'to_s': (now - START_NS) * 1e-9
                }  # fmt: skip
                holds.append(entry['hold'])
            scans.append(entry)
            now += PERIOD_NS
    (directory / 'experiment.yaml').write_text(
        yaml.safe_dump(
            {
                'name': directory.name,
                'label': 'SYNTHETIC: made by the tests',
                'synthetic': True,
                'object': 'tennis_ball',
                'scanner': {'noise_sigma_m': 1e-4},
                'start_ns': START_NS,
                'scans': scans,
            }
        )
    )
    return directory
