# SPDX-License-Identifier: Apache-2.0
"""Linear theory at every sample of a recording, as the fast loop of the live node does it."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_replay.holds import usable
from grasp_replay.recording import Recording, in_object_frame
from grasp_replay.theories import TheorySet
from shell_deform.live.background.condensed import contact_rows
from shell_deform.live.background.contact_tracking import Touch
from shell_deform.live.background.small_loads import SmallLoads, small_loads
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.live.pose import IDENTITY, Pose
from shell_deform.live.tick.hold import ForceMemory
from shell_deform.live.tick.linearity import linear_error
from shell_deform.live.tick.sample import ContactSample, SampleError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SampleTrace:
    """One value per sample (n,): time [s] since the bag's start, fingers in contact, mean push
    [N] as felt, largest displacement by linear theory [m], and the share of it that linear theory
    misses or invents [-]. `refused` samples carried numbers no contact can have.
    """

    time_s: Array
    contacts: NDArray[np.int64]
    force_n: Array
    linear_displacement_m: Array
    linear_error: Array
    refused: int


def trace_samples(recording: Recording, shell: TheorySet, pose: Pose | None = None) -> SampleTrace:
    """Run linear theory over every sample; patches follow the fingers as in the live node."""
    loop = _LinearLoop(shell)
    count = len(recording.samples)
    values = np.zeros((5, count))
    refused = 0
    poses = _poses(recording, pose)
    law = shell.shell.relaxation
    memory = None if law is None else ForceMemory(law)
    for i, sample in enumerate(recording.samples):
        values[0, i] = (sample.stamp - recording.start) * 1e-9
        try:
            felt = usable(sample)
        except SampleError:
            refused += 1
            continue
        needed = felt if memory is None else memory.elastic(felt)
        values[1, i] = len(felt.finger)
        if len(felt.finger):
            values[2, i] = felt.push.mean()
            values[3:, i] = loop.serve(in_object_frame(needed, poses[i]))
    return SampleTrace(
        values[0], values[1].astype(np.int64), values[2], values[3], values[4], refused
    )


def _poses(recording: Recording, given: Pose | None) -> list[Pose]:
    if given is not None or not recording.poses:
        return [given or IDENTITY] * len(recording.samples)
    times = np.array([time for time, _ in recording.poses])
    stamps = np.array([sample.stamp for sample in recording.samples])
    places = np.maximum(np.searchsorted(times, stamps, side='right') - 1, 0)
    return [recording.poses[place][1] for place in places]


class _LinearLoop:
    """The response of the shell at rest to unit pushes, for the contacts of the moment."""

    def __init__(self, shell: TheorySet) -> None:
        self._model = shell.model
        self._tracker = shell.tracker()
        self._koiter = EquilibriumTracker(self._model)
        self._linear = EquilibriumTracker(shell.models['linear'])
        self._loads: SmallLoads | None = None
        self._columns = np.zeros((len(self._model.rest), 3, 0))

    def serve(self, sample: ContactSample) -> tuple[float, float]:
        """Largest displacement [m] by linear theory, and the share of it that is wrong."""
        touches = tuple(
            Touch(
                int(sample.finger[i]),
                sample.point[i],
                sample.normal[i],
                float(sample.radius[i]),
                float(sample.push[i]),
                float(sample.travel[i]),
                float('nan'),
            )
            for i in range(len(sample.finger))
        )
        if self._tracker.update(touches, self._model.rest) or self._loads is None:
            self._lay()
        assert self._loads is not None
        push = sample.push
        moved = self._columns @ push
        size = float(np.sqrt(np.max(np.einsum('ni,ni->n', moved, moved))))
        return size, linear_error(self._loads.compliance, self._loads.second_order, push)

    def _lay(self) -> None:
        rest = self._model.rest
        rows = contact_rows(self._model, self._tracker.patches)
        # Where the response begins to bend is asked of koiter theory: linear theory has no bend.
        self._loads = small_loads(self._model, rest, self._koiter.rest_system(rest, rows), rows)
        count = rows.contacts
        columns = self._linear.rest_system(rest, rows).push_fields
        fields = columns.reshape(len(rest), 3 * count)
        limit = self._model.surface.limit_matrix @ fields
        self._columns = np.asarray(limit).reshape(len(rest), 3, count)


def trace_csv(trace: SampleTrace) -> str:
    """The trace as a table with a heading, SI units."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(
        ['time_s', 'contacts', 'mean_force_n', 'linear_max_displacement_m', 'linear_error']
    )
    columns = zip(
        trace.time_s,
        trace.contacts,
        trace.force_n,
        trace.linear_displacement_m,
        trace.linear_error,
        strict=True,
    )
    for time, contacts, force, displacement, error in columns:
        writer.writerow(
            [f'{time:.6f}', int(contacts), f'{force:.6g}', f'{displacement:.6g}', f'{error:.6g}']
        )
    return stream.getvalue()
