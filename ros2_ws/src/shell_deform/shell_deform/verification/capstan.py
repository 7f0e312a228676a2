# SPDX-License-Identifier: Apache-2.0
"""A strip pulled around a rigid rod until it slips: the ratio of its tensions is exp(mu theta).

The strip lies on an arc of the rod and leaves it straight on both sides, where grips hold its
ends. Euler's formula (1769) is exact for a strip that is thin against the rod.
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

ROD, WALL, WIDTH, LEAD = 0.02, 1e-4, 5e-3, 8e-3
ARC = np.radians(120.0)
FRICTION = 0.3
MATERIAL = Material(1e9, 0.0)
# The end is pulled in these steps [m]: the strip slips all over from the first third on.
PULLS = 1e-4 * np.arange(1, 9)
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


def pulled(cells: tuple[int, int]) -> tuple[ShellModel, list[Equilibrium]]:
    """States while one end is pulled."""
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
    body = Body(rod(ROD, 4.0 * WIDTH), ROD * out, frame, out, FRICTION)
    patch = contact_patch(shell.surface, ROD * out, 0.2 * WIDTH, out)
    contact = replace(patch, body=body)
    solver, states, state = EquilibriumSolver(model), [], None
    for pull in PULLS:
        motion = np.zeros((2, 6))
        motion[1, :3] = pull * _tangent(ARC)
        case = LoadCase((contact,), np.array([np.nan]), np.zeros(1), grip_motion=motion)
        state = solver.solve(case, state)
        states.append(state)
        if not state.converged:
            break
    return model, states


def problems(cells: tuple[int, int] = (72, 2)) -> Iterator[Verified]:
    """The ratio of the tensions of the strip that slips all over."""
    with stopwatch() as watch:
        model, states = pulled(cells)
    last = states[-1]
    held, drawn = (wrench[:3] for wrench in last.grip_wrench)
    ratio = float(np.linalg.norm(drawn) / np.linalg.norm(held)) if last.converged else np.nan
    yield Verified(
        'strip_on_a_cylinder', 'ratio of the tensions', float(np.exp(FRICTION * ARC)),
        'exp(mu theta), L. Euler 1769: exact', ratio, len(model.rest), watch.seconds, 0.01,
    )  # fmt: skip
