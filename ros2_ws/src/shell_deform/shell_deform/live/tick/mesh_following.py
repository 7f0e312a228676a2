# SPDX-License-Identifier: Apache-2.0
"""When the mesh should be built again, because fingers rest where it is too coarse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.rest_shell import RestShell
from shell_deform.live.background.worker_link import WorkerLink
from shell_deform.live.exchange import Slot
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.estimator import Estimator
from shell_deform.live.tick.finger_path import FingerPath
from shell_deform.live.tick.first_touch import FirstTouch

Array = NDArray[np.float64]

COARSE = 0.005
"""A mesh whose stiffness under a contact is further off than this share is too coarse there."""

COARSE_UNDER_BODIES = 0.03
"""The same under rigid bodies, which press along a ring that grows: meshes graded for them have
triangles of a quarter to a third of the bending length, 0.01 to 0.02 by the same measure."""

REST_S = 0.25
"""So long the contacts stay in place before that is worth a new mesh [s]."""

SAME = 0.5
"""Places closer than this share of the contact's radius are the same."""


class MeshFollower:
    """Watches where contacts rest, while `active`; asks for no mesh twice in a row."""

    def __init__(self) -> None:
        self.active = True
        self._rest: RestShell | None = None
        self._places: Array = np.zeros((0, 3))
        self._since = 0.0
        self._built: Array = np.zeros((0, 3))

    def forget(self) -> None:
        """Another object."""
        self._rest = None
        self._places = self._built = np.zeros((0, 3))

    def follow(
        self, link: WorkerLink, estimator: Estimator, path: FingerPath, now: float
    ) -> tuple[Slot, FirstTouch] | None:
        """Ask `link` for a new mesh, and say when it answers the contacts of `estimator`.

        Returns its first equilibrium and what answers first touches on it; `now` steady [s].
        Fingers that carry bodies take it along their `path` first: friction has memory.
        """
        if path.active and not path.whole:
            # The grasp has lasted too long to be gone through again: it keeps its mesh.
            link.drop_candidate()
            self._rest = None
            return None
        if link.tend_candidate():
            # It could not be built: the mesh stays as it is, with its error in sigma.
            self._rest = None
        candidate, sample = link.candidate, estimator.sample
        if candidate is not None and sample is not None:
            self._rest = candidate.handed_over() or self._rest
            if not path.caught_up(candidate):
                return None
            slot, adopted = candidate.newer_result(), estimator.adopted
            if slot is None or adopted is None or self._rest is None:
                return None
            if not _same(adopted.places, self._built, float(sample.radius.min(initial=np.inf))):
                # The fingers have gone elsewhere meanwhile.
                link.drop_candidate()
                self._rest, self._built = None, np.zeros((0, 3))
                return None
            fingers = slot.record['finger'][: int(slot.record['contacts'])]
            if slot.record['share'] < 1.0 or fingers.tolist() != adopted.fingers.tolist():
                return None
            first, self._rest = FirstTouch(self._rest), None
            return slot, first
        first_touch = estimator.first_touch
        if self.active and first_touch is not None and sample is not None and len(sample.finger):
            radius, adopted = float(sample.radius.min()), estimator.adopted
            if path.active and adopted is not None and not adopted.carries:
                # One finger alone counts as a pin until another one joins.
                return None
            places = self.look(adopted, radius, now)
            if places is not None:
                link.grade(places, radius, first_touch.curl)
        return None

    def look(self, adopted: Adopted | None, radius: float, now: float) -> Array | None:
        """Places (k, 3) [m] of the object to grade the mesh at, or None; `now` steady [s].

        `radius` [m]: smallest of the contacts.
        """
        most = COARSE_UNDER_BODIES if adopted is not None and adopted.carries else COARSE
        if adopted is None or not (adopted.coarseness > most).any():
            self._places = np.zeros((0, 3))
            return None
        places = adopted.places
        if not _same(places, self._places, radius):
            self._places, self._since = places, now
            return None
        if now - self._since < REST_S or _same(places, self._built, radius):
            return None
        self._built = places
        return places


def _same(first: Array, second: Array, radius: float) -> bool:
    """Whether two sets of places (k, 3) agree, in any order."""
    if first.shape != second.shape or not len(first):
        return False
    gap = np.linalg.norm(first[:, None] - second[None], axis=2)
    return bool((gap.min(axis=1, initial=np.inf) < SAME * radius).all())
