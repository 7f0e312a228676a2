# SPDX-License-Identifier: Apache-2.0
"""The mission's ball between two rigid plates: theory `thick` beside a solid with contact."""

from __future__ import annotations

from collections.abc import Iterator

from shell_deform.building import build_model, object_contacts
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import THICK
from shell_deform.verification.plates import kept_solution, squeezed_sphere
from shell_deform.verification.problem import Verified, stopwatch

GOAL = 0.03
"""A few contact points make up the first touch."""


def problems(control_vertices: int = 1000) -> Iterator[Verified]:
    """Force at each depth of the kept solution up to one wall."""
    kept = kept_solution('solid_thick_plates')
    ball = squeezed_sphere(kept)
    depths = [depth for depth in kept['depth_m'] if depth <= kept['thickness_m']]
    with stopwatch() as watch:
        model = build_model(ball, THICK, control_vertices=control_vertices)
        plates = object_contacts(ball, model)
        cases = [displaced(plates, [depth, depth]) for depth in depths]
        states = EquilibriumSolver(model).sweep(cases)
    for depth, force, state in zip(depths, kept['force_n'], states, strict=False):
        yield Verified(
            'thick_ball_between_plates', f'force at {1e3 * depth:g} mm', force, kept['source'],
            float(state.force[0]) if state.converged else float('nan'), len(model.rest),
            watch.seconds / len(states), GOAL,
        )  # fmt: skip
