"""The fast tick: from one sample of the contacts to the served surface, without solving anything.

The background process leaves an equilibrium and what a few inputs do to it. A tick weighs force
against motion for the inputs (`fusion`), multiplies the columns (`serve_kernel`) and adds what is
known of the errors. It allocates only small arrays and never waits.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.exchange import Slot
from shell_deform.live.pose import IDENTITY, Pose
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.fusion import ErrorModel, Posterior, fuse
from shell_deform.live.tick.fusion_types import Measured
from shell_deform.live.tick.linearity import linear_error
from shell_deform.live.tick.load_request import write_load
from shell_deform.live.tick.release import measured_displacement, pressing
from shell_deform.live.tick.sample import ContactSample, one_row_per_finger
from shell_deform.live.tick.serve_kernel import FIELDS, NONLINEAR_FIELDS, serve

Array = NDArray[np.float64]

FIRMLY = 0.5
"""Rest is the better tangent where its error estimate is less than this share of the other's."""

UNKNOWN_DENT = 5e-3
"""What a contact of unknown travel may have dented before anything is known of it [m]."""


@dataclass(frozen=True)
class Settings:
    """Everything a user may choose about the tick."""

    errors: ErrorModel = field(default_factory=ErrorModel)
    default_radius: float = 2e-3


@dataclass(frozen=True)
class Served:
    """One answer. `packed` (n, 8) float32 is overwritten by the next tick.

    Attributes:
        stamp: of the sample [ns]. packed: x y z ux uy uz displacement sigma.
        max_displacement: [m]. linearity: predicted relative error of linear theory [-].
        strain_energy: [J]. nonlinear_age: sample stamp minus that of the equilibrium [s].
        snap_margin: contact stiffness over that at rest. contradiction: force against motion.
        suspect: what strains most when they contradict. extrapolation: error estimate of the
            linear step at the worst vertex [m]. force, displacement: (k,) of the known contacts.
        unknown: fingers in contact that the background process has not taken up yet.
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


class Estimator:
    """The tick and what it remembers between samples."""

    def __init__(self, rest: Array, rest_normals: Array, settings: Settings) -> None:
        """`rest` (n, 3) unloaded limit positions [m] with unit normals."""
        self.rest = rest
        self.rest_normals = rest_normals
        self.settings = settings
        self.pose: Pose | None = None
        self.adopted: Adopted | None = None
        self.posterior: Posterior | None = None
        self.measured: Measured | None = None
        self.sample: ContactSample | None = None
        self._push = np.zeros(0)
        self._push_root = np.zeros((0, 0))
        n = len(rest)
        self._packed = np.zeros((n, len(FIELDS)), dtype=np.float32)
        self._packed_linear = np.zeros_like(self._packed)
        self._packed_nonlinear = np.zeros((n, len(NONLINEAR_FIELDS)), dtype=np.float32)
        self._no_columns = np.zeros((n, 3, 1))
        self._no_bend = np.zeros((n, 3))
        self._no_third = np.zeros(n)

    def forget(self) -> None:
        """Serve rest until a new result is adopted."""
        self.adopted = None
        self.posterior = None

    def adopt(self, slot: Slot) -> None:
        """Take a new result of the background process."""
        self.adopted = Adopted(slot)

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
        merged = pressing(merged, self.settings.errors)
        self.sample = merged
        adopted = self.adopted
        if adopted is None or not len(adopted.fingers) or not len(merged.finger):
            return self._serve_rest(merged)
        response = adopted.response
        measured = self._measured(adopted, merged)
        now = measured_displacement(response, measured)
        if adopted.missed_from_rest(now) < FIRMLY * adopted.missed(now - response.displacement):
            return self._serve_from_rest(adopted, measured, merged)
        posterior = fuse(self.settings.errors, response, adopted.doubted(measured))
        self.posterior, self.measured = posterior, measured
        k = len(adopted.fingers)
        inputs = posterior.inputs
        moved = response.displacement_by @ inputs
        unknown = _unknown(adopted, merged)
        doubt = _doubt(merged, unknown)
        bend, bend_error, third = adopted.bend(moved)
        pose = self.pose_in_use
        largest = serve(
            self.rest,
            adopted.slot.surface,
            adopted.slot.normals,
            adopted.columns,
            inputs,
            posterior.root,
            adopted.slot.bend,
            bend,
            bend_error,
            adopted.slot.third,
            third,
            doubt,
            pose.rotation,
            pose.translation,
            adopted.pose_root,
            self._packed,
        )
        force = response.force + inputs[:k]
        displacement = response.displacement + moved
        self._push, self._push_root = force, posterior.root[:k]
        return Served(
            stamp=sample.stamp,
            packed=self._packed,
            max_displacement=largest,
            linearity=linear_error(
                adopted.linear_compliance, adopted.second_order, force, displacement
            ),
            strain_energy=adopted.energy + float((response.force + 0.5 * inputs[:k]) @ moved),
            nonlinear_age=1e-9 * (sample.stamp - adopted.stamp),
            snap_margin=adopted.snap_margin,
            contradiction=posterior.contradiction,
            suspect=posterior.suspect,
            extrapolation=adopted.worst_bend * bend_error + adopted.worst_third * third + doubt,
            force=force,
            displacement=displacement,
            unknown=unknown,
        )

    def linear(self) -> NDArray[np.float32]:
        """The paper's linear theory from rest under the pushes of the last tick, packed (n, 8)."""
        adopted = self.adopted
        if adopted is None or len(self._push) != len(adopted.fingers) or not len(self._push):
            self._pack_rest(self._packed_linear)
            return self._packed_linear
        self._pack(
            self._packed_linear, self.rest, adopted.linear_columns, self._push, self._push_root
        )
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
        self._pack(
            self._packed_nonlinear, adopted.slot.surface, adopted.columns, np.zeros(j), root
        )
        self._packed_nonlinear[:, -1] = adopted.slot.energy_density
        return self._packed_nonlinear

    def fill_request(self, record: np.void) -> None:
        """Write the load case of the last tick into a mailbox record."""
        assert self.sample is not None
        errors = self.settings.errors
        write_load(
            record, self.sample, errors.drive, errors.tendon, self.pose, self.adopted,
            self.posterior,
        )  # fmt: skip

    def _measured(self, adopted: Adopted, sample: ContactSample) -> Measured:
        """The sample's values in the order of the known contacts."""
        fingers = adopted.fingers
        if np.array_equal(fingers, sample.finger):
            index, present = np.arange(len(fingers)), np.ones(len(fingers), bool)
        else:
            index = np.minimum(np.searchsorted(sample.finger, fingers), len(sample.finger) - 1)
            present = sample.finger[index] == fingers
        lateral = adopted.response.lateral @ self.pose_in_use.rotation.T
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
        self._push = np.zeros(0)
        unknown = tuple(sample.finger.tolist())
        doubt = _doubt(sample, unknown)
        self._pack_rest(self._packed, doubt)
        empty = np.zeros(0)
        return Served(
            sample.stamp, self._packed, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, '', doubt, empty, empty,
            unknown,
        )  # fmt: skip

    def _serve_from_rest(
        self, adopted: Adopted, measured: Measured, sample: ContactSample
    ) -> Served:
        """Linear theory from rest, the better tangent here; sigma has what it is known to miss."""
        known = measured._replace(sigma_tangential=np.full_like(measured.sigma_tangential, np.inf))
        found = fuse(self.settings.errors, adopted.at_rest, known)
        self.posterior = self.measured = None
        k = len(adopted.fingers)
        self._push, self._push_root = found.inputs[:k], found.root[:k]
        displacement = adopted.linear_compliance @ self._push
        missed = linear_error(
            adopted.linear_compliance, adopted.second_order, self._push, displacement
        )
        unknown = _unknown(adopted, sample)
        doubt = _doubt(sample, unknown) + missed * float(np.abs(displacement).max())
        largest = self._pack(
            self._packed, self.rest, adopted.linear_columns, self._push, self._push_root, doubt
        )
        return Served(
            stamp=sample.stamp,
            packed=self._packed,
            max_displacement=largest,
            linearity=missed,
            strain_energy=0.5 * float(self._push @ displacement),
            nonlinear_age=1e-9 * (sample.stamp - adopted.stamp),
            snap_margin=1.0,
            contradiction=found.contradiction,
            suspect=found.suspect,
            extrapolation=doubt,
            force=self._push,
            displacement=displacement,
            unknown=unknown,
        )

    def _pack_rest(self, packed: NDArray[np.float32], doubt: float = 0.0) -> None:
        """Fill `packed` with the unloaded surface."""
        self._pack(packed, self.rest, self._no_columns, np.zeros(1), np.zeros((1, 1)), doubt)

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
        normals = self.rest_normals if at_rest else self._adopted_normals()
        pose_root = self.adopted.pose_root if self.adopted is not None else np.zeros((6, 0))
        return serve(
            self.rest, surface, normals, columns, inputs, np.ascontiguousarray(root),
            self._no_bend, 0.0, 0.0, self._no_third, 0.0, doubt,
            pose.rotation, pose.translation, pose_root, packed,
        )  # fmt: skip

    def _adopted_normals(self) -> Array:
        assert self.adopted is not None
        return self.adopted.slot.normals


def _unknown(adopted: Adopted, sample: ContactSample) -> tuple[int, ...]:
    """Fingers in contact that the background process has not taken up yet."""
    known = set(adopted.fingers.tolist())
    return tuple(f for f in sample.finger.tolist() if f not in known)


def _doubt(sample: ContactSample, unknown: tuple[int, ...]) -> float:
    """How far contacts that the background process has not taken up yet may have dented [m]."""
    if not unknown:
        return 0.0
    travel = np.abs(sample.travel[np.isin(sample.finger, unknown)])
    return float(np.where(np.isfinite(travel), travel, UNKNOWN_DENT).max())
