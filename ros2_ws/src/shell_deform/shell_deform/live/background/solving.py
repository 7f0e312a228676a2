# SPDX-License-Identifier: Apache-2.0
"""What the background process does with a load case: contacts, equilibrium, columns, result.

Free of processes and shared memory, so that tests and offline runs can call it directly.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.reading import outer_feet
from shell_deform.live.background.carried import carried
from shell_deform.live.background.condensed import HELD_ROWS, Condensed, ContactRows, contact_rows
from shell_deform.live.background.contact_tracking import ContactTracker, Touch
from shell_deform.live.background.energy_density import EnergyDensity
from shell_deform.live.background.grasp_response import GraspResponse
from shell_deform.live.background.gripping import Gripping
from shell_deform.live.background.load_case import Load
from shell_deform.live.background.motion import Motion
from shell_deform.live.background.outer_field import OuterField, unmodelled
from shell_deform.live.background.placement import Placement, place
from shell_deform.live.background.rest_shell import RestShell, largest_curl
from shell_deform.live.background.small_loads import SmallLoads, small_loads
from shell_deform.live.background.tracking import EquilibriumTracker, Target, TrackingOptions
from shell_deform.live.exchange import DRIVE_FORCE, MAX_CONTACTS, MAX_RIGID, Slot
from shell_deform.live.grip_motion import AFFINE
from shell_deform.live.pose import IDENTITY, Pose
from shell_deform.model import ShellModel
from shell_deform.theory import THICK

Array = NDArray[np.float64]

SMALLEST_STEP = 0.02
"""Steps below this share of the wall thickness say nothing about the second order."""

SHORTEST_REACH = 0.3
"""A second order measured over less still serves over this share of the wall thickness."""

THIRD_FLOOR = 0.8
"""Third order per wall thickness is at least this share of the second."""

THIRD_REACH = 3.0
"""Beyond so many wall thicknesses the error of leaving it out grows with the square only."""

LIVE = TrackingOptions(step=4e-3)
"""What the last chord step leaves, a tenth or so of it, the columns take away by a Newton step."""

GOOD_CONTRACTION = 0.1
"""Columns serve on where the chord iterations on their tangent still contract so well."""

FARTHEST_STEP = 0.25
"""In real time a load case further than this many wall thicknesses is approached in parts, until a
newer one has come: a long step costs more than its parts, and while it is solved the fingers get
further away."""

MOST_STATES = 3
"""States in a row that are served with the same columns."""

STILL = 1e-3
"""A state that moved less than this share of the wall thickness keeps its columns."""


class LiveSolver:
    """One shell under changing load cases; after each, a result slot can be filled."""

    def __init__(self, model: ShellModel, options: TrackingOptions | None = None) -> None:
        self.model = model
        self.tracker = EquilibriumTracker(model, options or LIVE)
        self.contacts = ContactTracker(model, model.rest)
        self._gripping = Gripping(self.tracker) if model.grips else None
        self._wall = float(model.shell.thickness.mean())
        self._energy_density = EnergyDensity(model)
        self._size = len(model.rest)
        self.generation = 0
        self._rigid_anchor = np.zeros(0)
        self._condensed: Condensed | None = None
        self._limit_columns: Array | None = None
        self._condensed_at = np.zeros(0)
        self._states = 0
        self._exactly = True
        self._inputs_at: Array | None = None
        self._load: Load | None = None
        self._pose_in_use = IDENTITY
        self._unloaded: Array | None = None
        self._bend = np.zeros((self._size, 3))
        self._third = np.zeros(self._size)
        self._bend_direction = np.zeros(0)
        self._bend_reach = 0.0
        self._push_bend = np.zeros(0)
        self._face = OuterField(self.tracker) if model.theory == THICK else None
        self._small: SmallLoads | None = None
        self._linear_columns = np.zeros((self._size, 3, 0))
        self._placement: Placement | None = None
        self._feet = outer_feet(model, ())
        self._grasp = GraspResponse(model)
        self.share = 1.0
        self.seconds = 0.0
        self.turning = False
        """Whether the grips of the last load case had moved."""
        self.motion: Motion | None = None
        """Whether to solve ahead of the contacts' motion: in real time alone."""
        self.is_awaited: Callable[[], bool] = lambda: False
        """In real time: whether a newer load case has come."""
        self._unload()
        unloaded = self.tracker.positions
        # The given control points themselves, where nothing inflates them: searches know these.
        self.unloaded = model.rest if np.array_equal(unloaded, model.rest) else unloaded
        self._unloaded = self.unloaded
        self.contacts = ContactTracker(model, self.unloaded)
        self._unloaded_state = self.tracker.state
        self.unloaded_surface = model.surface.limit_positions(self.unloaded)
        self.unloaded_normals = model.surface.vertex_normals(self.unloaded)
        self.unloaded_outer = self._face and self.unloaded_surface + self._face.offset()
        if self._gripping is not None:
            self._take_grip_columns(self._gripping)
        self.rest_grips = self._gripping.limit_columns if self._gripping is not None else 0.0

    def _unload(self) -> None:
        """Go to equilibrium without contacts: not the given shape where gas is under pressure."""
        rows = contact_rows(self.model, ())
        self.tracker.reset()
        self.tracker.set_contacts(rows, np.zeros(0))
        if self.model.gas.is_sealed and self.model.gas.gauge_pressure or self.model.pressure:
            here = self.tracker.here(np.zeros(0, bool))
            self.tracker.advance(here)
        self._new_generation(rows)

    def warm_up(self) -> None:
        """Go once through a contact without force, so that the first real one does not wait.

        Raises what `take` raises, where no contact can lie at the chosen vertex.
        """
        vertex = self._size // 2
        inward = -self.unloaded_normals[vertex]
        point = self.unloaded_surface[vertex] - 0.5 * self._wall * inward
        touch = Touch(0, point, inward, 2.0 * self._wall, 0.0, np.nan, np.nan)
        nothing = np.zeros(MAX_RIGID)
        self.take(Load((touch,), DRIVE_FORCE, 0, nothing, 0.0, IDENTITY, 0))
        self.refine()
        self.take(Load((), DRIVE_FORCE, 0, nothing, 0.0, IDENTITY, 0, reset=True))

    def take(self, load: Load) -> None:
        """Bring contacts and equilibrium to `load` as far as they follow."""
        began = time.perf_counter()
        self._load = load
        self._states += 1
        grips = load.grips[: len(self.model.grips)]
        if load.reset or (not load.touches and self.contacts.contacts and not grips.any()):
            self._let_go()
        elif load.jump:
            # The shape is a start for what follows; who pressed it there is not known any more.
            self.contacts.reset()
            self._placement = None
            self._change_contacts(np.zeros(0))
        pose = self._pose(load)
        touches = tuple(_in_object_frame(touch, pose) for touch in load.touches)
        self.turning = not np.array_equal(grips, self.tracker.state.grips)
        anew = self.turning or self.contacts.contacts or (len(grips) and self.share < 1.0)
        if touches or anew:
            before = dict(zip(self._fingers(), self._displacements(), strict=True))
            self._lay(touches)
            target = self._target(load, touches, before)
            if self.motion is not None:
                target = self.motion.ahead(target, self.generation, began)
            good, lost = self.tracker.state, bool(self.tracker.message)
            self.share = self._approach(target)
            twice = bool(self.contacts.laid) or (bool(len(grips)) and not lost)
            if self.tracker.message and twice and not self._nearly_at_rest():
                # A grasp taken up from the shape of another one may lead nowhere: once from rest.
                self._let_go()
                self._lay(touches)
                self.share = self.tracker.advance(self._target(load, touches, {}))
            if self._gripping is not None and (torn := self._gripping.torn()):
                self.tracker.message, self.share = torn, 0.0
                if len(good.moved) == len(self.tracker.state.moved):
                    self.tracker.state = good
                    self.tracker.forget_tangent()
        self.seconds = time.perf_counter() - began

    def _approach(self, target: Target) -> float:
        """Go to `target`, or in real time until a newer load case has come; the share reached."""
        if self.motion is None:
            return self.tracker.advance(target)
        while True:
            near, part = self.tracker.within(target, FARTHEST_STEP * self._wall)
            share = part * self.tracker.advance(near)
            if part == 1.0 or self.tracker.message or self.is_awaited():
                return share

    def start_over(self) -> None:
        """Back to the unloaded shell without contacts, after a load case that nobody can solve."""
        self._load = None
        self._let_go()

    def rest_shell(self, curl: float = 0.0) -> RestShell:
        """What the node needs to answer contacts before this process does.

        `curl` as in `RestShell` where it is known: it belongs to the shell, not to its mesh.
        """
        tangent, factor = self.tracker.rest_tangent(self.unloaded)
        if not curl:
            curl = largest_curl(self.model, self.unloaded, tangent, factor, self.tracker.beat)
        return RestShell(self.model, self.unloaded, tangent, factor, curl)

    def _let_go(self) -> None:
        """No contacts, and the unloaded state."""
        self.contacts.reset()
        self._placement = None
        self.tracker.take(self.model)
        self.tracker.state = self._unloaded_state
        self.tracker.forget_tangent()
        self._change_contacts(np.zeros(0))
        self.share = 1.0

    def _lay(self, touches: tuple[Touch, ...]) -> None:
        """Patches for the fingers that touch, with the pushes that are there."""
        pushes = dict(zip(self._fingers(), self.tracker.state.force, strict=True))
        anew = not self.contacts.contacts
        moved = bool(self.tracker.state.grips.any())
        if self.contacts.update(touches, self.tracker.positions, moved):
            self._change_contacts(
                np.array([pushes.get(contact.finger, 0.0) for contact in self.contacts.contacts])
            )
            if anew:
                # Where the last grasp had carried the object is no part of this one.
                unloaded = self.tracker.unloaded(self.unloaded) - self.tracker.model.start
                self._rigid_anchor = self._rows().left.T @ unloaded.reshape(-1)

    @property
    def message(self) -> str:
        """Why the load case is not carried, or empty."""
        behind = 'the load case changes faster than the solver' if self.share < 1.0 else ''
        return self.tracker.message or behind

    @property
    def columns_serve(self) -> bool:
        """Whether the next state is worth more than columns of the present one."""
        good = self.tracker.contraction < GOOD_CONTRACTION and not self.tracker.message
        return self._condensed is not None and good and self._states < MOST_STATES

    def refine(self) -> bool:
        """Take columns and grasp at the present state; False if those at hand are good enough."""
        tracker = self.tracker
        if (
            self._condensed is not None
            and np.abs(tracker.state.moved - self._condensed_at).max() < STILL * self._wall
        ):
            return self._grasp.renew(tracker, self._feet, self._condensed, moved=False)
        old, old_columns, old_state = self._condensed, self._limit_columns, self._condensed_at
        old_inputs = self._inputs_at
        self._exactly = not (tracker.is_beside and self.is_awaited())
        self._condensed = tracker.condense(self._exactly)
        self._states = 0
        self._limit_columns = self._to_limit(self._condensed.fields)
        self._condensed_at = tracker.state.moved
        self._inputs_at = self._inputs()
        if self._small is not None and not len(self._bend_direction):
            self._bend_from_rest(self._small)
        if self._gripping is not None and self._gripping.left(self.tracker.state.grips):
            # What bent the way here was no contact's step alone.
            self._bend_direction = np.zeros(0)
        elif old is not None and old_columns is not None and old_inputs is not None:
            self._update_bend(old, old_columns, old_state, self._inputs_at - old_inputs)
        elif self._face is not None:
            self._face.refined(0.0)
        if self._gripping is not None:
            self._take_grip_columns(self._gripping)
        self._grasp.renew(tracker, self._feet, self._condensed, moved=True)
        return True

    def _take_grip_columns(self, gripping: Gripping) -> None:
        columns = self.tracker.system().grip_columns(self.tracker.model)
        gripping.take_columns(self._to_limit(columns.fields), columns)

    def fill(self, slot: Slot) -> None:
        """Write the present result."""
        if self._condensed is None:
            self.refine()
        condensed = self._condensed
        assert condensed is not None and self._limit_columns is not None
        tracker, record = self.tracker, slot.record
        rows = self._rows()
        k, r = rows.contacts, rows.left.shape[1]
        here = tracker.here(np.zeros(k, bool))
        system = tracker.system()
        load = self._load
        record['answers'] = 0
        record['stamp'] = load.stamp if load is not None else 0
        record['generation'] = self.generation
        record['contacts'], record['rigid_count'] = k, r
        record['share'] = self.share
        driven = self._driven(load)
        point, normal = self._feet.at(tracker.positions)
        record['stable'] = int(system.negative_modes_driven(driven) == 0)
        record['snap_margin'] = self._snap_margin(system.compliance)
        record['energy'] = tracker.state.energy
        record['seconds'] = self.seconds
        record['factorisations'] = tracker.factorisations
        for name, values in (
            ('finger', self._fingers()),
            ('force', tracker.state.force),
            ('displacement', here.displacement),
            ('travel_offset', [c.travel_offset for c in self.contacts.contacts]),
            ('axis', [c.patch.axis for c in self.contacts.contacts]),
            ('anchor', [c.touched for c in self.contacts.contacts]),
            ('place', [c.patch.point for c in self.contacts.contacts]),
            ('coarseness', [c.coarseness for c in self.contacts.contacts]),
            ('lateral', [d for c in self.contacts.contacts for d in c.patch.lateral]),
            ('rigid', here.rigid),
            ('touch_point', point),
            ('touch_normal', normal),
            ('reaction', -tracker.state.multipliers[rows.lateral_columns]),
            ('rigid_reaction', -tracker.state.multipliers[HELD_ROWS * k :]),
            ('spin', self._spins()),
        ):
            values = np.asarray(values)
            if len(values):
                record[name][: len(values)] = values
        since = rows.measure.T @ (tracker.state.moved - self._condensed_at)
        known = len(self._bend_direction) == k
        record['bend_direction'][:k] = self._bend_direction if known else 0.0
        along = float(self._bend_direction @ since) if known else float(np.linalg.norm(since))
        record['bend_offset'] = along
        record['bend_reach'] = self._bend_reach
        record['push_bend'][:k] = self._push_bend if len(self._push_bend) == k else 0.0
        record['third_reach'] = THIRD_REACH * self._wall
        record['rigid_scale'] = np.sqrt(self._size)
        j = condensed.fields.shape[1]
        record['displacement_by'][:k, :j] = condensed.displacement
        record['reaction_by'][: 2 * k, :j] = condensed.reaction
        record['rigid_by'][:r, :j] = condensed.rigid_reaction
        self._grasp.fill(record, k)
        if self._small is not None:
            pairs = self._small.second_order.shape[1]
            record['linear_compliance'][:k, :k] = self._small.compliance
            record['second_order'][:k, :pairs] = self._small.second_order
        if self._gripping is not None:
            _fill_grips(slot, self._gripping, self.tracker.state.grips, rows)
        self._fill_place(record)
        positions = tracker.positions
        slot.surface[:] = self.model.surface.limit_positions(positions)
        slot.normals[:] = self.model.surface.vertex_normals(positions)
        slot.columns[: 3 * self._size * j] = self._limit_columns.reshape(-1)
        slot.linear[: 3 * self._size * k] = self._linear_columns.reshape(-1)
        slot.bend[:] = self._bend
        slot.third[:] = self._third
        slot.energy_density[:] = self._energy_density.at(positions)
        slot.unmodelled[:] = 0.0
        if self._face is not None and slot.outer is not None and slot.outer_slope is not None:
            slot.unmodelled[:] = unmodelled(
                self.unloaded_surface, self._wall, self.contacts.patches, here.displacement
            )
            slot.outer[:], slot.outer_slope[:] = self._face.offset(), self._face.slope

    def _fill_place(self, record: np.void) -> None:
        """Write where the object lies, and what there is to say."""
        placement = self._placement
        record['carried'] = self._carried().numbers
        record['pose'] = self._pose_in_use.numbers
        record['pose_covariance'] = placement.covariance if placement is not None else 0.0
        note = placement.open_directions if placement is not None and not self.message else ''
        record['message'] = (self.message or note).encode()[:200]

    def _rows(self) -> ContactRows:
        assert self.tracker.rows is not None
        return self.tracker.rows

    def _fingers(self) -> list[int]:
        return [contact.finger for contact in self.contacts.contacts]

    def _spins(self) -> Array:
        """(k,) torques [N m] of the fingers about their axes."""
        patches = self.contacts.patches
        held = self.tracker.state.multipliers[: HELD_ROWS * len(patches)].reshape(-1, HELD_ROWS)
        return np.array(
            [-patch.radius * one[-1] for patch, one in zip(patches, held, strict=True)]
        )

    def _displacements(self) -> Array:
        return np.asarray(self._rows().measure.T @ self.tracker.state.moved)

    def _pose(self, load: Load) -> Pose:
        if load.pose is not None:
            self._placement = None
            self._pose_in_use = load.pose
        elif load.touches and (
            self._placement is None or len(load.touches) > self._placement.contacts
        ):
            first = self._placement is None
            if first or self._nearly_at_rest():
                self._placement = place(
                    self.model.surface,
                    self.unloaded,
                    0.5 * self._wall,
                    [touch.first_point for touch in load.touches],
                    [touch.normal for touch in load.touches],
                )
                self._pose_in_use = self._placement.pose
        elif self._placement is None:
            self._pose_in_use = IDENTITY
        return self._pose_in_use

    def _nearly_at_rest(self) -> bool:
        controls = slice(0, 3 * self._size)
        away = self.tracker.state.moved[controls] - self._unloaded_state.moved[controls]
        return bool(np.abs(away).max(initial=0.0) < 0.2 * self._wall)

    def _change_contacts(self, force: Array) -> None:
        if len(self.contacts.contacts) > MAX_CONTACTS:
            raise ValueError(f'more than {MAX_CONTACTS} contacts; merge tactile cells first')
        self.tracker.take(self.model.on_contacts(self.contacts.patches))
        rows = contact_rows(self.tracker.model, self.contacts.patches)
        self._feet = outer_feet(self.model, self.contacts.patches)
        self._grasp.take(self.tracker.model, self.contacts.patches)
        self.tracker.set_contacts(rows, force)
        self._new_generation(rows)

    def _new_generation(self, rows: ContactRows) -> None:
        self.generation += 1
        self._rigid_anchor = rows.left.T @ self.tracker.state.moved
        self._condensed = None
        self._inputs_at = None
        self._bend, self._third = np.zeros((self._size, 3)), np.zeros(self._size)
        self._bend_direction, self._bend_reach = np.zeros(0), 0.0
        self._push_bend = np.zeros(0)
        self._small = None
        if self._face is not None:
            self._face.forget()
        if rows.contacts and self._unloaded is not None:
            system = self.tracker.rest_system(self._unloaded, rows)
            unloaded = self.tracker.unloaded(self._unloaded)
            self._small = small_loads(self.tracker.model, unloaded, system, rows)
            self._linear_columns = self._to_limit(self._small.fields)
            self._bend_from_rest(self._small)
        else:
            self._linear_columns = np.zeros((self._size, 3, 0))

    def _driven(self, load: Load | None) -> NDArray[np.bool_]:
        contacts = self.contacts.contacts
        if load is None or load.drive == DRIVE_FORCE:
            return np.zeros(len(contacts), bool)
        known = {touch.finger: np.isfinite(touch.travel) for touch in load.touches}
        return np.array([known.get(contact.finger, False) for contact in contacts], bool)

    def _target(self, load: Load, touches: tuple[Touch, ...], before: dict[int, float]) -> Target:
        """What the load case prescribes on the patches in use."""
        by_finger = {touch.finger: touch for touch in touches}
        contacts = self.contacts.contacts
        here = self.tracker.here(self._driven(load))
        same = load.generation == self.generation
        force = here.force.copy()
        displacement = here.displacement.copy()
        for i, contact in enumerate(contacts):
            touch = by_finger.get(contact.finger)
            force[i] = touch.force if touch is not None else 0.0
            if touch is None or not here.driven[i]:
                continue
            new = contact.finger in self.contacts.laid
            if same and np.isfinite(touch.displacement):
                displacement[i] = touch.displacement
            elif np.isfinite(touch.displacement) and contact.finger in before and not new:
                displacement[i] += touch.displacement - before[contact.finger]
            else:
                displacement[i] = touch.travel + contact.travel_offset
                displacement[i] -= load.tendon * touch.force
        rigid = self._rigid_anchor
        if same and load.drive != DRIVE_FORCE and len(rigid):
            rigid = load.rigid[: len(rigid)]
        held = [contact.held for contact in contacts]
        return Target(
            force,
            displacement,
            here.driven,
            rigid,
            np.concatenate(held) if held else np.zeros(0),
            load.grips[: len(self.model.grips)],
        )

    def _inputs(self) -> Array:
        """Values of the condensed inputs at the present state."""
        rows = self._rows()
        here = self.tracker.here(np.zeros(rows.contacts, bool))
        lateral = (rows.held.T @ self.tracker.state.moved)[rows.lateral_columns]
        return np.concatenate([here.force, lateral, here.rigid, [0.0]])

    def _bend_from_rest(self, small: SmallLoads) -> None:
        """Second order of new contacts: exact for a shell at rest, elsewhere for the error."""
        count = len(small.compliance)
        direction = np.full(count, 1.0 / np.sqrt(count))
        bend, self._push_bend = small.bend(direction, self._driven(self._load))
        self._bend = self._to_limit(bend[:, None])[:, :, 0]
        self._third = THIRD_FLOOR / self._wall * np.linalg.norm(self._bend, axis=1)
        if self._nearly_at_rest():
            self._bend_direction = direction
            self._bend_reach = SHORTEST_REACH * self._wall

    def _update_bend(
        self, old: Condensed, old_columns: Array, old_state: Array, inputs: Array
    ) -> None:
        """Second and third order about the present state, along the way the contacts came.

        A cubic through both states with both tangents (Hermite) has the second order exactly at
        this end; what it has of third order is kept as the error of leaving it out.
        """
        assert self._condensed is not None and self._limit_columns is not None
        moved = self.tracker.state.moved
        steps = self._rows().measure.T @ (moved - old_state)
        step = float(np.linalg.norm(steps))
        short = step < SMALLEST_STEP * self._wall
        if self._face is not None:
            self._face.refined(0.0 if short else step)
        if short:
            return
        change = self._to_limit((moved - old_state)[:, None])[:, :, 0]
        inputs_before = self._inputs_for(old, steps, inputs)
        inputs_after = self._inputs_for(self._condensed, steps, inputs)
        push_bend = (2.0 * inputs_after + inputs_before - 3.0 * inputs) / step**2
        self._push_bend = push_bend[: len(steps)]
        before = old_columns @ inputs_before
        after = self._limit_columns @ inputs_after
        self._bend = (2.0 * after + before - 3.0 * change) / step**2
        third = np.linalg.norm((after + before - 2.0 * change) / step**3, axis=1)
        floor = THIRD_FLOOR / self._wall * np.linalg.norm(self._bend, axis=1)
        self._third = np.maximum(third, floor)
        self._bend_direction = steps / step
        self._bend_reach = max(step, SHORTEST_REACH * self._wall)

    def _inputs_for(self, condensed: Condensed, steps: Array, inputs: Array) -> Array:
        """`inputs` (j,) with the pushes of driven contacts as the tick finds them from `steps`."""
        driven = np.flatnonzero(self._driven(self._load))
        if not len(driven):
            return inputs
        left = steps - condensed.displacement @ inputs
        result = inputs.copy()
        result[driven] += np.linalg.lstsq(
            condensed.displacement[np.ix_(driven, driven)], left[driven], rcond=None
        )[0]
        return result

    def _to_limit(self, fields: Array) -> Array:
        """Motion of the limit positions (n, 3, j) for fields (N, j) of all unknowns."""
        count = fields.shape[1]
        controls = fields[: 3 * self._size].reshape(self._size, 3 * count)
        limit = self.model.surface.limit_matrix @ controls
        return np.ascontiguousarray(limit.reshape(self._size, 3, count))

    def _carried(self) -> Pose:
        """Rigid motion of an object that only fingers hold, since it was unloaded."""
        if self.model.free_modes.shape[1] < MAX_RIGID or not self.contacts.contacts:
            return IDENTITY
        surface = self.model.surface.limit_positions(self.tracker.positions)
        return carried(self.unloaded_surface, surface, self._energy_density.areas)

    def _snap_margin(self, compliance: Array) -> float:
        """Smallest contact stiffness over that of the unloaded shell; 0 where it snaps."""
        if self._small is None or not len(compliance):
            return 1.0
        return _smallest_stiffness(compliance) / _smallest_stiffness(self._small.compliance)


def _smallest_stiffness(compliance: Array) -> float:
    """Stiffness [N/m] along the softest combination of contacts; negative beyond a limit point."""
    values = np.linalg.eigvalsh(0.5 * (compliance + compliance.T))
    if values[0] < 0:
        return 1.0 / float(values[0])
    return 1.0 / float(values[-1])


def _fill_grips(slot: Slot, gripping: Gripping, motions: Array, rows: ContactRows) -> None:
    """Write what the grips do, and what they would do to the rest."""
    record, columns = slot.record, gripping.columns
    assert columns is not None
    g, k, r = len(motions), rows.contacts, rows.left.shape[1]
    record['grip'][:g] = motions
    record['grip_pose'][:g], record['grip_wrench'][:g] = gripping.answered()
    record['grip_bend'] = gripping.bend
    record['displacement_by_grip'][:k, : AFFINE * g] = columns.displacement
    record['reaction_by_grip'][: 2 * k, : AFFINE * g] = columns.reaction
    record['rigid_by_grip'][:r, : AFFINE * g] = columns.rigid_reaction
    slot.grips[:] = gripping.limit_columns


def _in_object_frame(touch: Touch, pose: Pose) -> Touch:
    return Touch(
        touch.finger,
        pose.to_object(touch.point),
        touch.normal @ pose.rotation,
        touch.radius,
        touch.force,
        touch.travel,
        touch.displacement,
    )
