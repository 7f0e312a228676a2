# SPDX-License-Identifier: Apache-2.0
"""What the background process does with fingers that carry rigid bodies: pads, tips, plates.

Their contact regions grow, stick and slip, and friction remembers how it got where it is: load
cases are taken one after the other, none is left out here, and every answer is a state of its own.
A load case says where the fingers are, never what an answer made of that, so that the states do
not depend on when answers were ready.

A free object that one finger alone touches can be held by none: until another one joins, the
finger counts as a pin, and friction begins where the second one touches.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.bodies import BodyError
from shell_deform.contact.body_file import FingerBody
from shell_deform.contact.contact_field import Memory, contact_field
from shell_deform.contact.finger_bodies import of_finger, sizes
from shell_deform.contact.region import pressed_areas
from shell_deform.grasp.contacts import GraspContacts
from shell_deform.grasp.reading import (
    Response,
    WallReader,
    WallState,
    body_mass,
    holds_still,
    unheld,
    wall_reader,
)
from shell_deform.grasp.touching import read_grasp, touched_response
from shell_deform.live.background.answer import Answer, write
from shell_deform.live.background.condensed import Condensed, CondensedSystem, contact_rows
from shell_deform.live.background.condensed_bodies import Touched, condense, touches_of
from shell_deform.live.background.contact_tracking import Touch
from shell_deform.live.background.energy_density import EnergyDensity
from shell_deform.live.background.fingers import Finger, laid
from shell_deform.live.background.grasp_response import fill_grasp
from shell_deform.live.background.gripping import fill_grips
from shell_deform.live.background.load_case import Load
from shell_deform.live.background.rest_shell import RestShell
from shell_deform.live.background.second_order import Columns, SecondOrder
from shell_deform.live.background.self_crossing import SelfCrossing
from shell_deform.live.background.small_loads import SmallLoads, small_loads, snap_margin
from shell_deform.live.background.solving import LiveSolver
from shell_deform.live.background.touch_cells import taxel_rows
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.live.exchange import DRIVE_FORCE, MAX_CONTACTS, Slot
from shell_deform.live.pose import Pose
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, gripped
from shell_deform.solve.first_touch import alone
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions

Array = NDArray[np.float64]

OPTIONS = NewtonOptions(tolerance=1e-4, contraction=0.4, chord_residual=0.3, stability=False)
"""Of equilibria that are told at a rate: an unbalanced force of 1e-4 of the loads moves a wall by
far less than anybody measures, and iterations cost a sixth of a factorisation."""

FEWEST_TO_HOLD = 2
"""Fingers that hold a free object between them."""

FEWEST_POINTS = 10
"""Contact points below which a contact region says little about its size."""

FIRST_DOUBT = 1.0
"""Before two answers are known: error of frozen contacts per squared step, over the wall [-]."""

FORGETS = 0.5
"""That error is at least this share of what it was an answer before [-]."""

SMALLEST_WAY = 0.005
"""Steps below this share of the wall tell nothing of it."""

SMALLEST_PUSH = 1e-3
"""A body driven by its force pushes at least with this [N]: it is said to touch."""


@dataclass(frozen=True)
class Held:
    """An answer: fingers on the shell, its equilibrium, and the columns there.

    Attributes:
        fingers: by their numbers. state: the equilibrium. case: what it is under.
        touched, columns: about it. by_grips: (n, 3, 12 g) of the surface.
        doubt: error of frozen contacts per squared step [1/m].
        grasp: its contacts; response: how they share out loads. wall: what the wall bears.
    """

    fingers: tuple[Finger, ...]
    state: Equilibrium
    case: LoadCase
    touched: Touched
    columns: Columns
    by_grips: Array
    doubt: float
    grasp: GraspContacts
    response: Response
    wall: WallState


class FingertipSolver:
    """One shell between fingers that carry bodies; after each load case a slot can be filled."""

    def __init__(self, model: ShellModel, bodies: Mapping[int, FingerBody]) -> None:
        """`bodies` by the numbers of their fingers, 0 for those without an own one."""
        self.pins = LiveSolver(model)
        self.model = model
        self._bodies = dict(bodies)
        self._solver = EquilibriumSolver(model, OPTIONS)
        self._solver.beat = lambda: self.tracker.beat()
        self._wall = float(model.shell.thickness.mean())
        self._energy_density = EnergyDensity(model)
        self._mass = body_mass(model)
        self._reader: WallReader | None = None
        self._crossing = SelfCrossing(model)
        self._second = SecondOrder(len(model.rest), self._wall)
        self._unloaded = alone(self._solver)
        self._held: Held | None = None
        self._load: Load | None = None
        self._pose: Pose | None = None
        self._small: SmallLoads | None = None
        self._untouched: Condensed | None = None
        self._linear = np.zeros((len(model.rest), 3, 0))
        self.share, self.seconds, self.message, self._refused = 1.0, 0.0, '', ''
        self.motion = None
        """Friction remembers: nothing is solved ahead of what has come."""
        self.is_awaited: Callable[[], bool] = lambda: False
        self.rest_grips = self.pins.rest_grips
        self.turning = False
        """Columns belong to every answer, whether grips move or not."""

    @property
    def tracker(self) -> EquilibriumTracker:
        """Follows what counts as a pin."""
        return self.pins.tracker

    @property
    def unloaded_surface(self) -> Array:
        """See `LiveSolver`."""
        return self.pins.unloaded_surface

    @property
    def unloaded_normals(self) -> Array:
        """See `LiveSolver`."""
        return self.pins.unloaded_normals

    @property
    def unloaded_outer(self) -> Array | None:
        """See `LiveSolver`."""
        return self.pins.unloaded_outer

    def warm_up(self) -> None:
        """See `LiveSolver`."""
        self.pins.warm_up()

    def rest_shell(self, curl: float = 0.0) -> RestShell:
        """See `LiveSolver`."""
        return self.pins.rest_shell(curl)

    def start_over(self) -> None:
        """Back to the unloaded shell without contacts."""
        self._let_go()
        self.pins.start_over()

    def take(self, load: Load) -> None:
        """Bring bodies and equilibrium to `load` as far as they follow."""
        began = time.perf_counter()
        if load.reset or load.jump or not load.touches:
            self._let_go()
        self._load = load
        if not self._can_hold(load):
            if self._held is not None:
                self._let_go()
            self.pins.take(load)
            self.pins.refine()
        else:
            self._follow(load)
        self.seconds = time.perf_counter() - began

    columns_serve = True
    """Columns belong to every answer: there are none to add."""

    def refine(self) -> bool:
        """See `columns_serve`."""
        return False

    def _can_hold(self, load: Load) -> bool:
        return len(load.touches) >= FEWEST_TO_HOLD or (
            bool(load.touches) and not self.model.free_modes.shape[1]
        )

    def _let_go(self) -> None:
        self._held = self._pose = self._small = self._untouched = None
        self._second.forget()
        self.share, self.message, self._refused = 1.0, '', ''
        self.pins.generation += 1

    def _follow(self, load: Load) -> None:
        """Take a load case of bodies; where it cannot be, the last answer stays, with why."""
        if self._held is None:
            self.pins.start_over()
        if load.pose is not None or self._pose is None:
            self._pose = self.pins.pose_of(load)
        pose = self._pose
        assert pose is not None
        touches = sorted(load.touches, key=lambda touch: touch.finger)[:MAX_CONTACTS]
        try:
            self._held = self._answered(load, [touch.seen_from(pose) for touch in touches])
            self._refused = ''
        except BodyError as error:
            self._refused = str(error)
        except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            if self._held is None:
                raise
            self.share, self.message = 0.0, str(error)

    def _answered(self, load: Load, touches: list[Touch]) -> Held:
        """The answer to a load case from the last one."""
        fingers, state, anew = self._met(touches, load)
        case = self._case(load, fingers)
        found = self._solver.solve(case, state)
        gripping = self.pins.gripping
        if gripping is not None:
            torn = gripping.tears(self._solver.model, found.unknowns, found.grip_motion)
            if torn:
                raise ValueError(torn)
        self.share, self.message = found.load_fraction, found.message
        found = replace(found, converged=True, message='')
        found = replace(found, touches=touches_of(self._solver, case, found))
        near = self._solver.known if load.hurried else None
        model = self._solver.model
        grasp = read_grasp(model, case.contacts, found, load.friction)
        held = holds_still(model, case.contacts, grasp)
        self.tracker.beat()
        touched = condense(self._solver, case, found, self._mass if held else None, near)
        if anew:
            self._begin(fingers)
        if self._untouched is not None and np.all(np.abs(found.force) < SMALLEST_PUSH):
            # Until a body presses, what it is about to do is what a pin does there.
            rigid = np.zeros(len(self._untouched.rigid_reaction))
            touched = replace(touched, condensed=self._untouched, rigid=rigid)
        columns = self._columns(fingers, found, touched)
        doubt = self._learn(None if anew else self._held, fingers, case, columns)
        # In a hurry the grasp and the wall are those of the last answer.
        last = None if near is None or anew else self._held
        if touched.standing is None:
            response = unheld(found.positions.mean(axis=0), len(fingers))
        elif last is not None and last.response.sharing is not None:
            response = last.response
        else:
            response = touched_response(model, case.contacts, found, grasp, touched.standing)
        self.tracker.beat()
        if anew or self._reader is None:
            self._reader = wall_reader(model, case.contacts)
        if last is not None:
            wall = last.wall
        else:
            wall = self._reader.at(found.unknowns, found.force, found.displacement)
        by_grips = model.surface.limit_fields(touched.grips.fields)
        return Held(fingers, found, case, touched, columns, by_grips, doubt, grasp, response, wall)

    def _met(
        self, touches: list[Touch], load: Load
    ) -> tuple[tuple[Finger, ...], Equilibrium, bool]:
        """Fingers where they report, the last state seen with them, and whether they are others.

        What bodies that stay remember of their friction stays with them.
        """
        held = self._held
        known = {} if held is None else {finger.number: finger for finger in held.fingers}
        state = self._untouched_by(load) if held is None else held.state
        friction = load.friction
        fingers, places = [], []
        for touch in touches:
            old = known.get(touch.finger)
            if old is not None and _far(old, touch):
                old = None
            places.append(-1 if old is None or held is None else held.fingers.index(old))
            if old is not None:
                fingers.append(old.moved(touch, friction))
                continue
            carried = of_finger(self._bodies, touch.finger)
            fingers.append(laid(self._solver.model, state.unknowns, touch, carried, friction))
        stay = held is not None and places == list(range(len(held.fingers)))
        if not stay:
            state = self._with_contacts(tuple(fingers), places, state)
        return tuple(fingers), state, not stay

    def _untouched_by(self, load: Load) -> Equilibrium:
        """The shell before any body touches it, its grips where they are. Raises ValueError."""
        motions = load.grips[: len(self.model.grips)]
        if not motions.any():
            return self._unloaded
        found = self._solver.solve(gripped(motions), self._unloaded)
        if not found.converged:
            raise ValueError(f'the grips lead nowhere: {found.message}')
        return found

    def _with_contacts(
        self, fingers: tuple[Finger, ...], places: list[int], state: Equilibrium
    ) -> Equilibrium:
        """The state under other contacts: those at `places` of the last ones, -1 for new ones."""
        self._solver.known = None
        count = len(fingers)
        depth = np.array([finger.offset for finger in fingers])
        force, motion = np.zeros(count), np.zeros((count, 6))
        model = self._solver.model
        field = contact_field(
            model.outer_face,
            model.wall_stiffness,
            {k: finger.body for k, finger in enumerate(fingers)},
            np.ones(count, dtype=bool),
        )
        for new, old in enumerate(places):
            if old >= 0:
                force[new], depth[new] = state.force[old], state.displacement[old]
                motion[new] = 0.0 if state.motion is None else state.motion[old]
        fresh = field.started(None, state.unknowns, depth, motion).memory
        distance, anchor = fresh.distance.copy(), fresh.anchor.copy()
        for new, old in enumerate(places):
            if old >= 0 and state.memory is not None:
                distance[new], anchor[new] = state.memory.distance[old], state.memory.anchor[old]
        return replace(
            state,
            force=force,
            displacement=depth,
            motion=motion,
            memory=Memory(distance, anchor),
            touches=(),
            multipliers=np.zeros(0),
            history=(),
        )

    def _case(self, load: Load, fingers: tuple[Finger, ...]) -> LoadCase:
        """By their travel where it is known and counts, else by their force."""
        depth = np.array([finger.depth(load.tendon) for finger in fingers])
        if load.drive == DRIVE_FORCE:
            depth[:] = np.nan
        push = np.array([max(finger.touch.force, SMALLEST_PUSH) for finger in fingers])
        return LoadCase(
            tuple(finger.contact for finger in fingers),
            np.where(np.isfinite(depth), np.nan, push),
            depth,
            motion=np.array([finger.motion for finger in fingers]),
            grip_motion=load.grips[: len(self.model.grips)],
        )

    def _columns(
        self, fingers: tuple[Finger, ...], state: Equilibrium, touched: Touched
    ) -> Columns:
        """The tangent about an answer, on the limit surface."""
        condensed = touched.condensed
        across = [
            float(axis @ finger.motion[:3])
            for finger in fingers
            for axis in finger.contact.lateral
        ]
        return Columns(
            self.model.surface.limit_positions(state.positions),
            self.model.surface.limit_fields(condensed.fields),
            condensed.displacement,
            state.displacement,
            np.concatenate([state.force, across, touched.rigid, [0.0]]),
        )

    def _areas(self, state: Equilibrium) -> list[Array]:
        """Of the contact region of each body, by its pressed points [m^2]."""
        assert state.memory is not None
        face = self._solver.model.outer_face
        return [pressed_areas(face, state.memory, touch) for touch in state.touches]

    def _begin(self, fingers: tuple[Finger, ...]) -> None:
        """Other contacts: linear theory from rest for pins at their places."""
        self.pins.generation += 1
        model, unloaded = self.model, self.pins.unloaded
        rows = contact_rows(model, tuple(finger.pin for finger in fingers))
        tangent, factor = self.pins.tracker.rest_tangent(unloaded)
        system = CondensedSystem(factor, tangent, rows)
        self._untouched = system.condense()
        self._small = small_loads(
            model, model.shell.continued(model.shell, unloaded), system, rows
        )
        self._linear = model.surface.limit_fields(self._small.fields)
        self._second.forget()

    def _learn(
        self,
        last: Held | None,
        fingers: tuple[Finger, ...],
        case: LoadCase,
        columns: Columns,
    ) -> float:
        """Second order of the way here, and by how much frozen contacts missed its end [1/m]."""
        if last is None:
            return FIRST_DOUBT / self._wall
        if not np.array_equal(case.grip_motion, last.case.grip_motion):  # type: ignore[arg-type]
            # What bent the way here was no body's step alone.
            self._second.forget()
            return last.doubt
        steps = columns.displacement - last.columns.displacement
        change = case.motions - last.case.motions
        halves = np.array([finger.carried.size for finger in fingers])
        ways = np.abs(steps) + np.linalg.norm(change[:, :3], axis=1)
        way = float((ways + halves * np.linalg.norm(change[:, 3:], axis=1)).max())
        doubt = last.doubt
        if way > SMALLEST_WAY * self._wall:
            same = columns.inputs.shape == last.columns.inputs.shape
            inputs = columns.inputs - last.columns.inputs if same else np.zeros(0)
            served = last.columns.surface + (last.columns.columns @ inputs if same else 0.0)
            if len(self._second.direction) == len(steps):
                served = served + (self._second.direction @ steps) ** 2 * self._second.field
            missed = float(np.linalg.norm(columns.surface - served, axis=1).max())
            doubt = max(missed / way**2, FORGETS * doubt)
            if same:
                self._second.along(last.columns, columns, case.driven)
        return doubt

    def fill(self, slot: Slot) -> None:
        """Write the present result."""
        if self._held is None:
            self.pins.fill(slot)
        else:
            self._fill(slot, self._held)
        if self._refused:
            slot.record['refused'] = 1
            slot.record['message'] = self._refused.encode()[:200]

    def _fill(self, slot: Slot, held: Held) -> None:
        fingers, state, condensed = held.fingers, held.state, held.touched.condensed
        count = len(fingers)
        lateral = np.array([d for f in fingers for d in f.contact.lateral])
        pushed = np.repeat([touch.force for touch in state.touches], 2, axis=0)
        reaction = np.einsum('ki,ki->k', lateral, pushed)
        if len(state.multipliers) >= 3 * count and not fingers[0].body.friction:
            reaction -= state.multipliers[: 3 * count].reshape(count, 3)[:, :2].ravel()
        assert self._pose is not None and self._load is not None
        answer = Answer(
            numbers={
                'stamp': self._load.stamp,
                'generation': self.pins.generation,
                'share': self.share,
                'stable': int(held.touched.stable(held.case.driven)),
                'crosses': int(self._crossing.found(state.positions, self._load.stamp)),
                'snap_margin': snap_margin(self._small, condensed.displacement[:, :count]),
                'energy': state.energy,
                'rest_energy': self._unloaded.energy,
                'seconds': self.seconds,
                'factorisations': state.factorisations,
                'rigid_scale': np.sqrt(len(self.model.rest)),
                'set_doubt': held.doubt,
            },
            contacts={
                'finger': [finger.number for finger in fingers],
                'force': state.force,
                'displacement': state.displacement,
                'travel_offset': [finger.offset for finger in fingers],
                'axis': [finger.contact.axis for finger in fingers],
                'anchor': [finger.touch.point for finger in fingers],
                'frame': [finger.now for finger in fingers],
                'reach': [finger.carried.size for finger in fingers],
                'place': [finger.contact.point for finger in fingers],
                'coarseness': [finger.coarseness for finger in fingers],
                'lateral': lateral,
                'rigid': held.touched.rigid,
                'touch_point': held.grasp.point,
                'touch_normal': held.grasp.normal,
                'spin': held.grasp.spin,
                'arm': held.grasp.arm,
                'reaction': reaction,
                'rigid_reaction': np.zeros(len(held.touched.rigid)),
                'pose': self._pose.numbers,
                'pose_covariance': np.zeros((6, 6)),
            },
            condensed=condensed,
            columns=held.columns.columns,
            since=np.zeros(count),
            second=self._second,
            small=self._small,
            linear=self._linear,
            message=self.message or _few_points(fingers, state),
            surface=held.columns.surface,
            normals=self.model.surface.vertex_normals(state.positions),
            energy_density=self._energy_density.at(state.positions),
            taxels=taxel_rows(fingers, state.touches, self._areas(state)),
        )
        write(slot, answer, self._wall)
        fill_grasp(slot.record, held.response, held.wall)
        if self.pins.gripping is not None:
            told = state.grip_pose, state.grip_wrench
            fill_grips(slot, state.grip_motion, told, held.touched.grips, held.by_grips)
            slot.record['grip_bend'] = self.pins.gripping.bend
        if slot.outer is not None and slot.outer_slope is not None:
            slot.outer[:] = self._solver.model.shell.outer_face(state.unknowns) - answer.surface
            slot.outer_slope[:] = 0.0


def _far(finger: Finger, touch: Touch) -> bool:
    """Whether a finger is so far from where it last was that it touches anew."""
    away = float(np.linalg.norm(touch.point - finger.touch.point))
    turned = finger.moved(touch, finger.body.friction).now - finger.now
    reach = sizes([finger.carried])[1]
    leap = max(away, reach * float(np.linalg.norm(turned, axis=0).max()))
    return leap > 2.0 * finger.carried.size


def _few_points(fingers: tuple[Finger, ...], state: Equilibrium) -> str:
    """A word where a contact region is seen by too few points."""
    few = [
        f'finger {finger.number} presses {len(touch.pressure)} contact points'
        for finger, touch in zip(fingers, state.touches, strict=True)
        if 0 < len(touch.pressure) < FEWEST_POINTS
    ]
    return f'{"; ".join(few)}: more control vertices there resolve its region' if few else ''
