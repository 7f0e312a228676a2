# SPDX-License-Identifier: Apache-2.0
"""Every kind of finger on every kind of object: what pushes, works and holds is looked at.

Each pair is squeezed by 1 mm in eight steps without friction and in four with 0.4, and followed by
the live estimator, the first finger turning until it slips, then letting go. Without friction the
work of the pushes is the energy of wall and contact layer, with friction never less; the forces of
all fingers on a free object cancel; every load case is carried whole.

    python tests/benchmarks/finger_tour.py [--objects egg_mesh,tube] [--bodies plate] [--live]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
import yaml
from figures import Row, show
from live_fingertips import SURE, sample_at
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shell_deform.building import build_model
from shell_deform.contact.finger_bodies import read_finger_bodies, sizes
from shell_deform.live.tick.estimator import Settings
from shell_deform.live.tick.load_path import LoadPath
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.objects import ObjectError, load_object
from shell_deform.squeeze import Squeezed, SqueezeError, load

Array = NDArray[np.float64]

DEPTH, FRICTION, STEP = 1e-3, 0.4, 2e-4
TURNS = (0.03, 0.06, 0.09)
UNBALANCED, LOST = 1e-5, 0.01

BODIES = {
    'plate': 'plate: {width_m: 0.03, length_m: 0.04, edge_radius_m: 0.001}',
    'flat_pad': 'pad: {radius_m: 0.008}',
    'curved_pad': 'pad: {radius_m: 0.008, curvature_radius_m: 0.02}',
    'ball': 'ball: {radius_m: 0.008}',
    'rod': 'rod: {radius_m: 0.005, length_m: 0.02}',
    'mesh': 'mesh: {file: tip.stl, unit: mm}',
    'barrett_fingertip': '',
}
RUBBER = {'thickness_m': 1e-3, 'young_modulus_pa': 1e7, 'poisson_ratio': 0.35}
SIDES = [([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]), ([-1.0, 0.0, 0.0], [0.0, 0.0, 1.0])]


def objects(folder: Path) -> dict[str, tuple[dict[str, object], float, list[object]]]:
    """Surface, wall and supports by name; how far out fingers touch [m]; where, and their way."""
    ball = trimesh.creation.icosphere(5)
    egg = trimesh.Trimesh(ball.vertices * [22.0, 22.0, 28.5], ball.faces)
    egg.export(folder / 'egg.stl')
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 81)
    profile = np.column_stack([0.022 * np.cos(angle), 0.0285 * np.sin(angle)])
    profile[[0, -1], 0] = 0.0
    x, y = np.meshgrid(*2 * [np.arange(-0.03, 0.0301, 0.002)])
    np.savetxt(folder / 'dome.txt', 0.02 - (x**2 + y**2) / 0.08)
    bounded = {'supports': [{'kind': 'clamped', 'where': 'boundary'}]}
    field = {'height_field': {'file': 'dome.txt', 'spacing_m': 0.002}}
    tube = {'outer_diameter_m': 0.05, 'length_m': 0.08, 'ends': 'open'}
    can = {'outer_diameter_m': 0.066, 'length_m': 0.1, 'ends': 'closed'}
    egg_mesh = {'mesh': {'file': 'egg.stl', 'unit': 'mm', 'face': 'outer'}}
    top = [([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])]
    return {
        'sphere': ({'surface': {'sphere': {'outer_diameter_m': 0.06}}}, 0.03, SIDES),
        'egg_ellipsoid': (
            {'surface': {'ellipsoid': {'outer_diameters_m': [0.044, 0.044, 0.057]}}}, 0.022, SIDES
        ),
        'egg_revolution': (
            {'surface': {'revolution': {'outer_profile_m': profile.tolist()}}}, 0.022, SIDES
        ),
        'egg_mesh': ({'surface': egg_mesh}, 0.022, SIDES),
        'height_field': ({'surface': field, **bounded}, 0.02, top),
        'tube': ({'surface': {'cylinder': tube}}, 0.025, SIDES),
        'can': (
            {'surface': {'cylinder': can}, 'thickness_m': 5e-4, 'young_modulus_pa': 2e9},
            0.033, SIDES,
        ),
    }  # fmt: skip


def bodies(folder: Path) -> dict[str, str]:
    """The file, or the name, of every body."""
    ball = trimesh.creation.icosphere(2, radius=2.0).vertices
    corners = [[x, y, z] for x in (-5, 5) for y in (-3, 3) for z in (-2, -8)]
    tip = np.concatenate([ball + corner for corner in corners])
    trimesh.convex.convex_hull(tip).export(folder / 'tip.stl')
    found = {}
    for name, text in BODIES.items():
        (folder / f'{name}.yaml').write_text(f'name: {name}\n{text}\n')
        found[name] = str(folder / f'{name}.yaml') if text else name
    return found


def squeezes(file: Path, steps: int) -> list[Squeezed]:
    """States on the way to the full depth."""
    return list(
        load(file, theory='koiter').sweep(displacement=DEPTH * np.arange(1, steps + 1) / steps)
    )


def lost(states: list[Squeezed]) -> float:
    """Share of the work of all pushes that neither wall nor contact layer has."""
    last, stored = states[-1], states[-1].energy
    wall = last.model.wall_stiffness
    for touch in last.state.touches:
        at = touch.face.at
        rubbed = np.sum(touch.friction**2, axis=1) / wall.along[at]
        stored += 0.5 * float(touch.weights @ (touch.pressure**2 / wall.across[at] + rubbed))
    push = np.array([0.0, *(float(state.contact_force.sum()) for state in states)])
    work = float(np.trapezoid(push, dx=DEPTH / len(states)))
    return (work - stored) / work


def resultant(state: Squeezed) -> float:
    """Force of all fingers together over the sum of their sizes."""
    forces = np.array([touch.force for touch in state.state.touches])
    return float(np.linalg.norm(forces.sum(axis=0)) / np.linalg.norm(forces, axis=1).sum())


def offline(folder: Path, wall: dict[str, object], contacts: list[dict[str, object]]) -> str:
    """What a squeeze without and with friction gives; raises ValueError for what cannot be."""
    found = []
    for friction, steps in ((0.0, 8), (FRICTION, 4)):
        rows = [{**contact, 'friction': friction} for contact in contacts]
        text = {'name': 'toured', 'source': 'a tour', **RUBBER, **wall, 'contacts': rows}
        (folder / 'toured.yaml').write_text(yaml.safe_dump(text))
        found.append(squeezes(folder / 'toured.yaml', steps))
    share, rubbed, left = lost(found[0]), lost(found[1]), resultant(found[1][-1])
    if abs(share) > LOST or rubbed < -LOST or (len(contacts) > 1 and left > UNBALANCED):
        raise ValueError(f'work lost {share:.2%}, {rubbed:.2%}, resultant {left:.1e}')
    push = found[0][-1].contact_force[0]
    return f'{push:.3f} N; {share:+.2%}, {rubbed:+.2%}'


def live(folder: Path, wall: dict[str, object], body: str, where: list[object], out: float) -> str:
    """The same followed live, turned and let go; raises ValueError for what is not carried."""
    text = {'name': 'toured', 'source': 'a tour', **RUBBER, **wall}
    (folder / 'bare.yaml').write_text(yaml.safe_dump(text))
    carried = read_finger_bodies(body)
    outward, along = (np.array(part, float) for part in zip(*where, strict=True))
    model = build_model(
        carried.touching(load_object(str(folder / 'bare.yaml')), out * outward),
        control_vertices=300,
    )
    tips = Rehearsal(model, Settings(SURE), carried.loaded())
    path = LoadPath(STEP, sizes(list(carried.loaded().values()))[1])
    way = [(DEPTH * k / 5, 0.0) for k in range(6)] + [(DEPTH, turn) for turn in TURNS]
    for stamp, (depth, turn) in enumerate([*way, (0.5 * DEPTH, TURNS[-1])], 1):
        turned = along.copy()
        turned[0] = Rotation.from_rotvec(turn * outward[0]).apply(along[0])
        sample = sample_at(stamp, depth).rows(np.arange(len(where)))
        place = (out - depth) * outward
        tips.follow(
            replace(sample, point=place, normal=-outward, force=-5.0 * outward, along=turned),
            path, FRICTION,
        )  # fmt: skip
        adopted = tips.estimator.adopted
        if adopted is None or adopted.share < 1.0:
            why = '' if adopted is None else adopted.message
            raise ValueError(f'live lost at {1e3 * depth:g} mm, {turn:g} rad: {why}')
    return f'live {adopted.response.force[0]:.3f} N'


def rows(names: list[str], which: list[str], only_live: bool, folder: Path) -> Iterator[Row]:
    """One row for every pair."""
    files = bodies(folder)
    for name, (wall, out, where) in objects(folder).items():
        for label, body in files.items():
            if name not in names or label not in which:
                continue
            contacts = [
                {'at_m': (out * np.array(at)).tolist(), 'kind': 'fingertip', 'body': body,
                 'along': along}
                for at, along in where
            ]  # fmt: skip
            try:
                told = '' if only_live else offline(folder, wall, contacts) + '; '
                told += live(folder, wall, body, where, out)
            except (ValueError, SqueezeError, ObjectError) as error:
                yield Row(f'{name}, {label}', str(error), 'balanced', False)
                continue
            yield Row(f'{name}, {label}', told, 'balanced')


def main() -> int:
    """Measure and print; returns 1 when a pair is not balanced or not followed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--objects', help='only these, with commas')
    parser.add_argument('--bodies', help='only these, with commas')
    parser.add_argument('--live', action='store_true', help='leave the squeezes offline out')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        names = options.objects.split(',') if options.objects else list(objects(folder))
        which = options.bodies.split(',') if options.bodies else list(BODIES)
        return int(show(rows(names, which, options.live, folder)) > 0)


if __name__ == '__main__':
    sys.exit(main())
