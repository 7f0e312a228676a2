# SPDX-License-Identifier: Apache-2.0
"""Balls of several R/h between two rigid pins as solids: forces and outer faces, kept in one file.

What `shell_verify --group thick` compares theory `thick` with. Every ball is solved again with
elements half as large at the rim of the pin, and elsewhere: kept is how much it changed. One ball
has a Mooney-Rivlin wall instead of a neo-Hookean one of the same E: what the law costs.
`python -m bags.solid_faces` solves them anew (needs ccx, about a quarter of an hour).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from bags import axisymmetric, calculix
from bags.axisymmetric import Ball
from bags.calculix import Array
from bags.solid_ball import sphere

KEPT = (
    Path(__file__).parents[1]
    / 'ros2_ws/src/shell_deform/shell_deform/verification/solid_faces.json'
)
# Load steps of the solver.
STEPS = 12
# Smallest elements, at the pin's rim, over its radius; how they grow; the widest over the wall.
CORNER, GROWTH, WIDEST_ACROSS = 1.0 / 12.0, 1.35, 0.14
# Smallest elements over these, one after the other while deep states are missing.
CORNERS = (1.0, 2.0, 4.0)
# Nodes of the outer face that are kept: the face is smooth beyond the pin.
KEPT_NODES = 60


@dataclass(frozen=True)
class Pinned:
    """One ball: R/h, the radius of its pins [mm], the pushes [N] at which it is kept (E 1 MPa).

    `mooney_share`: of C01 in C10 + C01, usual rubbers have some 0.2.
    """

    ratio: float
    pin_radius: float
    forces: tuple[float, ...]
    mooney_share: float = 0.0


@dataclass(frozen=True)
class Level:
    """A state [mm]: rest arc (n,) of the outer nodes, travel of the pin, where they are (n, 2)."""

    arc: Array
    travel: float
    face: Array

    def at(self, arc: Array) -> Array:
        """(m, 2) the outer face at rest arcs (m,)."""
        return np.asarray(CubicSpline(self.arc, self.face)(arc))


BALLS = (
    Pinned(12.5, 1.0, (0.1, 0.1988333, 0.3965, 0.897875, 1.12225, 1.45665)),
    Pinned(12.5, 2.0, (0.1, 0.3965, 0.897875, 1.12225, 1.45665)),
    Pinned(6.0, 2.0, (0.4340278, 1.7264058, 5.2822989, 7.2764757)),
    Pinned(8.0, 2.0, (0.2246094, 0.9503164, 2.7763062, 3.9029999, 4.5224457)),
    Pinned(25.0, 1.0, (0.0199125, 0.0750925, 0.1384156, 0.189125, 0.2877)),
    Pinned(12.5, 1.0, (0.1, 0.1988333, 0.3965, 0.897875, 1.12225, 1.45665), 0.2),
)


def ball_of(pinned: Pinned, corner: float = 1.0, elsewhere: float = 1.0) -> Ball:
    """The ball between rigid pins; elements at the pin's rim and elsewhere over the usual ones."""
    ball = sphere(pinned.ratio)
    smallest = corner * CORNER * pinned.pin_radius
    growth, widest = GROWTH**elsewhere, elsewhere * WIDEST_ACROSS * ball.thickness
    upper = np.cumsum(axisymmetric.graded(0.5 * ball.thickness, smallest, growth, widest)[::-1])
    lower = np.linspace(0.0, 0.5, int(np.ceil(0.5 * ball.thickness / widest)) + 1)
    return replace(
        ball,
        pin='rigid',
        pin_radius=pinned.pin_radius,
        across=(*lower.tolist(), *(0.5 + upper[:-1] / ball.thickness).tolist(), 1.0),
        growth=growth,
        coarsest=elsewhere * ball.coarsest,
        corner=smallest,
        mooney_share=pinned.mooney_share,
    )


def solve(ball: Ball, forces: tuple[float, ...]) -> list[Level]:
    """Its states under the pushes, as far as the solver comes; on the way in steps it can take."""
    between = [f for f in np.linspace(0.0, forces[-1], STEPS + 1)[1:]
               if np.min(np.abs(f - np.array(forces))) > 0.2 * forces[-1] / STEPS]  # fmt: skip
    way = np.sort([*forces, *between])
    found = axisymmetric.solve(ball, way, np.zeros(len(way)), timeout=1500.0, partial=True)
    outer = found.mesh.outer - 1
    rest = found.mesh.positions[outer]
    arc = np.arctan2(rest[:, 0], rest[:, 1]) * ball.outer_radius
    travel = found.outer_displacement()
    return [
        Level(arc, float(travel[k]), found.positions[k][outer])
        for k in np.searchsorted(way, forces)
        if k < len(found.positions)
    ]


def record(pinned: Pinned) -> dict[str, Any]:
    """One ball with how much it changes with finer elements at the pin's rim, and elsewhere, SI.

    The rim's own field is singular: on small elements the surface folds there from some depth on,
    and the solver ends; deeper states are those of larger ones.
    """
    ball = ball_of(pinned)
    usual: list[Level] = []
    for corner in CORNERS:
        usual += solve(ball_of(pinned, corner), pinned.forces)[len(usual) :]
        if len(usual) == len(pinned.forces):
            break
    finer = {
        'rim': solve(ball_of(pinned, corner=0.5), pinned.forces),
        'elsewhere': solve(ball_of(pinned, elsewhere=0.5), pinned.forces),
    }
    nodes = usual[0].arc
    arc = nodes[np.unique(np.linspace(0, len(nodes) - 1, KEPT_NODES).round().astype(int))]
    slope = np.gradient(np.array(pinned.forces[: len(usual)]), [level.travel for level in usual])
    levels: list[dict[str, object]] = []
    for k, level in enumerate(usual):
        kept: dict[str, object] = {
            'travel_m': round(1e-3 * level.travel, 9),
            'force_n': pinned.forces[k],
            'face_m': np.round(1e-3 * level.at(arc), 8).tolist(),
        }
        for where, found in finer.items():
            if k < len(found):
                moved = found[k].travel - level.travel
                distance = np.linalg.norm(level.at(arc) - found[k].at(arc), axis=1)
                kept[f'force_change_finer_{where}'] = round(
                    float(-moved * slope[k] / pinned.forces[k]), 6
                )
                kept[f'face_change_finer_{where}_m'] = round(
                    1e-3 * float(np.quantile(distance, 0.95)), 9
                )
        levels.append(kept)
    return {
        'radius_over_thickness': pinned.ratio,
        'middle_radius_m': round(1e-3 * (ball.outer_radius - 0.5 * ball.thickness), 9),
        'thickness_m': round(1e-3 * ball.thickness, 9),
        'pin_radius_m': 1e-3 * ball.pin_radius,
        'young_modulus_pa': 1e6 * ball.young_modulus,
        'poisson_ratio': ball.poisson_ratio,
        'mooney_share': ball.mooney_share,
        'arc_m': np.round(1e-3 * arc, 9).tolist(),
        'levels': levels,
    }


def main() -> None:
    """Solve and keep."""
    kept = {
        'source': f'CalculiX CrunchiX {calculix.solver_version()}, CAX8R, axisymmetric '
        'neo-Hookean solid, all outer nodes within the rest arc of the pin moved alike along the '
        'axis; made by bags/solid_faces.py',
        'refined': 'relative change of the force at equal travel, and of the face at equal force, '
        'with elements half as large at the rim of the pin, and everywhere else; states without '
        'such a number fold on those',
    }
    balls = []
    for pinned in BALLS:
        print(f'R/h {pinned.ratio:g} under {pinned.pin_radius:g} mm', flush=True)
        balls.append(record(pinned))
        for level in balls[-1]['levels']:
            print({key: one for key, one in level.items() if key != 'face_m'}, flush=True)
    KEPT.write_text(json.dumps({**kept, 'balls': balls}) + '\n')


if __name__ == '__main__':
    main()
