# SPDX-License-Identifier: Apache-2.0
"""The stress that begins a dent: elastic aluminium balls between two pins, as solids.

Largest von Mises stress at both faces of the wall. Lengths in mm, forces in N, stresses in MPa
inside; results are kept in SI units.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bags import axisymmetric, calculix
from bags.axisymmetric import Ball, Mesh
from bags.calculix import Array

KEPT = (
    Path(__file__).parents[1]
    / 'ros2_ws/src/shell_deform/shell_deform/verification/solid_dents.json'
)


@dataclass(frozen=True)
class Case:
    """R/h, pin radius [mm], radius of the middle surface [mm], modulus [MPa], Poisson's ratio."""

    ratio: float
    pin_radius: float
    radius: float = 31.25
    young: float = 7e4
    poisson: float = 0.33


CASES = (
    (50.0, 2.0), (50.0, 1.0), (50.0, 0.625), (25.0, 2.5), (25.0, 1.875), (12.5, 3.75),
    (100.0, 0.625), (100.0, 2.0), (200.0, 1.0), (200.0, 0.3125),
)  # fmt: skip
"""R/h and pin radius [mm] of the balls by which the limits of what is resolved were chosen."""
HELD_OUT = (
    Case(40.0, 1.5, 20.0, 2.1e5, 0.3),
    Case(70.0, 1.2, 45.0, 3e3, 0.4),
    Case(30.0, 4.0, 45.0, 1.1e4, 0.45),
    Case(20.0, 3.2, 20.0, 2.1e5, 0.3),
    Case(140.0, 0.8, 45.0, 7e4, 0.2),
    Case(15.0, 5.0, 40.0, 3e3, 0.4),
)
"""Other walls, pins, metals and plastics: scored once, when the limits stood."""
LEVELS = (0.04, 0.4, 1.2, 2.0, 3.0, 4.5)
"""Pushes over E h^3 / R: dents of a hundredth of the wall to several walls."""
GAUSS = 1.0 / np.sqrt(3.0)


def ball_of(case: Case) -> Ball:
    """The ball, nine elements under its pin."""
    wall = case.radius / case.ratio
    return replace(
        Ball(),
        outer_radius=case.radius + 0.5 * wall, thickness=wall, young_modulus=case.young,
        poisson_ratio=case.poisson, pin_radius=case.pin_radius, pin='traction', pin_elements=9,
        coarsest=float(0.15 * np.sqrt(case.radius * wall)),
    )  # fmt: skip


def gauss_stresses(text: str, elements: int) -> list[Array]:
    """(elements, 8, 6) stresses [MPa] at the integration points, at the end of each step."""
    steps: list[Array] = []
    reading = False
    for line in text.splitlines():
        if line.startswith(' stresses'):
            time = float(line.split()[-1])
            reading = abs(time - round(time)) < 1e-6
            if reading:
                steps.append(np.full((elements, 8, 6), np.nan))
        elif line.strip() and not line.strip()[0].isdigit():
            reading = False
        elif reading and line.strip():
            fields = line.split()
            steps[-1][int(fields[0]) - 1, int(fields[1]) - 1] = [float(x) for x in fields[2:8]]
    return steps


def face_stress(mesh: Mesh, ball: Ball, stress: Array, outer: bool) -> float:
    """Largest von Mises stress [MPa] at a face, carried there from the points next to it.

    CalculiX makes bricks of axisymmetric elements; of their points the odd ones lie deeper.
    """
    rows = len(ball.across) - 1
    last = stress.reshape(-1, rows, 8, 6)[:, -1 if outer else 0]
    inner_level, outer_level = (last[:, i::2].mean(axis=1) for i in (0, 1))
    middle, slope = 0.5 * (inner_level + outer_level), 0.5 * (outer_level - inner_level) / GAUSS
    face = middle + slope if outer else middle - slope
    xx, yy, zz, xy, xz, yz = face.T
    equivalent = np.sqrt(
        0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (xy**2 + xz**2 + yz**2)
    )
    return float(equivalent.max())


def record(case: Case) -> dict[str, object]:
    """One ball, SI."""
    ball = ball_of(case)
    mesh = axisymmetric.build_mesh(ball)
    forces = np.array(LEVELS) * case.young * ball.thickness**3 / case.radius
    text = axisymmetric.deck(ball, mesh, forces, np.zeros(len(forces)))
    text = text.replace('*END STEP', '*EL PRINT,ELSET=WALL\nS\n*END STEP')
    found = calculix.printed(text.replace('0.5,1.0,1e-4', '1.0,1.0,1e-4'), 'dent', partial=True)
    stresses = gauss_stresses(found, len(mesh.elements))
    return {
        'radius_over_thickness': case.ratio,
        'middle_radius_m': 1e-3 * case.radius,
        'pin_radius_m': 1e-3 * case.pin_radius,
        'young_modulus_pa': 1e6 * case.young,
        'poisson_ratio': case.poisson,
        'levels': [
            {
                'force_n': round(float(force), 6),
                'outer_stress_pa': round(1e6 * face_stress(mesh, ball, stress, True), 1),
                'inner_stress_pa': round(1e6 * face_stress(mesh, ball, stress, False), 1),
            }
            for force, stress in zip(forces, stresses, strict=False)
        ],
    }


def main() -> None:
    """Solve and keep."""
    kept = {
        'source': f'CalculiX CrunchiX {calculix.solver_version()}, CAX8R, elastic (neo-Hookean) '
        'solid, pin as an even traction; stress carried from the integration points to the face; '
        'made by bags/solid_dents.py',
        'balls': [record(Case(*case)) for case in CASES],
        'held_out': [record(case) for case in HELD_OUT],
    }
    KEPT.write_text(json.dumps(kept, indent=1) + '\n')


if __name__ == '__main__':
    main()
