# SPDX-License-Identifier: Apache-2.0
"""Shells off the axis beside solids with the same numbers: three fingers, the cup, the half can.

`python -m bags.off_axis` drives Koiter's and the thick wall to the travel of the solid's rigid
pins, with the solid's own modulus and Poisson's ratio and nothing fitted, and prints force and
outer face; `--solve` makes the solids of cup and can under rigid pins anew, and that of the ball
with four elements through its wall (needs ccx).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bags import solid_can, solid_cup, solid_shell, solid_three_fingers
from bags.axisymmetric import ball_of
from bags.live_bias import BAGS, DENT, along_normals
from bags.surfaces import ShellTruth
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

THEORIES = ('koiter', 'thick')
BALL_FORCES = (4.0, 8.5, 11.5, 13.0, 14.5, 16.0)
CUP_FORCES = (0.25, 1.0, 2.0, 4.0, 6.0)
CAN_FORCES = (0.1, 0.3, 0.5, 0.756197674594285)


# The kept solids and the objects of their shells.
SOLIDS = {
    'ball_three_finger': str(BAGS / 'tennis_ball_three_finger' / 'object.yaml'),
    'ball_three_finger_layered': str(BAGS / 'tennis_ball_three_finger' / 'object.yaml'),
    'off_axis_cup_rigid': str(BAGS / 'cup_off_axis' / 'object.yaml'),
    'half_soda_can_rigid': 'half_soda_can',
}


@dataclass(frozen=True)
class Beside:
    """A shell at the travel of a solid.

    Attributes:
        travel: of the pins [m]. force: relative error. error: (n,) of the outer face along the
            normals, beyond the pins [m]. dent: (n,) in the dents.
    """

    travel: float
    force: float
    error: Array
    dent: NDArray[np.bool_]


def beside(name: str, theory: str) -> Iterator[Beside]:
    """One shell at every kept level of its solid.

    A thick wall's pins act on its outer face, those of a thin one on its middle surface. As in the
    solid, they slide sideways freely where supports keep the object in place.
    """
    truth = ShellTruth(name)
    told = truth.data
    radius = told['contacts'][0]['radius_m']
    shell = with_material(
        load_object(SOLIDS[name]), told['young_modulus_pa'], told['poisson_ratio']
    )
    model = build_model(shell, theory, refine_radius=radius)
    pins = object_contacts(shell, model, radius, pins_slide=bool(shell.supports))
    solver = EquilibriumSolver(model)
    state = solver.rest()
    for level, push in zip(told['levels'], truth.forces[1:].tolist(), strict=True):
        kind = 'outer' if theory == 'thick' else 'middle'
        travel = level[f'{kind}_displacement_m'][0]
        state = solver.solve(displaced(pins, [travel] * len(pins)), state)
        if not state.converged:
            raise SystemExit(f'{name}, {theory}, {1e3 * travel:.2f} mm: {state.message}')
        used = solver.model
        active = np.unique(used.shell.mesh.triangles[used.shell.mesh.active])
        rest = used.shell.outer_face(used.start)[active]
        now = used.shell.outer_face(state.unknowns)[active]
        beyond = np.min(
            [np.linalg.norm(rest - np.array(one.at_m), axis=1) for one in shell.contacts], axis=0
        )
        seen = beyond > 1.05 * radius
        error, _ = along_normals(now[seen], truth.surface(push))
        moved = np.linalg.norm(now - rest, axis=1)
        force = float(state.force.mean()) / push - 1.0
        yield Beside(travel, force, error, moved[seen] > DENT * moved.max())


def solve() -> None:
    """The ball in layers; cup and can with pins as rigid stamps, which slide sideways."""
    coarse = ShellTruth('ball_three_finger').data
    gas = [1e-6 * level['gas_gauge_pressure_pa'] for level in coarse['levels']]
    guess = np.interp(BALL_FORCES, [level['force_n'] for level in coarse['levels']], gas)
    solid_three_fingers.layered_ball(
        ball_of(coarse), 'ball_three_finger_layered', np.array(BALL_FORCES), guess
    )
    for model, forces, name in (
        (solid_can.model(solid_can.HalfCan()), CAN_FORCES, 'half_soda_can_rigid'),
        (solid_cup.model(solid_cup.Cup()), CUP_FORCES, 'off_axis_cup_rigid'),
    ):
        pins = tuple(replace(contact, kind='rigid') for contact in model.contacts)
        history = solid_shell.solve(
            replace(model, contacts=pins), np.array(forces), timeout=5400.0
        )
        solid_shell.keep(history, name)
        print(name, flush=True)


def main() -> int:
    """Print the table, or solve the solids."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('solid', nargs='*', default=list(SOLIDS), help=f'of {", ".join(SOLIDS)}')
    parser.add_argument('--solve', action='store_true', help='the solids of cup and can')
    options = parser.parse_args()
    if options.solve:
        solve()
        return 0
    unknown = sorted(set(options.solid) - set(SOLIDS))
    if unknown:
        parser.error(f'no solid {", ".join(unknown)}; there are {", ".join(SOLIDS)}')
    print(
        '| solid | theory | travel [mm] | force | dent, mean [mm] | face, 95 % | largest |\n'
        '|---|' + 6 * '---|'
    )
    for name in options.solid:
        for theory in THEORIES:
            for one in beside(name, theory):
                size = np.abs(one.error)
                found = [one.error[one.dent].mean(), np.quantile(size, 0.95), size.max()]
                told = ' | '.join(f'{1e3 * value:.3f}' for value in found)
                print(
                    f'| {name} | {theory} | {1e3 * one.travel:.2f} | {100 * one.force:+.1f} % '
                    f'| {told} |',
                    flush=True,
                )
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
