# SPDX-License-Identifier: Apache-2.0
"""The response of a shell that rigid bodies touch, with who touches and who slips as they are.

The same inputs and outputs as for pins (`condensed`): a push is that of a body along its axis, a
lateral motion that of the body, a displacement its depth. The depths are eliminated: every body
may give way along its axis until its push is what it is said to be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.contact.contact_field import ContactField, Press, Touch
from shell_deform.grasp.reading import body_loads
from shell_deform.grasp.touching import Standing, standing_loads
from shell_deform.live.background.condensed import (
    HELD_ROWS,
    LATERAL_ROWS,
    Condensed,
    GripColumns,
    grip_loads,
    shared_solution,
)
from shell_deform.solve.borders import bordered, borders, negative_directions
from shell_deform.solve.contact_step import touched_tangent
from shell_deform.solve.equilibrium import Equilibrium, LoadCase
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import Known

Array = NDArray[np.float64]

LOOSE = 1e-3
"""What a body that is said to touch, but carries nothing, gives way [m/N]."""


@dataclass(frozen=True)
class Touched:
    """Columns about an equilibrium, and what the factorisation tells beside.

    Attributes:
        condensed: columns. rigid: (r,) amplitudes of the rigid motions there that nothing
            prevents. negative: directions of negative stiffness while pushes are given.
        standing: what wrenches do while all bodies stand still; None where these do not hold.
        grips: what grips do.
    """

    condensed: Condensed
    rigid: Array
    negative: int
    standing: Standing | None
    grips: GripColumns

    def stable(self, driven: NDArray[np.bool_]) -> bool:
        """Whether there are none while the depths of the `driven` (k,) bodies are given.

        By Haynsworth every negative compliance takes one of them away.
        """
        block = self.condensed.displacement[np.ix_(driven, np.flatnonzero(driven))]
        values = np.linalg.eigvalsh(0.5 * (block + block.T)) if len(block) else np.zeros(0)
        return self.negative <= int(np.sum(values < 0.0))


@dataclass(frozen=True)
class _Motions:
    """How the bodies' motions along three axes each take part; k bodies, N dofs.

    Attributes:
        rows: (k, N, 3) minus nodal forces per motion along the axis and two lateral directions.
        corner: (k, 3, 3) what the bodies themselves need for it. pressing: (k,) who presses.
    """

    rows: Array
    corner: Array
    pressing: NDArray[np.bool_]


def touches_of(solver: EquilibriumSolver, case: LoadCase, state: Equilibrium) -> tuple[Touch, ...]:
    """The contacts of a state, also where it was found carried as it was."""
    if state.touches:
        return state.touches
    bordering = borders(solver.model, case).started(state)
    assert bordering.field is not None
    motion = case.motions if state.motion is None else state.motion
    press = bordering.field.press(state.unknowns, state.displacement, state.force, motion)
    return press.touches


def condense(
    solver: EquilibriumSolver,
    case: LoadCase,
    state: Equilibrium,
    mass: sp.csr_matrix | None,
    near: Known | None = None,
) -> Touched:
    """Columns of an equilibrium under a case whose contacts are all bodies.

    `mass` (n, n) of the wall, over which wrenches on the object are spread; None where the bodies
    let it move whatever they do. By the tangent there, or by one that is known `near` it: with who
    touched and slipped then.
    """
    count = len(case.contacts)
    free = replace(case, force=np.zeros(count), displacement=np.full(count, np.nan))
    bordering = borders(solver.model, free)
    assert bordering.field is not None
    touches = state.touches if near is None else near.press.touches
    motions = _motions(bordering.field, touches, state.unknowns.size, case)
    pressing = np.flatnonzero(motions.pressing)
    depth = motions.rows[pressing, :, 0].T
    corner = motions.corner[pressing, 0, 0]
    if near is None:
        press = Press(
            touches, np.zeros_like(state.unknowns), state.force, state.displacement, depth,
            corner, pressing, np.zeros(count),
        )  # fmt: skip
        tangent = touched_tangent(solver.model.tangent(state.unknowns), bordering.field, press)
        elastic = tangent.gradient + tangent.gas_pressure * tangent.gas_row
        system = solver.system(tangent, bordering)
    else:
        tangent = replace(near.tangent, pad_rows=depth, pad_corner=corner)
        elastic = tangent.gradient - near.press.gradient.reshape(-1)
        elastic = elastic + tangent.gas_pressure * tangent.gas_row
        system = bordered(solver.model, tangent, bordering, lambda _: near.factor)
    held = bordering.held.shape[1]
    r = _rigid_rows(bordering.held, solver.model.free_modes)
    loads, below, moved = _unit_inputs(motions, elastic, held, r)
    inputs, by_grips = loads.shape[1], grip_loads(solver.model)
    loads = np.concatenate([loads, by_grips], axis=1)
    below = np.pad(below, ((0, 0), (0, by_grips.shape[1])))
    moved = np.pad(moved, ((0, 0), (0, 0), (0, by_grips.shape[1])))
    eliminated = -depth @ (moved[pressing, 0] / corner[:, None])
    centre, carried, still = np.zeros(3), np.zeros((0, 0)), np.zeros((len(elastic), 0))
    if mass is not None:
        centre, carried = body_loads(mass, state.positions)
        still = standing_loads(bordering.field.face, touches, carried, len(elastic))
    fields, multipliers = system.solve(
        np.concatenate([loads + eliminated, still], axis=1),
        np.concatenate([below, np.zeros((held, still.shape[1]))], axis=1),
        refinements=0,
    )
    unit = loads.shape[1]
    answers = _outputs(motions, fields[:, :unit], multipliers[:, :unit], moved, corner, r, count)
    columns, grips = _part(answers, slice(0, inputs)), _part(answers, slice(inputs, unit))
    standing = None
    if mass is not None:
        # Bodies push as much more as brings them back to where they stand, what is rigid is
        # balanced.
        moving = [*pressing, *range(inputs - r - 1, inputs - 1)]
        by = np.concatenate([columns.displacement[pressing], columns.rigid_reaction])[:, moving]
        away = (depth.T @ fields[:, unit:]) / corner[:, None]
        given = shared_solution(by, np.concatenate([away, multipliers[held - r :, unit:]]))
        standing = Standing(
            centre,
            carried,
            fields[:, unit:] + fields[:, moving] @ given,
            multipliers[:, unit:] + multipliers[:, moving] @ given,
        )
    return Touched(
        columns,
        bordering.held[:, held - r :].T @ (state.unknowns - solver.model.start).reshape(-1),
        negative_directions(system, bordering),
        standing,
        GripColumns(grips.fields, grips.displacement, grips.reaction, grips.rigid_reaction),
    )


def _part(columns: Condensed, which: slice) -> Condensed:
    """Some of the columns."""
    return Condensed(
        columns.fields[:, which],
        columns.displacement[:, which],
        columns.held[:, which],
        columns.rigid_reaction[:, which],
    )


def _rigid_rows(held: Array, modes: Array) -> int:
    """How many of the held rows (N, h), the last, are rigid motions that nothing prevents."""
    beside = np.linalg.norm(held - modes @ (modes.T @ held), axis=0)
    return int(np.sum(beside < 1e-6 * np.linalg.norm(held, axis=0)))


def _motions(
    field: ContactField, touches: tuple[Touch, ...], size: int, case: LoadCase
) -> _Motions:
    """From the contacts as they are told, on `size` unknowns."""
    count = len(case.contacts)
    rows, corner = np.zeros((count, size, 3)), np.zeros((count, 3, 3))
    pressing = np.zeros(count, dtype=bool)
    for k, (touch, contact) in enumerate(zip(touches, case.contacts, strict=True)):
        if not len(touch.pressure):
            continue
        axes = np.stack([contact.axis, *contact.lateral], axis=1)
        stiff = touch.weights[:, None, None] * (touch.stiffness @ axes)
        for a in range(3):
            rows[k, :, a] = -field.face.forces(touch.face, stiff[:, :, a]).reshape(-1)
        corner[k] = axes.T @ stiff.sum(axis=0)
        pressing[k] = corner[k, 0, 0] > 0.0
    return _Motions(rows, corner, pressing)


def _unit_inputs(
    motions: _Motions, elastic: Array, held: int, r: int
) -> tuple[Array, Array, Array]:
    """Unit inputs: loads (N, j), constraint values (held, j), and for bodies (k, 3, j).

    Those are the push along the axis that a body lacks, then its lateral motions.
    """
    count = len(motions.rows)
    inputs = (1 + LATERAL_ROWS) * count + r + 1
    loads, below = np.zeros((len(elastic), inputs)), np.zeros((held, inputs))
    moved = np.zeros((count, 3, inputs))
    for k in range(count):
        moved[k, 0, k] = 1.0
        for a in range(LATERAL_ROWS):
            j = count + LATERAL_ROWS * k + a
            moved[k, 1 + a, j] = 1.0
            loads[:, j] -= motions.rows[k, :, 1 + a]
            moved[k, 0, j] = -motions.corner[k, 0, 1 + a]
    for i in range(r):
        below[held - r + i, (1 + LATERAL_ROWS) * count + i] = 1.0
    loads[:, -1] = -elastic
    return loads, below, moved


def _outputs(
    motions: _Motions,
    fields: Array,
    multipliers: Array,
    moved: Array,
    corner: Array,
    r: int,
    count: int,
) -> Condensed:
    """Depths, lateral forces and rigid reactions of solved columns (N, j)."""
    depth = LOOSE * np.eye(count, fields.shape[1])
    pressing = np.flatnonzero(motions.pressing)
    along = motions.rows[pressing, :, 0] @ fields
    depth[pressing] = (moved[pressing, 0] - along) / corner[:, None]
    motion = np.concatenate([depth[:, None], moved[:, 1:]], axis=1)
    motion[~motions.pressing, 0] = 0.0
    lateral = np.einsum('kab,kbj->kaj', motions.corner, motion)[:, 1:]
    lateral = lateral + np.einsum('kna,nj->kaj', motions.rows[:, :, 1:], fields)
    held = len(multipliers) - r
    holding = np.zeros((count, HELD_ROWS, fields.shape[1]))
    if held == HELD_ROWS * count:
        # What no friction holds is held in place, by the finger that touches it.
        holding = multipliers[:held].reshape(count, HELD_ROWS, -1).copy()
    holding[:, :LATERAL_ROWS] -= lateral
    return Condensed(fields, depth, holding.reshape(HELD_ROWS * count, -1), -multipliers[held:])
