# SPDX-License-Identifier: Apache-2.0
"""The grasp of each row of a report: does it close, with which friction, what does it lift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasp_replay.errors import BagError
from grasp_replay.experiment import Experiment
from grasp_replay.pipeline import Row
from grasp_replay.theories import TheorySet
from grasp_replay.touch_cells import carried_bodies, touch_document
from shell_deform.contact.bodies import BodyError
from shell_deform.contact.body_file import FingerBody
from shell_deform.contact.finger_bodies import of_finger
from shell_deform.contact.loads import ContactPatch
from shell_deform.factor.base import FactorError
from shell_deform.grasp.cone import ConeError
from shell_deform.grasp.contacts import GraspError
from shell_deform.grasp.mapping import BODY_STEPS
from shell_deform.grasp.measures import Doubt, Task, measure
from shell_deform.grasp.measures import Held as KnownGrasp
from shell_deform.grasp.reading import normal_sigma, wall_reader
from shell_deform.grasp.touching import read_grasp, read_response
from shell_deform.grasp.window import Limits
from shell_deform.model import ShellModel
from shell_deform.objects import ObjectError
from shell_deform.readout import wall_ratio
from shell_deform.solve.equilibrium import Equilibrium, forced
from shell_deform.solve.first_touch import FirstTouchError, first_touch
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import KOITER, THICK
from shell_deform.theory.thin_wall import WORTH_A_THICK_WALL, excess_stiffness

FRICTION, FRICTION_SIGMA = 0.5, 0.1
"""Where a recording does not tell it; what closure needs does not depend on it."""

POINT_SIGMA = 2e-4
STRAIN_LIMIT = 0.2


@dataclass(frozen=True)
class Held:
    """The grasp of a row on a shell that carries it."""

    theory: str
    model: ShellModel
    patches: tuple[ContactPatch, ...]
    state: Equilibrium


def grasp_document(shell: TheorySet, row: Row, experiment: Experiment) -> dict[str, Any]:
    """Measures of the row's grasp on the shape that theory gives, or why there are none.

    Of the thick wall where that is worth it: the normals of a thin one turn too far. Fingers that
    carried bodies press with these, whatever carried the row's surface.
    """
    friction = FRICTION if experiment.friction is None else experiment.friction
    sigma = experiment.friction_sigma
    task = Task(experiment.mass, experiment.down, FRICTION_SIGMA if sigma is None else sigma)
    try:
        if experiment.finger_body:
            bodies = carried_bodies(experiment.finger_body)
            held = _by_bodies(shell, row, bodies, friction)
        else:
            held = _by_pins(shell, row)
        if isinstance(held, str):
            return {'failed': held}
        told = _measured(shell, row, held, friction, task)
        contacts = row.contacts
        if experiment.finger_body and contacts.cells:
            fingers = contacts.finger.tolist()
            told['touch'] = touch_document(fingers, held.state.touches, bodies, contacts.cells)
        return told
    except (
        BagError, ObjectError, BodyError, FirstTouchError, FactorError, ConeError, GraspError
    ) as error:  # fmt: skip
        return {'failed': str(error)}


def _by_pins(shell: TheorySet, row: Row) -> Held | str:
    """The row's own equilibrium, or why there is none."""
    theory = KOITER
    if excess_stiffness(wall_ratio(shell.model)) > WORTH_A_THICK_WALL:
        solid = row.solved.get(THICK)
        if solid is not None and solid.surface is not None:
            theory = THICK
    state = row.solved[theory].state
    if state is None or not state.converged:
        return row.solved[theory].message
    model = shell.models[theory]
    patches = row.patches
    if theory == THICK:
        patches = tuple(model.contact(p.point, p.radius, p.axis) for p in patches)
        model = model.on_contacts(patches)
    return Held(theory, model, patches, state)


def _by_bodies(
    shell: TheorySet, row: Row, bodies: Mapping[int, FingerBody], friction: float
) -> Held | str:
    """The thin shell under the row's pushes by bodies, each along the normal of its finger."""
    model, contacts = shell.model, row.contacts
    along = np.broadcast_to(contacts.along, contacts.normal.shape)
    at = contacts.point - np.nan_to_num(contacts.travel)[:, None] * contacts.normal
    patches = []
    for k, number in enumerate(contacts.finger.tolist()):
        body = of_finger(bodies, number)
        if body is None:
            return f'finger {number} carries no body in experiment.yaml'
        tip = along[k] if np.isfinite(along[k]).all() else None
        patches.append(
            model.touched_by(
                body.shape, at[k], body.size, tip, friction, towards=contacts.normal[k]
            )
        )
    solver = EquilibriumSolver(model)
    alone, touch = first_touch(solver, tuple(patches))
    state = replace(alone, force=np.zeros(len(patches)), displacement=touch)
    for share in np.linspace(0.0, 1.0, BODY_STEPS + 1)[1:].tolist():
        state = solver.solve(forced(tuple(patches), share * contacts.push), state)
        if not state.converged:
            return state.message
    return Held(KOITER, model, tuple(patches), state)


def _measured(
    shell: TheorySet, row: Row, held: Held, friction: float, task: Task
) -> dict[str, Any]:
    model, patches, state = held.model, held.patches, held.state
    count = len(patches)
    grasp, solver = read_grasp(model, patches, state, friction), EquilibriumSolver(model)
    response = read_response(solver, patches, state, grasp)
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
    wall = wall_reader(model, patches).at(state.unknowns, state.force, state.displacement)
    limit = shell.shell.yield_stress_pa
    limits = Limits(
        stress=wall.stress / limit if limit else 0.0, strain=wall.strain / STRAIN_LIMIT
    )
    known = KnownGrasp(
        response.centre, response.sharing, response.compliance, state.energy, limits,
        response.slipping,
    )  # fmt: skip
    doubt = Doubt(
        np.asarray(row.contacts.sigma, float),
        np.zeros(count),
        np.full(count, POINT_SIGMA),
        np.full(count, normal_sigma(model)),
    )
    told = measure(grasp, known, task, doubt).to_json()
    return {
        'theory': held.theory,
        'friction_given': friction,
        'friction_sigma_given': task.friction_sigma,
        'mass_given_kg': task.mass,
        **told,
        'largest_stress_pa': wall.stress,
        'largest_strain': wall.strain,
        'stress_sigma_pa': wall.stress * wall.doubt,
        'stress_unresolved': wall.unresolved,
        'yields': None if limit is None else bool(wall.stress > limit),
        'dent_push_n': float(row.force * limit / wall.stress) if limit and wall.stress else None,
    }
