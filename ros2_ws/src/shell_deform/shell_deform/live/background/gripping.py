# SPDX-License-Identifier: Apache-2.0
"""The grips of an object in the background: their columns, what they do, what they tear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.condensed import GripColumns
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.live.exchange import MAX_GRIPS, Slot
from shell_deform.live.grip_motion import AFFINE, Followed, GripPlan, followed
from shell_deform.model import ShellModel
from shell_deform.readout import TORN_STRAIN, principal, read_out
from shell_deform.supports.grips import poses_and_wrenches

Array = NDArray[np.float64]

BEND_AT_FIRST = 0.25
"""Second order of how the surface follows, over its size, before any was seen."""

FADING = 0.7
"""A smaller second order replaces the one that was seen before by and by."""

LOOK_FOR_TEARS = 0.05
"""Grips that went so far, radians or shares of the object, may have torn it."""


class Gripping:
    """The grips of one shell while an `EquilibriumTracker` follows them."""

    def __init__(self, tracker: EquilibriumTracker) -> None:
        """Raises ValueError for more grips than can be followed."""
        model = tracker.model
        if len(model.grips) > MAX_GRIPS:
            raise ValueError(
                f'the object has {len(model.grips)} grips; at most {MAX_GRIPS} can be followed'
            )
        self._tracker = tracker
        self.plan = plan_of(model)
        self.size = float(np.ptp(model.rest, axis=0).max())
        self.columns: GripColumns | None = None
        self.limit_columns = np.zeros((len(model.rest), 3, AFFINE * len(model.grips)))
        """(n, 3, 12 g) of the surface, at the last columns that were taken."""
        self.bend = BEND_AT_FIRST * self.size
        """Largest second-order motion [m] per squared `Followed.step`."""
        self._at = np.zeros((len(model.grips), 6))
        self._surface: Array | None = None
        self._contacts = 0

    def take_columns(self, limit_columns: Array, columns: GripColumns) -> None:
        """At the tracker's state; learns from the last ones how far they reach."""
        tracker, now = self._tracker, self._tracker.state.grips
        surface = tracker.model.surface.limit_positions(tracker.positions)
        contacts = len(tracker.state.force)
        if self._surface is not None and contacts == self._contacts == 0:
            way = self.followed(now)
            missed = way.carried(self._surface + self.limit_columns @ way.inputs) - surface
            if way.step > 1e-3:
                seen = float(np.linalg.norm(missed, axis=1).max()) / way.step**2
                self.bend = max(seen, FADING * self.bend)
        self.columns, self.limit_columns = columns, limit_columns
        self._surface, self._at, self._contacts = surface, now, contacts

    def followed(self, now: Array) -> Followed:
        """From where the columns were taken to motions `now` (g, 6)."""
        return followed(self.plan, self._at, now, self.size, not self._contacts)

    def left(self, now: Array) -> bool:
        """Whether the grips, at motions `now` (g, 6), have left where the columns were taken."""
        return not np.array_equal(self._at, now)

    def answered(self) -> tuple[Array, Array]:
        """(g, 6) poses and wrenches of the grips at the tracker's state."""
        tracker = self._tracker
        model, state, rows = tracker.model, tracker.state, tracker.rows
        assert rows is not None
        other = rows.push @ state.force - rows.constraints @ state.multipliers
        count = len(model.rest)
        reaction = model.wall_force(tracker.unknowns)[:count] - other.reshape(-1, 3)[:count]
        return poses_and_wrenches(
            model.grips, model.rest, tracker.positions, reaction, state.grips
        )

    def fill(self, slot: Slot) -> None:
        """Write what the grips do at the tracker's state, and what they would do to the rest."""
        assert self.columns is not None
        motions, answered = self._tracker.state.grips, self.answered()
        fill_grips(slot, motions, answered, self.columns, self.limit_columns)
        slot.record['grip_bend'] = self.bend

    def torn(self) -> str:
        """What the grips do to the object that no wall stands, or ''."""
        tracker = self._tracker
        return self.tears(tracker.model, tracker.unknowns, tracker.state.grips)

    def tears(self, model: ShellModel, unknowns: Array, motions: Array) -> str:
        """The same of a state with the grips at `motions` (g, 6)."""
        way = followed(self.plan, np.zeros_like(motions), motions, self.size, True)
        if way.step < LOOK_FOR_TEARS:
            return ''
        faces = read_out(model, unknowns)
        strain = max(float(principal(e).max()) for e in (faces.outer_strain, faces.inner_strain))
        if strain <= TORN_STRAIN:
            return ''
        return f'the grips tear the object apart: its wall is stretched by {100 * strain:.0f} %'


def fill_grips(
    slot: Slot, motions: Array, answered: tuple[Array, Array], columns: GripColumns, limit: Array
) -> None:
    """Write `motions` (g, 6), poses and wrenches `answered` (g, 6), columns, `limit` (n, 3, 12 g).

    How far the columns reach is left for who knows it.
    """
    record = slot.record
    g, (k, a), r = len(motions), columns.displacement.shape, len(columns.rigid_reaction)
    record['grip'][:g] = motions
    record['grip_pose'][:g], record['grip_wrench'][:g] = answered
    record['displacement_by_grip'][:k, :a] = columns.displacement
    record['reaction_by_grip'][: 2 * k, :a] = columns.reaction
    record['rigid_by_grip'][:r, :a] = columns.rigid_reaction
    slot.grips[:] = limit


def plan_of(model: ShellModel) -> GripPlan:
    """What the node has to know of the grips of a model."""
    origins = np.array([grip.origin for grip in model.grips]).reshape(-1, 3)
    bound = model.supports is not None or any(len(grip.free) for grip in model.grips)
    return GripPlan(tuple(grip.name for grip in model.grips), origins, not bound)
