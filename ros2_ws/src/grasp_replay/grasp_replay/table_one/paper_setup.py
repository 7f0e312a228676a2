# SPDX-License-Identifier: Apache-2.0
"""(g) The paper's own set-up for the ball: its patches, its theory, its minimiser, its 7 %.

Section V gives each finger a subdivision patch of 45 x 45 mm with an unmoved rim; the two are
mirror images, so one is solved. The air is not modelled there. The sentence 'within 7 % of each
other' is read as the mean error in per cent of the largest displacement.
"""

from __future__ import annotations

from typing import Any

from grasp_replay.table_one.ball import Rows
from shell_deform.solve.conjugate_gradient import minimise
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.verification.linear_course import unheld
from shell_deform.verification.paper_setup import RADIUS, SIDE, YOUNG, Z, patch
from shell_deform.verification.problem import used_vertices

THEORY = 'paper'


def paper_setup(rows: Rows, published: list[dict[str, float]], pin: float) -> dict[str, Any]:
    """Both solvers on one patch, with the modulus of row one; forces with the printed modulus."""
    model = patch(theory=THEORY)
    contact = (model.contact(RADIUS * Z, pin),)
    solver = EquilibriumSolver(model)
    state, carried = solver.rest(), []
    for depth in rows.displacement:
        state = solver.solve(unheld(displaced(contact, [depth])), state)
        carried.append(float(state.force[0]))
    # without air every force is proportional to the modulus
    ratio = float(rows.force[0]) / carried[0]
    state, newton, gradients = solver.rest(), [], []
    for force in rows.force:
        case = unheld(forced(contact, [force / ratio]))
        state = solver.solve(case, state)
        found = minimise(model, case)
        newton.append(float(state.displacement[0]))
        gradients.append(
            {
                'displacement_m': float(found.displacement[0]),
                'converged': bool(found.converged),
                'iterations': found.iterations,
                'initial_radius_m': found.radius,
            }
        )
    return {
        'patch_side_m': SIDE,
        'theory': THEORY,
        'pin_radius_m': pin,
        'control_vertices': used_vertices(model),
        'printed_young_modulus_pa': YOUNG,
        'force_with_printed_modulus_n': carried,
        'young_modulus_pa': YOUNG * ratio,
        'displacement_m': newton,
        'relative_error': [
            found / true - 1.0 for found, true in zip(newton, rows.displacement, strict=True)
        ],
        'conjugate_gradients': gradients,
        'published_error_over_displacement': [
            {
                'nonlinear': row['nonlinear_mean_error_m'] / row['measured_max_displacement_m'],
                'linear': row['linear_mean_error_m'] / row['measured_max_displacement_m'],
            }
            for row in published
        ],
    }
