# SPDX-License-Identifier: Apache-2.0
"""The fast tick: from one sample of the contacts to the served surface, without solving anything.

The background process leaves an equilibrium and what a few inputs do to it. A tick weighs force
against motion for the inputs (`fusion`), multiplies the columns (`serve_kernel`) and adds what is
known of the errors. It allocates only small arrays and never waits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from shell_deform.live.exchange import MAX_CONTACTS, Slot
from shell_deform.live.grip_motion import GripPlan, GripPoses, affine
from shell_deform.live.pose import IDENTITY, Pose
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.at_rest import AtRest
from shell_deform.live.tick.first_touch import FirstTouch
from shell_deform.live.tick.fusion import ErrorModel, Posterior, fuse
from shell_deform.live.tick.fusion_types import Measured, Response
from shell_deform.live.tick.hold import ForceMemory
from shell_deform.live.tick.load_request import write_load
from shell_deform.live.tick.release import measured_displacement, pressing
from shell_deform.live.tick.sample import ContactSample, check_fingers, one_row_per_finger
from shell_deform.live.tick.serve_kernel import (
    FIELDS,
    NONLINEAR_FIELDS,
    OUTER_FIELDS,
    serve,
    serve_outer,
)
from shell_deform.live.tick.whereabouts import PlaceDoubt

Array = NDArray[np.float64]

FIRMLY = 0.5
"""Rest is the better tangent where its error estimate is less than this share of the other's."""

UNKNOWN_DENT = 5e-3
"""What a contact of unknown travel may have dented before anything is known of it [m]."""


@dataclass(frozen=True)
class Settings:
    """Everything a user may choose about the tick.

    `pose_from_fingers`: whether a pose that is given follows from the points of the fingers.
    """

    errors: ErrorModel = field(default_factory=ErrorModel)
    default_radius: float = 2e-3
    pose_from_fingers: bool = True


@dataclass(frozen=True)
class Served:
    """One answer. `packed` (n, 8) float32, (n, 11) with an outer face, is overwritten by the next
    tick.

    Attributes:
        stamp: of the sample [ns]. packed: x y z ux uy uz displacement sigma, perhaps ox oy oz.
        max_displacement: of the surface against the undeformed one where fingers have carried that
            [m]. linearity: predicted relative error of linear theory [-].
        strain_energy: [J]. nonlinear_age: sample stamp minus that of the equilibrium [s].
        snap_margin: contact stiffness over that at rest. contradiction: force against motion.
        suspect: what strains most when they contradict. extrapolation: error estimate of the
            linear step at the worst vertex [m]. force, displacement: (k,) of the known contacts.
        unknown: fingers in contact that the background process has not taken up yet.
        gripped: whether grips alone are what an equilibrium is known of.
    """

    stamp: int
    packed: NDArray[np.float32]
    max_displacement: float
    linearity: float
    strain_energy: float
    nonlinear_age: float
    snap_margin: float
    contradiction: float
    suspect: str
    extrapolation: float
    force: Array
    displacement: Array
    unknown: tuple[int, ...]
    gripped: bool = False

    @property
    def taking_up(self) -> bool:
        """Whether a finger presses that no equilibrium knows yet."""
        return bool(self.unknown)

    @property
    def answer(self) -> str:
        """What kind of answer this is, in words."""
        if self.taking_up:
            return 'taking up'
        return 'nonlinear' if len(self.force) or self.gripped else 'at rest'


@dataclass(frozen=True)
class Joined:
    """What fingers that no equilibrium knows yet add to one.

    Attributes:
        fingers: their numbers. columns: (n, 3, m) motion per push. inputs: (m,) pushes [N].
        root: (m, i) of their covariance. doubt: what all this is wrong by [m].
    """

    fingers: tuple[int, ...]
    columns: Array
    inputs: Array
    root: Array
    doubt: float


class Estimator:
    """The tick and what it remembers between samples."""

    def __init__(
        self,
        rest: Array,
        rest_normals: Array,
        settings: Settings,
        rest_outer: Array | None = None,
        grips: tuple[GripPlan, Array] | None = None,
    ) -> None:
        """`rest` (n, 3) unloaded limit positions [m] with unit normals.

        `rest_outer` (n, 3): the outer face over them, where that is a field of its own [m].
        `grips`: which there are, and (n, 3, 12 g) what they do to the surface at rest.
        """
        self.rest = rest
        self._carried_rest = rest
        self.rest_normals = rest_normals
        self.settings = settings
        self.pose: Pose | None = None
        self.adopted: Adopted | None = None
        self.posterior: Posterior | None = None
        self.measured: Measured | None = None
        self.sample: ContactSample | None = None
        self.first_touch: FirstTouch | None = None
        self.hold: ForceMemory | None = None
        self.grips = None if grips is None else GripPoses(grips[0])
        self._rest_grips = np.zeros((len(rest), 3, 0)) if grips is None else grips[1]
        self._linear: tuple[AtRest, Array, Array] | None = None
        self._places = PlaceDoubt()
        n = len(rest)
        size = float(np.linalg.norm(np.ptp(rest, axis=0)))
        self.widest = size if grips is None else math.inf
        """No answer moves the surface by more; grips may take the object anywhere [m]."""
        self._rest_offset = None if rest_outer is None else rest_outer - rest
        more = 0 if rest_outer is None else len(OUTER_FIELDS)
        self._packed = np.zeros((n, len(FIELDS) + more), dtype=np.float32)
        self._packed_linear = np.zeros((n, len(FIELDS)), dtype=np.float32)
        self._packed_nonlinear = np.zeros((n, len(NONLINEAR_FIELDS) + more), dtype=np.float32)
        self._no_columns = np.zeros((n, 3, 1))
        self._no_bend = np.zeros((n, 3))
        self._no_third = np.zeros(n)

    def forget(self) -> None:
        """Serve rest until a new result is adopted."""
        self.adopted = None
        self.posterior = None
        self._places = PlaceDoubt()
        if self.hold is not None:
            self.hold.forget()

    def adopt(self, slot: Slot) -> None:
        """Take a new result of the background process."""
        self.adopted = Adopted(slot)
        self._carried_rest = self.adopted.carried.from_object(self.rest)
        self._places.adopt(self.adopted, self.rest, self.rest_normals)
        if self.hold is not None:
            self.hold.take(self.adopted.softening)

    @property
    def pose_in_use(self) -> Pose:
        """The object's pose: given, else inferred, else identity."""
        if self.pose is not None:
            return self.pose
        return self.adopted.pose if self.adopted is not None else IDENTITY

    @property
    def unbalance(self) -> float:
        """Resultant of the measured forces of the last sample [N]: what the fit projects out."""
        return 0.0 if self.sample is None else float(np.linalg.norm(self.sample.force.sum(axis=0)))

    def tick(self, sample: ContactSample) -> Served:
        """Answer one sample; see `Served`."""
        merged = one_row_per_finger(sample, self.settings.default_radius)
        if self.hold is not None:
            merged = self.hold.elastic(merged)
        merged = pressing(merged, self.settings.errors)
        check_fingers(merged, MAX_CONTACTS)
        self.sample = merged
        if self.adopted is not None and self.grips is not None:
            self.adopted.follow(self.grips)
        self._linear = None
        told = self.pose is None or self.settings.pose_from_fingers
        self._places.see(merged, self.pose_in_use, told)
        if not len(merged.finger):
            if self.first_touch is not None:
                self.first_touch.forget()
            return self._serve_rest(merged)
        adopted = self.adopted
        away = self.grips is not None and self.grips.away
        known = np.zeros(len(merged.finger), bool)
        if adopted is not None:
            known = adopted.knows(merged, self.pose_in_use)
        first = self._first(merged) if not (known.all() or away) else None
        if adopted is None or not known.any():
            if first is None:
                return self._serve_rest(merged)
            return self._serve_from_rest(first, merged, math.nan)
        response = adopted.response
        pressed = merged if first is None else merged.rows(known)
        unknown = tuple(merged.finger[~known].tolist())
        measured = self._measured(response, adopted.fingers, pressed)
        now = measured_displacement(response, measured)
        better = FIRMLY * adopted.linearisation_error(now - response.displacement)
        stays = not away and not adopted.carries
        if stays and adopted.at_rest.error(now) < better:
            age = 1e-9 * (sample.stamp - adopted.stamp)
            unseen = _doubt(merged, unknown)
            return self._serve_from_rest(adopted.at_rest, pressed, age, unknown, unseen)
        errors = self.settings.errors.on_mesh(adopted.coarseness)
        lateral, frozen = adopted.across(pressed, self.pose_in_use)
        posterior = fuse(errors, adopted.after(lateral), adopted.widened(measured))
        k = len(adopted.fingers)
        posterior.inputs[k : 3 * k] += lateral
        self.posterior, self.measured = posterior, measured
        inputs = posterior.inputs
        moved = response.displacement_by @ inputs
        self._linear = adopted.at_rest, response.force + inputs[:k], posterior.root[:k]
        doubt = _doubt(merged, unknown) + frozen
        joined = self._joined(first, known, merged, doubt)
        return self._serve_nonlinear(adopted, posterior, moved, sample.stamp, joined)

    def _serve_nonlinear(
        self,
        adopted: Adopted,
        posterior: Posterior,
        moved: Array,
        stamp: int,
        joined: Joined,
    ) -> Served:
        """About the last equilibrium: contacts `moved` (k,) [m] from there, `joined` on top."""
        response, k = adopted.response, len(adopted.fingers)
        columns, inputs, root = adopted.columns, posterior.inputs, posterior.root
        if len(joined.inputs):
            columns = np.concatenate([columns, joined.columns], axis=2)
            inputs = np.concatenate([inputs, joined.inputs])
            root = scipy.linalg.block_diag(root, joined.root)
        bend, bend_error, third = adopted.bend(moved)
        pose = self.pose_in_use
        largest = serve(
            self._carried_rest,
            adopted.surface,
            adopted.normals,
            columns,
            inputs,
            root,
            adopted.slot.bend,
            bend,
            bend_error,
            adopted.slot.third,
            third,
            joined.doubt + adopted.doubt,
            self._places.unmodelled(adopted),
            pose.rotation,
            pose.translation,
            self._places.pose_root(self.pose is not None),
            self._packed,
        )
        offset = adopted.outer_offset(moved)
        if offset is not None:
            serve_outer(offset, pose.rotation, self._packed)
        extra = posterior.inputs[:k]
        force = response.force + extra
        displacement = response.displacement + moved
        return Served(
            stamp=stamp,
            packed=self._packed,
            max_displacement=largest,
            linearity=adopted.at_rest.linearisation_error(force, displacement),
            strain_energy=adopted.energy + float((response.force + 0.5 * extra) @ moved),
            nonlinear_age=1e-9 * (stamp - adopted.stamp),
            snap_margin=adopted.snap_margin,
            contradiction=posterior.contradiction,
            suspect=posterior.suspect,
            extrapolation=adopted.worst_bend * bend_error
            + adopted.worst_third * third
            + joined.doubt
            + adopted.doubt,
            force=force,
            displacement=displacement,
            unknown=joined.fingers,
        )

    def _first(self, sample: ContactSample) -> AtRest | None:
        """Linear theory for contacts nobody knows yet; None before the pose is known."""
        placed = self.pose is not None or (self.adopted is not None and len(self.adopted.fingers))
        if self.first_touch is None or not placed:
            return None
        return self.first_touch.answer(sample, self.pose_in_use)

    def _joined(
        self,
        first: AtRest | None,
        known: NDArray[np.bool_],
        sample: ContactSample,
        unknown_dent: float,
    ) -> Joined:
        """Fingers that join a grasp, by the tangent at rest; the others keep their dents.

        Where that has no answer, `unknown_dent` [m] is all that is said.
        """
        fingers = tuple(sample.finger[~known].tolist())
        if first is None or self.first_touch is None:
            nothing = np.zeros((len(self.rest), 3, 0))
            return Joined(fingers, nothing, np.zeros(0), np.zeros((0, 0)), unknown_dent)
        new = self.first_touch.joined(first, known)
        measured = self._measured(new.response, new.fingers, sample)
        errors = self.settings.errors.on_mesh(new.coarseness)
        found = fuse(errors, new.response, _without_grip(measured))
        m = len(new.fingers)
        push = found.inputs[:m]
        moved = new.compliance @ push
        size = float(np.abs(moved).max())
        margin = 1.0 if self.adopted is None else min(max(self.adopted.snap_margin, 0.0), 1.0)
        # What bends the response of its own dent, and what softened the shell meanwhile.
        doubt = (new.linearisation_error(push, moved) + 1.0 - margin) * size
        return Joined(fingers, new.columns, push, np.ascontiguousarray(found.root[:m]), doubt)

    def linear(self) -> NDArray[np.float32]:
        """The paper's linear theory from rest under the pushes of the last tick, packed (n, 8)."""
        if self._linear is None:
            self._pack_rest(self._packed_linear)
        else:
            at_rest, push, root = self._linear
            self._pack(self._packed_linear, self._linear_rest, at_rest.columns, push, root)
        return self._packed_linear

    def nonlinear(self) -> NDArray[np.float32] | None:
        """The last converged equilibrium, packed (n, 9); None before the first."""
        adopted = self.adopted
        if adopted is None:
            return None
        j = adopted.columns.shape[2]
        root = self.posterior.root if self.posterior is not None else np.zeros((j, j))
        if root.shape != (j, j):
            root = np.zeros((j, j))
        packed = self._packed_nonlinear
        self._pack(packed, adopted.slot.surface, adopted.columns, np.zeros(j), root)
        packed[:, len(FIELDS)] = adopted.slot.energy_density
        if adopted.slot.outer is not None:
            serve_outer(adopted.slot.outer, self.pose_in_use.rotation, packed)
        return packed

    def fill_request(self, record: np.void, as_reported: bool = False) -> None:
        """Write the load case of the last tick into a mailbox record.

        `as_reported`: what the sample says alone, nothing that answers so far made of it.
        """
        assert self.sample is not None
        errors = self.settings.errors
        known = (None, None) if as_reported else (self.adopted, self.posterior)
        write_load(record, self.sample, errors.drive, errors.tendon, self.pose, *known)
        if self.grips is not None:
            record['grip'][: len(self.grips.motion)] = self.grips.motion

    def _measured(
        self, response: Response, fingers: NDArray[np.int64], sample: ContactSample
    ) -> Measured:
        """The sample's values in the order of the contacts of `response`."""
        if np.array_equal(fingers, sample.finger):
            index, present = np.arange(len(fingers)), np.ones(len(fingers), bool)
        else:
            index = np.minimum(np.searchsorted(sample.finger, fingers), len(sample.finger) - 1)
            present = sample.finger[index] == fingers
        lateral = response.lateral @ self.pose_in_use.rotation.T
        force = sample.force[index]
        return Measured(
            finger=fingers,
            flags=sample.flags[index],
            present=present,
            push=np.einsum('pi,pi->p', force, sample.normal[index]),
            sigma_push=sample.sigma_normal[index],
            travel=sample.travel[index],
            sigma_travel=sample.sigma_travel[index],
            tangential=np.einsum('pi,pi->p', lateral, force.repeat(2, axis=0)),
            sigma_tangential=sample.sigma_tangential[index].repeat(2),
        )

    def _serve_rest(self, sample: ContactSample) -> Served:
        """Nothing presses, or nothing is known of what presses."""
        self.posterior = self.measured = None
        unknown = tuple(sample.finger.tolist())
        doubt = _doubt(sample, unknown)
        if self.grips is not None and self.grips.away:
            return self._serve_gripped(sample, self.grips, unknown, doubt)
        self._pack_rest(self._packed, doubt)
        empty = np.zeros(0)
        return Served(
            sample.stamp, self._packed, 0.0, 0.0, 0.0, math.nan if unknown else 0.0, 1.0, 0.0, '',
            doubt, empty, empty, unknown,
        )  # fmt: skip

    @property
    def _linear_rest(self) -> Array:
        """(n, 3) surface without contacts by linear theory, the grips where they are now."""
        if self.grips is None or not self.grips.away:
            return self.rest
        moved = self._rest_grips @ affine(self.grips.motion).reshape(-1)
        return np.ascontiguousarray(self.rest + moved)

    def _serve_gripped(
        self, sample: ContactSample, grips: GripPoses, unknown: tuple[int, ...], doubt: float
    ) -> Served:
        """Grips alone have moved the object, or nothing else that is known has."""
        adopted, linear = self.adopted, self._linear_rest
        surface, columns, inputs, offset = linear, self._no_columns, np.zeros(1), None
        age, margin, energy = math.nan, 1.0, 0.0
        if adopted is not None:
            surface, margin = adopted.surface, adopted.snap_margin
            offset = adopted.outer_offset(np.zeros(len(adopted.fingers)))
            age = 1e-9 * (sample.stamp - adopted.stamp)
            if len(adopted.fingers):
                # They have let go, which the background process does not know yet.
                columns, inputs = adopted.columns, np.zeros(adopted.columns.shape[2])
                inputs[: len(adopted.fingers)] = -adopted.response.force
                doubt += float(np.abs(adopted.response.displacement).max())
            energy = adopted.energy + float(
                np.sum(adopted.grip_wrench * (grips.motion - adopted.grips))
            )
            doubt += adopted.doubt
        else:
            doubt += float(np.linalg.norm(linear - self.rest, axis=1).max())
        root = np.zeros((len(inputs), len(inputs)))
        largest = self._pack(self._packed, surface, columns, inputs, root, doubt)
        if offset is not None:
            serve_outer(offset, self.pose_in_use.rotation, self._packed)
        largest_difference = float(np.linalg.norm(linear - surface, axis=1).max())
        linearity = largest_difference / max(largest, 1e-12)
        empty = np.zeros(0)
        return Served(
            sample.stamp, self._packed, largest, linearity, energy, age, margin,
            0.0, '', doubt, empty, empty, unknown, adopted is not None,
        )  # fmt: skip

    def _serve_from_rest(
        self,
        at_rest: AtRest,
        sample: ContactSample,
        age: float,
        unknown: tuple[int, ...] = (),
        doubt: float = 0.0,
    ) -> Served:
        """Linear theory from rest; sigma has what it is known to miss.

        It serves before the first equilibrium of a grasp (`age` NaN), and where rest is the better
        tangent. `unknown`: fingers that press beside those of `at_rest`, which may have dented the
        shell by `doubt` [m].
        """
        taking_up = math.isnan(age)
        measured = _without_grip(self._measured(at_rest.response, at_rest.fingers, sample))
        errors = self.settings.errors.on_mesh(at_rest.coarseness)
        uses_motion = errors.drive != 'force'
        weighed = at_rest.widened(measured) if taking_up and uses_motion else measured
        found = fuse(errors, at_rest.response, weighed)
        self.posterior = self.measured = None
        k = len(at_rest.fingers)
        push, root = found.inputs[:k], found.root[:k]
        self._linear = at_rest, push, root
        displacement = at_rest.compliance @ push
        linearity = at_rest.linearisation_error(push, displacement)
        if taking_up:
            doubt += at_rest.doubt(push, measured, uses_motion)
        else:
            doubt += linearity * float(np.abs(displacement).max())
        largest = self._pack(self._packed, self.rest, at_rest.columns, push, root, doubt)
        return Served(
            stamp=sample.stamp,
            packed=self._packed,
            max_displacement=largest,
            linearity=linearity,
            strain_energy=0.5 * float(push @ displacement),
            nonlinear_age=age,
            snap_margin=1.0,
            contradiction=found.contradiction,
            suspect=found.suspect,
            extrapolation=doubt,
            force=push,
            displacement=displacement,
            unknown=tuple(at_rest.fingers.tolist()) if taking_up else unknown,
        )

    def _pack_rest(self, packed: NDArray[np.float32], doubt: float = 0.0) -> None:
        """Fill `packed` with the unloaded surface."""
        surface = self.rest if packed is self._packed else self._linear_rest
        self._pack(packed, surface, self._no_columns, np.zeros(1), np.zeros((1, 1)), doubt)

    def _pack(
        self,
        packed: NDArray[np.float32],
        surface: Array,
        columns: Array,
        inputs: Array,
        root: Array,
        doubt: float = 0.0,
    ) -> float:
        """Fill `packed` with `doubt` [m] as the only error; returns the largest displacement."""
        pose = self.pose_in_use
        at_rest = surface is self.rest or self.adopted is None
        normals, unmodelled = self.rest_normals, self._no_third
        if self.adopted is not None and not at_rest:
            normals, unmodelled = self.adopted.normals, self.adopted.slot.unmodelled
        largest = serve(
            self.rest, surface, normals, columns, inputs, np.ascontiguousarray(root),
            self._no_bend, 0.0, 0.0, self._no_third, 0.0, doubt, unmodelled,
            pose.rotation, pose.translation, self._places.pose_root(self.pose is not None), packed,
        )  # fmt: skip
        if packed is self._packed and self._rest_offset is not None:
            serve_outer(self._rest_offset, pose.rotation, packed)
        return largest


def _without_grip(measured: Measured) -> Measured:
    """The same without tangential forces, which linear theory from rest knows nothing of."""
    nobody = np.full_like(measured.sigma_tangential, np.inf)
    return measured._replace(sigma_tangential=nobody)


def _doubt(sample: ContactSample, unknown: tuple[int, ...]) -> float:
    """How far contacts that the background process has not taken up yet may have dented [m]."""
    if not unknown:
        return 0.0
    travel = np.abs(sample.travel[np.isin(sample.finger, unknown)])
    return float(np.where(np.isfinite(travel), travel, UNKNOWN_DENT).max())
