# SPDX-License-Identifier: Apache-2.0
"""Recordings of turns: a tube that is bent, a cap that is turned until the fingers slip.

`python -m bags.turning` writes both. The arm's poses and a wrist's wrench are synthetic: the
moment of the tube is that of the kept solid (`solid_tube.py`), the torque of the cap grows as a
spring does until friction, mu times the sum of the fingers' forces times the radius, is used up.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from bags.calculix import Array
from bags.solid_tube import KEPT
from grasp_replay.bag_writer import BagWriter

FOLDER = Path(__file__).parent
START_NS = 1_600_000_000_000_000_000
RATE = 20.0
LABEL = (
    'SYNTHETIC: the poses of an arm and the wrench of its wrist; nothing here was measured on a '
    'real object'
)
# Of a small wrist sensor: force [N] and torque [N m].
FORCE_SIGMA, TORQUE_SIGMA = 0.05, 0.002


def tube_bend() -> None:
    """Half a tube whose end an arm bends by 36 degrees, its middle a plane of symmetry."""
    kept = json.loads(KEPT.read_text())
    bend = kept['bend']
    turns, moments = np.array(bend['turn_rad']), np.array(bend['moment_nm'])
    curve = CubicSpline([0.0, *turns], [0.0, *moments])
    length, wall = bend['length_m'], bend['thickness_m']
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    angle = turns[-1] * np.clip(time / 8.0, 0.0, 1.0)
    half = 0.5 * angle
    # The end goes along the arc of a beam that keeps its length; it is free to shift in fact.
    place = np.stack(
        [
            length * np.sin(half) * np.sinc(half / np.pi),
            0.0 * angle,
            length * np.sinc(angle / np.pi) - 0.5 * length,
        ],
        axis=1,
    )
    torque = np.outer(curve(angle), [0.0, 1.0, 0.0])
    described = {
        'name': 'bent_tube',
        'surface': {
            'cylinder': {
                'outer_diameter_m': 2.0 * bend['middle_radius_m'] + wall,
                'length_m': length,
                'ends': 'open',
            }
        },
        'thickness_m': wall,
        'young_modulus_pa': bend['young_modulus_pa'],
        'poisson_ratio': bend['poisson_ratio'],
        'supports': [{'kind': 'symmetry', 'where': 'lower'}],
        'contacts': [{'kind': 'grip', 'where': 'upper', 'free': ['x', 'z']}],
        'control_vertices': 800,
        'source': 'half of the tube of bags/solid_tube.py',
    }
    truth = {
        'source': kept['source'],
        'turn_rad': bend['turn_rad'],
        'moment_nm': bend['moment_nm'],
        'largest_moment_nm': max(bend['moment_nm']),
    }
    _write('tube_bend', described, time, place, np.outer(angle, [0, 1, 0]), torque, None, truth)


def cap_unscrew() -> None:
    """A bottle that three fingers hold while its neck is turned until all of them slip."""
    radius, friction, seed_force = 0.0325, 0.5, 5.0
    time = np.arange(0.0, 8.0, 1.0 / RATE)
    angle = np.radians(0.2) * np.clip((time - 0.5) / 7.0, 0.0, 1.0)
    forces = np.column_stack([seed_force + drift * time for drift in (0.004, -0.006, 0.002)])
    slip = friction * forces.sum(axis=1) * radius
    # A spring of 2.8 N m a degree: only what comes after it, the slip, is scored.
    torque = np.outer(np.minimum(2.8 * np.degrees(angle), slip), [0.0, 0.0, 1.0])
    place = np.tile([0.0, 0.0, 0.08], (len(time), 1))
    corners = np.radians([90.0, 210.0, 330.0])
    described = {
        'name': 'held_bottle',
        'surface': {
            'cylinder': {'outer_diameter_m': 2.0 * radius, 'length_m': 0.16, 'ends': 'open'}
        },
        'thickness_m': 5e-4,
        'young_modulus_pa': 2.7e9,
        'poisson_ratio': 0.38,
        'contacts': [
            *(
                {
                    'kind': 'pad',
                    'at_m': [
                        round(radius * float(np.cos(a)), 9),
                        round(radius * float(np.sin(a)), 9),
                        -0.02,
                    ],
                    'radius_m': 0.012,
                    'curvature_radius_m': 0.03,
                    'friction': friction,
                }
                for a in corners
            ),
            {'kind': 'grip', 'where': 'upper'},
        ],
        'control_vertices': 400,
        'source': 'a PET bottle of 65 mm as a tube',
    }
    at = int(np.argmax(2.8 * np.degrees(angle) >= slip))
    truth = {
        'source': 'closed form: friction times the sum of the forces times the radius',
        'slip_torque_nm': float(slip[-1]),
        'slip_from_s': float(time[at]),
    }
    _write(
        'cap_unscrew', described, time, place, np.outer(angle, [0, 0, 1]), torque, forces, truth
    )


def _write(
    name: str,
    described: dict[str, Any],
    time: Array,
    place: Array,
    turn: Array,
    torque: Array,
    fingers: Array | None,
    truth: dict[str, Any],
) -> None:
    """The recording, its object, its truth and what a reader should know."""
    folder = FOLDER / name
    if folder.exists():
        shutil.rmtree(folder)
    random = np.random.default_rng(20261129)
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    stamp_of, header_of = types['builtin_interfaces/msg/Time'], types['std_msgs/msg/Header']
    vector, point = types['geometry_msgs/msg/Vector3'], types['geometry_msgs/msg/Point']
    quaternion = types['geometry_msgs/msg/Quaternion']

    def header(stamp: int) -> Any:
        return header_of(stamp_of(stamp // 10**9, stamp % 10**9), 'object')

    def pose(stamp: int, at: Array, turned: Array) -> bytes:
        x, y, z, w = Rotation.from_rotvec(turned).as_quat()
        body = types['geometry_msgs/msg/Pose'](point(*at), quaternion(x, y, z, w))
        message = types['geometry_msgs/msg/PoseStamped'](header(stamp), body)
        return bytes(store.serialize_cdr(message, 'geometry_msgs/msg/PoseStamped'))

    def wrench(stamp: int, force: Array, moment: Array) -> bytes:
        body = types['geometry_msgs/msg/Wrench'](vector(*force), vector(*moment))
        message = types['geometry_msgs/msg/WrenchStamped'](header(stamp), body)
        return bytes(store.serialize_cdr(message, 'geometry_msgs/msg/WrenchStamped'))

    with BagWriter(folder) as writer:
        add: Callable[[str, str], int] = lambda topic, kind: writer.add_topic(  # noqa: E731
            topic, f'geometry_msgs/msg/{kind}'
        )
        poses, felt = (
            add('/grip/upper/pose', 'PoseStamped'),
            add('/grip/upper/wrench', 'WrenchStamped'),
        )
        hand = [
            add(f'/hand/finger_{k + 1}/wrench', 'WrenchStamped')
            for k in range(0 if fingers is None else 3)
        ]
        for k, seconds in enumerate(time):
            stamp = START_NS + round(1e9 * float(seconds))
            for finger, topic in enumerate(hand):
                assert fingers is not None
                force = np.array([0.0, 0.0, fingers[k, finger]])
                writer.write(topic, wrench(stamp, force, np.zeros(3)), stamp)
            writer.write(poses, pose(stamp, place[k], turn[k]), stamp)
            noisy = torque[k] + TORQUE_SIGMA * random.normal(size=3)
            writer.write(felt, wrench(stamp, FORCE_SIGMA * random.normal(size=3), noisy), stamp)
    (folder / 'object.yaml').write_text(yaml.safe_dump(described, sort_keys=False))
    (folder / 'truth.yaml').write_text(yaml.safe_dump(truth, sort_keys=False))
    experiment = {
        'name': name,
        'title': {'tube_bend': 'A tube bent by an arm', 'cap_unscrew': 'A cap turned to slip'}[
            name
        ],
        'label': LABEL,
        'synthetic': True,
        'object': 'object.yaml',
        'start_ns': START_NS,
        'duration_s': round(float(time[-1]), 6),
    }
    (folder / 'experiment.yaml').write_text(yaml.safe_dump(experiment, sort_keys=False))
    (folder / 'README.md').write_text(
        f'# {name}\n\n{LABEL}.\n\n`grasp_report bags/{name} --out DIR` solves it: torque against '
        'angle beside that of the wrist.\n`truth.yaml` holds what the recording was made from; '
        '`python -m bags.turning` makes it again.\n'
    )


if __name__ == '__main__':
    tube_bend()
    cap_unscrew()
