"""The dense borders of a load case: what pushes, what measures, what is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.model import ShellModel, Tangent
from shell_deform.solve.bordered import BorderedSystem
from shell_deform.solve.equilibrium import LoadCase
from shell_deform.solve.factor_base import Factor
from shell_deform.supports import free_rigid_modes

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Borders:
    """Dense parts of the system for one load case; N = 3 n dofs, k contacts.

    Attributes:
        push: (N, k) nodal forces of unit pushes. measure: (N, k) rows of centre displacements.
        held: (N, h) rows kept at zero: held contacts, rigid motions that nothing else prevents.
        dead: (N,) other dead load [N]. driven: (k,) whether the displacement is prescribed.
    """

    push: Array
    measure: Array
    held: Array
    dead: Array
    driven: NDArray[np.bool_]

    @property
    def unknown_pushes(self) -> Array:
        """(N, d) patterns of the forces that are unknowns."""
        return self.push[:, self.driven]


def borders(model: ShellModel, case: LoadCase) -> Borders:
    """Rows and patterns of a load case, with the rigid motions nothing else prevents."""
    contacts = case.contacts
    size = model.rest.shape
    count = 3 * len(model.rest)
    push = np.zeros((count, len(contacts)))
    measure = np.zeros((count, len(contacts)))
    held: list[Array] = []
    dead = np.zeros(size) if case.dead_load is None else case.dead_load.copy()
    for i, contact in enumerate(contacts):
        push[:, i] = contact.force_pattern(contact.axis).reshape(-1)
        measure[:, i] = contact.displacement_row().reshape(-1)
        if case.held:
            held.extend(row.reshape(-1) for row in contact.held_rows())
        if case.lateral is not None:
            dead += contact.force_pattern(case.lateral[i])
    rows = np.stack(held, axis=1) if held else np.zeros((count, 0))
    rows = _independent(rows)
    left = free_rigid_modes(
        model.free_modes, np.concatenate([rows, measure[:, case.driven]], axis=1)
    )
    return Borders(
        push=push,
        measure=measure,
        held=np.concatenate([rows, left], axis=1),
        dead=dead.reshape(-1),
        driven=case.driven,
    )


def negative_directions(
    system: BorderedSystem, factor: Factor, edge: Borders, tangent: Tangent
) -> int:
    """Negative directions of a factorised system with symmetric borders."""
    negative = factor.inertia.negative + int(np.sum(np.linalg.eigvalsh(system.schur) < 0))
    constraints = int(edge.driven.sum()) + edge.held.shape[1]
    return negative - constraints - (1 if tangent.gas_stiffness else 0)


def _independent(rows: Array) -> Array:
    """Drop rows that supports already keep at zero."""
    norm = np.linalg.norm(rows, axis=0)
    return rows[:, norm > 1e-9 * max(1.0, float(norm.max(initial=0.0)))]
