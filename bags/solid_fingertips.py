# SPDX-License-Identifier: Apache-2.0
"""A hollow ball between two fingertips as a solid with contact and friction, kept as a small file.

The fingers squeeze it, then turn about the line between them, one each way, until they slip. Half
of the ball is solved: half a turn about z takes one finger to the other. The pads are drawn from
the numbers of their file by this module alone; it shares no code and no theory with the shell.
`python -m bags.solid_fingertips` solves it anew (needs ccx). Lengths in mm, forces in N.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from bags import calculix, hexahedra
from bags.calculix import Array
from bags.hexahedra import Patch, Solid

ROOT = Path(__file__).resolve().parents[1]
PAD = ROOT / 'ros2_ws/src/shell_deform/shell_deform/objects/fingers/barrett_fingertip.yaml'
KEPT = ROOT / 'bags/solid/ball_fingertips'

# Over Young's modulus [1/mm]: of contact, and along it while points stick.
CONTACT_STIFFNESS, STICK_STIFFNESS = 3e1, 1e1
# What lies behind the drawn face of a pad.
BEHIND = 3.0


@dataclass(frozen=True)
class Grasp:
    """The ball (mm, MPa), the fingers' programme (mm, rad) and how finely it is solved.

    `finest`: faces at the finger [mm]; `layers` through the wall; `pad`: faces of the pad [mm].
    """

    outer_radius: float = 32.5
    thickness: float = 2.5
    young_modulus: float = 12.75
    poisson_ratio: float = 0.49
    friction: float = 0.4
    depths: tuple[float, ...] = (0.3, 0.6, 0.9, 1.2)
    turns: tuple[float, ...] = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12)
    finest: float = 2.2
    layers: int = 1
    pad: float = 1.5

    @property
    def path(self) -> list[tuple[float, float]]:
        """Depth and turn of every state."""
        squeeze = [(depth, 0.0) for depth in self.depths]
        return squeeze + [(self.depths[-1], turn) for turn in self.turns]


@dataclass(frozen=True)
class PadMesh:
    """A pad in its own frame, x to the tip and z out of the face, from the foot of the touch.

    Attributes:
        face, back: (m, n, 3) points of the face, and behind it. cells: (c, 3) touch cells, with
            their normals (c, 3).
    """

    face: Array
    back: Array
    cells: Array
    normals: Array


def draw_pad(size: float) -> PadMesh:
    """The face of the fingertip in its file, in quadrilaterals of `size` [mm]."""
    file = yaml.safe_load(PAD.read_text())['fingertip']
    heel, flat_to, touch = (1e3 * file[key] for key in ('heel_m', 'flat_to_m', 'touch_at_m'))
    half, edge = 0.5e3 * file['width_m'], 1e3 * file['edge_radius_m']
    arcs = [(1e3 * arc['radius_m'], float(arc['turn_rad'])) for arc in file['arcs']]

    def profile(along: float) -> tuple[float, float]:
        """Height over the flat and lean of the face at a place along the finger."""
        height, lean, at = 0.0, 0.0, flat_to
        for radius, turn in arcs:
            if along <= at:
                break
            end = min(
                float(np.arcsin(min(1.0, np.sin(lean) + (along - at) / radius))), lean + turn
            )
            height -= radius * (np.cos(lean) - np.cos(end))
            at += radius * (np.sin(end) - np.sin(lean))
            lean = end
        return height, lean

    first, last = heel + 1.0, flat_to + arcs[0][0] * np.sin(arcs[0][1]) + 4.0
    stations = np.linspace(first, last, round((last - first) / size) + 1)
    flat = np.linspace(edge - half, half - edge, round(2.0 * (half - edge) / size) + 1)
    round_off = np.linspace(0.0, np.radians(75.0), 5)[1:]
    # Places across: on the flat, and how far the rounded edge has turned there.
    across = np.concatenate([np.full(4, edge - half), flat, np.full(4, half - edge)])
    turned = np.concatenate([-round_off[::-1], np.zeros(len(flat)), round_off])
    touch_height, touch_lean = profile(touch)
    sine, cosine = np.sin(touch_lean), np.cos(touch_lean)
    frame = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])

    def placed(points: Array) -> Array:
        return (points - [touch, 0.0, touch_height]) @ frame

    face, back = [], []
    for along in stations:
        height, lean = profile(float(along))
        out = np.array([np.sin(lean), 0.0, np.cos(lean)])
        core = np.array([along, 0.0, height]) - edge * out
        normal = np.cos(turned)[:, None] * out + np.sin(turned)[:, None] * [0.0, 1.0, 0.0]
        places = core + across[:, None] * [0.0, 1.0, 0.0] + edge * normal
        face.append(placed(places))
        back.append(placed(places - BEHIND * out))
    rows, columns = (1e3 * np.array(file[key]) for key in ('cell_rows_m', 'cell_columns_m'))
    feet = [(row, column, *profile(float(row))) for row in rows for column in columns]
    cells = np.array([[row, column, height] for row, column, height, _ in feet])
    normals = np.array([[np.sin(lean), 0.0, np.cos(lean)] for *_, lean in feet])
    return PadMesh(np.array(face), np.array(back), placed(cells), normals @ frame)


def half_ball(grasp: Grasp) -> Solid:
    """x >= 0: a square about the finger on +x, and four strips from there to the equator."""
    radius = grasp.outer_radius - 0.5 * grasp.thickness
    side = np.radians(26.0)
    count = 2 * round(side * radius / grasp.finest)
    angle = np.linspace(-side, side, 2 * count + 1)
    square = np.stack(
        [
            np.ones((len(angle), len(angle))),
            np.broadcast_to(np.tan(angle)[:, None], (len(angle), len(angle))),
            np.broadcast_to(np.tan(angle)[None], (len(angle), len(angle))),
        ],
        axis=2,
    )
    patches = [_patch(radius, square)]
    length = radius * (0.5 * np.pi - side)
    outward = hexahedra.with_midpoints(hexahedra.graded(length, grasp.finest, 5.0, 1.3)) / length
    for edge, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        rim = square[-1 if sign > 0 else 0] if edge == 0 else square[:, -1 if sign > 0 else 0]
        start = rim / np.linalg.norm(rim, axis=1, keepdims=True)
        # Straight on along the great circle through the finger's axis.
        end = np.stack([np.zeros(len(start)), start[:, 1], start[:, 2]], axis=1)
        end /= np.linalg.norm(end, axis=1, keepdims=True)
        way = np.arccos(np.einsum('pi,pi->p', start, end))
        share = outward[None, :, None]
        one, other = (start[:, None], end[:, None])
        turn = way[:, None, None]
        strip = (np.sin((1 - share) * turn) * one + np.sin(share * turn) * other) / np.sin(turn)
        strip = strip if (edge == 1) == (sign > 0) else strip[::-1]
        patches.append(_patch(radius, strip))
    return hexahedra.build(patches, grasp.thickness, grasp.layers)


def _patch(radius: float, directions: Array) -> Patch:
    normals = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    # Elements are right-handed where the first direction crossed with the second points out.
    across = np.cross(normals[1, 0] - normals[0, 0], normals[0, 1] - normals[0, 0])
    normals = normals if across @ normals[0, 0] > 0.0 else normals[::-1]
    return Patch(radius * normals, normals)


def pose(grasp: Grasp, depth: float, turn: float) -> tuple[Array, Array]:
    """Origin (3,) and axes (3, 3) of the finger on +x: pushed in by `depth`, turned about +x."""
    along = np.array([0.0, -np.sin(turn), np.cos(turn)])
    z = np.array([-1.0, 0.0, 0.0])
    return np.array([grasp.outer_radius - depth, 0.0, 0.0]), np.stack(
        [along, np.cross(z, along), z], axis=1
    )


def first_touch(grasp: Grasp, pad: PadMesh) -> float:
    """How far the finger must go, from where its origin lies on the ball, to touch it [mm]."""
    origin, axes = pose(grasp, 0.0, 0.0)
    points = pad.face.reshape(-1, 3) @ axes.T + origin
    beside = np.hypot(points[:, 1], points[:, 2])
    near = beside < 0.9 * grasp.outer_radius
    sphere = np.sqrt(grasp.outer_radius**2 - beside[near] ** 2)
    return float((points[near, 0] - sphere).min())


@dataclass(frozen=True)
class Pressed:
    """A solid under one pad, which goes from pose to pose.

    Attributes:
        heading: of the deck. solid: what is pressed. near: its elements, from 1, whose outer faces
            may come to touch. young_modulus [MPa], poisson_ratio, friction: of the contact too.
        held: cards of how the rest of the object holds it. pad: in its own frame.
        poses: origin (3,) and axes (3, 3) where the pad first touches, then at every state.
    """

    heading: str
    solid: Solid
    near: list[int]
    young_modulus: float
    poisson_ratio: float
    friction: float
    held: str
    pad: PadMesh
    poses: list[tuple[Array, Array]]

    def face(self, state: int) -> Array:
        """(n, 3) nodes of the face of the pad at a state, from 1; 0 is first touch."""
        origin, axes = self.poses[state]
        return np.asarray(self.pad.face.reshape(-1, 3) @ axes.T + origin)


def deck(case: Pressed) -> str:
    """The input file: one step from each pose of the pad to the next."""
    solid, pad = case.solid, case.pad
    start = len(solid.positions)
    rows, columns = pad.face.shape[:2]
    drawn = np.concatenate([pad.face.reshape(-1, 3), pad.back.reshape(-1, 3)])
    origin, axes = case.poses[0]
    placed = drawn @ axes.T + origin
    number = start + 1 + np.arange(rows * columns).reshape(rows, columns)
    behind = number + rows * columns
    blocks = [
        [behind[i, j], behind[i + 1, j], behind[i + 1, j + 1], behind[i, j + 1],
         number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]]
        for i in range(rows - 1)
        for j in range(columns - 1)
    ]  # fmt: skip
    first_pad = len(solid.elements) + 1
    nodes = {k + 1: row for k, row in enumerate(solid.positions)}
    nodes |= {start + 1 + k: row for k, row in enumerate(placed)}
    parts = [
        f'*HEADING\n{case.heading}',
        '*NODE,NSET=ALL\n' + calculix.node_lines(nodes),
        '*ELEMENT,TYPE=C3D20R,ELSET=WALL',
        calculix.element_lines(solid.elements),
        '*ELEMENT,TYPE=C3D8,ELSET=PAD',
        calculix.element_lines(np.array(blocks), first_pad),
        calculix.set_lines('PAD', 'N', range(start + 1, start + 1 + len(placed))),
        calculix.set_lines('FACE', 'N', np.unique(solid.outer).tolist()),
        '*MATERIAL,NAME=WALL',
        calculix.neo_hooke(case.young_modulus, case.poisson_ratio),
        f'*MATERIAL,NAME=STIFF\n*ELASTIC\n{1e3 * case.young_modulus},0.3',
        '*SOLID SECTION,ELSET=WALL,MATERIAL=WALL',
        '*SOLID SECTION,ELSET=PAD,MATERIAL=STIFF',
        '*SURFACE,NAME=OUTER\n' + '\n'.join(f'{k},S2' for k in case.near),
        '*SURFACE,NAME=TIP\n' + '\n'.join(f'{first_pad + k},S2' for k in range(len(blocks))),
        '*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR',
        f'{CONTACT_STIFFNESS * case.young_modulus},0.',
        f'*FRICTION\n{case.friction},{STICK_STIFFNESS * case.young_modulus}',
        '*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nOUTER,TIP',
        case.held,
    ]
    for origin, axes in case.poses[1:]:
        parts.append(_step(start, drawn @ axes.T + origin - placed))
    return '\n'.join(parts) + '\n'


def half_ball_pressed(grasp: Grasp) -> Pressed:
    """The half ball and its finger, first touch and every state of the programme."""
    solid, pad = half_ball(grasp), draw_pad(grasp.pad)
    offset = first_touch(grasp, pad)
    outer = [e + 1 for e in range(len(solid.elements)) if e % grasp.layers == grasp.layers - 1]
    near = [
        e for e in outer
        if np.linalg.norm(solid.positions[solid.elements[e - 1][4] - 1] - [32.5, 0, 0]) < 20.0
    ]  # fmt: skip
    poses = [pose(grasp, offset + depth, turn) for depth, turn in [(0.0, 0.0), *grasp.path]]
    return Pressed(
        'half a ball and a fingertip', solid, near, grasp.young_modulus, grasp.poisson_ratio,
        grasp.friction, _half_turn(solid), pad, poses,
    )  # fmt: skip


def _step(start: int, moved: Array) -> str:
    """One step, in which the nodes of the pad, numbered from `start`, move by (n, 3) in all."""
    values = '\n'.join(
        f'{start + 1 + k},{a + 1},{a + 1},{row[a]:.12g}'
        for k, row in enumerate(moved)
        for a in range(3)
    )
    return (
        '*STEP,NLGEOM,INC=300\n*STATIC\n0.5,1.0,1e-5\n*BOUNDARY\n'
        f'{values}\n*NODE PRINT,NSET=PAD\nRF\n*NODE PRINT,NSET=FACE\nU\n*END STEP'
    )


def _half_turn(solid: Solid) -> str:
    """Half a turn about z takes the equator to itself: its motions come in pairs."""
    on = np.flatnonzero(np.abs(solid.positions[:, 0]) < 1e-6)
    place = {tuple(np.round(solid.positions[k, 1:], 4) + 0.0): int(k) + 1 for k in on}
    lines, fixed = [], []
    for (y, z), node in place.items():
        other = place[-y + 0.0, z]
        if other == node:
            fixed += [f'{node},1,1', f'{node},2,2']
        elif node < other:
            for axis, sign in ((1, 1.0), (2, 1.0), (3, -1.0)):
                lines.append(f'*EQUATION\n2\n{other},{axis},1.,{node},{axis},{sign}')
    return '\n'.join([*lines, '*BOUNDARY', *fixed])


def read_states(case: Pressed, printed: str) -> tuple[list[dict], Array]:
    """Force, torque and cells of each state that was reached, and how (s, n, 3) the face moved.

    The face by its corner nodes, in m; forces of the pad on the solid, torques about the origin,
    those of cells along their normals.
    """
    tables = calculix.read_tables(printed)
    pad, start = case.pad, len(case.solid.positions)
    face = pad.face.reshape(-1, 3)
    cell = np.argmin(np.linalg.norm(face[:, None] - pad.cells[None], axis=2), axis=1)
    states, moved = [], []
    for step, (_, axes) in enumerate(case.poses[1:], 1):
        time = min(tables, key=lambda one: abs(one - step))
        if abs(time - step) > 1e-6:
            print(f'ended before state {step} of {len(case.poses) - 1}')
            break
        table = {name: rows for (_, name), rows in tables[time].items()}
        # Reactions on the pad are the forces that hold it: what it does to the object.
        force = np.array([table['PAD'][start + 1 + k] for k in range(len(face))])
        torque = np.cross(case.face(step), force).sum(axis=0)
        cells = np.zeros((len(pad.cells), 3))
        np.add.at(cells, cell, force)
        states.append(
            {
                'force_n': force.sum(axis=0).round(6).tolist(),
                'torque_nm': (1e-3 * torque).round(9).tolist(),
                'cells_n': np.einsum('ci,ci->c', cells, pad.normals @ axes.T).round(5).tolist(),
            }
        )
        moved.append(1e-3 * np.array([table['FACE'][k] for k in corners(case.solid)]))
    return states, np.array(moved)


def corners(solid: Solid) -> np.ndarray:
    """Numbers, from 1, of the corner nodes of the outer face."""
    return np.unique(solid.outer[:, :4])


def write(kept: dict, case: Pressed, states: list[dict], moved: Array, path: Path) -> None:
    """Keep what was solved beside its deck, and the outer face at rest and moved."""
    version = calculix.solver_version()
    material = {
        'young_modulus_pa': 1e6 * case.young_modulus,
        'poisson_ratio': case.poisson_ratio,
        'friction': case.friction,
    }
    source = {
        'solver': f'CalculiX CrunchiX {version}',
        'source': f'CalculiX CrunchiX {version}, C3D20R, neo-Hooke, contact with friction, NLGEOM',
    }
    calculix.keep_deck(deck(case), path.with_suffix('.inp.gz'))
    path.with_suffix('.json').write_text(
        json.dumps({**kept, **source, **material, 'states': states}, indent=1) + '\n'
    )
    np.savez_compressed(
        path.with_suffix('.npz'),
        rest_m=(1e-3 * case.solid.positions[corners(case.solid) - 1]).astype(np.float32),
        moved_m=moved.astype(np.float32),
    )


def keep(grasp: Grasp, printed: str, path: Path) -> None:
    """Keep the deck, forces, torques and cells of what was printed, and the outer face."""
    case = half_ball_pressed(grasp)
    states, moved = read_states(case, printed)
    told = [
        {'depth_m': round(1e-3 * depth, 9), 'turn_rad': turn, **state}
        for (depth, turn), state in zip(grasp.path, states, strict=False)
    ]
    kept = {
        'what': 'half a hollow ball (x >= 0; half a turn about z gives the other half) under a '
        'BarrettHand fingertip on +x, its tip along +z, pushed in, then turned about +x; the '
        'other one turns the other way; forces of the finger on the ball, of cells along their '
        'normals',
        'outer_radius_m': 1e-3 * grasp.outer_radius,
        'thickness_m': 1e-3 * grasp.thickness,
        'finest_m': 1e-3 * grasp.finest,
        'layers': grasp.layers,
    }
    write(kept, case, told, moved, path)


def main() -> None:
    """Solve as the arguments say."""
    command = argparse.ArgumentParser(description=__doc__)
    command.add_argument('--finest', type=float, default=Grasp.finest, help='faces [mm]')
    command.add_argument('--pad', type=float, default=Grasp.pad, help='faces of the pad [mm]')
    command.add_argument('--out', type=Path, default=KEPT, help='without its ending')
    command.add_argument('--timeout', type=float, default=7200.0, help='[s]')
    options = command.parse_args()
    grasp = Grasp(finest=options.finest, pad=options.pad)
    printed = calculix.printed(
        deck(half_ball_pressed(grasp)), 'fingertips', options.timeout, partial=True
    )
    keep(grasp, printed, options.out)


if __name__ == '__main__':
    main()
