# SPDX-License-Identifier: Apache-2.0
"""Theory `thick` where a wall is thin: it becomes Koiter's, on the same mesh under the same load.

What is left is the dent that the shear of the wall adds under the load, in proportion to h / R;
what a locking element would add does not fall with it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.thick import thick_shell
from shell_deform.building import build_model, object_contacts
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import LoadCase
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import KOITER, THICK
from shell_deform.theory.material import Material
from shell_deform.verification.linear_course import first_order
from shell_deform.verification.problem import Verified, stopwatch
from shell_deform.verification.spheres import pinched_sphere, reissner_slope

Array = NDArray[np.float64]

RADIUS, YOUNG, POISSON = 0.1, 1e9, 0.3
PATCH = 0.5
"""Radius of the loaded patches over sqrt(R h): wider than any wall is thick."""

GOALS = {100.0: 1e-2, 1000.0: 1e-3}
DEEP_PUSH = 1.0
"""Large force over h times Reissner's slope: it dents three walls."""


def problems(control_vertices: int = 1600) -> Iterator[Verified]:
    """A sphere between two patches of dead load: a small dent, and one of three walls."""
    for ratio, goal in GOALS.items():
        yield from _sphere(ratio, goal, control_vertices)


def _sphere(ratio: float, goal: float, control_vertices: int) -> Iterator[Verified]:
    wall = RADIUS / ratio
    ball = pinched_sphere(
        RADIUS, wall, YOUNG, POISSON, PATCH * np.sqrt(RADIUS * wall), control_vertices
    )
    thin = build_model(ball)
    patches = object_contacts(ball, thin)
    material = Material(YOUNG, POISSON)
    thick = thick_shell(thin.shell.mesh, material, wall, everywhere=True)
    push = np.add.reduce([patch.force_pattern(patch.axis) for patch in patches])
    unit = reissner_slope(RADIUS, wall, YOUNG, POISSON)

    def dent(motion: Array) -> float:
        points = motion[: len(thin.rest)]
        return float(np.mean([patch.centre @ points @ patch.axis for patch in patches]))

    found, seconds = {}, 0.0
    for theory, model in ((KOITER, thin), (THICK, ShellModel(thick, THICK))):
        with stopwatch() as watch:
            small = dent(first_order(model, _dead(push))) * unit
            state = EquilibriumSolver(model).solve(_dead(DEEP_PUSH * unit * wall * push))
            large = dent(state.positions - model.rest) / wall if state.converged else np.nan
        found[theory], seconds = (small, large), watch.seconds
    name = f'thick_thin_sphere_rh_{ratio:g}'
    source = 'own: theory koiter on the same mesh'
    for k, quantity in enumerate(
        ('small dent x slope / force', 'dent over h under a large force')
    ):
        yield Verified(
            name, quantity, found[KOITER][k], source, found[THICK][k], len(thin.rest),
            seconds, goal,
        )  # fmt: skip


def _dead(load: Array) -> LoadCase:
    return LoadCase((), np.zeros(0), np.zeros(0), held=False, dead_load=load)
