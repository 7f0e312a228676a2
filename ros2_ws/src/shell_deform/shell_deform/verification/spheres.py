# SPDX-License-Identifier: Apache-2.0
"""Squeezed spheres: an independent axisymmetric solution, and closed forms under pressure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from shell_deform.building import build_model, object_contacts
from shell_deform.objects import Contact, ShellObject
from shell_deform.objects.shell_object import Sphere
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.verification.problem import Verified, references, stopwatch

MILLI = 1e-3
# Strain measures of the reference cases and ours.
CASES = {
    'koiter_disc2_nu0.5': 'koiter',
    'koiter_disc2_nu0.49': 'koiter',
    'novozhilov_disc2_nu0.5': 'paper_restored',
    'paper_disc2_nu0.5': 'paper',
}
PIN_RADIUS = 2e-3
FORCE_GOAL = 5e-3
PRESSURE_GOAL = 1e-2
# Pin radius over sqrt(R h): small, since the closed form is for a point force.
PIN_SHARE = 0.025


def pinched_sphere(
    radius: float,
    thickness: float,
    young: float,
    poisson: float,
    pin_radius: float,
    vertices: int = 650,
) -> ShellObject:
    """A sphere of middle radius [m] with two opposite pins on its x axis."""
    outer = radius + 0.5 * thickness
    pins = tuple(Contact((sign * outer, 0.0, 0.0), pin_radius, 'pin') for sign in (1.0, -1.0))
    return ShellObject(
        name='sphere',
        surface=Sphere(2.0 * outer),
        thickness_m=thickness,
        young_modulus_pa=young,
        poisson_ratio=poisson,
        contacts=pins,
        control_vertices=vertices,
    )


def mission_sphere(case: str, rows: int | None = None) -> Iterator[Verified]:
    """Force at the tabulated displacements of one case, E 1 MPa; at the first `rows` only."""
    sphere = references()['mission_sphere']
    table = sphere['cases'][case]
    data = table['data'][:rows]
    with stopwatch() as watch:
        ball = pinched_sphere(
            sphere['R'] * MILLI, sphere['h'] * MILLI, sphere['E'] * 1e6, table['nu'], PIN_RADIUS
        )
        model = build_model(ball, CASES[case])
        contacts = object_contacts(ball, model)
        solver = EquilibriumSolver(model)
        state = solver.rest()
        forces = []
        for row in data:
            state = solver.solve(displaced(contacts, [row[0] * MILLI] * 2), state)
            forces.append(float(state.force[0]) if state.converged else np.nan)
    source = 'own: axisymmetric shell solution (verification/axisymmetric.py)'
    slope = forces[0] / data[0][0]
    yield Verified(
        f'mission_sphere_{case}', 'initial slope [N/mm]',
        data[0][2] / data[0][0], source, slope,
        len(model.rest), watch.seconds, FORCE_GOAL,
    )  # fmt: skip
    for row, force in zip(data, forces, strict=True):
        yield Verified(
            f'mission_sphere_{case}', f'force at {row[0]:g} mm [N]', row[2], source, force,
            len(model.rest), watch.seconds, FORCE_GOAL,
        )  # fmt: skip


def reissner_slope(radius: float, thickness: float, young: float, poisson: float) -> float:
    """Stiffness [N/m] of a shallow sphere under a point force (Reissner 1946)."""
    return 4.0 * young * thickness**2 / (radius * np.sqrt(3.0 * (1.0 - poisson**2)))


def pressurised_slope_ratio(tension: float) -> float:
    """Stiffness of a pressurised over an unpressurised shallow sphere, at tension tau.

    tau = p R^2 / (4 sqrt(E h B)), B the bending stiffness. Vella, Ajdari, Vaziri & Boudaoud,
    J. R. Soc. Interface 9:448 (2012), doi 10.1098/rsif.2011.0352.
    """
    if tension > 1.0:
        root = np.sqrt(1.0 - tension**-2)
        return float(0.5 * np.pi * np.sqrt(tension**2 - 1.0) / np.arctanh(root))
    if tension == 1.0:
        return float(0.5 * np.pi)
    root = np.sqrt(1.0 / max(tension, 1e-12) ** 2 - 1.0)
    return float(0.5 * np.pi * np.sqrt(1.0 - tension**2) / np.arctan(root))


def pressurised_sphere(tension: float, radius_over_thickness: float = 1000.0) -> Verified:
    """Initial slope under a small pin of a thin sphere blown up by a constant pressure."""
    young, poisson, radius = 1e9, 0.3, 0.1
    thickness = radius / radius_over_thickness
    bending = young * thickness**3 / (12.0 * (1.0 - poisson**2))
    pressure = 4.0 * tension * np.sqrt(young * thickness * bending) / radius**2
    with stopwatch() as watch:
        ball = pinched_sphere(
            radius, thickness, young, poisson, PIN_SHARE * np.sqrt(radius * thickness), 1600
        )
        model = replace(build_model(ball), pressure=pressure)
        contacts = object_contacts(ball, model)
        solver = EquilibriumSolver(model)
        blown = solver.solve(forced(contacts, [0.0, 0.0]))
        push = 1e-4 * reissner_slope(radius, thickness, young, poisson) * thickness
        pushed = solver.solve(forced(contacts, [push, push]), blown)
        slope = push / float(np.mean(pushed.displacement - blown.displacement))
    return Verified(
        'pressurised_sphere', f'slope [N/m] at tau {tension:g}',
        pressurised_slope_ratio(tension) * reissner_slope(radius, thickness, young, poisson),
        'Vella et al. 2012, doi 10.1098/rsif.2011.0352', slope, len(model.rest), watch.seconds,
        PRESSURE_GOAL,
    )  # fmt: skip


def problems() -> Iterator[Verified]:
    """The mission sphere under each strain measure, and spheres under pressure."""
    for case in CASES:
        yield from mission_sphere(case)
    for tension in (0.5, 2.0, 5.0):
        yield pressurised_sphere(tension)
