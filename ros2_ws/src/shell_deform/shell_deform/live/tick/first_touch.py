# SPDX-License-Identifier: Apache-2.0
"""Contacts that no equilibrium knows yet, answered in the tick that sees them first.

The tangent at rest was handed over once. Where a finger touches, its patch is laid on the shell at
rest and a few triangular solves give its columns: linear theory from rest, right for the small
dents of a first touch. Its error is estimated from how the response bends elsewhere on the shell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.condensed import CondensedSystem, contact_rows
from shell_deform.live.background.contact_tracking import ContactTracker, Touch
from shell_deform.live.background.rest_shell import RestShell
from shell_deform.live.exchange import MAX_CONTACTS
from shell_deform.live.pose import Pose
from shell_deform.live.tick.at_rest import AtRest
from shell_deform.live.tick.sample import ContactSample

Array = NDArray[np.float64]


class FirstTouch:
    """Lays patches where fingers are and keeps their columns while they stay."""

    def __init__(self, shell: RestShell) -> None:
        self._shell = shell
        self._contacts = ContactTracker(
            shell.model, shell.control, at_rest=True, slides=shell.pins_slide
        )
        self._answer: AtRest | None = None
        # The first search on a surface lays its tables.
        shell.model.surface.closest_point(shell.model.rest, shell.model.rest[:1])

    @property
    def curl(self) -> float:
        """See `RestShell`."""
        return self._shell.curl

    def forget(self) -> None:
        """The fingers let go."""
        self._contacts.reset()
        self._answer = None

    def answer(self, sample: ContactSample, pose: Pose) -> AtRest | None:
        """Linear theory for all fingers of a sample, one row each; None where it has no answer."""
        if len(sample.finger) > MAX_CONTACTS:
            return None
        try:
            if self._contacts.update(_touches(sample, pose), self._shell.control):
                self._answer = self._solve()
        except (ValueError, RuntimeError, IndexError, np.linalg.LinAlgError):
            # Points that lie nowhere near the object, patches on top of each other.
            self.forget()
        return self._answer

    def joined(self, answer: AtRest, known: NDArray[np.bool_]) -> AtRest:
        """The contacts that are not `known` (k,), while the others keep their displacements."""
        new = ~known
        compliance, columns = answer.compliance, answer.columns
        pull = np.linalg.pinv(compliance[np.ix_(known, known)]) @ compliance[np.ix_(known, new)]
        own = compliance[np.ix_(new, new)] - compliance[np.ix_(new, known)] @ pull
        return AtRest(
            fingers=answer.fingers[new],
            compliance=own,
            second_order=bent(own, self._shell.curl),
            columns=np.ascontiguousarray(columns[:, :, new] - columns[:, :, known] @ pull),
            lateral=answer.lateral[np.repeat(new, 2)],
            # A finger that joins touches the deformed shell: its travel counts from there.
            travel_offset=np.zeros(int(new.sum())),
            coarseness=answer.coarseness[new],
        )

    def _solve(self) -> AtRest:
        shell, contacts = self._shell, self._contacts.contacts
        rows = contact_rows(shell.model, self._contacts.patches)
        system = CondensedSystem(shell.factor, shell.tangent, rows)
        k = len(contacts)
        return AtRest(
            fingers=np.array([contact.finger for contact in contacts], np.int64),
            compliance=system.compliance,
            second_order=bent(system.compliance, shell.curl),
            columns=shell.model.surface.limit_fields(system.push_fields),
            lateral=np.array([axis for c in contacts for axis in c.patch.lateral]).reshape(-1, 3),
            travel_offset=np.zeros(k),
            coarseness=np.array([contact.coarseness for contact in contacts]),
        )


def bent(compliance: Array, curl: float) -> Array:
    """Second order (k, k (k + 1) / 2) that bends each displacement by `curl` times its square."""
    first, second = np.triu_indices(len(compliance))
    twice = np.where(first == second, 1.0, 2.0)
    return np.asarray(curl * twice * compliance[:, first] * compliance[:, second])


def _touches(sample: ContactSample, pose: Pose) -> tuple[Touch, ...]:
    """The rows of a sample in the object's frame."""
    points = pose.to_object(sample.point)
    normals = sample.normal @ pose.rotation
    push = sample.push
    return tuple(
        Touch(
            int(sample.finger[i]),
            points[i],
            normals[i],
            float(sample.radius[i]),
            float(push[i]),
            float(sample.travel[i]),
            np.nan,
            sample.along[i] @ pose.rotation,
        )
        for i in range(len(sample.finger))
    )
