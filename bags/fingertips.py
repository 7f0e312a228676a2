# SPDX-License-Identifier: Apache-2.0
"""Recordings of fingertips: a ball that is squeezed, held, and twisted until the fingers slip.

`python -m bags.fingertips` writes them from the kept solids with contact and friction. Contacts
and touch cells are synthetic: forces and cells of the solid between its states, with noise.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import PchipInterpolator

from bags.calculix import Array
from bags.solid_fingertips import KEPT
from grasp_replay.bag_writer import BagWriter

FOLDER = Path(__file__).parent
START_NS = 1_600_000_000_000_000_000
RATE = 50.0
LABEL = (
    'SYNTHETIC: fingers, gauges and touch cells are made from a solid model; nothing here was '
    'measured on a real object'
)
# Of a gauge [N], of a touch cell [N].
FORCE_SIGMA, CELL_SIGMA = 0.1, 0.02
BODY = 'barrett_fingertip'
CONTACT = np.dtype(
    [
        *((name, '<f4') for name in ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz')),
        *((name, '<f4') for name in ('sigma_n', 'radius', 'finger', 'flags', 'sigma_t')),
        *((name, '<f4') for name in ('travel', 'sigma_travel', 'ax', 'ay', 'az')),
    ]
)
CELL = np.dtype([(name, '<f4') for name in ('finger', 'cell', 'force')])


@dataclass(frozen=True)
class Programme:
    """What the fingers do over time: depths (t,) [m] and turns (t,) [rad] at seconds (t,)."""

    time: Array
    depth: Array
    turn: Array


def squeeze_and_twist(depth: float, turn: float) -> Programme:
    """In 3 s to `depth`, held for 1 s, in 4 s turned to `turn`, held for 1 s."""
    time = np.arange(0.0, 9.0, 1.0 / RATE)
    return Programme(
        time,
        depth * np.clip(time / 3.0, 0.0, 1.0),
        turn * np.clip((time - 4.0) / 4.0, 0.0, 1.0),
    )


def between(states: list[dict[str, Any]], name: str, programme: Programme) -> Array:
    """(t, ...) a quantity of kept states along a programme: first their depths, then turns."""
    squeezed = [state for state in states if state['turn_rad'] == 0.0]
    turned = [squeezed[-1], *(state for state in states if state['turn_rad'] > 0.0)]
    values = np.array([state[name] for state in squeezed])
    nothing = np.zeros_like(values[:1])
    by_depth = PchipInterpolator(
        [0.0, *(state['depth_m'] for state in squeezed)], np.concatenate([nothing, values])
    )
    result = by_depth(programme.depth)
    if len(turned) > 1:
        by_turn = PchipInterpolator(
            [state['turn_rad'] for state in turned], np.array([state[name] for state in turned])
        )
        moving = programme.turn > 0.0
        result[moving] = by_turn(programme.turn[moving])
    return np.asarray(result)


def ball_fingertips() -> None:
    """Two fingers face to face; each turns about the line between them, one each way."""
    kept = json.loads(KEPT.with_suffix('.json').read_text())
    states, radius = kept['states'], kept['outer_radius_m']
    programme = squeeze_and_twist(states[-1]['depth_m'], states[-1]['turn_rad'])
    push = -between(states, 'force_n', programme)[:, 0]
    cells = between(states, 'cells_n', programme)
    random = np.random.default_rng(20261130)
    frames: list[tuple[np.ndarray, np.ndarray]] = []
    for k in range(len(programme.time)):
        contacts = np.zeros(2, CONTACT)
        for finger, side in enumerate((1.0, -1.0)):
            row = contacts[finger]
            inward = np.array([-side, 0.0, 0.0])
            place = radius * -inward + programme.depth[k] * inward
            along = [0.0, -side * np.sin(programme.turn[k]), np.cos(programme.turn[k])]
            force = (push[k] + FORCE_SIGMA * random.normal()) * inward
            row['x'], row['y'], row['z'] = place
            row['nx'], row['ny'], row['nz'] = inward
            row['fx'], row['fy'], row['fz'] = force
            row['ax'], row['ay'], row['az'] = along
            row['finger'], row['flags'], row['radius'] = finger + 1, 1, 0.00755
            row['sigma_n'], row['sigma_t'] = FORCE_SIGMA, np.inf
            row['travel'], row['sigma_travel'] = programme.depth[k], 2e-5
        felt = np.zeros(2 * cells.shape[1], CELL)
        felt['finger'] = np.repeat([1, 2], cells.shape[1])
        felt['cell'] = np.tile(np.arange(cells.shape[1]), 2)
        felt['force'] = np.tile(cells[k], 2) + CELL_SIGMA * random.normal(size=len(felt))
        frames.append((contacts, felt))
    described = {
        'name': 'ball_between_fingertips',
        'surface': {'sphere': {'outer_diameter_m': 2.0 * radius}},
        'thickness_m': kept['thickness_m'],
        'young_modulus_pa': kept['young_modulus_pa'],
        'poisson_ratio': kept['poisson_ratio'],
        'contacts': [
            {
                'at_m': [side * radius, 0.0, 0.0],
                'kind': 'fingertip',
                'body': BODY,
                'along': [0.0, 0.0, 1.0],
                'friction': kept['friction'],
            }
            for side in (1.0, -1.0)
        ],
        'control_vertices': 650,
        'source': 'the ball of bags/solid_fingertips.py, open to the air',
    }
    truth = {
        'source': kept['source'],
        'surface': 'bags/solid/ball_fingertips.npz: the outer face at each of the states',
        'states': states,
    }
    title = 'A ball squeezed, held and twisted to slip by two fingertips'
    _write('ball_fingertips', title, described, programme, frames, kept['friction'], truth)


def _write(
    name: str,
    title: str,
    described: dict[str, Any],
    programme: Programme,
    frames: list[tuple[np.ndarray, np.ndarray]],
    friction: float,
    truth: dict[str, Any],
) -> None:
    """The recording, its object, its truth and what a reader should know."""
    folder = FOLDER / name
    if folder.exists():
        shutil.rmtree(folder)
    with BagWriter(folder) as writer:
        topics = [
            writer.add_topic(topic, 'sensor_msgs/msg/PointCloud2')
            for topic in ('/hand/contacts', '/hand/tactile')
        ]
        for seconds, clouds in zip(programme.time, frames, strict=True):
            stamp = START_NS + round(1e9 * float(seconds))
            for topic, rows in zip(topics, clouds, strict=True):
                writer.write(topic, _cloud(rows, stamp), stamp)
    (folder / 'object.yaml').write_text(yaml.safe_dump(described, sort_keys=False))
    (folder / 'truth.yaml').write_text(yaml.safe_dump(truth, sort_keys=False))
    experiment = {
        'name': name,
        'title': title,
        'label': LABEL,
        'synthetic': True,
        'object': 'object.yaml',
        'finger_body': BODY,
        'friction': friction,
        'start_ns': START_NS,
        'duration_s': round(float(programme.time[-1]), 6),
    }
    (folder / 'experiment.yaml').write_text(yaml.safe_dump(experiment, sort_keys=False))
    (folder / 'README.md').write_text(
        f'# {name}\n\n{LABEL}.\n\n{title}: `hand/contacts` and `hand/tactile`, in the frame of '
        'the object.\n\n    deformation --ros-args -p '
        f'object:=bags/{name}/object.yaml -p finger_body:={BODY} -p friction:={friction}\n\n'
        f'solves it live beside `replay bags/{name}`. `truth.yaml` holds what the recording was '
        'made from;\n`python -m bags.fingertips` makes it again.\n'
    )


def _cloud(rows: np.ndarray, stamp: int) -> bytes:
    """A PointCloud2 of float32 fields."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    time = types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9)
    field = types['sensor_msgs/msg/PointField']
    assert rows.dtype.names is not None
    message = types['sensor_msgs/msg/PointCloud2'](
        header=types['std_msgs/msg/Header'](time, 'object'),
        height=1,
        width=len(rows),
        fields=[
            field(name, 4 * number, field.FLOAT32, 1)
            for number, name in enumerate(rows.dtype.names)
        ],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * len(rows),
        data=np.frombuffer(rows.tobytes(), np.uint8),
        is_dense=False,
    )
    return bytes(store.serialize_cdr(message, 'sensor_msgs/msg/PointCloud2'))


if __name__ == '__main__':
    ball_fingertips()
