# SPDX-License-Identifier: Apache-2.0
"""A grasp that is held while the wall relaxes: from measured pushes to those of an elastic wall.

One function of time relaxes the whole wall, so what a finger feels is the hereditary integral of
what it would feel of an elastic wall of the stated modulus. Solved for that at every sample, it
keeps depth, fusion, contradiction and the learned modulus free of time: a push that falls at
constant travel is the same elastic push. Exact while the shape stays. Against the full history of
the wall (`solve.hold`), by force alone: creep to half as deep again 0.3 % of depth; after a ramp
of 5 mm in 2 s at 8 % a decade 0.18 mm, two seconds later below 0.1 mm. Gas does not relax, and
what it carries is taken as wall: 0.06 mm after ten minutes of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.tick.sample import ContactSample
from shell_deform.theory.relaxation import Heredity, Relaxation, RelaxationError, step_of

Array = NDArray[np.float64]

LATER_S = (10.0, 60.0, 600.0, 3600.0)
"""How much later the force is told [s]."""

LONGEST_HOLD_S = 1e5
"""So long a law in the logarithm of time goes on beyond its range [s]."""

ANEW_S = 1.0
"""A finger that was away longer begins another hold; the wall still remembers the first one."""

LATER_FIELDS = ('finger', 'later', 'force', 'sigma')


class ForceMemory:
    """What the fingers have pushed with since time last jumped; one sample after the other."""

    def __init__(self, law: Relaxation) -> None:
        self.law = _lasting(law)
        self.forget()

    def forget(self) -> None:
        """The wall has long been left alone."""
        none = np.zeros((0, 3))
        self._fingers: NDArray[np.int64] = np.zeros(0, np.int64)
        self._began = self._seen = np.zeros(0, np.int64)
        self._memory = Heredity(none, none, np.zeros((len(self.law.times), 0, 3)))
        self._stamp: int | None = None
        self._measured: ContactSample | None = None
        self._answer: ContactSample | None = None

    def elastic(self, sample: ContactSample) -> ContactSample:
        """A sample, one row per finger, with the forces that an elastic wall would need.

        Asked again for the same stamp it answers as before. A sample from before the last one is
        answered from what is known now.
        """
        if sample.stamp == self._stamp and self._answer is not None:
            return self._answer
        self._take_up(sample)
        late = self._stamp is not None and sample.stamp < self._stamp
        passed = 0.0 if self._stamp is None or late else 1e-9 * (sample.stamp - self._stamp)
        step = step_of(self.law, passed)
        index = np.searchsorted(self._fingers, sample.finger)
        force = np.zeros((len(self._fingers), 3))
        force[index] = (sample.force - self._memory.held(step)[index]) / step.now
        held = force[index]
        share = _ratio(held, sample.force)
        age = 1e-9 * (sample.stamp - self._began[index])
        own = np.linalg.norm(held, axis=1) * self._sigma(np.maximum(age, 0.0))
        answer = replace(
            sample, force=held, sigma_normal=np.hypot(sample.sigma_normal * share, own)
        )
        if not late:
            self._seen[index] = sample.stamp
            self._memory = self._memory.after(step, force)
            self._stamp, self._measured, self._answer = sample.stamp, sample, answer
        return answer

    def _take_up(self, sample: ContactSample) -> None:
        """Make room for fingers that are new."""
        new = np.setdiff1d(sample.finger, self._fingers)
        back = np.isin(self._fingers, sample.finger)
        back &= sample.stamp - self._seen > 1e9 * ANEW_S
        self._began[back & (self._seen < self._last_stamp)] = sample.stamp
        if not len(new):
            return
        fingers = np.concatenate([self._fingers, new])
        order, memory = np.argsort(fingers, kind='stable'), self._memory
        rest = np.zeros((len(new), 3))
        terms = np.zeros((len(self.law.times), len(new), 3))
        elastic = np.concatenate([memory.elastic, rest])[order]
        self._memory = Heredity(
            elastic,
            np.zeros_like(elastic),
            np.concatenate([memory.terms, terms], axis=1)[:, order],
        )
        self._fingers = fingers[order]
        now = np.full(len(new), sample.stamp, np.int64)
        self._began = np.concatenate([self._began, now])[order]
        self._seen = np.concatenate([self._seen, now])[order]

    @property
    def _last_stamp(self) -> int:
        return 0 if self._stamp is None else self._stamp

    def _sigma(self, age: Array) -> Array:
        return self.law.sigma_of(age, self.law.reference or self.law.first)

    def share(self, finger: NDArray[np.int64]) -> Array:
        """(k,) measured force over the elastic one, at the last sample; 1 where nothing pushes."""
        result = np.ones(len(finger))
        if self._measured is None or self._answer is None:
            return result
        own = _ratio(self._measured.force, self._answer.force)
        for k, number in enumerate(finger):
            at = np.flatnonzero(self._measured.finger == number)
            if len(at):
                result[k] = own[at[0]]
        return result

    @property
    def oldest(self) -> float:
        """How long the finger that has pushed longest has done so [s]."""
        touching = self._began[self._seen == self._stamp]
        return 1e-9 * float(self._last_stamp - touching.min()) if len(touching) else 0.0

    def later(self, times: Sequence[float] = LATER_S) -> NDArray[np.float32]:
        """(r, 4) `LATER_FIELDS`: what each finger will feel if it stays where it is [s, N].

        For each of `times` [s] from now. Sigma is of the gauge now, and of the law from now on.
        """
        sample = self._measured
        if sample is None:
            return np.zeros((0, len(LATER_FIELDS)), np.float32)
        index = np.searchsorted(self._fingers, sample.finger)
        age = np.maximum(1e-9 * (sample.stamp - self._began[index]), 0.0)
        rows: list[Array] = []
        for later in times:
            step = step_of(self.law, later)
            force = (step.now * self._memory.elastic + self._memory.held(step))[index]
            push = np.einsum('pi,pi->p', force, sample.normal)
            relative = [float(self.law.sigma_of(a + later, max(a, self.law.first))) for a in age]
            sigma = np.hypot(sample.sigma_normal, np.abs(push) * np.array(relative))
            rows.extend(np.stack([sample.finger, np.full(len(push), later), push, sigma], axis=1))
        return np.array(rows, np.float32).reshape(-1, len(LATER_FIELDS))


def _lasting(law: Relaxation) -> Relaxation:
    """The law with terms for a long hold and what is told of later; its range stays as known."""
    try:
        return law.covering(LONGEST_HOLD_S)
    except RelaxationError:
        # It would leave nothing of the wall by then: it ends where it is known to.
        return law


def _ratio(force: Array, over: Array) -> Array:
    """(k,) lengths of forces (k, 3) over those of others; 1 where there are none."""
    length = np.linalg.norm(over, axis=1)
    own = np.linalg.norm(force, axis=1)
    return np.where((length > 0.0) & (own > 0.0), own / np.where(length > 0.0, length, 1.0), 1.0)
