# SPDX-License-Identifier: Apache-2.0
"""A grasp that is held while the wall relaxes: from measured pushes to those of an elastic wall.

One function of time relaxes the whole wall. At a shape that stays all forces fall by it; while the
shape changes, what the wall has been strained to before presses through the shape of now. With all
strains growing in proportion to one number e, whose half square is the energy of the squeeze, a
finger feels F_e / e times the hereditary integral of e, F_e what it would feel of an elastic wall.
Solved for that at every sample, it keeps depth, fusion, contradiction and the learned modulus free
of time: a push that falls at constant travel is the same elastic push. Where linear theory holds e
goes with the force. Against the full history of the wall (`solve.hold`), by force alone: after a
ramp of 5 mm in 2 s at 8 % a decade 0.07 mm. Gas does not relax, and what it carries is taken as
wall: 0.03 mm after a minute of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.tick.sample import ContactSample
from shell_deform.theory.relaxation import Heredity, Relaxation, RelaxationError, Step, step_of

Array = NDArray[np.float64]

LATER_S = (10.0, 60.0, 600.0, 3600.0)
"""How much later the force is told [s]."""

LONGEST_HOLD_S = 1e5
"""So long a law in the logarithm of time goes on beyond its range [s]."""

ANEW_S = 1.0
"""A finger that was away longer begins another hold; the wall still remembers the first one."""

LATER_FIELDS = ('finger', 'later', 'force', 'sigma')


LEAST_FORCE = 0.05
"""Pushes below say nothing of how the wall softens [N]."""

SOLVES = 4
"""Passes in which the elastic pushes and the softening at them agree."""


@dataclass(frozen=True)
class Softening:
    """How force goes with the strain of the wall: F_e over e, as a share of linear theory's.

    Attributes:
        force: size of all pushes where it is known [N]. share: there. power: by which it goes on
            with the pushes.
    """

    force: float = 1.0
    share: float = 1.0
    power: float = 0.0

    def at(self, force: float) -> float:
        """The share at pushes of another size [N]; not beyond linear theory's on the way back."""
        if not force > 0.0 or self.power == 0.0:
            return self.share
        ratio = force / self.force
        share = self.share * ratio**self.power
        if ratio < 1.0:
            return min(share, 1.0) if self.share < 1.0 else max(share, 1.0)
        return float(share)


def softening(force: Array, compliance: Array, at_rest: Array, energy: float) -> Softening:
    """Of an equilibrium: pushes (k,) [N], compliances (k, k) there and at rest [m/N], energy [J].

    Along the pushes e changes by F C F / 2 W of itself per change of the pushes of themselves.
    """
    size, linear = float(np.linalg.norm(force)), 0.5 * float(force @ at_rest @ force)
    if size < LEAST_FORCE or not (energy > 0.0 and linear > 0.0):
        return Softening()
    power = 1.0 - float(force @ compliance @ force) / (2.0 * energy)
    return Softening(size, float(np.sqrt(linear / energy)), float(np.clip(power, -1.0, 0.75)))


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
        self._before = self._memory
        self._passed, self._slope = 0.0, 1.0
        self._stamp: int | None = None
        self._measured: ContactSample | None = None
        self._answer: ContactSample | None = None
        self._softening = self._softened = Softening()

    def take(self, found: Softening) -> None:
        """How the wall softens at the newest equilibrium."""
        self._softening = found

    def elastic(self, sample: ContactSample) -> ContactSample:
        """A sample, one row per finger, with the forces that an elastic wall would need.

        Asked again for the same stamp it answers as before, unless more is known of the wall. A
        sample from before the last one is answered from what is known now.
        """
        again = sample.stamp == self._stamp
        if again and self._answer is not None and self._softened is self._softening:
            return self._answer
        self._take_up(sample)
        late = self._stamp is not None and sample.stamp < self._stamp
        passed = 0.0 if self._stamp is None or late else 1e-9 * (sample.stamp - self._stamp)
        if again and len(self._before.elastic) == len(self._memory.elastic):
            self._memory, passed = self._before, self._passed
        step = step_of(self.law, passed)
        index = np.searchsorted(self._fingers, sample.finger)
        strain = np.zeros((len(self._fingers), 3))
        strain[index], slope = self._strained(sample.force, self._memory.held(step)[index], step)
        here = slope * strain[index]
        share = _ratio(here, sample.force)
        age = 1e-9 * (sample.stamp - self._began[index])
        own = np.linalg.norm(here, axis=1) * self._sigma(np.maximum(age, 0.0))
        answer = replace(
            sample, force=here, sigma_normal=np.hypot(sample.sigma_normal * share, own)
        )
        if not late:
            self._seen[index] = sample.stamp
            self._before, self._passed, self._slope = self._memory, passed, slope
            self._memory = self._memory.after(step, strain)
            self._stamp, self._measured, self._answer = sample.stamp, sample, answer
            self._softened = self._softening
        return answer

    def _strained(self, force: Array, held: Array, step: Step) -> tuple[Array, float]:
        """(k, 3) share of each finger in e for forces as felt, in newtons of linear theory; and
        the elastic force over it.
        """
        slope = self._softening.at(float(np.linalg.norm(force)))
        strain = (force / slope - held) / step.now
        for _ in range(SOLVES):
            slope = self._softening.at(slope * float(np.linalg.norm(strain)))
            strain = (force / slope - held) / step.now
        return strain, slope

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
            strain = (step.now * self._memory.elastic + self._memory.held(step))[index]
            force = self._slope * strain
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
