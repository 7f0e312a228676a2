# SPDX-License-Identifier: Apache-2.0
"""Recordings of fingertips: a ball squeezed, held and twisted to slip; a bottle squeezed and held.

`python -m bags.fingertips` writes them from the kept solids with contact and friction. Contacts,
touch cells and scans are synthetic: forces and cells of the solid between its states, its outer
face before and at the end of the squeeze, with noise.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import PchipInterpolator, RBFInterpolator
from scipy.spatial.transform import Rotation

from bags import solid_bottle, solid_fingertips
from bags.calculix import Array
from grasp_replay.bag_writer import BagWriter
from shell_deform.contact.bodies import Pose, frame_of
from shell_deform.contact.finger_bodies import read_finger_bodies

FOLDER = Path(__file__).parent
START_NS = 1_600_000_000_000_000_000
RATE = 50.0
LABEL = (
    'SYNTHETIC: fingers, gauges and touch cells are made from a solid model; nothing here was '
    'measured on a real object'
)
# Of a gauge [N], of a touch cell [N].
FORCE_SIGMA, CELL_SIGMA = 0.1, 0.02
SCAN_SIGMA, SCAN_POINTS = 0.127e-3, 40_000
# What lies nearer to a finger is hidden from the scanner [m]; how many nodes a place lies between.
HIDDEN, NEIGHBOURS = 3e-3, 24
BODY = 'barrett_fingertip'
CONTACT = np.dtype(
    [
        *((name, '<f4') for name in ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz')),
        *((name, '<f4') for name in ('sigma_n', 'radius', 'finger', 'flags', 'sigma_t')),
        *((name, '<f4') for name in ('travel', 'sigma_travel', 'ax', 'ay', 'az')),
    ]
)
CELL = np.dtype([(name, '<f4') for name in ('finger', 'cell', 'force')])
POINT = np.dtype([(name, '<f4') for name in 'xyz'])


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


@dataclass(frozen=True)
class Face:
    """The outer face of a whole object of which a part was solved.

    Attributes:
        places: (p, 3) on it [m], normals: (p, 3) there, seen by the scanner. images: (p, 3, 3)
            that take them into the solved part. kept: name of the nodes' file in bags/solid.
    """

    places: Array
    normals: Array
    images: Array
    kept: str

    def moved(self, state: int) -> Array:
        """(p, 3) displacements [m] at one of the kept states."""
        solid = np.load(FOLDER / f'solid/{self.kept}.npz')
        found = RBFInterpolator(solid['rest_m'], solid['moved_m'][state], NEIGHBOURS)
        part = np.einsum('pij,pj->pi', self.images, self.places)
        return np.asarray(np.einsum('pji,pj->pi', self.images, found(part)))

    def scanned(self, state: int | None, hidden: Callable[[Array], Array]) -> np.ndarray:
        """Points that a scanner sees at a state, None for the undeformed face, with noise."""
        points = self.places if state is None else self.places + self.moved(state)
        random = np.random.default_rng(0 if state is None else 1 + state)
        points = points + SCAN_SIGMA * random.normal(size=(len(points), 1)) * self.normals
        if state is not None:
            points = points[~hidden(points)]
        return np.ascontiguousarray(points, '<f4').view(POINT)[:, 0]


def by_fingers(grips: list[Grip], depth: float) -> Callable[[Array], Array]:
    """Which points (p, 3) fingers at a depth [m] hide."""
    shape = read_finger_bodies(BODY).loaded()[0].shape

    def hidden(points: Array) -> Array:
        found = np.zeros(len(points), dtype=bool)
        for grip in grips:
            pose = Pose(grip.place + depth * grip.inward, frame_of(grip.inward, grip.along))
            found |= pose.distance(shape, points).value < HIDDEN
        return found

    return hidden


def ball_face(places: Array, normals: Array) -> Face:
    """Half of it was solved, x > 0; a half turn about z takes the other half there."""
    images = np.tile(np.eye(3), (len(places), 1, 1))
    images[places[:, 0] < 0.0] = np.diag([-1.0, -1.0, 1.0])
    return Face(places, normals, images, 'ball_fingertips')


def bottle_face(places: Array, normals: Array) -> Face:
    """A sixth was solved, from the middle of a finger to half way to the next."""
    angle, third = np.arctan2(places[:, 1], places[:, 0]), 2.0 * np.pi / 3.0
    back = -third * np.round(angle / third)
    side = np.where(angle + back < 0.0, -1.0, 1.0)
    images = Rotation.from_rotvec(back[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    images[:, 1] *= side[:, None]
    return Face(places, normals, images, 'bottle_fingertips')


def ball_points(radius: float) -> tuple[Array, Array]:
    """Places (p, 3) all over a ball of this radius [m], and normals there."""
    normals = np.random.default_rng(1).normal(size=(SCAN_POINTS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def bottle_points(bottle: solid_bottle.Bottle) -> tuple[Array, Array]:
    """Places (p, 3) all over the outer face of the bottle [m], and normals there."""
    random = np.random.default_rng(1)
    angle = random.uniform(0.0, 2.0 * np.pi, SCAN_POINTS)
    height = random.uniform(0.0, bottle.outline_z[-1], SCAN_POINTS)
    places, normals = bottle.outer(angle, height)
    return 1e-3 * places, normals


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


@dataclass(frozen=True)
class Scans:
    """The undeformed face, and that of a squeeze held for the second before `at` [s]."""

    undeformed: np.ndarray
    held: np.ndarray
    at: float


def scans_of(face: Face, state: int, grips: list[Grip], depth: float, at: float) -> Scans:
    """Of a kept state, that of the full depth [m]."""
    hidden = by_fingers(grips, depth)
    return Scans(face.scanned(None, hidden), face.scanned(state, hidden), at)


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
    held = len([state for state in states if state['turn_rad'] == 0.0]) - 1
    scans = scans_of(ball_face(*ball_points(radius)), held, grips, programme.depth[-1], 4.0)
    frames = felt(states, grips, programme)
    _write('ball_fingertips', title, ball, programme, frames, scans, kept)


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
    face = bottle_face(*bottle_points(solid_bottle.Bottle()))
    scans = scans_of(face, len(states) - 1, grips, programme.depth[-1], 5.98)
    folder = _write('bottle_fingertips', title, bottle, programme, frames, scans, kept)
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
    scans: Scans,
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
    stamps = [START_NS, START_NS + round(1e9 * scans.at)]
    with BagWriter(folder) as writer:
        topics = [
            writer.add_topic(topic, 'sensor_msgs/msg/PointCloud2')
            for topic in ('/hand/contacts', '/hand/tactile', '/scan/points')
        ]
        for seconds, clouds in zip(programme.time, frames, strict=True):
            stamp = START_NS + round(1e9 * float(seconds))
            for topic, rows in zip(topics[:2], clouds, strict=True):
                writer.write(topic, _cloud(rows, stamp), stamp)
            for at, points in zip(stamps, (scans.undeformed, scans.held), strict=True):
                if at == stamp:
                    writer.write(topics[2], _cloud(points, at), at)
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
        'scanner': {'noise_sigma_m': SCAN_SIGMA},
        'scans': [
            {'scan_stamp_ns': stamps[0], 'kind': 'undeformed'},
            {
                'scan_stamp_ns': stamps[1],
                'kind': 'held',
                'hold': {'from_s': scans.at - 0.9, 'to_s': scans.at},
            },
        ],
    }
    (folder / 'experiment.yaml').write_text(yaml.safe_dump(experiment, sort_keys=False))
    (folder / 'README.md').write_text(
        f'# {name}\n\n{LABEL}.\n\n{title}: `hand/contacts`, `hand/tactile` and two scans, in the '
        'frame of the object.\n\n    deformation --ros-args -p '
        f'object:=bags/{name}/object.yaml -p finger_body:={BODY} -p friction:={friction}\n\n'
        f'solves it live beside `replay bags/{name}`, `grasp_report bags/{name} --out report` '
        'offline, beside the scans. `truth.yaml` holds what the recording was '
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
