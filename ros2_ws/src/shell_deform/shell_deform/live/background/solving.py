# SPDX-License-Identifier: Apache-2.0
"""What the background process does with a load case: contacts, equilibrium, columns, result.

Free of processes and shared memory, so that tests and offline runs can call it directly.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.stamps import WallError
from shell_deform.grasp.contacts import UNIFORM_ARM
from shell_deform.grasp.reading import outer_feet
from shell_deform.live.background.answer import Answer, write
from shell_deform.live.background.carried import carried
from shell_deform.live.background.condensed import (
    HELD_ROWS,
    Condensed,
    ContactRows,
    contact_rows,
    lateral_part,
)
from shell_deform.live.background.contact_tracking import ContactTracker, HeldContact, Touch
from shell_deform.live.background.energy_density import EnergyDensity
from shell_deform.live.background.grasp_response import GraspResponse
from shell_deform.live.background.gripping import Gripping
from shell_deform.live.background.load_case import Load
from shell_deform.live.background.motion import Motion
from shell_deform.live.background.outer_field import OuterField, unmodelled
from shell_deform.live.background.placement import Placement, place
from shell_deform.live.background.rest_shell import RestShell, largest_curl
from shell_deform.live.background.second_order import Columns, SecondOrder
from shell_deform.live.background.self_crossing import SelfCrossing
from shell_deform.live.background.shear_dent import ShearDent
from shell_deform.live.background.small_loads import SmallLoads, small_loads, snap_margin
from shell_deform.live.background.tracked_state import State, Target
from shell_deform.live.background.tracking import EquilibriumTracker, TrackingOptions
from shell_deform.live.exchange import DRIVE_FORCE, MAX_CONTACTS, MAX_RIGID, Slot
from shell_deform.live.pose import IDENTITY, Pose
from shell_deform.model import ShellModel
from shell_deform.solve.first_touch import alone
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import THICK

Array = NDArray[np.float64]

LIVE = TrackingOptions(step=4e-3)
"""What the last chord step leaves, a tenth or so of it, the columns take away by a Newton step."""

FEW_ITERATIONS = 4
"""Columns serve on where their tangent led to the next state in so many iterations."""

FARTHEST_STEP = 0.25
"""In real time a thick wall goes to a load case further than this many wall thicknesses in parts,
until a newer one has come: a long step costs more than its parts, and while it is solved the
fingers get further away."""

SLIDING = 8
"""New tangents that following a slide may take: a pin that stays where it was costs less."""

MOST_STATES = 3
"""States in a row that are served with the same columns."""

STILL = 1e-3
"""A state that moved less than this share of the wall thickness keeps its columns."""


@dataclass(frozen=True)
class Held:
    """A shell under its fingers: their patches, the model with these, its equilibrium."""

    contacts: tuple[HeldContact, ...]
    model: ShellModel
    state: State


class LiveSolver:
    """One shell under changing load cases; after each, a result slot can be filled."""

    def __init__(
        self, model: ShellModel, options: TrackingOptions | None = None, pins_slide: bool = False
    ) -> None:
        """`pins_slide`: whether fingers do not rub, so that nothing holds a patch sideways."""
        self.model = model
        self.pins_slide = pins_slide
        self.tracker = EquilibriumTracker(model, options or LIVE)
        self.contacts = ContactTracker(model, model.rest, slides=pins_slide)
        self.gripping = Gripping(self.tracker) if model.grips else None
        self._wall = float(model.shell.thickness.mean())
        self._energy_density = EnergyDensity(model)
        self._size = len(model.rest)
        self.generation = 0
        self._rigid_anchor = np.zeros(0)
        self._condensed: Condensed | None = None
        self._condensed_at = np.zeros(0)
        self._states = 0
        self._exactly = True
        self._columns: Columns | None = None
        self._load: Load | None = None
        self._pose_in_use = IDENTITY
        self._unloaded: Array | None = None
        self._second = SecondOrder(self._size, self._wall)
        self._face = OuterField(self.tracker) if model.theory == THICK else None
        self._shear_dent = None if model.theory == THICK else ShearDent(model)
        self._small: SmallLoads | None = None
        self._linear_columns = np.zeros((self._size, 3, 0))
        self._placement: Placement | None = None
        self._feet = outer_feet(model, ())
        self._grasp = GraspResponse(model)
        self._crossing = SelfCrossing(model)
        self.share = 1.0
        self._nowhere = np.zeros((0, 3))
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
        self.contacts = ContactTracker(model, self.unloaded, slides=pins_slide)
        self._unloaded_state = self.tracker.state
        self.unloaded_surface = model.surface.limit_positions(self.unloaded)
        self.unloaded_normals = model.surface.vertex_normals(self.unloaded)
        self.unloaded_outer: Array | None = None
        if self._face is not None:
            self.unloaded_outer = self.unloaded_surface + self._face.offset()
        if self.gripping is not None:
            self._take_grip_columns(self.gripping)
        self.rest_grips = self.gripping.limit_columns if self.gripping is not None else 0.0

    def _unload(self) -> None:
        """Go to equilibrium without contacts: not the given shape where it is under pressure.

        Raises FirstTouchError where it cannot stand under that.
        """
        rows = contact_rows(self.model, ())
        self.tracker.reset()
        self.tracker.set_contacts(rows, np.zeros(0))
        if self.model.own_pressure:
            self.tracker.start_from(alone(EquilibriumSolver(self.model)))
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
        pose = self.pose_of(load)
        touches = tuple(touch.seen_from(pose) for touch in load.touches)
        self.turning = not np.array_equal(grips, self.tracker.state.grips)
        anew = self.turning or self.contacts.contacts or (len(grips) and self.share < 1.0)
        if touches or anew:
            if not len(grips) and self.contacts.exchanged(touches):
                # What those that have gone had made of the shell is no shape to come to.
                self._let_go()
            before = dict(zip(self._fingers(), self._displacements(), strict=True))
            lost = bool(self.tracker.message)
            good = self._go(load, touches, before, began)
            twice = bool(self.contacts.laid) or (bool(len(grips)) and not lost)
            twice |= not len(grips) and self._leads_nowhere(lost, touches)
            if self.tracker.message and twice and not self._nearly_at_rest():
                # The shape of another grasp or a lost one may lead nowhere: once from rest.
                self._let_go()
                self._lay(touches)
                self.share = self.tracker.advance(self._target(load, touches, {}))
            if self.gripping is not None and (torn := self.gripping.torn()):
                self.tracker.message, self.share = torn, 0.0
                if len(good.moved) == len(self.tracker.state.moved):
                    self.tracker.state = good
                    self.tracker.forget_tangent()
        self.seconds = time.perf_counter() - began

    def _go(
        self, load: Load, touches: tuple[Touch, ...], before: dict[int, float], began: float
    ) -> State:
        """Follow the fingers and go to `load`; returns the state that was left.

        Those that have slid where no equilibrium is found, or no pin can lie, stay as they were.
        """
        held = Held(self.contacts.contacts, self.tracker.model, self.tracker.state)
        try:
            self._lay(touches)
            target = self._target(load, touches, before)
            if self.motion is not None:
                target = self.motion.ahead(target, self.generation, began)
            left = self.tracker.state
            self.share = self._approach(target)
            if not (self.tracker.message and self._only_slid(held)):
                return left
        except WallError:
            if not self._only_slid(held):
                raise
        self.contacts.stay(held.contacts, touches)
        self._change_contacts(held.state.force, held)
        self.share = self._approach(self._target(load, touches, before))
        return held.state

    def _leads_nowhere(self, lost: bool, touches: tuple[Touch, ...]) -> bool:
        """Whether a state that was `lost` before is no way at all to where the fingers are.

        Once for every quarter of a wall that they move: to come from rest instead is dear.
        """
        if not lost or self.share > 0.0:
            self._nowhere = np.zeros((0, 3))
            return False
        at = np.array([touch.point for touch in touches]).reshape(-1, 3)
        near = FARTHEST_STEP * self._wall
        if at.shape == self._nowhere.shape and np.abs(at - self._nowhere).max(initial=0.0) < near:
            return False
        self._nowhere = at
        return True

    def _only_slid(self, held: Held) -> bool:
        """Whether the fingers that `held` are all there, and some of them on other patches."""
        same = self._fingers() == [contact.finger for contact in held.contacts]
        return same and bool(self.contacts.slid) and not self.contacts.laid

    def _approach(self, target: Target) -> float:
        """Go to `target`, or with a thick wall in real time until a newer load case has come.

        Returns the share reached.
        """
        tangents = SLIDING if self.contacts.slid and not self.contacts.laid else None
        if self.motion is None or self._face is None:
            return self.tracker.advance(target, tangents)
        while True:
            near, part = self.tracker.within(target, FARTHEST_STEP * self._wall)
            share = part * self.tracker.advance(near, tangents)
            # A grasp that is taken up is answered whole: its first answer ends the taking up.
            if part == 1.0 or self.tracker.message:
                return share
            if not self.contacts.laid and self.is_awaited():
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
        return RestShell(self.model, self.unloaded, tangent, factor, curl, self.pins_slide)

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
        good = self.tracker.tried <= FEW_ITERATIONS and not self.tracker.message
        return self._condensed is not None and good and self._states < MOST_STATES

    def refine(self) -> bool:
        """Take columns and grasp at the present state; False if those at hand are good enough."""
        tracker = self.tracker
        if (
            self._condensed is not None
            and self._exactly
            and np.abs(tracker.state.moved - self._condensed_at).max() < STILL * self._wall
        ):
            return self._grasp.renew(tracker, self._feet, self._condensed, moved=False)
        old = self._columns
        self._exactly = not (tracker.is_near_tangent and self.is_awaited())
        self._condensed = tracker.condense(self._exactly)
        self._states = 0
        self._condensed_at = tracker.state.moved
        self._columns = Columns(
            self.model.surface.limit_positions(tracker.positions),
            self.model.surface.limit_fields(self._condensed.fields),
            self._condensed.displacement,
            self._displacements(),
            self._inputs(),
        )
        if self._small is not None and not len(self._second.direction):
            self._bend_from_rest(self._small)
        step = 0.0
        if self.gripping is not None and self.gripping.left(tracker.state.grips):
            # What bent the way here was no contact's step alone.
            self._second.direction = np.zeros(0)
        elif old is not None:
            step = self._second.along(old, self._columns, self._driven(self._load))
        if self._face is not None:
            self._face.refined(step)
        if self.gripping is not None:
            self._take_grip_columns(self.gripping)
        self._grasp.renew(tracker, self._feet, self._condensed, moved=True)
        return True

    def _take_grip_columns(self, gripping: Gripping) -> None:
        columns = self.tracker.system().grip_columns(self.tracker.model)
        gripping.take_columns(self.model.surface.limit_fields(columns.fields), columns)

    def fill(self, slot: Slot) -> None:
        """Write the present result."""
        if self._condensed is None:
            self.refine()
        condensed, columns = self._condensed, self._columns
        assert condensed is not None and columns is not None
        tracker = self.tracker
        rows = self._rows()
        k = rows.contacts
        present = tracker.present(np.zeros(k, bool))
        system = tracker.system()
        placement = self._placement
        positions = tracker.positions
        point, normal = self._feet.at(positions)
        note = placement.open_directions if placement is not None and not self.message else ''
        surface = self.model.surface.limit_positions(positions)
        contacts = self.contacts.contacts
        normals = self.model.surface.vertex_normals(positions)
        answer = Answer(
            numbers={
                'stamp': self._stamp,
                'generation': self.generation,
                'share': self.share,
                'stable': int(system.negative_modes_driven(self._driven(self._load)) == 0),
                'crosses': int(self._crossing.found(positions, self._stamp)),
                'snap_margin': snap_margin(self._small, system.compliance),
                'energy': tracker.state.energy,
                'rest_energy': self._unloaded_state.energy,
                'seconds': self.seconds,
                'factorisations': tracker.factorisations,
                'rigid_scale': np.sqrt(self._size),
            },
            contacts={
                'finger': self._fingers(),
                'force': tracker.state.force,
                'displacement': present.displacement,
                'travel_offset': [c.travel_offset for c in contacts],
                'axis': [c.patch.axis for c in contacts],
                'anchor': [c.touched for c in contacts],
                'place': [c.patch.point for c in contacts],
                'coarseness': [c.coarseness for c in contacts],
                'lateral': [d for c in contacts for d in c.patch.lateral],
                'rigid': present.rigid,
                'touch_point': point,
                'touch_normal': normal,
                'reaction': -lateral_part(rows.of_patches(tracker.state.multipliers)),
                'rigid_reaction': -rows.of_left(tracker.state.multipliers),
                'spin': self._spins(),
                'arm': [UNIFORM_ARM * c.patch.radius for c in contacts],
                'carried': self._carried(surface).numbers,
                'pose': self._pose_in_use.numbers,
                'pose_covariance': np.zeros((6, 6)) if placement is None else placement.covariance,
            },
            condensed=condensed,
            columns=columns.columns,
            since=rows.measure.T @ (tracker.state.moved - self._condensed_at),
            second=self._second,
            small=self._small,
            linear=self._linear_columns,
            message=self.message or note,
            surface=surface,
            normals=normals,
            energy_density=self._energy_density.at(positions),
        )
        write(slot, answer, self._wall)
        self._grasp.fill(slot.record)
        if self.gripping is not None:
            self.gripping.fill(slot)
        slot.unmodelled[:] = self._unmodelled(columns, present.displacement, normals)
        if self._face is not None and slot.outer is not None and slot.outer_slope is not None:
            slot.outer[:], slot.outer_slope[:] = self._face.offset(), self._face.slope

    @property
    def _stamp(self) -> int:
        return self._load.stamp if self._load is not None else 0

    def _rows(self) -> ContactRows:
        assert self.tracker.rows is not None
        return self.tracker.rows

    def _fingers(self) -> list[int]:
        return [contact.finger for contact in self.contacts.contacts]

    def _spins(self) -> Array:
        """(k,) torques [N m] of the fingers about their axes."""
        patches = self.contacts.patches
        held = self._rows().of_patches(self.tracker.state.multipliers).reshape(-1, HELD_ROWS)
        return np.array(
            [-patch.radius * one[-1] for patch, one in zip(patches, held, strict=True)]
        )

    def _displacements(self) -> Array:
        return np.asarray(self._rows().measure.T @ self.tracker.state.moved)

    def pose_of(self, load: Load) -> Pose:
        """Where the object is, given or fitted to the contacts of first touch."""
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

    def _change_contacts(self, force: Array, held: Held | None = None) -> None:
        """Go on with the patches in use and these pushes (k,) [N], or as these patches `held`."""
        if len(self.contacts.contacts) > MAX_CONTACTS:
            raise ValueError(f'more than {MAX_CONTACTS} contacts; merge tactile cells first')
        model = held.model if held is not None else self.model.on_contacts(self.contacts.patches)
        self.tracker.take(model)
        rows = contact_rows(self.tracker.model, self.contacts.patches)
        self._feet = outer_feet(self.model, self.contacts.patches)
        self._grasp.take(self.tracker.model, self.contacts.patches)
        self.tracker.set_contacts(rows, force)
        if held is not None:
            self.tracker.state = held.state
            self.tracker.forget_tangent()
        self._new_generation(rows)

    def _new_generation(self, rows: ContactRows) -> None:
        self.generation += 1
        self._rigid_anchor = rows.left.T @ self.tracker.state.moved
        self._condensed = self._columns = None
        self._second.forget()
        self._small = None
        if self._face is not None:
            self._face.forget()
        if rows.contacts and self._unloaded is not None:
            system = self.tracker.rest_system(self._unloaded, rows)
            unloaded = self.tracker.unloaded(self._unloaded)
            self._small = small_loads(self.tracker.model, unloaded, system, rows)
            self._linear_columns = self.model.surface.limit_fields(self._small.fields)
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
        present = self.tracker.present(self._driven(load))
        same = load.generation == self.generation
        force = present.force.copy()
        displacement = present.displacement.copy()
        for i, contact in enumerate(contacts):
            touch = by_finger.get(contact.finger)
            force[i] = touch.force if touch is not None else 0.0
            if touch is None or not present.driven[i]:
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
        held = [contact.held for contact in contacts if not contact.patch.slides]
        return Target(
            force,
            displacement,
            present.driven,
            rigid,
            np.concatenate(held) if held else np.zeros(0),
            load.grips[: len(self.model.grips)],
        )

    def _inputs(self) -> Array:
        """Values of the condensed inputs at the present state."""
        rows = self._rows()
        present = self.tracker.present(np.zeros(rows.contacts, bool))
        lateral = lateral_part(rows.of_patches(rows.held.T @ self.tracker.state.moved))
        return np.concatenate([present.force, lateral, present.rigid, [0.0]])

    def _bend_from_rest(self, small: SmallLoads) -> None:
        """Second order of new contacts: exact for a shell at rest, elsewhere for the error."""
        count = len(small.compliance)
        direction = np.full(count, 1.0 / np.sqrt(count))
        bend, push = small.bend(direction, self._driven(self._load))
        field = self.model.surface.limit_fields(bend[:, None])[:, :, 0]
        self._second.from_rest(field, push, direction, self._nearly_at_rest())

    def _unmodelled(self, columns: Columns, displacement: Array, normals: Array) -> Array:
        """Sigma (n,) [m] along `normals` (n, 3) of what the theory has not.

        The contacts are displaced by (k,) [m].
        """
        patches, k = self.contacts.patches, len(displacement)
        if self._shear_dent is None:
            return unmodelled(self.unloaded_surface, self._wall, patches, displacement)
        radius = np.array([patch.radius for patch in patches])
        return self._shear_dent.sigma(
            self.tracker.state.force, radius, columns.columns[..., :k],
            columns.displacement_by[:, :k], normals,
        )  # fmt: skip

    def _carried(self, surface: Array) -> Pose:
        """Rigid motion to `surface` (n, 3) of an object that only fingers hold."""
        if self.model.free_modes.shape[1] < MAX_RIGID or not self.contacts.contacts:
            return IDENTITY
        return carried(self.unloaded_surface, surface, self._energy_density.areas)
