# SPDX-License-Identifier: Apache-2.0
"""What a hand's own doubt about where its fingers stand makes of the served surface.

An object that fingers hold is where they are: its pose, told by them, is known as well as that of
a rigid body through points that are off by `sigma_point` each. What no rigid motion of the body
takes up moves a finger along the surface, and its dent goes with it: an error by the sine of the
angle that the wall has turned by. Where something else tells the pose, all of it does that. So
does what a finger has slid since its pin was laid on the shell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.pose import Pose
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.sample import ContactSample

Array = NDArray[np.float64]

OPEN_TURN = 0.2
"""A turn that the points tell no better than this [rad] they leave open: friction holds it."""

SAME = 1e-9
"""Share of the best known direction below which points tell nothing [-]."""


@dataclass(frozen=True)
class Whereabouts:
    """How well it is known where an object and k fingers are, the object in its own frame.

    Attributes:
        fingers: (k,) numbers. pose_root: (6, i) root of the covariance of the object's pose,
            translation [m] and rotation vector [rad]. along_surface: (k,) sigma of a finger's
            place on the object, in each of two directions [m].
    """

    fingers: NDArray[np.int64]
    pose_root: Array
    along_surface: Array


def point_sigma(sample: ContactSample) -> Array:
    """Sigma (p,) of the points of a sample [m], 0 where the hand says nothing that can be."""
    told = sample.sigma_point
    return np.where(np.isfinite(told) & (told > 0.0), told, 0.0)


def whereabouts(
    fingers: NDArray[np.int64], points: Array, normals: Array, sigma: Array, told_by_fingers: bool
) -> Whereabouts:
    """What points (k, 3) [m] with inward normals and `sigma` (k,) [m] tell of the object.

    `told_by_fingers`: whether they tell its pose; one point alone never does.
    """
    if not told_by_fingers or len(points) < 2 or not (sigma > 0.0).all():
        return Whereabouts(fingers, np.zeros((6, 0)), sigma)
    size = float(np.abs(points).max())
    # Motion of the points per shift, and per turn times the size of the object.
    rows = np.zeros((len(points), 3, 6))
    rows[:, :, :3] = np.eye(3)
    for axis in range(3):
        rows[:, :, 3 + axis] = np.cross(np.eye(3)[axis], points) / size
    weighted = (rows / sigma[:, None, None]).reshape(-1, 6)
    values, vectors = np.linalg.eigh(weighted.T @ weighted)
    known = values > max(SAME * float(values.max()), 1.0 / (OPEN_TURN * size) ** 2)
    root = vectors[:, known] / np.sqrt(values[known])
    body = rows @ root
    # What is left of each point's own scatter, of which the body takes a part along.
    left = sigma[:, None, None] ** 2 * np.eye(3) - body @ body.transpose(0, 2, 1)
    across = np.trace(left, axis1=1, axis2=2) - np.einsum('ki,kij,kj->k', normals, left, normals)
    root[3:] /= size
    return Whereabouts(fingers, np.ascontiguousarray(root), np.sqrt(np.maximum(0.5 * across, 0.0)))


class PlaceDoubt:
    """Keeps `Whereabouts` from one equilibrium to the next, and what they do to its dents."""

    def __init__(self) -> None:
        self._known = Whereabouts(np.zeros(0, np.int64), np.zeros((6, 0)), np.zeros(0))
        self._fresh = False
        self._adopted: Adopted | None = None
        self._sine = np.zeros(0)
        self._nearest = np.zeros(0, np.int64)
        self._slid = np.zeros(0)
        self._unmodelled: Array | None = None

    def adopt(self, adopted: Adopted, rest: Array, rest_normals: Array) -> None:
        """A new equilibrium of the surface `rest` (n, 3) [m], unit normals, without fingers."""
        turned = rest_normals @ adopted.carried.rotation.T
        # How far the wall has turned, and beside which contact.
        self._sine = np.linalg.norm(np.cross(turned, adopted.slot.normals), axis=1)
        away = np.linalg.norm(rest[:, None] - adopted.places[None], axis=2)
        self._nearest = away.argmin(axis=1) if len(adopted.places) else self._nearest[:0]
        self._adopted, self._fresh, self._unmodelled = adopted, False, None
        self._slid = np.zeros(len(adopted.fingers))

    def see(self, sample: ContactSample, pose: Pose, told_by_fingers: bool) -> None:
        """Take the points of a sample; once for every equilibrium and set of fingers."""
        if self._fresh and np.array_equal(sample.finger, self._known.fingers):
            return
        self._known = whereabouts(
            sample.finger,
            pose.to_object(sample.point),
            sample.normal @ pose.rotation,
            point_sigma(sample),
            told_by_fingers,
        )
        self._fresh, self._unmodelled = True, None
        if self._adopted is not None:
            self._slid = self._adopted.slid(sample, pose)

    def pose_root(self, given: bool) -> Array:
        """(6, i) root of the covariance of the object's pose; one fitted to first touch, not
        `given`, has its own."""
        if not given and self._adopted is not None:
            return self._adopted.pose_root
        return self._known.pose_root

    def unmodelled(self, adopted: Adopted) -> Array:
        """Sigma (n,) [m] of what no shell has, and of dents that may lie elsewhere."""
        if adopted is not self._adopted:
            return adopted.slot.unmodelled
        if self._unmodelled is None:
            self._unmodelled = self._with_places(adopted)
        return self._unmodelled

    def _with_places(self, adopted: Adopted) -> Array:
        known, unmodelled = self._known, adopted.slot.unmodelled
        if not (len(self._nearest) and len(known.fingers)):
            return unmodelled
        same = adopted.fingers[:, None] == known.fingers[None]
        sigma = np.hypot(np.where(same, known.along_surface, 0.0).max(axis=1), self._slid)
        return np.hypot(unmodelled, self._sine * sigma[self._nearest])
