# SPDX-License-Identifier: Apache-2.0
"""A hollow sphere between two rigid plates as a solid with contact, kept as a small file.

The oracle of the rigid pads of `shell_deform`: it shares no code and no theory with them.
`python -m bags.solid_plates` solves it anew (needs ccx, about a minute). With `--balls` nothing is
kept: the mission's ball between two small ones of steel, as a solid and by both walls of ours.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bags import calculix
from shell_deform.building import build_model, object_contacts
from shell_deform.objects import ShellObject
from shell_deform.objects.shell_object import Contact, Sphere
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

KEPT = (
    Path(__file__).parents[1]
    / 'ros2_ws/src/shell_deform/shell_deform/verification/solid_plates.json'
)
PLATE_ELEMENTS = 40
# How far around a small ball its face goes [rad].
WIDEST = 1.2
# CalculiX turns axisymmetric elements into a wedge of two degrees and prints the forces on it.
WEDGES = 180
# Contact stiffness over Young's modulus [1/mm]: less than 1e-3 mm of overclosure gets through.
CONTACT_STIFFNESS = 1e2
# The same along the plates while points stick.
STICK_STIFFNESS = 1e1


@dataclass(frozen=True)
class Squeezed:
    """The upper half of a hollow sphere (mm, MPa): middle radius, wall, material, mesh.

    `rubber`: neo-Hookean instead of linear in the logarithm of the strain. `indenter`: radius of
    rigid balls in place of the plates; 0: plates.
    """

    radius: float = 50.0
    thickness: float = 1.0
    young_modulus: float = 1000.0
    poisson_ratio: float = 0.3
    along: int = 160
    across: int = 2
    friction: float = 0.0
    rubber: bool = False
    indenter: float = 0.0


# The mission's ball as a solid, without its air.
THICK = Squeezed(31.25, 2.5, 1.0, 0.49, along=120, across=4, rubber=True)


Nodes = dict[int, tuple[float, float, float]]


def wall_nodes(ball: Squeezed) -> tuple[Nodes, dict[tuple[int, int], int]]:
    """Nodes of the wall (mm), and their numbers by their place along the meridian and across."""
    columns, rows = 2 * ball.along, 2 * ball.across
    # Half of the elements lie within the cap that a plate flattens.
    share = np.linspace(0.0, 1.0, columns + 1)
    angle = 0.5 * np.pi * (0.4 * share + 0.6 * share**3)
    level = ball.radius + ball.thickness * np.linspace(-0.5, 0.5, rows + 1)
    number: dict[tuple[int, int], int] = {}
    nodes: Nodes = {}
    for i in range(columns + 1):
        for j in range(rows + 1):
            if i % 2 and j % 2:
                continue
            number[i, j] = len(nodes) + 1
            x, y = level[j] * np.sin(angle[i]), level[j] * np.cos(angle[i])
            nodes[number[i, j]] = (x if i else 0.0, y if i < columns else 0.0, 0.0)
    return nodes, number


def deck(ball: Squeezed, depths: np.ndarray) -> str:
    """Axisymmetric quadratic elements, a stiff plate above the pole, one step for each depth."""
    columns, rows = 2 * ball.along, 2 * ball.across
    nodes, number = wall_nodes(ball)
    elements = [
        [number[i + a, j + b] for a, b in
         ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))]
        for i in range(0, columns, 2)
        for j in range(0, rows, 2)
    ]  # fmt: skip
    outer = [k + 1 for k in range(len(elements)) if k % ball.across == ball.across - 1]
    first, top = len(nodes) + 1, ball.radius + 0.5 * ball.thickness
    for i in range(PLATE_ELEMENTS + 1):
        part, y = i / PLATE_ELEMENTS, top
        x = 0.6 * ball.radius * part
        if ball.indenter:
            x = ball.indenter * float(np.sin(WIDEST * part))
            y += ball.indenter * float(1.0 - np.cos(WIDEST * part))
        nodes[first + 2 * i], nodes[first + 2 * i + 1] = (x, y, 0.0), (x, y + 2.0, 0.0)
    plate = np.array(
        [[first + 2 * i + c for c in (0, 2, 3, 1)] for i in range(PLATE_ELEMENTS)], dtype=np.int64
    )
    start = len(elements) + 1
    equator = [number[columns, j] for j in range(rows + 1)]
    axis = [number[0, j] for j in range(rows + 1)]
    parts = [
        '*HEADING\nhollow sphere between rigid plates',
        '*NODE,NSET=ALL\n' + calculix.node_lines(nodes),
        '*ELEMENT,TYPE=CAX8R,ELSET=WALL',
        calculix.element_lines(np.array(elements, dtype=np.int64)),
        '*ELEMENT,TYPE=CAX4,ELSET=PLATE',
        calculix.element_lines(plate, start),
        calculix.set_lines('PLATE', 'N', range(first, len(nodes) + 1)),
        calculix.set_lines('FACE', 'N', (number[i, rows] for i in range(columns // 2))),
        '*MATERIAL,NAME=WALL',
        calculix.neo_hooke(ball.young_modulus, ball.poisson_ratio)
        if ball.rubber
        else f'*ELASTIC\n{ball.young_modulus},{ball.poisson_ratio}',
        f'*MATERIAL,NAME=STIFF\n*ELASTIC\n{1e4 * ball.young_modulus},0.3',
        '*SOLID SECTION,ELSET=WALL,MATERIAL=WALL',
        '*SOLID SECTION,ELSET=PLATE,MATERIAL=STIFF',
        '*SURFACE,NAME=OUTER\n' + '\n'.join(f'{k},S3' for k in outer),
        '*SURFACE,NAME=FACE\n' + '\n'.join(f'{start + i},S1' for i in range(PLATE_ELEMENTS)),
        '*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR',
        f'{CONTACT_STIFFNESS * ball.young_modulus},0.',
        *(
            [f'*FRICTION\n{ball.friction},{STICK_STIFFNESS * ball.young_modulus}']
            if ball.friction
            else []
        ),
        '*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nOUTER,FACE',
        '*BOUNDARY\nPLATE,1,1',
        *(f'{node},2,2' for node in equator),
        *(f'{node},1,1' for node in axis),
    ]
    for depth in depths:
        parts += [
            '*STEP,NLGEOM,INC=200\n*STATIC\n0.5,1.0,1e-4',
            f'*BOUNDARY\nPLATE,2,2,{-depth:.12g}',
            '*NODE PRINT,NSET=PLATE\nRF\n*NODE PRINT,NSET=FACE\nU\n*END STEP',
        ]
    return '\n'.join(parts) + '\n'


def solve(ball: Squeezed, depths: np.ndarray) -> tuple[list[float], list[float]]:
    """Force on one plate (N) at each depth of it (mm), and the radius that it touches (mm)."""
    tables = calculix.run(deck(ball, depths), 'plates')
    nodes = wall_nodes(ball)[0]
    top = ball.radius + 0.5 * ball.thickness
    forces, radii = [], []
    for step, depth in enumerate(depths.tolist(), 1):
        table = tables[min(tables, key=lambda time: abs(time - step))]
        reaction = next(rows for (what, _), rows in table.items() if what.startswith('forces'))
        forces.append(-WEDGES * float(sum(row[1] for row in reaction.values())))
        moved = next(rows for (what, _), rows in table.items() if what.startswith('disp'))
        face = np.array([np.add(nodes[node], move) for node, move in moved.items()])
        face = face[np.argsort(face[:, 0])]
        gap = (top - depth) - face[:, 1]
        # The contact is stiff, not rigid: what it touches reaches a little beyond the plate.
        last = int(np.flatnonzero(gap <= 0.0)[-1])
        radii.append(float(np.interp(0.0, gap[last : last + 2], face[last : last + 2, 0])))
    return forces, radii


def keep(ball: Squeezed, shares: list[float], path: Path) -> None:
    """Solve at these depths over the wall and keep."""
    depths = ball.thickness * np.array(shares)
    forces, _ = solve(ball, depths)
    kept = {
        'what': 'hollow sphere between two rigid flat plates without friction; depth of one plate',
        'source': f'CalculiX CrunchiX {calculix.solver_version()}, CAX8R, contact, NLGEOM',
        'middle_radius_m': round(1e-3 * ball.radius, 9),
        'thickness_m': round(1e-3 * ball.thickness, 9),
        'young_modulus_pa': 1e6 * ball.young_modulus,
        'poisson_ratio': ball.poisson_ratio,
        'depth_m': (1e-3 * depths).round(9).tolist(),
        'force_n': [round(force, 6) for force in forces],
    }
    path.write_text(json.dumps(kept, indent=1) + '\n')


def keep_friction(ball: Squeezed, shares: list[float], frictions: list[float]) -> None:
    """Solve with each friction at these depths over the wall and keep, with the contact radius."""
    depths = ball.thickness * np.array(shares)
    found = [solve(replace(ball, friction=friction), depths) for friction in frictions]
    kept = {
        'what': 'hollow sphere between two rigid flat plates with friction; force on one plate',
        'source': f'CalculiX CrunchiX {calculix.solver_version()}, CAX8R, contact with friction, '
        'NLGEOM',
        'depth_m': (1e-3 * depths).round(9).tolist(),
        'friction': frictions,
        'force_n': [np.round(forces, 3).tolist() for forces, _ in found],
        'radius_m': [(1e-3 * np.array(radii)).round(6).tolist() for _, radii in found],
    }
    path = KEPT.with_name('solid_friction.json')
    path.write_text(json.dumps(kept, indent=1) + '\n')


def beside_balls(ball: Squeezed, shares: list[float]) -> None:
    """Print force of the solid at these depths over the wall, and the error of both walls."""
    depths = ball.thickness * np.array(shares)
    outer = 1e-3 * (ball.radius + 0.5 * ball.thickness)
    rim = 1e-3 * ball.indenter * np.sin(WIDEST)
    pads = tuple(
        Contact((0.0, 0.0, z), rim, 'pad', curvature_radius_m=1e-3 * ball.indenter)
        for z in (outer, -outer)
    )
    shell = ShellObject(
        'ball between balls', Sphere(2.0 * outer), 1e-3 * ball.thickness,
        1e6 * ball.young_modulus, ball.poisson_ratio, contacts=pads,
    )  # fmt: skip
    print('| depth [mm] | ' + ' | '.join(f'{depth:g}' for depth in depths) + ' |')
    print('|---|' + len(depths) * '---|')
    forces, _ = solve(ball, depths)
    print('| solid [N] | ' + ' | '.join(f'{force:.4f}' for force in forces) + ' |')
    for theory in ('thick', 'koiter'):
        model = build_model(shell, theory, control_vertices=1000)
        contacts = object_contacts(shell, model)
        cases = [displaced(contacts, [depth, depth]) for depth in 1e-3 * depths]
        states = EquilibriumSolver(model).sweep(cases)
        errors = [100.0 * (s.force[0] / f - 1.0) for s, f in zip(states, forces, strict=False)]
        print(f'| {theory} [%] | ' + ' | '.join(f'{error:+.1f}' for error in errors) + ' |')


def main() -> None:
    """The thin sphere, then the mission's ball."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--balls', type=float, metavar='MM', help='radius of the small ones')
    indenter = parser.parse_args().balls
    if indenter:
        small = replace(THICK, along=160, across=6, indenter=indenter)
        beside_balls(small, [0.05, 0.1, 0.25, 0.5])
        return
    keep_friction(Squeezed(), [0.5, 1.0, 1.5], [0.0, 0.3, 1.0])
    keep(Squeezed(), [0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5], KEPT)
    keep(THICK, [0.1, 0.25, 0.5, 0.75, 1.0, 1.5], KEPT.with_name('solid_thick_plates.json'))


if __name__ == '__main__':
    main()
