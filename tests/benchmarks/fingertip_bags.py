# SPDX-License-Identifier: Apache-2.0
"""Recorded fingertips through the real node, beside the solids they were made from.

The node runs as a process of its own; `replay` sends it the contacts and touch cells of a bag, in
step (every load case answered before the next sample), or as fast as they were recorded. What is
served for the moments at which the solid was solved is compared with its outer face there.

    python tests/benchmarks/fingertip_bags.py [--bag bottle_fingertips] [--live | --offline]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
import yaml
from figures import Row, show
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.interpolate import PchipInterpolator
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh

from grasp_replay.bag_reader import open_bag
from grasp_replay.cdr import header_stamp
from shell_deform.building import build_model
from shell_deform.contact.finger_bodies import read_finger_bodies, sizes
from shell_deform.live.tick.contact_cloud import ContactReader
from shell_deform.live.tick.load_path import LoadPath
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.node.parameters import PARAMETERS, settings
from shell_deform.objects import load_object

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bags.fingertips import START_NS, ball_face, bottle_face  # noqa: E402
from tests.patience import Patience  # noqa: E402
from tests.running import own_domain, processes  # noqa: E402

Array = NDArray[np.float64]

FACES = {'ball_fingertips': ball_face, 'bottle_fingertips': bottle_face}
SQUEEZE_S = 3.0
"""The fingers go in evenly for so long."""
NEAR_M = 0.02
"""What is nearer to a finger than this is called its dent."""


@dataclass
class Heard:
    """What the node has published: surfaces and sums of cell forces by stamp [ns], its mesh."""

    surfaces: dict[int, Array] = field(default_factory=dict)
    forces: dict[int, Array] = field(default_factory=dict)
    meshes: list[Mesh] = field(default_factory=list)

    def surface(self, message: PointCloud2) -> None:
        """A served surface: positions and displacements (n, 6) [m], sigma (n, 1)."""
        rows = np.frombuffer(message.data, np.float32).reshape(message.width, -1)
        self.surfaces[_stamp(message)] = rows[:, [0, 1, 2, 3, 4, 5, 7]].astype(float)

    def taxels(self, message: PointCloud2) -> None:
        """Touch cells: the force of each finger [N]."""
        rows = np.frombuffer(message.data, np.float32).reshape(message.width, -1)
        names = [one.name for one in message.fields]
        whose = rows[:, names.index('finger')]
        force = rows[:, [names.index(name) for name in ('fx', 'fy', 'fz')]]
        self.forces[_stamp(message)] = np.array(
            [np.linalg.norm(force[whose == one].sum(axis=0)) for one in np.unique(whose)]
        )


def _stamp(message: PointCloud2) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def served(bag: Path, live: bool, folder: Path) -> Heard:
    """What the node serves of a bag; `live`: as fast as it was recorded, else in step."""
    facts, heard = yaml.safe_load((bag / 'experiment.yaml').read_text()), Heard()
    with own_domain() as domain, processes(folder) as start:
        rclpy.init(domain_id=domain)
        node = rclpy.create_node('solid_listener')
        many = QoSProfile(depth=1000)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(PointCloud2, 'deformation/surface', heard.surface, many)
        node.create_subscription(PointCloud2, 'deformation/taxels', heard.taxels, many)
        node.create_subscription(Mesh, 'deformation/mesh', heard.meshes.append, latched)
        options = {
            'object': bag / 'object.yaml',
            'finger_body': facts['finger_body'],
            'friction': facts['friction'],
            'wait_for_take_up': 0.0 if live else 120.0,
        }
        parameters = [word for name in options for word in ('-p', f'{name}:={options[name]}')]
        solver = start('deformation', '--ros-args', *parameters)
        _spin(node, lambda: heard.meshes, solver)
        topics = ('--topics', '/hand/contacts', '/hand/tactile')
        step = ('--lockstep', '/hand/contacts:=/deformation/surface', '--lockstep-timeout', '120')
        player = start('replay', bag, '--wait', '30', *topics, *(() if live else step))
        _spin(node, lambda: player.process.poll() is not None, solver)
        if player.process.returncode:
            raise RuntimeError(player.text)
        node.destroy_node()
        rclpy.try_shutdown()
    return heard


def _spin(node: rclpy.node.Node, condition: object, solver: object) -> None:
    patience = Patience(300.0)
    while not condition():  # type: ignore[operator]
        rclpy.spin_once(node, timeout_sec=0.02)
        if patience.over or solver.process.poll() is not None:  # type: ignore[attr-defined]
            raise RuntimeError(solver.text)  # type: ignore[attr-defined]


def normals_of(points: Array, triangles: NDArray[np.int64]) -> Array:
    """(n, 3) unit normals at the vertices, by the areas of the triangles around them."""
    corner = points[triangles]
    turn = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    found = np.zeros_like(points)
    for a in range(3):
        np.add.at(found, triangles[:, a], turn)
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))


def offline(bag: Path) -> dict[int, Array]:
    """The same surfaces by stamp without node, process or topics: tick and solver in turn."""
    facts = yaml.safe_load((bag / 'experiment.yaml').read_text())
    bodies = read_finger_bodies(facts['finger_body'])
    model = build_model(bodies.on(load_object(str(bag / 'object.yaml'))))
    values = {one.name: one.default for one in PARAMETERS}
    tips = Rehearsal(model, settings(values), bodies.loaded())
    reach = sizes(list(bodies.loaded().values()))[1]
    path, reader = LoadPath(float(values['path_step']), reach), ContactReader()
    found: dict[int, Array] = {}
    with open_bag(bag) as recorded:
        for message in recorded.messages(['/hand/contacts']):
            stamp = header_stamp(message.data)
            sample = reader.read(recorded.decode(message), stamp)
            packed = tips.follow(sample, path, float(facts['friction'])).packed
            found[stamp] = packed[:, [0, 1, 2, 3, 4, 5, 7]].astype(float)
    return found


def rows(bag: Path, live: bool, beside: bool, folder: Path) -> Iterator[Row]:
    """The errors at each state of the squeeze that the solid was solved for."""
    heard = served(bag, live, folder)
    if beside:
        alone = offline(bag)
        same = [np.array_equal(alone[one], heard.surfaces[one]) for one in heard.surfaces]
        yield Row(f'{bag.name}: surfaces with the bytes of the same offline',
                  f'{sum(same)} of {len(same)}', 'all', all(same))  # fmt: skip
    states = yaml.safe_load((bag / 'truth.yaml').read_text())['states']
    wall = yaml.safe_load((bag / 'object.yaml').read_text())
    half, fingers = 0.5 * wall['thickness_m'], np.array([c['at_m'] for c in wall['contacts']])
    triangles = np.array([one.vertex_indices for one in heard.meshes[-1].triangles])
    yield Row(f'{bag.name}: surfaces answered, vertices', f'{len(heard.surfaces)}, '
              f'{len(heard.meshes[-1].vertices)}')  # fmt: skip
    deepest = max(state['depth_m'] for state in states)
    squeezed = [state for state in states if not state['turn_rad']]
    solid_force = PchipInterpolator(
        [0.0, *(state['depth_m'] for state in squeezed)],
        [0.0, *(float(np.linalg.norm(state['force_n'])) for state in squeezed)],
    )
    for number, state in enumerate(states):
        if state['turn_rad']:
            continue
        wanted = START_NS + round(1e9 * SQUEEZE_S * state['depth_m'] / deepest)
        stamp = min(heard.surfaces, key=lambda one: abs(one - wanted))
        packed = heard.surfaces[stamp]
        now, rest = packed[:, :3], packed[:, :3] - packed[:, 3:6]
        if len(now) <= triangles.max():
            continue
        before, after = normals_of(rest, triangles), normals_of(now, triangles)
        place = rest + half * before
        used = np.linalg.norm(before, axis=1) > 0.5
        away = np.linalg.norm(place[:, None] - fingers, axis=2).min(axis=1)
        truth = FACES[bag.name](place, before).moved(number)
        missed = np.linalg.norm(now + half * after - place - truth, axis=1)
        dent = used & (away < NEAR_M)
        rms = float(np.sqrt(np.mean(missed[dent] ** 2)))
        lengths = 1e3 * np.array([rms, missed[dent].max(), np.linalg.norm(truth, axis=1).max()])
        inside = float(np.mean(missed[dent] < 2.0 * packed[dent, 6]))
        depth = f'{bag.name}, {1e3 * state["depth_m"]:.2g} mm'
        yield Row(f'{depth}: outer face within 20 mm of a finger, RMS (max) of the dent',
                  f'{lengths[0]:.3f} ({lengths[1]:.3f}) mm of {lengths[2]:.2f} mm; '
                  f'{100 * inside:.0f} % within two sigma')  # fmt: skip
        # Forces belong to the load case that was solved last, up to a step of the path before.
        told = min(heard.forces, key=lambda one: abs(one - wanted))
        share = deepest * 1e-9 * (told - START_NS) / SQUEEZE_S
        solid = float(solid_force(share))
        push = heard.forces[told]
        yield Row(f'{depth}: force of a finger beside the solid',
                  f'{push.mean():.2f} N, {100 * (push.mean() / solid - 1):+.1f} %')  # fmt: skip


def main() -> int:
    """Measure and print; returns 1 when a figure is short of its goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--bag', choices=sorted(FACES), help='only this one')
    how = parser.add_mutually_exclusive_group()
    how.add_argument('--live', action='store_true', help='as fast as recorded, not in step')
    how.add_argument('--offline', action='store_true', help='beside the same without a node, too')
    options = parser.parse_args()
    failed = 0
    for name in [options.bag] if options.bag else sorted(FACES):
        with tempfile.TemporaryDirectory() as folder:
            failed += show(rows(ROOT / 'bags' / name, options.live, options.offline, Path(folder)))
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
