# SPDX-License-Identifier: Apache-2.0
"""A squeeze bottle between three fingertips as a solid with contact and friction.

The bottle is free-form: belly, shoulder and neck, its section three-sided by an amount that
changes with the height. Three fingers that point down press its flats, 120 degrees apart. Mirror
planes through a finger and half way to the next leave a sixth; the foot is clamped, the neck open.
Every depth is solved by itself, from first touch.
`python -m bags.solid_bottle` solves it anew (needs ccx). Lengths in mm, forces in N.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, LinearNDInterpolator

from bags import calculix, hexahedra, solid_fingertips, solid_shell
from bags.calculix import Array
from bags.hexahedra import Patch, Solid
from bags.solid_fingertips import PadMesh, Pressed

KEPT = Path(__file__).parent / 'solid/bottle_fingertips'
SIXTH = np.pi / 3.0


@dataclass(frozen=True)
class Bottle:
    """The bottle (mm, MPa: a low-density polyethylene), its fingers and how finely it is solved.

    `outline_r`, `outline_z`: of the mean radius; `sides`: how far its section is from round.
    `touch_z`: where fingers touch. `across`, `along`: faces at the finger [mm]; `pad`: of the pad.
    """

    outline_r: tuple[float, ...] = (31.0, 32.0, 33.5, 33.8, 31.5, 23.0, 15.0, 14.0)
    outline_z: tuple[float, ...] = (0.0, 12.0, 32.0, 50.0, 72.0, 92.0, 108.0, 120.0)
    sides: float = 0.035
    thickness: float = 1.2
    young_modulus: float = 250.0
    poisson_ratio: float = 0.42
    friction: float = 0.4
    touch_z: float = 48.0
    depths: tuple[float, ...] = (0.4, 0.8, 1.2, 1.6, 2.0)
    across: float = 1.8
    along: float = 3.0
    coarsest: float = 9.0
    pad: float = 1.5

    def outer(self, angle: Array, height: Array) -> tuple[Array, Array]:
        """Points (..., 3) of the outer face at angles [rad] and heights, and outward normals."""
        outline = CubicSpline(self.outline_z, self.outline_r, bc_type='clamped')
        wave = np.pi / self.outline_z[-1]
        lobes = self.sides * np.sin(wave * height) ** 2
        lobes_slope = self.sides * wave * np.sin(2.0 * wave * height)
        mean, waves = outline(height), np.cos(3.0 * angle)
        radius = mean * (1.0 - lobes * waves)
        turned = 3.0 * mean * lobes * np.sin(3.0 * angle)
        slope = outline(height, 1) * (1.0 - lobes * waves) - mean * lobes_slope * waves
        out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        round_it = np.stack([-out[..., 1], out[..., 0], out[..., 2]], axis=-1)
        up = np.array([0.0, 0.0, 1.0])
        points = radius[..., None] * out + height[..., None] * up
        first = turned[..., None] * out + radius[..., None] * round_it
        normal = np.cross(first, slope[..., None] * out + up)
        return points, normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def sixth(self) -> Solid:
        """From the middle of a finger to half way to the next, graded towards the finger."""
        side = self.outline_r[3] * SIXTH
        around = hexahedra.graded(side, self.across, self.coarsest, 1.2) * (SIXTH / side)
        below = hexahedra.graded(self.touch_z - 24.0, self.along, self.coarsest, 1.25)
        above = hexahedra.graded(
            self.outline_z[-1] - self.touch_z - 18.0, self.along, self.coarsest, 1.25
        )
        middle = np.linspace(
            self.touch_z - 24.0, self.touch_z + 18.0, round(42.0 / self.along) + 1
        )
        up = np.concatenate([middle[0] - below[:0:-1], middle, middle[-1] + above[1:]])
        angle, height = np.meshgrid(
            hexahedra.with_midpoints(around), hexahedra.with_midpoints(up), indexing='ij'
        )
        points, normals = self.outer(angle, height)
        middle_points = points - 0.5 * self.thickness * normals
        return hexahedra.build([Patch(middle_points, normals)], self.thickness, 1)

    def pose(self, depth: float) -> tuple[Array, Array]:
        """Origin (3,) and axes (3, 3) of the finger on +x, `depth` [mm] inside the outer face."""
        place, normal = self.outer(np.zeros(()), np.array(self.touch_z))
        along = np.cross([0.0, 1.0, 0.0], normal)
        along *= -np.sign(along[2])
        return place - depth * normal, np.stack([along, np.cross(-normal, along), -normal], axis=1)

    def first_touch(self, pad: PadMesh) -> float:
        """How far the finger must go, from where its origin lies on the bottle, to touch it."""
        origin, axes = self.pose(0.0)
        angle, height = np.meshgrid(
            np.linspace(-0.5, 0.5, 161), self.touch_z + np.linspace(-30.0, 30.0, 241)
        )
        face = (self.outer(angle, height)[0].reshape(-1, 3) - origin) @ axes
        points = pad.face.reshape(-1, 3)
        gap = LinearNDInterpolator(face[:, :2], face[:, 2])(points[:, :2]) - points[:, 2]
        return float(np.nanmin(gap))

    def pressed(self, depth: float) -> Pressed:
        """A sixth and its finger, at first touch and pushed in by `depth` from there [mm]."""
        solid, pad = self.sixth(), solid_fingertips.draw_pad(self.pad)
        offset = self.first_touch(pad)
        place = self.pose(0.0)[0]
        foot = np.flatnonzero(np.abs(solid.positions[:, 2]) < 1e-6) + 1
        fixed = [f'{node},1,3' for node in foot.tolist()]
        held = set(foot.tolist())
        fixed += [
            f'{node},2,2'
            for node in solid_shell.symmetric(solid, [0.0, 1.0, 0.0])
            if node not in held
        ]
        turned = np.array([-np.sin(SIXTH), np.cos(SIXTH), 0.0])
        tied = [
            solid_shell.equation(((node, 2, turned[1]), (node, 1, turned[0])))
            for node in solid_shell.symmetric(solid, turned)
            if node not in held
        ]
        near = [
            number
            for number, nodes in enumerate(solid.elements, 1)
            if np.linalg.norm(solid.positions[nodes[4] - 1] - place) < 32.0
            and solid.positions[nodes[4] - 1][1] < 14.0
        ]
        cards = ['*EQUATION', *tied, '*BOUNDARY', *fixed]
        return Pressed(
            'a sixth of a bottle and a fingertip', solid, near, self.young_modulus,
            self.poisson_ratio, self.friction, '\n'.join(cards), pad,
            [self.pose(offset), self.pose(offset + depth)],
        )  # fmt: skip


def solved(bottle: Bottle, depth: float, timeout: float) -> tuple[dict, Array]:
    """Force, torque and cells of a whole finger, both of its halves, and how the face moved."""
    case = bottle.pressed(depth)
    printed = calculix.printed(solid_fingertips.deck(case), 'bottle', timeout)
    [state], moved = solid_fingertips.read_states(case, printed)
    cells = np.reshape(state['cells_n'], (-1, 3))
    force, torque = np.array(state['force_n']), np.array(state['torque_nm'])
    told = {
        'depth_m': round(1e-3 * depth, 9),
        'turn_rad': 0.0,
        'force_n': (force + force * [1.0, -1.0, 1.0]).round(6).tolist(),
        'torque_nm': (torque + torque * [-1.0, 1.0, -1.0]).round(9).tolist(),
        'cells_n': (cells + cells[:, ::-1]).round(5).ravel().tolist(),
    }
    return told, moved[0]


def keep(bottle: Bottle, found: list[tuple[dict, Array]], path: Path) -> None:
    """Keep what was solved, with the deck of the last depth."""
    case = bottle.pressed(bottle.depths[-1])
    normal = -bottle.pose(0.0)[1][:, 2]
    kept = {
        'what': 'a sixth of a squeeze bottle (0 to 60 degrees about z; mirrors and thirds of a '
        'turn give the rest) under a BarrettHand fingertip on +x, its tip down, pushed in along '
        'the inward normal; forces of a whole finger on the bottle, of cells along their normals',
        'touch_m': (1e-3 * bottle.pose(0.0)[0]).round(9).tolist(),
        'normal': normal.round(12).tolist(),
        'first_touch_m': round(1e-3 * bottle.first_touch(case.pad), 9),
        'height_m': 1e-3 * bottle.outline_z[-1],
        'thickness_m': 1e-3 * bottle.thickness,
        'across_m': 1e-3 * bottle.across,
        'along_m': 1e-3 * bottle.along,
    }
    states = [state for state, _ in found]
    moved = np.array([face for _, face in found])
    solid_fingertips.write(kept, case, states, moved, path)


def main() -> None:
    """Solve as the arguments say."""
    command = argparse.ArgumentParser(description=__doc__)
    command.add_argument('--across', type=float, default=Bottle.across, help='faces [mm]')
    command.add_argument('--along', type=float, default=Bottle.along, help='faces [mm]')
    command.add_argument('--pad', type=float, default=Bottle.pad, help='faces of the pad [mm]')
    command.add_argument('--out', type=Path, default=KEPT, help='without its ending')
    command.add_argument('--timeout', type=float, default=7200.0, help='[s]')
    options = command.parse_args()
    bottle = Bottle(across=options.across, along=options.along, pad=options.pad)
    keep(bottle, [solved(bottle, depth, options.timeout) for depth in bottle.depths], options.out)


if __name__ == '__main__':
    main()
