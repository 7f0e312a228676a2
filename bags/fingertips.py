# SPDX-License-Identifier: Apache-2.0
"""Recordings of fingertips: a ball squeezed, held and twisted to slip; a bottle squeezed and held.

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

from bags import solid_bottle, solid_fingertips
from bags.calculix import Array
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


@dataclass(frozen=True)
class Grip:
    """How one finger stands: where it touches (3,) [m], its way in (3,), itself to its tip (3,).

    `turns`: by how much of the programme's turn it turns about its way in.
    """

    place: Array
    inward: Array
    along: Array
    turns: float = 0.0

    def along_at(self, turn: float) -> Array:
        """The direction of the finger to its tip after a turn of the programme [rad]."""
        angle = self.turns * turn
        return np.asarray(
            np.cos(angle) * self.along + np.sin(angle) * np.cross(self.inward, self.along)
        )


def squeeze_and_twist(depth: float, turn: float) -> Programme:
    """In 3 s to `depth`, held for 1 s, in 4 s turned to `turn`, held for 1 s."""
    time = np.arange(0.0, 9.0, 1.0 / RATE)
    return Programme(
        time,
        depth * np.clip(time / 3.0, 0.0, 1.0),
        turn * np.clip((time - 4.0) / 4.0, 0.0, 1.0),
    )


def squeeze_and_hold(depth: float) -> Programme:
    """In 3 s to `depth`, held for 3 s."""
    time = np.arange(0.0, 6.0, 1.0 / RATE)
    return Programme(time, depth * np.clip(time / 3.0, 0.0, 1.0), np.zeros_like(time))


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


def felt(
    states: list[dict[str, Any]], grips: list[Grip], programme: Programme
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Contacts and touch cells of every sample: what the solid feels, with noise."""
    push = between(states, 'force_n', programme) @ grips[0].inward
    cells = between(states, 'cells_n', programme)
    random = np.random.default_rng(20261130)
    frames: list[tuple[np.ndarray, np.ndarray]] = []
    for k in range(len(programme.time)):
        contacts = np.zeros(len(grips), CONTACT)
        for finger, grip in enumerate(grips):
            row = contacts[finger]
            row['x'], row['y'], row['z'] = grip.place + programme.depth[k] * grip.inward
            row['nx'], row['ny'], row['nz'] = grip.inward
            force = (push[k] + FORCE_SIGMA * random.normal()) * grip.inward
            row['fx'], row['fy'], row['fz'] = force
            row['ax'], row['ay'], row['az'] = grip.along_at(programme.turn[k])
            row['finger'], row['flags'], row['radius'] = finger + 1, 1, 0.00755
            row['sigma_n'], row['sigma_t'] = FORCE_SIGMA, np.inf
            row['travel'], row['sigma_travel'] = programme.depth[k], 2e-5
        cell = np.zeros(len(grips) * cells.shape[1], CELL)
        cell['finger'] = np.repeat(np.arange(1, len(grips) + 1), cells.shape[1])
        cell['cell'] = np.tile(np.arange(cells.shape[1]), len(grips))
        cell['force'] = np.tile(cells[k], len(grips)) + CELL_SIGMA * random.normal(size=len(cell))
        frames.append((contacts, cell))
    return frames


def described(name: str, kept: dict[str, Any], grips: list[Grip]) -> dict[str, Any]:
    """What every object of these recordings says of itself but its surface."""
    return {
        'name': name,
        'surface': {},
        'thickness_m': kept['thickness_m'],
        'young_modulus_pa': kept['young_modulus_pa'],
        'poisson_ratio': kept['poisson_ratio'],
        'contacts': [
            {
                'at_m': grip.place.round(9).tolist(),
                'kind': 'fingertip',
                'body': BODY,
                'along': grip.along.round(9).tolist(),
                'friction': kept['friction'],
            }
            for grip in grips
        ],
        'control_vertices': 650,
    }


def ball_fingertips() -> None:
    """Two fingers face to face; each turns about the line between them, one each way."""
    kept = json.loads(solid_fingertips.KEPT.with_suffix('.json').read_text())
    states, radius = kept['states'], kept['outer_radius_m']
    programme = squeeze_and_twist(states[-1]['depth_m'], states[-1]['turn_rad'])
    grips = [
        Grip(
            np.array([side * radius, 0.0, 0.0]),
            np.array([-side, 0.0, 0.0]),
            np.array([0.0, 0.0, 1.0]),
            -1.0,
        )
        for side in (1.0, -1.0)
    ]
    ball = {
        **described('ball_between_fingertips', kept, grips),
        'surface': {'sphere': {'outer_diameter_m': 2.0 * radius}},
        'source': 'the ball of bags/solid_fingertips.py, open to the air',
    }
    title = 'A ball squeezed, held and twisted to slip by two fingertips'
    _write('ball_fingertips', title, ball, programme, felt(states, grips, programme), kept)


def bottle_fingertips() -> None:
    """Three fingers that point down, 120 degrees apart, on the flats of a free-form bottle."""
    kept = json.loads(solid_bottle.KEPT.with_suffix('.json').read_text())
    inward = -np.array(kept['normal'])
    down = np.cross(inward, [0.0, 1.0, 0.0])
    down *= -np.sign(down[2])
    grips = []
    for third in range(3):
        c, s = np.cos(third * 2.0 * np.pi / 3.0), np.sin(third * 2.0 * np.pi / 3.0)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        grips.append(Grip(turn @ kept['touch_m'], turn @ inward, turn @ down))
    bottle = {
        **described('free_form_bottle', kept, grips),
        'surface': {'mesh': {'file': 'bottle.obj', 'unit': 'mm', 'face': 'outer'}},
        'supports': [{'kind': 'clamped', 'where': 'z=0'}],
        'control_vertices': 1200,
        'source': 'the bottle of bags/solid_bottle.py, its outer face in triangles',
    }
    states = kept['states']
    programme = squeeze_and_hold(states[-1]['depth_m'])
    title = 'A free-form squeeze bottle squeezed and held by three fingertips'
    frames = felt(states, grips, programme)
    folder = _write('bottle_fingertips', title, bottle, programme, frames, kept)
    (folder / 'bottle.obj').write_text(_triangles(solid_bottle.Bottle()))


def _triangles(bottle: solid_bottle.Bottle, around: int = 96, up: int = 61) -> str:
    """The outer face of the bottle as an OBJ file [mm]."""
    angle, height = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around, endpoint=False),
        np.linspace(0.0, bottle.outline_z[-1], up),
        indexing='ij',
    )
    points = bottle.outer(angle, height)[0].reshape(-1, 3)
    lines = [f'v {x:.4f} {y:.4f} {z:.4f}' for x, y, z in points + 0.0]
    for i in range(around):
        for j in range(up - 1):
            here, beside = 1 + up * i + j, 1 + up * ((i + 1) % around) + j
            lines += [f'f {here} {beside} {beside + 1}', f'f {here} {beside + 1} {here + 1}']
    return '\n'.join(lines) + '\n'


def _write(
    name: str,
    title: str,
    shell: dict[str, Any],
    programme: Programme,
    frames: list[tuple[np.ndarray, np.ndarray]],
    kept: dict[str, Any],
) -> Path:
    """The folder of a recording, with its object, its truth and what a reader should know."""
    friction = kept['friction']
    truth = {
        'source': kept['source'],
        'surface': f'bags/solid/{name}.npz: the outer face at each of the states',
        'states': kept['states'],
    }
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
    (folder / 'object.yaml').write_text(yaml.safe_dump(shell, sort_keys=False))
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
    return folder


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
    bottle_fingertips()
