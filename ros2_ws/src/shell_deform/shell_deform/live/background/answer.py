# SPDX-License-Identifier: Apache-2.0
"""One answer of the background process, and how it is written into the shared memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.condensed import Condensed
from shell_deform.live.background.second_order import SecondOrder
from shell_deform.live.background.small_loads import SmallLoads
from shell_deform.live.exchange import Slot
from shell_deform.live.pose import IDENTITY

Array = NDArray[np.float64]

THIRD_REACH = 3.0
"""Beyond so many wall thicknesses the error of leaving the third order out grows with the square
only."""


@dataclass(frozen=True)
class Answer:
    """An equilibrium of a shell of n vertices under k contacts, and what is known about it.

    Attributes:
        numbers: fields of the record with one value: share, stable, energy [J], ...
        contacts: fields of the record with rows for contacts or rigid motions.
        condensed: columns of j inputs; columns: (n, 3, j) of the surface.
        since: (k,) motion of the contacts from where the columns were taken [m].
        second: second order about there. small: linear theory from rest; linear: (n, 3, k) its
            columns. message: what is to be said.
        surface, normals: (n, 3). energy_density: (n,) [J/m^2].
        taxels: (t, f) rows of `exchange.TAXEL_FIELDS`.
    """

    numbers: dict[str, float]
    contacts: dict[str, Any]
    condensed: Condensed
    columns: Array
    since: Array
    second: SecondOrder
    small: SmallLoads | None
    linear: Array
    message: str
    surface: Array
    normals: Array
    energy_density: Array
    taxels: Array = field(default_factory=lambda: np.zeros((0, 0)))


def write(slot: Slot, answer: Answer, wall: float) -> None:
    """Fill a slot; `wall` [m]: thickness."""
    record, condensed, second = slot.record, answer.condensed, answer.second
    k, j = condensed.displacement.shape
    r = len(condensed.rigid_reaction)
    record['answers'] = 0
    record['contacts'], record['rigid_count'] = k, r
    record['set_doubt'], record['reach'], record['refused'] = 0.0, 0.0, 0
    record['carried'], record['grasp_known'] = IDENTITY.numbers, 0
    record['spin'], record['arm'], record['slip_push'] = 0.0, 0.0, 0.0
    for name, value in answer.numbers.items():
        record[name] = value
    for name, rows in answer.contacts.items():
        values = np.asarray(rows)
        if len(values):
            record[name][: len(values)] = values
    known = len(second.direction) == k
    record['bend_direction'][:k] = second.direction if known else 0.0
    along = second.direction @ answer.since if known else np.linalg.norm(answer.since)
    record['bend_offset'] = float(along)
    record['bend_reach'] = second.reach
    record['push_bend'][:k] = second.push if len(second.push) == k else 0.0
    record['third_reach'] = THIRD_REACH * wall
    record['displacement_by'][:k, :j] = condensed.displacement
    record['reaction_by'][: 2 * k, :j] = condensed.reaction
    record['rigid_by'][:r, :j] = condensed.rigid_reaction
    if answer.small is not None:
        pairs = answer.small.second_order.shape[1]
        record['linear_compliance'][:k, :k] = answer.small.compliance
        record['second_order'][:k, :pairs] = answer.small.second_order
    record['message'] = answer.message.encode()[:200]
    count = len(answer.taxels)
    record['taxels'] = count
    slot.taxels[:count] = answer.taxels if count else 0.0
    size = 3 * len(answer.surface)
    slot.surface[:], slot.normals[:] = answer.surface, answer.normals
    slot.columns[: size * j] = answer.columns.reshape(-1)
    slot.linear[: size * k] = answer.linear.reshape(-1)
    slot.bend[:], slot.third[:] = second.field, second.third
    slot.energy_density[:] = answer.energy_density
    slot.unmodelled[:] = 0.0
