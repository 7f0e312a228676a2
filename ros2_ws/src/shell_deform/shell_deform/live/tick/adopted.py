# SPDX-License-Identifier: Apache-2.0
"""A result of the background process, as the tick uses it: an equilibrium and its tangent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.slip import Sharing, Slipping
from shell_deform.live.background.contact_tracking import LONGEST_SLIDE, SHORTEST_JUMP
from shell_deform.live.exchange import Slot
from shell_deform.live.grip_motion import AFFINE, GripPoses, followed
from shell_deform.live.pose import Pose, pose_of
from shell_deform.live.tick.at_rest import AtRest
from shell_deform.live.tick.fusion_types import Measured, Response
from shell_deform.live.tick.hold import Softening, softening
from shell_deform.live.tick.sample import ContactSample

Array = NDArray[np.float64]

BEND_REACH = 3.0
"""The second-order field is trusted to this many times the step it was measured over."""

WIDEST_GAUGE = 1.0
"""However far the tangent is left behind, a gauge stays better than this [N]."""


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
        self._anchor = record['anchor'][:k].copy()
        self._axis = record['axis'][:k].copy()
        self.places = record['place'][:k].copy()
        self.axis = record['axis'][:k].copy()
        self.touch_point = record['touch_point'][:k].copy()
        self.touch_normal = record['touch_normal'][:k].copy()
        self.energy = float(record['energy'])
        self.squeeze = self.energy - float(record['rest_energy'])
        self.spin = record['spin'][:k].copy()
        self.arm = record['arm'][:k].copy()
        self.grasp_known = bool(record['grasp_known'])
        self.centre = record['centre'].copy()
        self.sharing = Sharing(
            record['share_push'][:k].copy(),
            record['share_across'][:k].copy(),
            record['share_spin'][:k].copy(),
        )
        self.slipping: Slipping | None = None
        if np.any(record['slip_push'][:k]):
            self.slipping = Slipping(record['slip_push'][:k].copy(), record['slip_arm'][:k].copy())
        self.compliance = record['body_compliance'].copy()
        self.stress, self.strain = float(record['stress']), float(record['strain'])
        self.stress_doubt = float(record['stress_doubt'])
        self.share = float(record['share'])
        self.stable = bool(record['stable'])
        self.crosses = bool(record['crosses'])
        """Whether the surface passes through itself."""
        self.snap_margin = float(record['snap_margin'])
        self.reach = record['reach'][:k].copy()
        self.frame = record['frame'][:k].copy()
        self.refused = bool(record['refused'])
        self.set_doubt = float(record['set_doubt'])
        self.message = bytes(record['message']).decode(errors='replace')
        self.columns = slot.input_columns()
        self.surface, self.normals = slot.surface, slot.normals
        self.turn = np.eye(3)
        self.doubt = 0.0
        """What following the grips may have made wrong [m]."""
        self._take_grips(slot, k, r)
        self.at_rest = AtRest(
            self.fingers,
            record['linear_compliance'][:k, :k].copy(),
            record['second_order'][:k, : k * (k + 1) // 2].copy(),
            slot.linear_columns(),
            self.response.lateral,
            self.response.travel_offset,
            record['coarseness'][:k].copy(),
        )
        self.bend_direction = record['bend_direction'][:k].copy()
        self.bend_offset = float(record['bend_offset'])
        self.bend_reach = float(record['bend_reach'])
        self.third_reach = float(record['third_reach'])
        self.push_bend = record['push_bend'][:k].copy()
        along = np.einsum('ni,ni->n', slot.normals, slot.bend)
        self.worst_bend = float(np.abs(along).max(initial=0.0))
        self.worst_third = float(slot.third.max(initial=0.0))
        self.carried = pose_of(record['carried'])
        self.pose = pose_of(record['pose'])
        self.pose_root = _root(record['pose_covariance'])

    def _take_grips(self, slot: Slot, k: int, r: int) -> None:
        """What the grips do, and what they would do to the rest."""
        record = slot.record
        g = slot.grips.shape[2] // AFFINE
        self.grips = record['grip'][:g].copy()
        self.grip_pose = record['grip_pose'][:g].copy()
        self.grip_wrench = record['grip_wrench'][:g].copy()
        self._bend_by_grips = float(record['grip_bend'])
        self._reached = self.grips
        self._still = self.response
        self._by_grips = (
            record['displacement_by_grip'][:k, : AFFINE * g].copy(),
            record['reaction_by_grip'][: 2 * k, : AFFINE * g].copy(),
            record['rigid_by_grip'][:r, : AFFINE * g].copy(),
        )

    @property
    def coarseness(self) -> Array:
        """(k,) relative stiffness error of the mesh under each contact."""
        return self.at_rest.coarseness

    @property
    def softening(self) -> Softening:
        """How its pushes go with the strain of the wall; unknown where grips strain it, too."""
        if self.grips.any():
            return Softening()
        response, k = self.response, len(self.fingers)
        return softening(
            response.force, response.displacement_by[:, :k], self.at_rest.compliance, self.squeeze
        )

    def follow(self, poses: GripPoses) -> None:
        """Go with the grips to where they are now: surface and response, by their columns."""
        if np.array_equal(poses.motion, self._reached):
            return
        self._reached = poses.motion
        size = float(np.ptp(self.slot.surface, axis=0).max())
        alone = not len(self.fingers)
        way = followed(poses.plan, self.grips, poses.motion, size, alone)
        moved = self.slot.grips @ way.inputs
        self.surface = way.carried(self.slot.surface + moved)
        self.turn = way.turn
        self.normals = np.ascontiguousarray(self.slot.normals @ way.turn.T)
        self.doubt = self._bend_by_grips * way.step**2
        if self.carries:
            # The bodies stand: where they slip on it, the wall under them does not go along.
            self.doubt += float(np.linalg.norm(moved, axis=1).max())
        displacement_by, reaction_by, rigid_by = self._by_grips
        still = self._still
        self.response = still._replace(
            displacement=still.displacement + displacement_by @ way.inputs,
            reaction=still.reaction + reaction_by @ way.inputs,
            rigid_reaction=still.rigid_reaction + rigid_by @ way.inputs,
        )

    def knows(self, sample: ContactSample, pose: Pose) -> NDArray[np.bool_]:
        """(p,) rows of a sample, one per finger, that press one of these contacts.

        A finger that is far from where it was pressed has touched anew, whatever its number. Where
        the background found nothing on the way from rest, its columns are those of no equilibrium.
        """
        if self.share == 0.0 and not self.response.force.any():
            return np.zeros(len(sample.finger), bool)
        index = np.minimum(np.searchsorted(self.fingers, sample.finger), len(self.fingers) - 1)
        if index.min(initial=0) < 0:
            return np.zeros(len(sample.finger), bool)
        away = pose.to_object(sample.point) - self._anchor[index]
        along = np.einsum('pi,pi->p', away, self._axis[index])
        sideways = np.einsum('pi,pi->p', away, away) - along * along
        reach = np.maximum(LONGEST_SLIDE * sample.radius, SHORTEST_JUMP)
        # The far side of the object lies on the same axis, and is pushed the other way.
        facing = np.einsum('pi,pi->p', sample.normal @ pose.rotation, self._axis[index])
        near = (sideways < reach * reach) & ((facing > 0.0) | (np.abs(along) < reach))
        return (self.fingers[index] == sample.finger) & near

    def slid(self, sample: ContactSample, pose: Pose) -> Array:
        """(k,) how far each finger has come across its push from where it presses here [m].

        Bodies carry what they touch along, and are followed (`across`).
        """
        k = len(self.fingers)
        if self.carries or not len(sample.finger):
            return np.zeros(k)
        index = np.minimum(np.searchsorted(sample.finger, self.fingers), len(sample.finger) - 1)
        away = pose.to_object(sample.point[index]) - self._anchor
        along = np.einsum('ki,ki->k', away, self._axis)
        sideways = np.linalg.norm(away - along[:, None] * self._axis, axis=1)
        return np.where(sample.finger[index] == self.fingers, sideways, 0.0)

    @property
    def carries(self) -> bool:
        """Whether the fingers carry rigid bodies, whose poses count."""
        return bool(self.reach.any())

    def across(self, sample: ContactSample, pose: Pose) -> tuple[Array, float]:
        """How bodies have moved across their axes since the equilibrium (2 k,) [m], and the doubt.

        That is the error [m] of columns that know nothing of turns, and for which the same points
        touch and slip as in the equilibrium.
        """
        k = len(self.fingers)
        if not self.carries:
            return np.zeros(2 * k), 0.0
        index = np.minimum(np.searchsorted(sample.finger, self.fingers), len(sample.finger) - 1)
        present = sample.finger[index] == self.fingers
        away = np.where(present[:, None], pose.to_object(sample.point[index]) - self._anchor, 0.0)
        lateral = np.einsum('kai,ki->ka', self.response.lateral.reshape(k, 2, 3), away)
        frames = np.stack([sample.along[index], sample.normal[index]], axis=2)
        turned = np.einsum('ij,kia->kja', pose.rotation, frames) - self.frame[:, :, [0, 2]]
        angle = np.linalg.norm(np.nan_to_num(turned), axis=1).sum(axis=1)
        turns = np.where(present, self.reach * angle, 0.0)
        way = float((np.linalg.norm(away, axis=1) + turns).max(initial=0.0))
        return lateral.ravel(), self.set_doubt * way * way + float(turns.max(initial=0.0))

    def after(self, lateral: Array) -> Response:
        """The response where the bodies have moved across their axes by (2 k,) [m]."""
        response, k = self.response, len(self.fingers)
        return response._replace(
            displacement=response.displacement + response.displacement_by[:, k : 3 * k] @ lateral,
            reaction=response.reaction + response.reaction_by[:, k : 3 * k] @ lateral,
            rigid_reaction=response.rigid_reaction + response.rigid_by[:, k : 3 * k] @ lateral,
        )

    def taxels(self, pose: Pose) -> NDArray[np.float32]:
        """(t, f) rows of `TAXEL_FIELDS` of the equilibrium, in the frame of the contacts."""
        rows = self.slot.taxels[: int(self.slot.record['taxels'])].copy()
        rows[:, 0:3] = pose.from_object(rows[:, 0:3])
        for first in (3, 6):
            rows[:, first : first + 3] = rows[:, first : first + 3] @ pose.rotation.T
        return rows.astype(np.float32)

    def bend(self, moved: Array) -> tuple[float, float, float]:
        """Inputs of the second-order field for moved contacts (k,) [m].

        Returns what it is multiplied with and how much of that is uncertain [m^2], and the input
        of the unknown third order [m^3]. The field was measured between the last two equilibria
        and serves along that direction. Where there was only one, all of it is error.
        """
        if not self.bend_direction.any():
            start = self.bend_offset
            end = start + float(np.linalg.norm(moved))
            return 0.0, end * end - start * start, self._cube(end) - self._cube(start)
        along = float(self.bend_direction @ moved)
        reach = BEND_REACH * self.bend_reach
        used = min(max(along, -reach), reach)
        offset = self.bend_offset
        value = (offset + used) ** 2 - offset**2
        rest = float(moved @ moved) - used * used
        return value, max(rest, 0.0), abs(self._cube(offset + along) - self._cube(offset))

    def outer_offset(self, moved: Array) -> Array | None:
        """(n, 3) outer face over the surface for moved contacts (k,) [m]; None: half a wall."""
        outer, slope = self.slot.outer, self.slot.outer_slope
        if outer is None or slope is None:
            return None
        reach = BEND_REACH * self.bend_reach
        along = float(self.bend_direction @ moved)
        return (outer + min(max(along, -reach), reach) * slope) @ self.turn.T

    def linearisation_error(self, moved: Array) -> float:
        """Error estimate [m], at the worst vertex, of the step of the contacts by `moved` (k,)."""
        _, bend_error, third = self.bend(moved)
        return self.worst_bend * bend_error + self.worst_third * third

    def widened(self, measured: Measured) -> Measured:
        """The same with wider gauges.

        The tangent does not know how the push bends away from it: over a long step a gauge would
        outvote the encoders with the error of the tangent.
        """
        step = measured.travel + self.response.travel_offset - self.response.displacement
        square = float(np.nansum(np.where(measured.present, step * step, 0.0)))
        bent = np.minimum(np.abs(self.push_bend) * square, WIDEST_GAUGE)
        return measured._replace(sigma_push=np.hypot(measured.sigma_push, bent))

    def _cube(self, step: float) -> float:
        """Third power of a short step [m^3], growing less for one beyond `third_reach`."""
        return step**3 / (1.0 + abs(step) / self.third_reach)


def _root(covariance: Array) -> Array:
    """(6, i) root of a covariance, without its null space."""
    values, vectors = np.linalg.eigh(covariance)
    keep = values > 1e-18
    return np.ascontiguousarray(vectors[:, keep] * np.sqrt(values[keep]))
