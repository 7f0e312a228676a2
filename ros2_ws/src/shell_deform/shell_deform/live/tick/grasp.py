# SPDX-License-Identifier: Apache-2.0
"""The grasp of every sample: which fingers slip when, whether it closes, what it lifts.

On the deformed normals of the last equilibrium, with the pushes of this sample. No gauge sees
tangential forces: they are values of the model, and friction is an input; the names of the fields
say so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.capacity import (
    DIRECTIONS,
    GRAVITY,
    Proofs,
    bounds_of,
    bounds_sigma,
    load_capacity,
)
from shell_deform.grasp.closure import Closure, closure
from shell_deform.grasp.cone import ConeError
from shell_deform.grasp.contacts import (
    UNIFORM_ARM,
    GraspContacts,
    GraspError,
    contact_wrenches,
    contacts,
)
from shell_deform.grasp.margins import margins
from shell_deform.grasp.probability import Sigmas, closure_sigma
from shell_deform.grasp.slip import slip_sigma, slipping_regions, slips_along
from shell_deform.grasp.window import UNKNOWN, UNLIMITED, Limits, squeeze_window
from shell_deform.live.tick.estimator import Estimator
from shell_deform.live.tick.grasp_draws import ClosureDraws
from shell_deform.live.tick.grasp_held import HeldGrasp, held_grasp

Array = NDArray[np.float64]

WHOLE = -1
"""Number of the finger in the row of the whole grasp."""

FINGER_FIELDS = (
    'x', 'y', 'z', 'nx', 'ny', 'nz', 'push', 'tangential_modelled', 'needed_angle',
    'slip_margin', 'slip_margin_sigma', 'soft_margin', 'spin_modelled', 'tangential_sigma',
)  # fmt: skip
GRASP_ONLY = (
    'closed', 'closure_probability', 'needed_friction', 'needed_friction_sigma',
    'gravity_capacity', 'worst_capacity', 'liftable_mass', 'least_push', 'most_push',
    'snap_margin', 'friction_given', 'friction_sigma_given', 'mass_given', 'on_deformed_normals',
    'gravity_slip', 'worst_slip', 'slip_finger', 'smallest_stiffness', 'adversary_work',
    'epsilon', 'epsilon_length', 'rigid_share', 'squeeze_energy', 'yield_share',
    'yield_share_sigma', 'dent_push', 'strain_share', 'stress_resolved', 'gravity_slip_sigma',
    'worst_slip_sigma', 'gravity_capacity_sigma', 'worst_capacity_sigma', 'liftable_mass_sigma',
)  # fmt: skip
GRASP_FIELDS = ('finger', *FINGER_FIELDS, *GRASP_ONLY)
PLOTTED = ('needed_friction', 'closure_probability', 'liftable_mass', 'least_push')


@dataclass(frozen=True)
class GraspTask:
    """What the grasp is for: friction and its sigma [-], sigma of the normals [rad], mass [kg].

    `down`: unit direction of the weight in the frame of the contacts. `strain_limit`: of the
    wall [-].
    """

    friction: float = 0.5
    friction_sigma: float = 0.1
    normal_sigma: float = 0.02
    mass: float = 0.0
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    strain_limit: float = 0.2


@dataclass(frozen=True)
class Seen:
    """Contacts of a sample with the sigmas of push and tangential force (k,) [N].

    `deformed`: whether normals and tangential forces are those of an equilibrium.
    """

    finger: NDArray[np.int64]
    grasp: GraspContacts
    push_sigma: Array
    tangential_sigma: Array
    deformed: bool


@dataclass(frozen=True)
class Closed:
    """Closure, why not, the friction that it needs [-] with its sigma, and its probability."""

    closed: bool
    why: str
    friction: float
    sigma: float
    probability: float


class GraspTick:
    """Measures of one sample after the other; what the last one proved saves the next one time.

    `why`: one sentence why the last grasp is not closed or what of it cannot be told, else empty.
    `told`: the same in words, empty before the first sample. `yield_stress`: of the object [Pa], 0
    where it has none.
    """

    def __init__(self) -> None:
        self.task = GraspTask()
        self.why = ''
        self.told = ''
        self.yield_stress = 0.0
        self._held: tuple[object, object, GraspTask, HeldGrasp] | None = None
        self._fingers: tuple[int, ...] = ()
        self._needed: float | None = None
        self._closure: tuple[object, GraspTask, bytes, Closure, Sigmas, float] | None = None
        self._draws = ClosureDraws()
        self._basis: tuple[object, object, Array] | None = None
        self._proofs = _unproved(0)
        self._next = 0

    def rows(self, estimator: Estimator) -> NDArray[np.float32]:
        """(k + 1, f) float32 of `GRASP_FIELDS`: one row a finger, the last for the whole grasp.

        Fields that say nothing of a row are zero there. `closed` is 1 or 0, as `closure` has it.
        """
        task, self.why = self.task, ''
        try:
            seen = contacts_of(estimator, task)
        except GraspError as error:
            seen, self.why = _nothing(task), str(error)
        grasp, count = seen.grasp, seen.grasp.count
        if tuple(seen.finger.tolist()) != self._fingers:
            self._fingers, self._needed = tuple(seen.finger.tolist()), None
            self._proofs = _unproved(count)
            self._held = None
        packed = np.zeros((count + 1, len(GRASP_FIELDS)), np.float32)
        pose = estimator.pose_in_use
        centre = pose.rotation @ estimator.rest.mean(axis=0) + pose.translation
        own = margins(
            grasp, seen.push_sigma, seen.tangential_sigma, task.friction_sigma, task.normal_sigma
        )
        packed[:count, 0] = seen.finger
        packed[:count, 1:4], packed[:count, 4:7] = grasp.point, grasp.normal
        packed[:count, 7] = grasp.push
        packed[:count, 8] = np.linalg.norm(grasp.tangential, axis=1)
        packed[:count, 9] = own.needed_angle
        packed[:count, 10], packed[:count, 11] = own.slip_margin, own.slip_sigma
        packed[:count, 12], packed[:count, 13] = own.soft_margin, grasp.spin
        packed[:count, 14] = own.tangential_sigma
        packed[-1, 0] = WHOLE
        packed[-1, 1:4] = centre
        whole = self._whole(estimator, seen, centre)
        packed[-1, 1 + len(FINGER_FIELDS) :] = whole
        said = 'closed' if whole[0] else 'not closed'
        self.told = f'{said}: {self.why}' if self.why else said
        return packed

    def _whole(self, estimator: Estimator, seen: Seen, centre: Array) -> tuple[float, ...]:
        task, grasp = self.task, seen.grasp
        known = self._closed(estimator, seen)
        self.why = self.why or known.why
        basis = self._wrenches(estimator, seen, centre)
        (lifted, worst), (lifted_sigma, worst_sigma) = self._capacities(seen, centre, basis)
        held = self._of_equilibrium(estimator, seen)
        push = float(grasp.push.mean()) if grasp.count else 0.0
        limits, doubt = Limits(), UNKNOWN
        slips, slip_doubt, slipping = (0.0, 0.0), (0.0, 0.0), -1
        if held is not None and estimator.adopted is not None:
            # Stress and strain in proportion to the push since the equilibrium.
            grown = push / held.push if held.push > 0.0 else 0.0
            stress = held.stress / self.yield_stress if self.yield_stress else 0.0
            limits = Limits(
                estimator.adopted.snap_margin, grown * stress,
                grown * held.strain / task.strain_limit,
            )  # fmt: skip
            doubt = held.stress_doubt
            if held.rates is not None:
                regions = slipping_regions(grasp, estimator.adopted.slipping)
                factor, contact, _ = slips_along(regions, held.rates)
                least = [0, 1 + int(factor[1:].argmin())]
                slips = float(factor[0]), float(factor[least[1]])
                relative = task.friction_sigma / max(task.friction, 1e-9)
                both = held.rates.along(least)
                doubts = slip_sigma(regions, both, factor[least], contact[least], relative)
                slip_doubt = float(doubts[0]), float(doubts[1])
                slipping = int(seen.finger[contact[0]]) if contact[0] >= 0 else -1
        window = squeeze_window(push, lifted / GRAVITY, task.mass, limits)
        dent = push / limits.stress if limits.stress > 0.0 else UNLIMITED
        of_state = (
            (held.smallest_stiffness, held.adversary_work, held.epsilon, held.length,
             held.rigid_share, held.energy)
            if held is not None else (0.0,) * 6
        )  # fmt: skip
        return (
            float(known.closed), known.probability, known.friction, known.sigma, lifted, worst,
            window.liftable, window.least, window.most, limits.snap_margin, task.friction,
            task.friction_sigma, task.mass, float(seen.deformed), *slips, float(slipping),
            *of_state, limits.stress, limits.stress * doubt, dent, limits.strain,
            float(doubt < UNKNOWN), *slip_doubt, lifted_sigma, worst_sigma, lifted_sigma / GRAVITY,
        )  # fmt: skip

    def _of_equilibrium(self, estimator: Estimator, seen: Seen) -> HeldGrasp | None:
        """What only another equilibrium, pose or task changes; None before there is one."""
        adopted, pose = estimator.adopted, estimator.pose_in_use
        if not seen.deformed or adopted is None:
            self._held = None
            return None
        if self._held is not None:
            of_adopted, of_pose, of_task, known = self._held
            if of_adopted is adopted and of_pose is pose and of_task is self.task:
                return known
        seed = None if self._held is None else self._held[3].weakest
        try:
            found = held_grasp(adopted, seen.grasp, pose, np.array(self.task.down), seed)
        except ConeError as error:
            self.why, self._held = self.why or str(error), None
            return None
        self._held = adopted, pose, self.task, found
        return found

    def _closed(self, estimator: Estimator, seen: Seen) -> Closed:
        """Closure: a matter of points, normals and friction, which an equilibrium decides."""
        grasp, task = seen.grasp, self.task
        pressing = grasp.pressing.tobytes()
        kept = self._closure
        same = kept is not None and kept[0] is estimator.adopted and kept[1] is task
        if kept is None or not (seen.deformed and same and kept[2] == pressing):
            found = closure(grasp, self._needed)
            self._needed = found.needed if len(found.squeeze) else None
            kept = estimator.adopted, task, pressing, found, *self._sure(grasp, found)
            self._closure = kept
        found, sigmas, sigma = kept[3:]
        sure = self._draws.probability(grasp, found, sigmas, task)
        return Closed(found.closed, found.why, found.needed_friction(grasp), sigma, sure)

    def _sure(self, grasp: GraspContacts, found: Closure) -> tuple[Sigmas, float]:
        """Sigmas of the contacts, and that of the friction that closure needs."""
        task = self.task
        spread, none = np.full(grasp.count, task.normal_sigma), np.zeros(grasp.count)
        sigmas = Sigmas(none, spread, task.friction_sigma / max(task.friction, 1e-9))
        if not len(found.squeeze):
            return sigmas, 0.0
        own = Sigmas(none, spread, 0.0)
        return sigmas, task.friction * closure_sigma(grasp, found, own)

    def _wrenches(self, estimator: Estimator, seen: Seen, centre: Array) -> Array:
        """(6, k, 4) `contact_wrenches` about `centre`, which pushes do not change."""
        adopted, pose = estimator.adopted, estimator.pose_in_use
        kept = self._basis
        if not (seen.deformed and kept and kept[0] is adopted and kept[1] is pose):
            kept = adopted, pose, contact_wrenches(seen.grasp, centre, 1.0)
            self._basis = kept
        return kept[2]

    def _capacities(self, seen: Seen, centre: Array, basis: Array) -> tuple[Array, Array]:
        """Weight that the squeeze carries and the worst force of 26 directions [N]; sigmas.

        One of them is found anew at every sample, the weight every other time.
        """
        grasp, proofs = seen.grasp, self._proofs
        if grasp.count < 2:
            return np.zeros(2), np.zeros(2)
        wrenches = np.zeros((1 + len(DIRECTIONS), 6))
        wrenches[0, :3], wrenches[1:, :3] = self.task.down, DIRECTIONS
        self._next += 1
        anew = [0 if self._next % 2 else 1 + (self._next // 2) % len(DIRECTIONS)]
        unknown = ~np.any(proofs.bounds != 0.0, axis=1)
        if unknown.any():
            anew = np.flatnonzero(unknown).tolist()
        try:
            for number in anew:
                found = load_capacity(grasp, wrenches[number], centre, basis)
                proofs.bounds[number], proofs.pushes[number] = found.bound, found.force[:, 0]
        except ConeError as error:
            self.why = self.why or str(error)
            return np.zeros(2), np.zeros(2)
        most = bounds_of(grasp, proofs.bounds, wrenches, basis)
        most = np.where(np.isfinite(most), most, 0.0)
        told = [0, 1 + int(most[1:].argmin())]
        sigma = bounds_sigma(
            grasp, Proofs(proofs.bounds[told], proofs.pushes[told]), wrenches[told], basis,
            seen.push_sigma, self.task.friction_sigma,
        )  # fmt: skip
        return most[told], sigma


def _unproved(count: int) -> Proofs:
    """Of as many contacts, before anything is known."""
    loads = 1 + len(DIRECTIONS)
    return Proofs(np.zeros((loads, 6)), np.zeros((loads, count)))


def _nothing(task: GraspTask) -> Seen:
    """A hand that holds nothing."""
    grasp = contacts(np.zeros((0, 3)), np.zeros((0, 3)), 0.0, task.friction)
    return Seen(np.zeros(0, np.int64), grasp, np.zeros(0), np.zeros(0), False)


def contacts_of(estimator: Estimator, task: GraspTask) -> Seen:
    """The contacts of the last tick in the frame of the contacts.

    Before an equilibrium of these fingers is known: points and normals as the hand gives them, and
    no tangential force. Raises GraspError for contacts that cannot be.
    """
    sample, adopted, posterior = estimator.sample, estimator.adopted, estimator.posterior
    if adopted is None or posterior is None or not len(adopted.fingers):
        if sample is None:
            return _nothing(task)
        length = np.linalg.norm(sample.normal, axis=1)[:, None]
        grasp = contacts(
            sample.point,
            sample.normal / np.where(length > 0.0, length, 1.0),
            sample.push,
            task.friction,
            UNIFORM_ARM * sample.radius,
        )
        unseen = np.zeros(grasp.count)
        known = np.where(np.isfinite(sample.sigma_normal), sample.sigma_normal, 1e3)
        return Seen(sample.finger, grasp, known, unseen, False)
    pose, response = estimator.pose_in_use, adopted.response
    k = len(adopted.fingers)
    push = response.force + posterior.inputs[:k]
    lateral = response.reaction + response.reaction_by @ posterior.inputs
    force = push[:, None] * adopted.axis
    force += (lateral[:, None] * response.lateral).reshape(k, 2, 3).sum(axis=1)
    normal = adopted.touch_normal @ pose.rotation.T
    force, spin = force @ pose.rotation.T, adopted.spin
    if estimator.hold is not None:
        # What the fingers feel now, not what an elastic wall would make them feel.
        share = estimator.hold.share(adopted.fingers)
        force, spin = force * share[:, None], spin * share
    grasp = contacts(
        adopted.touch_point @ pose.rotation.T + pose.translation,
        normal / np.linalg.norm(normal, axis=1)[:, None],
        np.einsum('ki,ki->k', force, normal),
        task.friction,
        adopted.arm,
        force,
        spin,
    )
    sigma = np.linalg.norm(posterior.root[:k], axis=1)
    across = np.linalg.norm(response.reaction_by @ posterior.root, axis=1).reshape(k, 2)
    return Seen(adopted.fingers, grasp, sigma, np.linalg.norm(across, axis=1), True)
