# SPDX-License-Identifier: Apache-2.0
"""The two-finger ball and the sphere series: solid solutions kept as small files in SI units."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import yaml

from bags import axisymmetric, calculix, solid_shell
from bags.axisymmetric import Ball, Solution
from bags.calculix import Array

FOLDER = Path(__file__).parent / 'solid'
SHIPPED = (
    Path(__file__).parents[1]
    / 'ros2_ws/src/shell_deform/shell_deform/verification/solid_spheres.json'
)
SHIPPED_NUMBERS = (
    'radius_over_thickness',
    'outer_radius_m',
    'thickness_m',
    'young_modulus_pa',
    'poisson_ratio',
    'pin_radius_m',
)
TABLE = Path(__file__).parent / 'published' / 'table1.yaml'
# A pin that grows with the bending length sqrt(R h) keeps the same load shape for every R/h;
# 2 mm on the ball of R 31.25 mm and h 2.5 mm fixes the factor.
PIN_PER_BENDING_LENGTH = 2.0 / np.sqrt(31.25 * 2.5)


def published_rows(object_name: str) -> list[dict]:
    """The rows of the published table for one object."""
    return [
        row for row in yaml.safe_load(TABLE.read_text())['rows'] if row['object'] == object_name
    ]


def fit_young_modulus(ball: Ball, force: float, displacement: float) -> float:
    """Modulus (MPa) with which a pin force (N) dents the sealed ball by `displacement` (mm).

    Measured at mid-thickness under the pin; secant iteration on E, which the dent follows
    almost as 1/E.
    """
    moduli = [ball.young_modulus]
    dents: list[float] = []
    for _ in range(8):
        solution = axisymmetric.solve_sealed(
            replace(ball, young_modulus=moduli[-1]), np.array([force])
        )
        dents.append(float(solution.middle_displacement()[-1]))
        if abs(dents[-1] - displacement) < 1e-5:
            return moduli[-1]
        slope = (
            -dents[-1] / moduli[-1]
            if len(dents) == 1
            else (dents[-1] - dents[-2]) / (moduli[-1] - moduli[-2])
        )
        moduli.append(moduli[-1] - (dents[-1] - displacement) / slope)
    raise calculix.CalculixError('the modulus for the first published row was not found')


def profile(solution: Solution, nodes: np.ndarray, level: int | None) -> list[list[float]]:
    """(distance from the axis, height) in m of one row of nodes from pole to equator."""
    positions = solution.mesh.positions if level is None else solution.positions[level]
    return np.round(positions[nodes - 1] * 1e-3, 9).tolist()


def level_record(solution: Solution, level: int, profiles: bool) -> dict:
    """One load level as plain numbers."""
    record: dict[str, object] = {
        'force_n': float(solution.forces[level]),
        'gas_gauge_pressure_pa': round(float(solution.pressures[level]) * 1e6, 4),
        'volume_ratio': round(float(solution.volumes[level] / solution.rest_volume), 9),
        'middle_displacement_m': round(float(solution.middle_displacement()[level]) * 1e-3, 9),
        'outer_displacement_m': round(float(solution.outer_displacement()[level]) * 1e-3, 9),
    }
    if profiles:
        record['outer_profile_m'] = profile(solution, solution.mesh.outer, level)
        record['middle_profile_m'] = profile(solution, solution.mesh.middle, level)
    return record


def document(solution: Solution, what: str, gas: str, profiles: bool) -> dict:
    """Everything about one solved history that a reader needs, without the deck."""
    ball = solution.ball
    found = {
        'what': what,
        'label': 'synthetic truth: solid finite elements, no code shared with the shell solver',
        'solver': f'CalculiX CrunchiX {calculix.solver_version()}, CAX8R, neo-Hooke, NLGEOM',
        'outer_radius_m': ball.outer_radius * 1e-3,
        'thickness_m': ball.thickness * 1e-3,
        'young_modulus_pa': round(ball.young_modulus * 1e6, 1),
        'poisson_ratio': ball.poisson_ratio,
        'pin': ball.pin,
        'pin_radius_m': round(ball.pin_radius * 1e-3, 9),
        'gas': gas,
        'rest_volume_m3': round(solution.rest_volume * 1e-9, 15),
        'mesh': {key: value for key, value in asdict(ball).items() if key in _MESH_KEYS}
        | {'nodes': len(solution.mesh.positions), 'elements': len(solution.mesh.elements)},
    }
    if profiles:
        found['outer_rest_profile_m'] = profile(solution, solution.mesh.outer, None)
        found['middle_rest_profile_m'] = profile(solution, solution.mesh.middle, None)
    found['levels'] = [
        level_record(solution, level, profiles) for level in range(len(solution.forces))
    ]
    return found


_MESH_KEYS = ('across', 'pin_elements', 'growth', 'coarsest')


def keep(found: dict, deck: str, name: str) -> None:
    """Write the result and its input deck next to each other."""
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f'{name}.json').write_text(solid_shell.compact_json(found))
    calculix.keep_deck(deck, FOLDER / f'{name}.inp.gz')


def two_finger_forces() -> Array:
    """Pin forces (N) of the kept history: the published four and even steps, up to 33 N."""
    published = [row['force_n'] for row in published_rows('tennis_ball')]
    steps = np.concatenate([np.arange(1, 31) * 0.75, np.arange(24.0, 34.0, 1.5)])
    even = [force for force in steps if min(abs(force - np.array(published))) > 0.1]
    return np.sort(np.array([*even, *published]))


def two_finger_ball() -> None:
    """The ball of the recordings: E from published row 1, ambient air sealed in, rigid pin."""
    row = published_rows('tennis_ball')[0]
    ball = Ball(young_modulus=14.2)
    young = fit_young_modulus(ball, row['force_n'], row['measured_max_displacement_m'] * 1e3)
    ball = replace(ball, young_modulus=round(young, 3))
    solution = axisymmetric.solve_sealed(ball, two_finger_forces())
    found = document(
        solution,
        'tennis ball between two antipodal pins; E so that the first published force gives the '
        'first published displacement at mid-thickness under the pin',
        'ambient air 101325 Pa sealed in, isothermal, V0 inside the inner face',
        True,
    )
    keep(found, solution.deck, 'ball_two_finger')


def reference_curve_ball() -> Solution:
    """The ball of the reference table: E 1 MPa, no air, traction over 2 mm, up to 12.1 mm."""
    forces = np.array([0.05, 0.2, 0.3967, 0.55, 0.6725, 0.83, 0.9732, 1.13, 1.2716, 1.44, 1.6])
    return axisymmetric.solve(
        Ball(pin='traction', pin_radius=2.0, young_modulus=1.0), forces, np.zeros(len(forces))
    )


def sphere(ratio: float, middle_radius: float = 31.25) -> Ball:
    """A sphere of given R/h (middle surface) with E 1 MPa and the scaled pin."""
    thickness = middle_radius / ratio
    return Ball(
        outer_radius=middle_radius + thickness / 2,
        thickness=thickness,
        pin='traction',
        pin_radius=float(PIN_PER_BENDING_LENGTH * np.sqrt(middle_radius * thickness)),
        coarsest=float(0.12 * np.sqrt(middle_radius * thickness)),
    )


SPHERE_RATIOS = (6.0, 8.0, 12.5, 16.0, 25.0, 40.0, 66.0, 100.0)


def sphere_series(ratios: tuple[float, ...] = SPHERE_RATIOS) -> None:
    """Force-dent curves of spheres from thick to thin, up to w = 4.8 h or a third of R.

    On the thickest spheres the traction folds the surface of the solid before that; the curve
    then ends at the last load that has a solution.
    """
    for ratio in ratios:
        ball = sphere(ratio)
        dents = ball.thickness * np.array([0.02, 0.1, 0.25, 0.5, 1.0, 1.6, 2.4, 3.2, 4.0, 4.8])
        dents = dents[dents <= 31.25 / 3]
        solution = axisymmetric.solve(
            ball, _forces_for(ball, dents), np.zeros(len(dents)), partial=True
        )
        found = document(
            solution,
            f'sphere of R/h = {ratio:g} (middle surface), pin radius 0.2263 sqrt(R h) on the '
            'outer face; forces chosen so that the dents are near round multiples of h',
            'none',
            False,
        )
        found['radius_over_thickness'] = ratio
        keep(found, solution.deck, f'sphere_rh_{ratio:g}')
    SHIPPED.write_text(shipped_series())


def shipped_series() -> str:
    """The part of the kept series that `shell_verify --solid` compares with, as JSON."""
    spheres = []
    for ratio in SPHERE_RATIOS:
        kept = json.loads((FOLDER / f'sphere_rh_{ratio:g}.json').read_text())
        spheres.append(
            {
                **{key: kept[key] for key in SHIPPED_NUMBERS},
                'force_n': [level['force_n'] for level in kept['levels']],
                'displacement_m': [level['middle_displacement_m'] for level in kept['levels']],
            }
        )
    lines = ',\n  '.join(json.dumps(sphere) for sphere in spheres)
    return f'{{\n "source": "{kept["solver"]}",\n "spheres": [\n  {lines}\n ]\n}}\n'


def _forces_for(ball: Ball, dents: Array) -> Array:
    """Forces (N) near the wanted dents, from the reference curve F R / (E h^3) of w / h."""
    over_thickness = [0.0, 0.1, 0.4, 0.8, 1.6, 3.2, 4.8]
    reference = [0.0, 0.2, 0.793, 1.345, 1.946, 2.543, 3.187]
    scaled = np.interp(dents / ball.thickness, over_thickness, reference)
    radius = ball.outer_radius - ball.thickness / 2
    return scaled * ball.young_modulus * ball.thickness**3 / radius
