"""The fast tick: from one sample of the contacts to the served surface, without solving anything.

The background process leaves an equilibrium and what a few inputs do to it. A tick weighs force
against motion for the inputs (`fusion`), multiplies the columns (`serve_kernel`) and adds what is
known of the errors. It allocates only small arrays and never waits.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.exchange import MAX_CONTACTS, Slot
from shell_deform.live.fusion import ErrorModel, Measured, Posterior, Response, fuse
from shell_deform.live.linearity import linear_error
from shell_deform.live.pose import IDENTITY, Pose, pose_of
from shell_deform.live.sample import ContactSample, one_row_per_finger
from shell_deform.live.serve_kernel import FIELDS, NONLINEAR_FIELDS, serve

Array = NDArray[np.float64]

BEND_REACH = 3.0
"""The second-order field is trusted to this many times the step it was measured over."""

WIDEST_GAUGE = 1.0
"""However far the tangent is left behind, a gauge stays better than this [N]."""

UNKNOWN_DENT = 5e-3
"""What a contact of unknown travel may have dented before anything is known of it [m]."""

DRIVE_CODES = {'force': 0, 'motion': 1, 'fused': 2}


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


class Adopted:
    """A result slot, unpacked once for many ticks. Arrays of n vertices stay views."""

    def __init__(self, slot: Slot) -> None:
        record = slot.record
        k, r = int(record['contacts']), int(record['rigid_count'])
        j = 3 * k + r + 1
        self.slot = slot
        self.stamp = int(record['stamp'])
        self.generation = int(record['generation'])
        self.fingers = record['finger'][:k].astype(np.int64)
        self.response = Response(
            force=record['force'][:k].copy(),
            displacement=record['displacement'][:k].copy(),
            travel_offset=record['travel_offset'][:k].copy(),
            rigid=record['rigid'][:r].copy(),
            rigid_scale=float(record['rigid_scale']),
            reaction=record['reaction'][: 2 * k].copy(),
            lateral=record['lateral'][: 2 * k].copy(),
            rigid_reaction=record['rigid_reaction'][:r].copy(),
            displacement_by=record['displacement_by'][:k, :j].copy(),
            reaction_by=record['reaction_by'][: 2 * k, :j].copy(),
            rigid_by=record['rigid_by'][:r, :j].copy(),
        )
        self.energy = float(record['energy'])
        self.share = float(record['share'])
        self.stable = bool(record['stable'])
        self.snap_margin = float(record['snap_margin'])
        self.message = bytes(record['message']).decode(errors='replace')
        self.linear_compliance = record['linear_compliance'][:k, :k].copy()
        self.second_order = record['second_order'][:k, : k * (k + 1) // 2].copy()
        self.columns = slot.input_columns()
        self.linear_columns = slot.linear_columns()
        self.bend_direction = record['bend_direction'][:k].copy()
        self.bend_offset = float(record['bend_offset'])
        self.bend_reach = float(record['bend_reach'])
        self.third_reach = float(record['third_reach'])
        self.push_bend = record['push_bend'][:k].copy()
        along = np.einsum('ni,ni->n', slot.normals, slot.bend)
        self.worst_bend = float(np.abs(along).max(initial=0.0))
        self.worst_third = float(slot.third.max(initial=0.0))
        self.pose = pose_of(record['pose'])
        self.pose_root = _root(record['pose_covariance'])

    def bend(self, moved: Array) -> tuple[float, float, float]:
        """Inputs of the second-order field for moved contacts (k,) [m].

        Returns what it is multiplied with and how much of that is uncertain [m^2], and the input
        of the unknown third order [m^3]. The field was measured between the last two equilibria
        and serves along that direction.
        """
        along = float(self.bend_direction @ moved)
        reach = BEND_REACH * self.bend_reach
        used = min(max(along, -reach), reach)
        offset = self.bend_offset
        value = (offset + used) ** 2 - offset**2
        rest = float(moved @ moved) - used * used
        return value, max(rest, 0.0), abs(self._cube(offset + along) - self._cube(offset))

    def doubted(self, measured: Measured) -> Measured:
        """The same with wider gauges.

        The tangent does not know how the push bends away from it: over a long step a gauge would
        outvote the encoders with the error of the tangent.
        """
        step = measured.travel + self.response.travel_offset - self.response.displacement
        square = float(np.nansum(np.where(measured.present, step * step, 0.0)))
        bent = np.minimum(np.abs(self.push_bend) * square, WIDEST_GAUGE)
        return replace(measured, sigma_push=np.hypot(measured.sigma_push, bent))

    def _cube(self, step: float) -> float:
        """Third power of a short step [m^3], growing less for one beyond `third_reach`."""
        return step**3 / (1.0 + abs(step) / self.third_reach)


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
        self.sample = merged
        adopted = self.adopted
        if adopted is None or not len(adopted.fingers) or not len(merged.finger):
            return self._serve_rest(merged)
        response = adopted.response
        measured = self._measured(adopted, merged)
        posterior = fuse(self.settings.errors, response, adopted.doubted(measured))
        self.posterior, self.measured = posterior, measured
        k = len(adopted.fingers)
        inputs = posterior.inputs
        moved = response.displacement_by @ inputs
        known = set(adopted.fingers.tolist())
        unknown = tuple(f for f in merged.finger.tolist() if f not in known)
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
        adopted, posterior = self.adopted, self.posterior
        if adopted is None or posterior is None or not len(adopted.fingers):
            self._pack_rest(self._packed_linear)
            return self._packed_linear
        k = len(adopted.fingers)
        force = adopted.response.force + posterior.inputs[:k]
        self._pack(
            self._packed_linear, self.rest, adopted.linear_columns, force, posterior.root[:k]
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
        sample, adopted, errors = self.sample, self.adopted, self.settings.errors
        assert sample is not None
        count = min(len(sample.finger), MAX_CONTACTS)
        record['stamp'] = sample.stamp
        record['drive'] = DRIVE_CODES[errors.drive]
        record['contacts'] = count
        record['tendon'] = errors.tendon
        record['placed'] = int(self.pose is not None)
        if self.pose is not None:
            record['pose'] = self.pose.numbers
        force = sample.push[:count]
        displacement = np.full(count, np.nan)
        record['generation'] = 0
        posterior = self.posterior
        if adopted is not None and posterior is not None and len(adopted.fingers):
            record['generation'] = adopted.generation
            response, k = adopted.response, len(adopted.fingers)
            if len(posterior.inputs) == response.displacement_by.shape[1]:
                index = np.searchsorted(adopted.fingers, sample.finger[:count])
                known = index < k
                known[known] = adopted.fingers[index[known]] == sample.finger[:count][known]
                force = force.copy()
                force[known] = (response.force + posterior.inputs[:k])[index[known]]
                moved = response.displacement + response.displacement_by @ posterior.inputs
                displacement[known] = moved[index[known]]
                r = len(response.rigid)
                record['rigid'][:r] = response.rigid + posterior.inputs[3 * k : 3 * k + r]
        touch = record['touch']
        touch['finger'][:count] = sample.finger[:count]
        touch['point'][:count] = sample.point[:count]
        touch['normal'][:count] = sample.normal[:count]
        touch['radius'][:count] = sample.radius[:count]
        touch['force'][:count] = force
        touch['travel'][:count] = sample.travel[:count]
        touch['displacement'][:count] = displacement

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
        unknown = tuple(sample.finger.tolist())
        doubt = _doubt(sample, unknown)
        self._pack_rest(self._packed, doubt)
        empty = np.zeros(0)
        return Served(
            sample.stamp, self._packed, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, '', doubt, empty, empty,
            unknown,
        )  # fmt: skip

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
    ) -> None:
        """Fill `packed` without error of a linear step."""
        pose = self.pose_in_use
        at_rest = surface is self.rest or self.adopted is None
        normals = self.rest_normals if at_rest else self._adopted_normals()
        pose_root = self.adopted.pose_root if self.adopted is not None else np.zeros((6, 0))
        serve(
            self.rest, surface, normals, columns, inputs, np.ascontiguousarray(root),
            self._no_bend, 0.0, 0.0, self._no_third, 0.0, doubt,
            pose.rotation, pose.translation, pose_root, packed,
        )  # fmt: skip

    def _adopted_normals(self) -> Array:
        assert self.adopted is not None
        return self.adopted.slot.normals


def _doubt(sample: ContactSample, unknown: tuple[int, ...]) -> float:
    """How far contacts that the background process has not taken up yet may have dented [m]."""
    if not unknown:
        return 0.0
    travel = np.abs(sample.travel[np.isin(sample.finger, unknown)])
    return float(np.where(np.isfinite(travel), travel, UNKNOWN_DENT).max())


def _root(covariance: Array) -> Array:
    """(6, i) root of a covariance, without its null space."""
    values, vectors = np.linalg.eigh(covariance)
    keep = values > 1e-18
    return np.ascontiguousarray(vectors[:, keep] * np.sqrt(values[keep]))
