# SPDX-License-Identifier: Apache-2.0
"""The response of a loaded shell about one equilibrium, condensed to a few inputs.

The fast tick may not solve the full system, so the background process does it once per state: it
factorises the tangent there and keeps what a handful of inputs do to the surface:

    push      extra force [N] along the axis of each contact,
    lateral   motion [m] of each held patch along its two lateral directions (slip, pin mounting),
    rigid     amplitude of each rigid motion that neither supports nor held contacts prevent,
    modulus   relative change of Young's modulus, loads unchanged.

and what they do to the outputs: displacement of each contact centre along its axis, lateral
reactions of the held patches, generalised reactions of the rigid motions (zero in equilibrium).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.shell_points import csr_matrix_of
from shell_deform.contact.loads import ContactPatch
from shell_deform.factor.analysis import Factor
from shell_deform.factor.bordered import BorderedFactor
from shell_deform.model import ShellModel, Tangent, diagonal_entry
from shell_deform.solve.borders import pin_rows
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import GRIP_TOLERANCE, free_rigid_modes

Array = NDArray[np.float64]

SAME = 1e-10
"""Singular values below this share of the largest are those of contacts in one place [-]."""

HELD_ROWS = 3
LATERAL_ROWS = 2


@dataclass(frozen=True)
class ContactRows:
    """Dense rows of one set of k contacts over the N unknowns of the shell.

    Attributes:
        push: (N, k) nodal forces of unit pushes. measure: (N, k) centre displacements.
        held: (N, 3 h) two lateral motions and the spin of the h patches that are held.
        left: (N, r) orthonormal rigid motions that nothing prevents.
        slides: (k,) which patches are not held.
    """

    push: Array
    measure: Array
    held: Array
    left: Array
    slides: NDArray[np.bool_]

    @property
    def contacts(self) -> int:
        """Number k of contacts."""
        return int(self.push.shape[1])

    @property
    def constraints(self) -> Array:
        """(N, 3 h + r) all constraint columns."""
        return np.concatenate([self.held, self.left], axis=1)

    @property
    def lateral_columns(self) -> NDArray[np.int64]:
        """Which constraint columns are lateral motions, contact by contact: (2 h,)."""
        first = np.arange(0, self.held.shape[1], HELD_ROWS)
        return (first[:, None] + np.arange(LATERAL_ROWS)).ravel()

    @property
    def lateral_inputs(self) -> NDArray[np.int64]:
        """Which of the 2 k lateral motions of all contacts these are: (2 h,)."""
        return np.flatnonzero(~np.repeat(self.slides, LATERAL_ROWS))

    def of_patches(self, values: Array) -> Array:
        """(3 k, ...) for all patches the constraints' `values` (3 h + r, ...); 0 if they slide."""
        result = np.zeros((HELD_ROWS * self.contacts, *values.shape[1:]))
        result[~np.repeat(self.slides, HELD_ROWS)] = values[: self.held.shape[1]]
        return result

    def of_left(self, values: Array) -> Array:
        """(r, ...) the constraints' `values` (3 h + r, ...) for the rigid motions."""
        return values[self.held.shape[1] :]


def lateral_part(values: Array) -> Array:
    """(2 k, ...) the lateral rows of `values` (3 k, ...) of all patches."""
    count = len(values) // HELD_ROWS
    rows = values.reshape(count, HELD_ROWS, *values.shape[1:])[:, :LATERAL_ROWS]
    return rows.reshape(LATERAL_ROWS * count, *values.shape[1:])


def contact_rows(model: ShellModel, patches: tuple[ContactPatch, ...]) -> ContactRows:
    """Rows of a set of contacts on `model`."""
    size = 3 * len(model.start)
    push = np.zeros((size, len(patches)))
    measure = np.zeros((size, len(patches)))
    slides = np.array([patch.slides for patch in patches], dtype=bool)
    held = np.zeros((size, HELD_ROWS * int(np.sum(~slides))))
    first = 0
    for i, patch in enumerate(patches):
        push[:, i], measure[:, i] = pin_rows(model, i, patch)
        if patch.slides:
            continue
        own = patch.held_rows().reshape(HELD_ROWS, -1).T
        held[: len(own), first : first + HELD_ROWS] = own
        first += HELD_ROWS
    left = free_rigid_modes(model.free_modes, held, GRIP_TOLERANCE)
    return ContactRows(push, measure, held, left, slides)


def shared_solution(matrix: Array, right: Array) -> Array:
    """Solution (n, w) of a square system; where two contacts in one place make it singular they
    share: the shortest one, in units in which rows and columns are alike.
    """
    rows = 1.0 / np.maximum(np.linalg.norm(matrix, axis=1), 1e-300)
    scaled = matrix * rows[:, None]
    columns = 1.0 / np.maximum(np.linalg.norm(scaled, axis=0), 1e-300)
    found = np.linalg.lstsq(scaled * columns, right * rows[:, None], rcond=SAME)[0]
    return np.asarray(columns[:, None] * found)


@dataclass(frozen=True)
class Condensed:
    """Columns and outputs for unit inputs, ordered push (k), lateral (2 k), rigid (r), modulus.

    Attributes:
        fields: (N, j) motion of the control points.
        displacement: (k, j) motion of the contact centres along their axes.
        held: (3 k, j) multipliers of the held rows.
        rigid_reaction: (r, j) generalised forces that hold the rigid motions.
    """

    fields: Array
    displacement: Array
    held: Array
    rigid_reaction: Array

    @property
    def reaction(self) -> Array:
        """(2 k, j) lateral forces of the fingers on the patches."""
        return -lateral_part(self.held)


@dataclass(frozen=True)
class GripColumns:
    """The same for the numbers of `live.grip_motion.affine`, grip after grip: 12 g columns.

    They are linear in where the grips have their conditions for turns of any size.
    """

    fields: Array
    displacement: Array
    reaction: Array
    rigid_reaction: Array


@dataclass(frozen=True)
class SprungFactor:
    """A factorised stiffness with springs [N/m] on a few dofs, which make a free body's regular.

    The springs are taken back exactly where the factor is used, and with them what the stiffness
    has too much where a grip may shift: `floated` (N, f), see `ShellModel.floated`.
    """

    factor: Factor
    springs: NDArray[np.int64]
    stiffness: float
    floated: Array


def factorise_sprung(solver: EquilibriumSolver, tangent: Tangent) -> SprungFactor:
    """Factorise the stiffness of a tangent of the solver's model."""
    springs = solver.model.springs
    matrix = tangent.stiffness
    if not len(springs):
        return SprungFactor(solver.factor(matrix), springs, 0.0, solver.model.floated)
    matrix = csr_matrix_of(matrix.data.copy(), matrix.indices, matrix.indptr)
    diagonal = matrix.diagonal()
    stiffness = float(np.median(diagonal[diagonal > 0]))
    for dof in springs:
        matrix.data[diagonal_entry(matrix, int(dof))] += stiffness
    return SprungFactor(solver.factor(matrix), springs, stiffness, solver.model.floated)


def grip_loads(model: ShellModel) -> Array:
    """(N, 12 g) nodal forces of the grips' springs per number of `live.grip_motion.affine`."""
    held = model.held
    if held is None or not model.grips:
        return np.zeros((model.start.size, 0))
    still = 0 if model.supports is None else len(model.supports.stiffness)
    count = sum(len(grip.rows.stiffness) for grip in model.grips)
    targets = np.zeros((still + count, 12 * len(model.grips)))
    for number, grip in enumerate(model.grips):
        size = len(grip.rows.stiffness)
        targets[still : still + size, 12 * number : 12 * number + 12] = grip.affine_targets(
            model.rest
        )
        still += size
    nowhere = np.zeros_like(model.start)
    return np.stack([-held.force(nowhere, t).reshape(-1) for t in targets.T], axis=1)


class CondensedSystem:
    """The factorised tangent at one state with the constraints of one set of contacts."""

    def __init__(self, sprung: SprungFactor, tangent: Tangent, rows: ContactRows) -> None:
        """`sprung` is that of `tangent`; springs and sealed gas enter as low-rank updates."""
        self.rows = rows
        size, springs = len(tangent.gradient), sprung.springs
        updates = np.zeros((size, len(springs) + 1))
        updates[springs, np.arange(len(springs))] = 1.0
        updates[:, -1] = tangent.gas_row
        floats = sprung.floated.shape[1]
        elastic = tangent.gradient + tangent.gas_pressure * tangent.gas_row
        self._bordered = BorderedFactor(
            sprung.factor,
            borders=rows.constraints,
            update_vectors=np.concatenate([updates, sprung.floated], axis=1),
            update_coefficients=np.concatenate(
                [
                    np.full(len(springs), -sprung.stiffness),
                    [tangent.gas_stiffness],
                    np.full(floats, -1.0),
                ]
            ),
            loads=np.concatenate([rows.push, -elastic[:, None]], axis=1),
        )
        fields, multipliers = self._bordered.solve_loads(0.0)
        self.push_fields, self._modulus_field = np.split(fields, [rows.contacts], axis=1)
        self.push_multipliers, self._modulus_multipliers = np.split(
            multipliers, [rows.contacts], axis=1
        )
        self.compliance = rows.measure.T @ self.push_fields

    def solve(self, loads: Array, prescribed: Array) -> tuple[Array, Array]:
        """Motion (N,) or (N, m) and constraint multipliers for loads and constraint values.

        Unrefined: eight digits are plenty for iterations that correct themselves and for columns.
        """
        if loads.ndim == 2 and loads.shape[1] == 0:
            return loads, prescribed
        return self._bordered.solve(loads, prescribed, refinements=0)

    @property
    def negative_modes(self) -> int:
        """Directions of negative stiffness among motions the constraints allow, forces dead."""
        return max(0, self._bordered.inertia.negative - self.rows.constraints.shape[1])

    def negative_modes_driven(self, driven: NDArray[np.bool_]) -> int:
        """The same while the displacement of the `driven` (k,) contacts is prescribed.

        Prescribing d displacements adds d constraints; by Haynsworth their Schur complement is
        minus the compliance, so every negative compliance takes one negative mode away.
        """
        block = self.compliance[np.ix_(driven, driven)]
        taken = int(np.sum(np.linalg.eigvalsh(0.5 * (block + block.T)) < 0)) if len(block) else 0
        return max(0, self.negative_modes - taken)

    def condense(self) -> Condensed:
        """Columns of all inputs; what slides answers none of its lateral ones."""
        rows = self.rows
        lateral, left = LATERAL_ROWS * rows.contacts, rows.left.shape[1]
        constraints = rows.constraints.shape[1]
        below = np.zeros((constraints, lateral + left))
        below[rows.lateral_columns, rows.lateral_inputs] = 1.0
        below[np.arange(constraints - left, constraints), lateral + np.arange(left)] = 1.0
        fields, multipliers = self.solve(np.zeros((len(self.push_fields), lateral + left)), below)
        fields = np.concatenate([self.push_fields, fields, self._modulus_field], axis=1)
        multipliers = np.concatenate(
            [self.push_multipliers, multipliers, self._modulus_multipliers], axis=1
        )
        return Condensed(
            fields=fields,
            displacement=rows.measure.T @ fields,
            held=rows.of_patches(multipliers),
            rigid_reaction=-rows.of_left(multipliers),
        )

    def grip_columns(self, model: ShellModel) -> GripColumns:
        """What the grips of `model` do to all this."""
        rows, loads = self.rows, grip_loads(model)
        fields, multipliers = self.solve(
            loads, np.zeros((rows.constraints.shape[1], loads.shape[1]))
        )
        return GripColumns(
            fields=fields,
            displacement=rows.measure.T @ fields,
            reaction=-lateral_part(rows.of_patches(multipliers)),
            rigid_reaction=-rows.of_left(multipliers),
        )
