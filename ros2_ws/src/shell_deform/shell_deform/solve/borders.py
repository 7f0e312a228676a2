# SPDX-License-Identifier: Apache-2.0
"""The dense borders of a load case: what pushes, what measures, what is held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.thick import ThickShell
from shell_deform.contact.contact_field import ContactField, contact_field
from shell_deform.contact.loads import ContactPatch
from shell_deform.factor.base import Factor, FactorError
from shell_deform.factor.bordered import BorderedFactor
from shell_deform.model import ShellModel, Tangent, diagonal_entry
from shell_deform.solve.equilibrium import Equilibrium, LoadCase
from shell_deform.supports import GRIP_TOLERANCE, free_rigid_modes

Array = NDArray[np.float64]

# Stiffness of motions that only a touching pad prevents, over that of one dof: a tangent needs
# some before the pad touches; no residual contains it.
LOOSE_STIFFNESS = 1e-6


@dataclass(frozen=True)
class Borders:
    """Dense parts of the system for one load case; N = 3 n dofs, k contacts.

    Attributes:
        push: (N, k) nodal forces of unit pushes. measure: (N, k) rows of centre displacements.
        held: (N, h) rows kept at zero: held contacts, rigid motions that nothing else prevents.
        dead: (N,) other dead load [N]. driven: (k,) whether the displacement is prescribed and
            the push an unknown: pins only, since a pad pushes by itself.
        loose: (N, l) rigid motions that only the pads prevent, and only while they touch.
        field: the case's rigid bodies, in the order of its contacts, or None.
        pattern: (3 n, k) nodal forces on the control points that unit pushes amount to, where
            they work on other unknowns; None where that is `push`.
    """

    push: Array
    measure: Array
    held: Array
    dead: Array
    driven: NDArray[np.bool_]
    loose: Array
    field: ContactField | None = None
    pattern: Array | None = None

    @property
    def unknown_pushes(self) -> Array:
        """(N, d) patterns of the forces that are unknowns."""
        return self.push[:, self.driven]

    def started(self, present: Equilibrium) -> Borders:
        """The same, its bodies remembering the state from which a step starts."""
        if self.field is None:
            return self
        still = np.zeros((len(present.force), 6)) if present.motion is None else present.motion
        field = self.field.started(present.memory, present.unknowns, present.displacement, still)
        return replace(self, field=field)


def borders(model: ShellModel, case: LoadCase) -> Borders:
    """Rows and patterns of a load case, with the rigid motions nothing else prevents."""
    contacts = case.contacts
    size = model.start.shape
    count = 3 * len(model.start)
    push = np.zeros((count, len(contacts)))
    measure = np.zeros((count, len(contacts)))
    pattern = np.zeros((3 * len(model.rest), len(contacts)))
    held: list[Array] = []
    dead = np.zeros(size)
    for holder, force in zip(model.grips, case.grip_forces(len(model.grips)), strict=True):
        dead[: len(model.rest)] += holder.load(force)
    if case.dead_load is not None:
        dead[: len(case.dead_load)] += case.dead_load
    for i, contact in enumerate(contacts):
        if not case.padded[i]:
            pin = i - int(case.padded[:i].sum())
            push[:, i], measure[:, i] = pin_rows(model, pin, contact)
            pattern[:, i] = contact.force_pattern(contact.axis).reshape(-1)
        if case.held and not contact.slides and not _rubs(contact):
            held.extend(_padded(row, count) for row in contact.held_rows())
        if case.lateral is not None:
            dead[: len(model.rest)] += contact.force_pattern(case.lateral[i])
    rows = np.stack(held, axis=1) if held else np.zeros((count, 0))
    rows = _independent(rows)
    driven = case.driven & ~case.padded
    grip = np.concatenate([rows, measure[:, driven]], axis=1)
    left = free_rigid_modes(model.free_modes, grip, GRIP_TOLERANCE)
    loose = np.zeros((count, 0))
    pushed = [
        _padded(row, count)
        for i in np.flatnonzero(case.padded)
        for row in _barred(contacts[i], bool(case.driven[i]))
    ]
    if pushed and left.shape[1]:
        all_left = left
        left = free_rigid_modes(all_left, np.stack(pushed, axis=1), GRIP_TOLERANCE)
        # SciPy 1.11 knows no null space of a matrix without rows.
        taken = (all_left.T @ left).T
        loose = all_left @ scipy.linalg.null_space(taken) if len(taken) else all_left
    return Borders(
        push=push,
        measure=measure,
        held=np.concatenate([rows, left], axis=1),
        dead=dead.reshape(-1),
        driven=driven,
        loose=loose,
        field=_field(model, case),
        pattern=pattern if isinstance(model.shell, ThickShell) else None,
    )


def _rubs(contact: ContactPatch) -> bool:
    """Whether friction holds what this contact touches."""
    return contact.body is not None and contact.body.friction > 0.0


def _barred(contact: ContactPatch, driven: bool) -> list[Array]:
    """Motions (n, 3) of the shell that a rigid body bars while it touches."""
    rows = [contact.displacement_row()] if driven else []
    return [*rows, *contact.held_rows()] if _rubs(contact) else rows


def _field(model: ShellModel, case: LoadCase) -> ContactField | None:
    """The bodies of a load case, None without any."""
    bodies = {i: c.body for i, c in enumerate(case.contacts) if c.body is not None}
    if not bodies:
        return None
    return contact_field(model.outer_face, model.wall_stiffness, bodies, case.driven)


def pin_rows(model: ShellModel, number: int, contact: ContactPatch) -> tuple[Array, Array]:
    """What a unit push of pin `number` works on (N,), and its displacement as a row (N,).

    A wall is pushed and measured where the contact says, on its middle surface; where a thick one
    carries the pin, that is an unknown of its own, its travel.
    """
    count = 3 * len(model.start)
    if isinstance(model.shell, ThickShell) and model.shell.stamps:
        row = np.zeros(count)
        row[3 * (model.shell.first_pin + number)] = 1.0
        return row, row
    return (
        contact.force_pattern(contact.axis).reshape(-1),
        contact.displacement_row().reshape(-1),
    )


def _padded(row: Array, count: int) -> Array:
    """A row on the control points as one on all `count` unknowns."""
    return np.concatenate([row.reshape(-1), np.zeros(count - row.size)])


def bordered(
    model: ShellModel,
    tangent: Tangent,
    bordering: Borders,
    factorise: Callable[[sp.csr_matrix], Factor],
) -> BorderedFactor:
    """The system of a tangent: stiffness, and as borders unknown pushes and what is held.

    Low-rank updates carry what is dense (sealed gas, pads under given force, grips that may
    shift), what makes the
    tangent regular before a pad touches, and take back exactly the springs with which a free body
    is factorised.
    """
    matrix = model.shell.pattern.matrix(tangent.stiffness.data.copy())
    springs = model.springs
    diagonal = matrix.diagonal()
    positive = diagonal[diagonal > 0]
    if not len(positive):
        raise FactorError('nothing of the shell resists: the load is far too large')
    stiff = float(np.median(positive)) if len(springs) else 1.0
    for dof in springs:
        matrix.data[diagonal_entry(matrix, int(dof))] += stiff
    pins = np.zeros((len(tangent.gradient), len(springs)))
    pins[springs, np.arange(len(springs))] = 1.0
    updates = [pins, tangent.gas_row[:, None], bordering.loose, model.floated]
    strengths = [
        np.full(len(springs), -stiff),
        np.array([tangent.gas_stiffness]),
        np.full(bordering.loose.shape[1], LOOSE_STIFFNESS * stiff),
        np.full(model.floated.shape[1], -1.0),
    ]
    if tangent.pad_rows is not None and tangent.pad_corner is not None:
        updates.append(tangent.pad_rows)
        strengths.append(-1.0 / tangent.pad_corner)
    columns = np.concatenate([-bordering.unknown_pushes, bordering.held], axis=1)
    rows = np.concatenate([bordering.measure[:, bordering.driven], bordering.held], axis=1)
    return BorderedFactor(
        factorise(matrix),
        columns,
        update_vectors=np.concatenate(updates, axis=1),
        update_coefficients=np.concatenate(strengths),
        measures=None if np.array_equal(rows, columns) else rows,
    )


def negative_directions(system: BorderedFactor, bordering: Borders) -> int:
    """Negative directions of a factorised system with symmetric borders."""
    return system.inertia.negative - int(bordering.driven.sum()) - bordering.held.shape[1]


def _independent(rows: Array) -> Array:
    """Drop rows that supports already keep at zero."""
    norm = np.linalg.norm(rows, axis=0)
    return rows[:, norm > 1e-9 * max(1.0, float(norm.max(initial=0.0)))]
