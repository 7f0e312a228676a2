# SPDX-License-Identifier: Apache-2.0
"""Recorded grasps of objects whose wall relaxes: elastic pushes, and the hold as it was felt.

What the gauges felt is turned, sample by sample, into what an elastic wall of the stated modulus
would have needed, as the live node does it; every theory then solves that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_replay.holds import Hold, usable
from grasp_replay.recording import Recording
from shell_deform.identify.relaxation import COUNT_N, DRIFT_N, NINETY
from shell_deform.live.tick.hold import ForceMemory
from shell_deform.live.tick.sample import ContactSample, SampleError
from shell_deform.theory.relaxation import Relaxation

Array = NDArray[np.float64]

KNOWN_SHARE = 0.1
"""Of a hold, before the rest of it is predicted: a minute of ten."""

LATER_POINTS = 40


def elastic_recording(recording: Recording, law: Relaxation) -> Recording:
    """The recording with pushes that a wall which does not relax would have needed."""
    memory = ForceMemory(law)
    samples: list[ContactSample] = []
    for sample in recording.samples:
        try:
            samples.append(memory.elastic(usable(sample)))
        except SampleError:
            samples.append(sample)
    return replace(recording, samples=tuple(samples))


@dataclass(frozen=True)
class HoldTrace:
    """The pushes of a hold over the time since the first finger touched, and a prediction.

    Attributes:
        finger: (k,). time: (m,) [s]. push: (m, k) as felt [N], NaN where a finger was away.
        known: until when the prediction knew them [s]. later: (q,) [s]. force, sigma: (q, k) of
            what the gauges were to say [N]: their noise and drift, and the doubt of the law; not
            what all of their forces are off by.
    """

    finger: NDArray[np.int64]
    time: Array
    push: Array
    known: float
    later: Array
    force: Array
    sigma: Array

    def to_json(self) -> dict[str, Any]:
        """At the end of the hold: predicted beside felt, a row a finger."""
        last = self.time >= self.time[-1] - 0.02 * (self.time[-1] - self.known)
        felt = np.nanmean(self.push[last], axis=0)
        return {
            'known_until_s': self.known,
            'predicted_at_s': float(self.later[-1]),
            'fingers': [
                {
                    'finger': int(finger),
                    'predicted_n': float(self.force[-1, k]),
                    'sigma_n': float(self.sigma[-1, k]),
                    'felt_n': float(felt[k]),
                }
                for k, finger in enumerate(self.finger)
            ],
            'inside_band': self.inside,
        }

    @property
    def inside(self) -> float:
        """Share of the later pushes inside the 90 % band."""
        after = self.time > self.known
        hits = []
        for k in range(len(self.finger)):
            push, time = self.push[after, k], self.time[after]
            seen = np.isfinite(push)
            centre = np.interp(time[seen], self.later, self.force[:, k])
            half = NINETY * np.interp(time[seen], self.later, self.sigma[:, k])
            hits.extend((np.abs(push[seen] - centre) <= half).tolist())
        return float(np.mean(hits)) if hits else 1.0


def hold_trace(recording: Recording, hold: Hold, law: Relaxation) -> HoldTrace | None:
    """The pushes of `hold` as felt, the later ones predicted from the first; None for no hold.

    A hold without a window of its own is only a moment.
    """
    contacts = hold.contacts
    if contacts is None or hold.entry.window is None:
        return None
    first, last = hold.entry.window
    known = first + round(KNOWN_SHARE * (last - first))
    memory = ForceMemory(law)
    stamps: list[int] = []
    rows: list[Array] = []
    later, predicted = np.zeros(0), np.zeros((0, 4))
    now = 0
    for sample in recording.samples:
        if sample.stamp > last:
            break
        try:
            seen = usable(sample)
        except SampleError:
            continue
        memory.elastic(seen)
        if not np.isin(contacts.finger, seen.finger).any():
            stamps, rows = [], []
            continue
        push = np.full(len(contacts.finger), np.nan)
        for k, finger in enumerate(contacts.finger):
            own = np.flatnonzero(seen.finger == finger)
            if len(own):
                push[k] = seen.push[own[0]]
        stamps.append(seen.stamp)
        rows.append(push)
        if not len(later) and seen.stamp >= known and np.isfinite(push).all():
            now = seen.stamp
            later = np.geomspace(1e-3, 1e-9 * (last - now), LATER_POINTS)
            predicted = memory.later(later.tolist()).astype(float)
    if not len(later) or last <= now:
        return None
    force = np.stack([predicted[predicted[:, 0] == f, 2] for f in contacts.finger], axis=1)
    time, push = 1e-9 * (np.array(stamps) - stamps[0]), np.array(rows)
    since = 1e-9 * (now - stamps[0])
    noise = np.sqrt(0.5 * np.nanmedian(np.diff(push[time <= since], axis=0) ** 2, axis=0))
    wander = DRIFT_N**2 * later / 60.0 + COUNT_N**2 / 12.0
    by_law = force * law.sigma_of(since + later, max(since, law.first))[:, None]
    sigma = np.sqrt(noise**2 + wander[:, None] + by_law**2)
    return HoldTrace(contacts.finger, time, push, since, since + later, force, sigma)
