# SPDX-License-Identifier: Apache-2.0
"""What a thin wall leaves out of a thick one: `python tests/benchmarks/thin_wall_sigma.py`.

Balls under two rigid pins by Koiter's theory at the travel of kept finite-element solids, with
their modulus: the distance of the outer faces over the sigma that the live solver states for it
(`shear_dent`: a formula without a fitted number, whose form was chosen with these balls in view).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from figures import Row, show
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from shell_deform.building import build_model, object_contacts
from shell_deform.live.background.shear_dent import ShearDent
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import KOITER
from shell_deform.verification.spheres import pinched_sphere
from shell_deform.verification.thick_balls import kept_solids, name_of, vertex_areas

LEVEL = 1.645
DENT = 0.1


def rows() -> Iterator[Row]:
    """One row a travel of every ball, then all together."""
    gathered: list[np.ndarray] = []
    for ball in kept_solids()['balls']:
        if ball['mooney_share']:
            continue
        sphere = pinched_sphere(
            ball['middle_radius_m'], ball['thickness_m'], ball['young_modulus_pa'],
            ball['poisson_ratio'], ball['pin_radius_m'], 650,
        )  # fmt: skip
        model = build_model(sphere, KOITER)
        pins, solver = object_contacts(sphere, model), EquilibriumSolver(model)
        known = ShearDent(model)
        axis, area, state = pins[0].axis, vertex_areas(model.shell.mesh), None
        rest = model.surface.limit_positions(model.rest)
        off_axis = np.linalg.norm(rest - np.outer(rest @ axis, axis), axis=1)
        beyond = off_axis > 1.02 * ball['pin_radius_m']
        fine = np.linspace(0.0, ball['arc_m'][-1], 6000)
        for level in ball['levels']:
            travel = level['travel_m']
            state = solver.solve(displaced(pins, [travel] * len(pins)), state)
            middle = model.surface.limit_positions(state.positions)
            normals = model.surface.vertex_normals(state.positions)
            outer = middle + 0.5 * ball['thickness_m'] * normals
            along = np.abs(outer @ axis)
            across = np.linalg.norm(outer - np.outer(outer @ axis, axis), axis=1)
            meridian = CubicSpline(np.array(ball['arc_m']), np.array(level['face_m']))(fine)
            off, _ = cKDTree(meridian).query(np.column_stack([across, along]))
            moved = np.linalg.norm(middle - rest, axis=1)
            less = travel - known.travel(state.force, np.full(2, ball['pin_radius_m']))
            bent = solver.solve(displaced(pins, less), state)
            field = middle - model.surface.limit_positions(bent.positions)
            sigma = np.abs(np.einsum('ni,ni->n', normals, field))
            ratio = off / np.maximum(sigma, 1e-9)
            dent = beyond & (moved > DENT * moved.max())
            gathered.append(np.column_stack((ratio, area))[dent])
            yield Row(
                f'{name_of(ball)}, {1e3 * travel:.2f} mm',
                f'largest {1e3 * off[dent].max():.3f} mm of {1e3 * sigma[dent].max():.3f} sigma; '
                + shares(gathered[-1]),
            )
    yield Row('all', shares(np.concatenate(gathered)), 'within 90 % level: 90 %')


def shares(parts: np.ndarray) -> str:
    """Share of the area of the dents within the 90 % level, and rms, of (n, 2) ratio and area."""
    ratio, area = parts.T
    inside = float(area[ratio < LEVEL].sum() / area.sum())
    rms = float(np.sqrt(area @ ratio**2 / area.sum()))
    return f'{100 * inside:.0f} % of the dent within 1.645 sigma, rms {rms:.2f}'


if __name__ == '__main__':
    sys.exit(int(show(rows()) > 0))
