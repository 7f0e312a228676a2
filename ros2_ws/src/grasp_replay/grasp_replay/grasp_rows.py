# SPDX-License-Identifier: Apache-2.0
"""The grasp of each row of a report: does it close, with which friction, what does it lift."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from grasp_replay.pipeline import Row
from grasp_replay.theories import TheorySet
from shell_deform.factor.base import FactorError
from shell_deform.grasp.cone import ConeError
from shell_deform.grasp.measures import Doubt, Held, Task, measure
from shell_deform.grasp.reading import normal_sigma, read_contacts, read_response, wall_reader
from shell_deform.grasp.window import Limits
from shell_deform.readout import wall_ratio
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import KOITER, THICK
from shell_deform.theory.thin_wall import WORTH_A_THICK_WALL, excess_stiffness

FRICTION, FRICTION_SIGMA = 0.5, 0.1
"""No recording holds it; what closure needs does not depend on it."""

POINT_SIGMA = 2e-4
STRAIN_LIMIT = 0.2


def grasp_document(shell: TheorySet, row: Row) -> dict[str, Any]:
    """Measures of the row's grasp on the shape that theory gives, or why there are none.

    Of the thick wall where that is worth it: the normals of a thin one turn too far.
    """
    theory = KOITER
    if excess_stiffness(wall_ratio(shell.model)) > WORTH_A_THICK_WALL:
        solid = row.solved.get(THICK)
        if solid is not None and solid.surface is not None:
            theory = THICK
    state = row.solved[theory].state
    if state is None or not state.converged:
        return {'failed': row.solved[theory].message}
    model = shell.models[theory]
    patches = row.patches
    if theory == THICK:
        patches = tuple(model.contact(p.point, p.radius, p.axis) for p in patches)
        model = model.on_contacts(patches)
    count = len(patches)
    grasp = read_contacts(model, patches, state, FRICTION)
    felt = row.contacts.felt
    if felt is not None:
        # A wall that has relaxed is pressed with less at the same shape: all of it goes down.
        share = felt / row.contacts.push
        grasp = replace(
            grasp,
            push=share * grasp.push,
            tangential=share[:, None] * grasp.tangential,
            spin=share * grasp.spin,
        )
    try:
        response = read_response(EquilibriumSolver(model), patches, state, grasp)
        wall = wall_reader(model, patches).at(state.unknowns, state.force, state.displacement)
        limit = shell.shell.yield_stress_pa
        limits = Limits(
            stress=wall.stress / limit if limit else 0.0, strain=wall.strain / STRAIN_LIMIT
        )
        held = Held(response.centre, response.sharing, response.compliance, state.energy, limits)
        doubt = Doubt(
            np.asarray(row.contacts.sigma, float),
            np.zeros(count),
            np.full(count, POINT_SIGMA),
            np.full(count, normal_sigma(model)),
        )
        told = measure(grasp, held, Task(friction_sigma=FRICTION_SIGMA), doubt).to_json()
    except (FactorError, ConeError) as error:
        return {'failed': str(error)}
    return {
        'theory': theory,
        'friction_given': FRICTION,
        'friction_sigma_given': FRICTION_SIGMA,
        **told,
        'largest_stress_pa': wall.stress,
        'largest_strain': wall.strain,
        'stress_sigma_pa': wall.stress * wall.doubt,
        'stress_unresolved': wall.unresolved,
        'yields': None if limit is None else bool(wall.stress > limit),
        'dent_push_n': float(row.force * limit / wall.stress) if limit and wall.stress else None,
    }
