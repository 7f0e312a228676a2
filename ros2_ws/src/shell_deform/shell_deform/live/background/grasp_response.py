# SPDX-License-Identifier: Apache-2.0
"""What a grasp does under a load while its fingers stand still, beside the columns of a state.

The tick tells first slip, stiffness and yield from it for whatever friction and mass it is asked.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch
from shell_deform.grasp.reading import (
    HELD_ROWS,
    Answer,
    OuterFeet,
    Response,
    WallReader,
    WallState,
    answered,
    body_loads,
    body_mass,
    held_contacts,
    holds_still,
    unheld,
    wall_reader,
)
from shell_deform.live.background.condensed import (
    Condensed,
    CondensedSystem,
    shared_solution,
)
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.model import ShellModel

Array = NDArray[np.float64]

EVERY = 4
"""Of so many refreshes under load one tells the grasp anew: it changes more slowly than a push."""


class GraspResponse:
    """Response of the grasp and state of the wall at a state not long ago."""

    def __init__(self, model: ShellModel) -> None:
        self._mass = body_mass(model)
        self._reader: WallReader | None = None
        self._response: Response | None = None
        self._wall: WallState | None = None
        self._age = 0

    def take(self, model: ShellModel, patches: tuple[ContactPatch, ...]) -> None:
        """Other contacts: what was known is known no more."""
        self._reader = wall_reader(model, patches) if patches else None
        self._response = self._wall = None

    def renew(
        self,
        tracker: EquilibriumTracker,
        feet: OuterFeet,
        condensed: Condensed,
        moved: bool,
    ) -> bool:
        """Tell the grasp at the state of `tracker`, whose columns `condensed` are; True if told.

        `moved`: the state is another one than last time; then only every few times. Where the
        shell comes to rest, it is told there.
        """
        if self._reader is None or (self._response is not None and not moved and not self._age):
            return False
        self._age = (self._age + 1) % EVERY if moved and self._response is not None else 0
        if self._age:
            return False
        patches, state = self._reader.patches, tracker.state
        count = len(patches)
        positions = tracker.positions
        centre, loads = body_loads(self._mass, positions)
        # Of the contacts alone: where nothing holds the shell still, no tangent is needed.
        assert tracker.rows is not None
        held = tracker.rows.of_patches(state.multipliers)
        grasp = held_contacts(patches, *feet.at(positions), state.force, held, 1.0)
        if holds_still(tracker.model, patches, grasp):
            answer = standing(tracker.system(), condensed, centre, loads)
            self._response = answered(patches, feet, positions, grasp, answer)
        else:
            self._response = unheld(centre, count)
        dent = tracker.present(np.zeros(count, bool)).displacement
        self._wall = self._reader.at(tracker.unknowns, state.force, dent)
        return True

    def fill(self, record: np.void) -> None:
        """Write what is known into a result."""
        if self._response is not None and self._wall is not None:
            fill_grasp(record, self._response, self._wall)


def fill_grasp(record: np.void, found: Response, wall: WallState) -> None:
    """Write how a grasp shares out loads, and what the wall bears, into a result."""
    count = len(found.force)
    record['centre'] = found.centre
    if found.sharing is not None and found.compliance is not None:
        record['grasp_known'] = 1
        record['share_push'][:count] = found.sharing.push
        record['share_across'][:count] = found.sharing.tangential
        record['share_spin'][:count] = found.sharing.spin
        record['body_compliance'] = found.compliance
        if found.slipping is not None:
            record['slip_push'][:count] = found.slipping.share
            record['slip_arm'][:count] = found.slipping.arm
    record['stress'], record['stress_doubt'] = wall.stress, wall.doubt
    record['strain'] = wall.strain


def standing(system: CondensedSystem, condensed: Condensed, centre: Array, loads: Array) -> Answer:
    """What loads (3 n, 6) do while the contacts' centres stand still, free motions balanced."""
    rows = system.rows
    k, r = rows.contacts, rows.left.shape[1]
    padded = np.zeros((len(rows.push), loads.shape[1]))
    padded[: len(loads)] = loads
    constraints = rows.constraints.shape[1]
    motion, border = system.solve(padded, np.zeros((constraints, loads.shape[1])))
    free = [*range(k), *range(3 * k, 3 * k + r)]
    by = np.concatenate([condensed.displacement, condensed.rigid_reaction])[:, free]
    there = np.concatenate([rows.measure.T @ motion, -rows.of_left(border)])
    given = shared_solution(by, -there)
    motion = motion + condensed.fields[:, free] @ given
    held = rows.of_patches(border) + condensed.held[:, free] @ given
    return Answer(centre, loads, motion[: len(loads)], given[:k], held.reshape(k, HELD_ROWS, -1))
