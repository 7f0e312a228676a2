# SPDX-License-Identifier: Apache-2.0
"""What grips do to the object, as the node tells it: relaxed, and beside the fingers' friction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shell_deform.grasp.contacts import GraspContacts
from shell_deform.live.pose import Pose
from shell_deform.live.tick.adopted import Adopted
from shell_deform.theory.relaxation import Heredity, Relaxation, step_of, unloaded

Array = NDArray[np.float64]

GRIP_FIELDS = (
    *('grip', 'x', 'y', 'z', 'rx', 'ry', 'rz', 'fx', 'fy', 'fz', 'tx', 'ty', 'tz'),
    *('friction_torque', 'friction_capacity'),
)
"""A grip: its point, its turn since it took hold, force and torque on the object about that point,
what the fingers give and could give by friction about the axis of the turn [m, rad, N, N m]."""

LEAST_TURN = 1e-6
"""A turn below has no axis [rad]."""


class WrenchMemory:
    """Wrenches of grips on a wall that relaxes: hereditary integrals of the elastic ones.

    In axes that turn with each grip, so that carrying the whole object about changes nothing.
    """

    def __init__(self, law: Relaxation | None) -> None:
        """Without a law wrenches stay as they are."""
        self._law = law
        self.forget()

    def forget(self) -> None:
        """The wall has long been left alone."""
        self._memory: Heredity | None = None
        self._stamp = 0

    def felt(self, adopted: Adopted) -> Array:
        """(g, 6) wrenches at an equilibrium; one from before the last changes nothing."""
        wrench = adopted.grip_wrench
        if self._law is None or not len(wrench):
            return wrench
        turns = Rotation.from_rotvec(adopted.grip_pose[:, 3:])
        elastic = np.stack([turns.inv().apply(wrench[:, :3]), turns.inv().apply(wrench[:, 3:])])
        if self._memory is None or self._memory.elastic.shape != elastic.shape:
            self._memory = unloaded(self._law, np.zeros_like(elastic))
            self._stamp = adopted.stamp
        passed = 1e-9 * (adopted.stamp - self._stamp)
        step = step_of(self._law, max(passed, 0.0))
        felt = step.now * elastic + self._memory.held(step)
        if passed >= 0.0:
            self._memory, self._stamp = self._memory.after(step, elastic), adopted.stamp
        return np.concatenate([turns.apply(felt[0]), turns.apply(felt[1])], axis=1)


def grip_rows(
    adopted: Adopted, wrench: Array, origins: Array, pose: Pose, fingers: GraspContacts | None
) -> NDArray[np.float32]:
    """(g, 15) `GRIP_FIELDS` in the frame of the contacts.

    `wrench` (g, 6): as felt. `origins` (g, 3): of the grips at rest [m]. `pose`: of the object.
    `fingers`: what presses, in the frame of the contacts.
    """
    count = len(wrench)
    rows = np.full((count, len(GRIP_FIELDS)), np.nan)
    rows[:, 0] = np.arange(count)
    rows[:, 1:4] = pose.from_object(origins + adopted.grip_pose[:, :3])
    rows[:, 4:7] = adopted.grip_pose[:, 3:] @ pose.rotation.T
    rows[:, 7:10] = wrench[:, :3] @ pose.rotation.T
    rows[:, 10:13] = wrench[:, 3:] @ pose.rotation.T
    for k in range(count):
        turn = float(np.linalg.norm(rows[k, 4:7]))
        if fingers is not None and turn > LEAST_TURN:
            rows[k, 13:] = friction_about(fingers, rows[k, 1:4], rows[k, 4:7] / turn)
    return rows.astype(np.float32)


def friction_about(fingers: GraspContacts, origin: Array, axis: Array) -> tuple[float, float]:
    """Torque of friction about an axis (3,) through `origin` (3,), and the most it can be [N m].

    Every finger as a point: friction times push times its arm. `contact.friction_share` is the
    exact sum over contact regions.
    """
    arms = np.cross(axis, fingers.point - origin)
    torque = np.einsum('ki,ki->k', fingers.tangential, arms)
    torque = torque + fingers.spin * (fingers.normal @ axis)
    reach = np.linalg.norm(arms, axis=1)
    capacity = fingers.friction * np.maximum(fingers.push, 0.0) * reach
    return float(torque.sum()), float(capacity.sum())
