# SPDX-License-Identifier: Apache-2.0
"""Tubes twisted and bent by rigid ends, as solids, kept as a small file.

The oracle of the grips of `shell_deform`: it shares no code and no theory with them. Millimetres,
newtons, megapascals. `python -m bags.solid_tube` solves it anew (needs ccx, some minutes).
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bags import calculix
from bags.calculix import Array
from bags.hexahedra import LOCAL

KEPT = (
    Path(__file__).parents[1]
    / 'ros2_ws/src/shell_deform/shell_deform/verification/solid_tubes.json'
)


@dataclass(frozen=True)
class Tube:
    """A tube about z from 0 to `length`, its middle radius and wall, and its mesh.

    `half` keeps y >= 0 alone, with symmetry.
    """

    radius: float = 10.0
    thickness: float = 1.0
    length: float = 600.0
    young_modulus: float = 1000.0
    poisson_ratio: float = 0.3
    around: int = 24
    along: int = 60
    half: bool = False


@dataclass(frozen=True)
class Mesh:
    """Nodes by number (from 1), elements, and the numbers of both ends and of the cut y = 0."""

    nodes: dict[int, Array]
    elements: np.ndarray
    lower: list[int]
    upper: list[int]
    cut: list[int]


def mesh(tube: Tube) -> Mesh:
    """One layer of quadratic hexahedra."""
    columns, rows = 2 * tube.around, 2 * tube.along
    total = np.pi if tube.half else 2.0 * np.pi
    number: dict[tuple[int, int, int], int] = {}
    nodes: dict[int, Array] = {}
    for i in range(columns + (1 if tube.half else 0)):
        angle = total * i / columns
        for j in range(rows + 1):
            for k in range(3):
                if (i % 2) + (j % 2) + (k % 2) > 1:
                    continue
                number[i, j, k] = len(nodes) + 1
                r = tube.radius + 0.5 * tube.thickness * (k - 1)
                height = tube.length * j / rows
                nodes[len(nodes) + 1] = np.array([r * np.cos(angle), r * np.sin(angle), height])
    wrap = 10**9 if tube.half else columns
    elements = [
        [number[(i + a) % wrap, j + b, c] for a, b, c in LOCAL]
        for i in range(0, columns, 2)
        for j in range(0, rows, 2)
    ]
    lower, upper = ([n for (_, j, _), n in number.items() if j == end] for end in (0, rows))
    # The rigid end keeps its own part of the cut.
    cut = [n for (i, j, _), n in number.items() if tube.half and i in (0, columns) and j < rows]
    return Mesh(nodes, np.array(elements), lower, upper, cut)


def deck(tube: Tube, solid: Mesh, boundary: list[str], steps: list[str]) -> str:
    """The input: a rigid upper end that ROT turns and REF shifts, and `steps` of both."""
    ref = len(solid.nodes) + 1
    nodes = dict(solid.nodes)
    nodes[ref] = nodes[ref + 1] = np.array([0.0, 0.0, tube.length])
    parts = [
        '*HEADING\ntube with rigid ends',
        '*NODE,NSET=ALL\n' + calculix.node_lines(nodes),
        '*ELEMENT,TYPE=C3D20R,ELSET=WALL',
        calculix.element_lines(solid.elements),
        calculix.set_lines('LOWER', 'N', solid.lower),
        calculix.set_lines('UPPER', 'N', solid.upper),
        calculix.set_lines('REF', 'N', [ref]),
        calculix.set_lines('ROT', 'N', [ref + 1]),
        *([calculix.set_lines('CUT', 'N', solid.cut)] if solid.cut else []),
        f'*MATERIAL,NAME=WALL\n*ELASTIC\n{tube.young_modulus},{tube.poisson_ratio}',
        '*SOLID SECTION,ELSET=WALL,MATERIAL=WALL',
        f'*RIGID BODY,NSET=UPPER,REF NODE={ref},ROT NODE={ref + 1}',
        '*BOUNDARY',
        *boundary,
    ]
    for step in steps:
        parts += [
            '*STEP,NLGEOM,INC=200\n*STATIC\n1.,1.0,1e-4',
            f'*BOUNDARY\n{step}',
            '*NODE PRINT,NSET=LOWER\nU,RF',
            '*NODE PRINT,NSET=REF\nU\n*END STEP',
        ]
    return '\n'.join(parts) + '\n'


def _solved(tube: Tube, boundary: list[str], steps: list[str]) -> list[tuple[Array, Array, Array]]:
    """Of every step: places (n, 3) and forces (n, 3) of the lower end, shift (3,) of the upper."""
    solid = mesh(tube)
    tables = calculix.run(deck(tube, solid, boundary, steps), 'tube', 1800.0, partial=True)
    found = []
    for step in range(1, len(steps) + 1):
        time = min(tables, key=lambda at: abs(at - step))
        if abs(time - step) > 1e-6:
            break
        table = {(what.split()[0], name): rows for (what, name), rows in tables[time].items()}
        moved, force = table['displacements', 'LOWER'], table['forces', 'LOWER']
        places = np.array([solid.nodes[n] + moved[n] for n in solid.lower])
        forces = np.array([force[n] for n in solid.lower])
        (shift,) = table['displacements', 'REF'].values()
        found.append((places, forces, shift))
    return found


def twisted(tube: Tube, angles: Array) -> dict[str, Any]:
    """Torque (N mm) and shortening (mm) at turns of the upper end, free along the axis."""
    boundary = ['LOWER,1,3', 'REF,1,2', 'ROT,1,2']
    states = _solved(tube, boundary, [f'ROT,3,3,{angle:.12g}' for angle in angles])
    torque = [-float(np.cross(x, f)[:, 2].sum()) for x, f, _ in states]
    return {'torque': torque, 'shortening': [-float(shift[2]) for _, _, shift in states]}


def bent(tube: Tube, angles: Array) -> dict[str, Any]:
    """Moment (N mm) at turns of the upper end about y, free to shift; z = 0 is symmetric.

    The tube keeps y >= 0 alone: the moment of the whole is twice what is counted.
    """
    boundary = ['LOWER,3,3', 'CUT,2,2', 'REF,2,2', 'ROT,1,1', 'ROT,3,3', '1,1,1']
    states = _solved(tube, boundary, [f'ROT,2,2,{angle:.12g}' for angle in angles])
    moments = [2.0 * float((x[:, 0] * f[:, 2]).sum()) for x, f, _ in states]
    return {'moment': moments, 'thrust': [2.0 * float(f[:, 2].sum()) for _, f, _ in states]}


def limit_torque(tube: Tube) -> float:
    """Torque (N mm) of the lowest eigenvalue about the unstressed tube, its ends hinged.

    Rigid ends hold the middle of the wall, which may turn about it; the upper end is free along
    the axis.
    """
    solid = mesh(tube)
    lower, upper = (
        [n for n in end if abs(np.hypot(*solid.nodes[n][:2]) - tube.radius) < 1e-9 * tube.radius]
        for end in (solid.lower, solid.upper)
    )
    solid = replace(solid, lower=lower, upper=upper)
    text = deck(tube, solid, ['LOWER,1,3', 'REF,1,2', 'ROT,1,2'], [])
    text += f'*STEP\n*BUCKLE\n4\n*CLOAD\n{len(solid.nodes) + 2},3,1.\n*END STEP\n'
    with tempfile.TemporaryDirectory(prefix='ccx_') as folder:
        (Path(folder) / 'limit.inp').write_text(text)
        command = ['nice', '-n', '10', calculix.solver_path(), '-i', 'limit']
        subprocess.run(command, cwd=folder, capture_output=True, check=True, timeout=900)
        told = (Path(folder) / 'limit.dat').read_text()
    first = re.search(r'^\s+1\s+(\S+)\s*$', told, re.MULTILINE)
    if first is None:
        raise calculix.CalculixError('ccx found no eigenvalue of the twisted tube')
    return float(first.group(1))


def main() -> None:
    """Solve and keep."""
    turns = np.radians(np.arange(5.0, 61.0, 5.0))
    whole = Tube()
    kept: dict[str, Any] = {
        'source': f'CalculiX CrunchiX {calculix.solver_version()}, C3D20R, NLGEOM, rigid ends',
        'twist': _kept(whole, turns, twisted(whole, turns)),
    }
    cut = Tube(length=150.0, around=16, along=40, half=True)
    bends = np.radians(np.arange(3.0, 52.0, 3.0))
    kept['bend'] = _kept(cut, bends, bent(cut, bends))
    thin = Tube(10.0, 0.1, 20.0, 1e5, around=96, along=24)
    limit = _kept(thin, np.zeros(0), {})
    kept['limit'] = limit | {'torque_nm': float(f'{1e-3 * limit_torque(thin):.6g}')}
    del kept['limit']['turn_rad']
    KEPT.write_text(json.dumps(kept, indent=1) + '\n')


def _kept(tube: Tube, angles: Array, found: dict[str, list[float]]) -> dict[str, Any]:
    """SI; moments and torques from N mm."""
    count = min((len(values) for values in found.values()), default=0)
    scale = {'torque': 1e-3, 'moment': 1e-3, 'shortening': 1e-3, 'thrust': 1.0}
    unit = {'torque': 'nm', 'moment': 'nm', 'shortening': 'm', 'thrust': 'n'}
    return {
        'middle_radius_m': 1e-3 * tube.radius,
        'thickness_m': 1e-3 * tube.thickness,
        'length_m': 1e-3 * tube.length,
        'young_modulus_pa': 1e6 * tube.young_modulus,
        'poisson_ratio': tube.poisson_ratio,
        'turn_rad': angles[:count].round(9).tolist(),
        **{
            f'{name}_{unit[name]}': [float(f'{scale[name] * value:.8g}') for value in values]
            for name, values in found.items()
        },
    }


if __name__ == '__main__':
    main()
