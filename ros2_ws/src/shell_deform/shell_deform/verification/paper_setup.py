# SPDX-License-Identifier: Apache-2.0
"""The paper's set-up beside the whole ball, its minimiser beside Newton's method.

Section V of the paper gives every finger its own subdivision patch of 45 x 45 mm on the ball, its
rim unmoved, and minimises by conjugate gradients. The two patches are mirror images, so one is
solved. E 1 MPa as printed; results scale with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import discretise
from shell_deform.building import build_model, object_contacts
from shell_deform.model import ShellModel
from shell_deform.solve.conjugate_gradient import minimise
from shell_deform.solve.equilibrium import LoadCase, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import clamp, joined
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import grid_surface
from shell_deform.verification.linear_course import unheld
from shell_deform.verification.problem import stopwatch, used_vertices
from shell_deform.verification.spheres import PIN_RADIUS, pinched_sphere

Array = NDArray[np.float64]

RADIUS, THICKNESS, YOUNG, POISSON = 31.25e-3, 2.5e-3, 1e6, 0.5
SIDE = 45e-3
X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class SetupRow:
    """One set-up solved one way: depth of the contact [m] under a force [N]."""

    setup: str
    method: str
    theory: str
    force: float
    depth: float
    vertices: int
    cpu_seconds: float


def patch(cells: int = 18, theory: str = 'paper') -> ShellModel:
    """One 45 x 45 mm patch with a clamped rim, sides measured along the sphere."""

    def cap(s: Array, t: Array) -> Array:
        a, b = SIDE * (s - 0.5), SIDE * (t - 0.5)
        arc = np.hypot(a, b)
        share = np.sinc(arc / (np.pi * RADIUS))
        return np.stack([a * share, b * share, RADIUS * np.cos(arc / RADIUS)], axis=1)

    grid = grid_surface(cap, (cells, cells))
    shell = discretise(grid.mesh, Material(YOUNG, POISSON), THICKNESS)
    rims = [('s0', X), ('s1', -X), ('t0', Y), ('t1', -Y)]
    held = [row for side, inward in rims for row in clamp(shell, grid.edge(side), inward)]
    return ShellModel(shell, theory, supports=joined(held))


def compare(force: float = 0.5, theory: str = 'paper', cells: int = 18) -> Iterator[SetupRow]:
    """The patch and the whole ball under one force [N], each by both methods."""
    model = patch(cells, theory)
    contact = model.contact(RADIUS * Z, PIN_RADIUS)
    yield from _both('45 x 45 mm patch', model, unheld(forced((contact,), [force])))
    ball = pinched_sphere(RADIUS, THICKNESS, YOUNG, POISSON, PIN_RADIUS)
    whole = build_model(ball, theory)
    pins = object_contacts(ball, whole)
    yield from _both('whole ball', whole, forced(pins, [force] * len(pins)))


def _both(setup: str, model: ShellModel, case: LoadCase) -> Iterator[SetupRow]:
    force, vertices = float(case.force[0]), used_vertices(model)
    with stopwatch() as watch:
        state = EquilibriumSolver(model).solve(case)
    depth = float(state.displacement[0])
    yield SetupRow(setup, 'Newton', model.theory, force, depth, vertices, watch.seconds)
    with stopwatch() as watch:
        found = minimise(model, case)
    depth = float(found.displacement[0])
    name = 'conjugate gradients'
    yield SetupRow(setup, name, model.theory, force, depth, vertices, watch.seconds)
