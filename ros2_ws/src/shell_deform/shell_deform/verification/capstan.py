# SPDX-License-Identifier: Apache-2.0
"""A strip pulled around a rigid rod until it slips: the ratio of its tensions is exp(mu theta).

The strip lies on an arc of the rod and leaves it straight on both sides, where grips hold its
ends. The rod tightens it a little, then one end is pulled. Euler's formula (1769) is exact for a
strip that is thin against the rod. The tension of a strip of wall h acts at R' = R + h / 2, half a
wall off the face that rubs: with constant curvature a shear force Q = mu p R h / (2 R') balances
the moment of friction, dT / dtheta = mu p R - Q, and p R = T - dQ / dtheta. So the exponent is
mu theta (R / R') / (1 + mu^2 h R / (2 R'^2)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import discretise
from shell_deform.contact.bodies import Body, rod
from shell_deform.contact.loads import contact_patch
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium, LoadCase
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports.grips import grip
from shell_deform.supports.springs import hold_position
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import GridSurface, grid_surface
from shell_deform.verification.problem import Verified, stopwatch

Array = NDArray[np.float64]

ROD, WALL, WIDTH, LEAD = 0.02, 4e-4, 5e-3, 8e-3
ARC = np.radians(120.0)
FRICTIONS = (0.1, 0.3, 0.5, 0.8)
GOAL = 0.01
SOURCE = 'exp(mu theta), L. Euler 1769, of a strip with a wall: exact'
MATERIAL = Material(1e9, 0.0)
# The rod is pushed against the strip, then an end is pulled in steps until nothing sticks [m].
PUSHES, PULL, MOST_PULLS = (1e-6, 3e-6, 1e-5, 2e-5, 4e-5), 2e-5, 50
ALONG_Y = np.array([0.0, 1.0, 0.0])


def _radial(angle: float | Array) -> Array:
    return np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=-1)


def _tangent(angle: float | Array) -> Array:
    return np.stack([-np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


def strip(cells: tuple[int, int]) -> GridSurface:
    """Its middle surface about the y axis, the outer face towards the rod."""
    radius = ROD + 0.5 * WALL
    arc = radius * ARC

    def place(s: Array, t: Array) -> Array:
        way = -LEAD + s * (arc + 2.0 * LEAD)
        angle = np.clip(way, 0.0, arc) / radius
        beyond = way - angle * radius
        return (
            radius * _radial(angle)
            + beyond[:, None] * _tangent(angle)
            + (WIDTH * (t - 0.5))[:, None] * ALONG_Y
        )

    return grid_surface(place, cells)


def pulled(cells: tuple[int, int], friction: float) -> tuple[ShellModel, Equilibrium]:
    """The strip whose end is pulled until all of it slips."""
    grid = strip(cells)
    shell = discretise(grid.mesh, MATERIAL, WALL)
    ends = [hold_position(shell, grid.edge(side), np.eye(3)) for side in ('s0', 's1')]
    places = shell.surface.limit_positions(grid.mesh.vertices)
    grips = tuple(
        grip(name, shell, [rows], places[grid.edge(side)].mean(axis=0))
        for name, rows, side in (('held', ends[0], 's0'), ('pulled', ends[1], 's1'))
    )
    model = ShellModel(shell, grips=grips)
    out = _radial(0.5 * ARC)
    frame = np.stack([ALONG_Y, np.cross(out, ALONG_Y), out], axis=1)
    body = Body(rod(ROD, 4.0 * WIDTH), ROD * out, frame, out, friction)
    patch = contact_patch(shell.surface, ROD * out, 0.2 * WIDTH, out)
    contact = replace(patch, body=body)
    solver = EquilibriumSolver(model)
    state = solver.rest()
    way = [(push, 0.0) for push in PUSHES]
    way += [(PUSHES[-1], PULL * (k + 1)) for k in range(MOST_PULLS)]
    for push, pull in way:
        motion = np.zeros((2, 6))
        motion[1, :3] = pull * _tangent(ARC)
        state = solver.solve(
            LoadCase((contact,), np.array([np.nan]), np.array([push]), grip_motion=motion), state
        )
        slips = pull > PULL and not any(touch.sticking.any() for touch in state.touches)
        if slips or not state.converged:
            break
    return model, state


def exact(friction: float) -> float:
    """The ratio of the tensions of a strip of this wall."""
    middle = ROD + 0.5 * WALL
    less = 1.0 + friction**2 * 0.5 * WALL * ROD / middle**2
    return float(np.exp(friction * ARC * ROD / middle / less))


def problems(
    cells: tuple[int, int] = (48, 1), frictions: tuple[float, ...] = FRICTIONS
) -> Iterator[Verified]:
    """The ratio of the tensions of the strip that slips all over."""
    for friction in frictions:
        with stopwatch() as watch:
            model, last = pulled(cells, friction)
        held, drawn = (wrench[:3] for wrench in last.grip_wrench)
        ratio = float(np.linalg.norm(drawn) / np.linalg.norm(held)) if last.converged else np.nan
        yield Verified(
            f'strip_on_a_cylinder_{friction:g}', 'ratio of the tensions',
            exact(friction), SOURCE, ratio,
            len(model.rest), watch.seconds, GOAL,
        )  # fmt: skip
