# SPDX-License-Identifier: Apache-2.0
"""Which contacts carried the object while it was scanned: the mean over each hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grasp_replay.errors import BagError
from grasp_replay.experiment import Experiment, ScanEntry
from grasp_replay.recording import RecordedScan, Recording, in_object_frame
from grasp_replay.touch_cells import carried_bodies, felt_in, shape_of
from shell_deform.contact.body_file import FingerBody
from shell_deform.contact.cell_load import CellShape
from shell_deform.contact.finger_bodies import of_finger
from shell_deform.live.background.contact_tracking import Touch
from shell_deform.live.pose import IDENTITY, Pose, pose_of
from shell_deform.live.tick.sample import (
    FLAG_FAULT,
    FLAG_NO_GAUGE,
    FLAG_NOT_TARED,
    FLAG_SATURATED,
    FLAG_STALE,
    ContactSample,
    SampleError,
    check,
    one_row_per_finger,
)
from shell_deform.live.tick.touch_check import TouchCells

Array = NDArray[np.float64]

UNUSABLE = FLAG_STALE | FLAG_FAULT | FLAG_NO_GAUGE | FLAG_NOT_TARED
# Without a description of the recording the load of a scan is that of the time before it.
DEFAULT_WINDOW_NS = 500_000_000
DEFAULT_RADIUS_M = 1e-3


@dataclass(frozen=True)
class HeldContacts:
    """Means over a hold, in the object's frame, one row per finger in their order.

    Attributes:
        finger: (k,). point: (k, 3) on the deformed outer face [m]. normal: (k, 3) inward.
        push: (k,) along the normal [N]. sigma: (k,) of the push [N]. radius: (k,) [m].
        travel: (k,) since first touch [m], NaN where unknown.
        samples: how many were averaged. saturated: whether a gauge was at its end.
        felt: (k,) push that the gauges felt of a wall that relaxes, where `push` is what an
            elastic one would have needed; None where the two are one.
        along: (k, 3) to the tips of the fingers, NaN where unknown.
        cells: what the touch cells of each finger felt (c,) [N], by its number.
        shapes: by finger, where its cells say that its push lies; without one it lies evenly.
    """

    finger: NDArray[np.int64]
    point: Array
    normal: Array
    push: Array
    sigma: Array
    radius: Array
    travel: Array
    samples: int
    saturated: bool
    felt: Array | None = None
    along: Array = field(default_factory=lambda: np.full((1, 3), np.nan))
    cells: Mapping[int, Array] = field(default_factory=dict)
    shapes: Mapping[int, CellShape] = field(default_factory=dict)

    def touches(self) -> tuple[Touch, ...]:
        """The contacts as the solver's tracker takes them."""
        return tuple(
            Touch(
                int(self.finger[i]),
                self.point[i],
                self.normal[i],
                float(self.radius[i]),
                float(self.push[i]),
                float(self.travel[i]),
                float('nan'),
                np.broadcast_to(self.along, self.normal.shape)[i],
                self.shapes.get(int(self.finger[i])),
            )
            for i in range(len(self.finger))
        )


@dataclass(frozen=True)
class Hold:
    """A scan and the load it was taken under; `contacts` is None for the undeformed object.

    `pose`: of the object in the frame of the contacts. `points` (n, 3): the scan in the object's
    frame [m]. `notes` say what was dropped of it.
    """

    entry: ScanEntry
    pose: Pose
    points: Array
    contacts: HeldContacts | None
    notes: tuple[str, ...] = ()


def usable(sample: ContactSample, default_radius: float = DEFAULT_RADIUS_M) -> ContactSample:
    """The rows in contact that can be relied on, one per finger; raises SampleError."""
    check(sample)
    return one_row_per_finger(sample.rows((sample.flags & UNUSABLE) == 0), default_radius)


def holds_of(
    recording: Recording, experiment: Experiment, pose: Pose | None = None
) -> tuple[Hold, ...]:
    """The scans of a recording with their loads, in order of time; raises BagError.

    Without a list of scans the first is the undeformed object and every other one is held. The
    pose is `pose`, or the recorded one, or the experiment's, or none (the frames are one).
    """
    entries = experiment.scans or tuple(
        ScanEntry(scan.stamp, held=number > 0) for number, scan in enumerate(recording.scans)
    )
    scans = {scan.stamp: scan for scan in recording.scans}
    headers = [scan.header_stamp for scan in recording.scans]
    for scan in recording.scans:
        # where scans go by the times of recording, their own stamps may still name them
        if headers.count(scan.header_stamp) == 1:
            scans.setdefault(scan.header_stamp, scan)
    if not entries:
        raise BagError(f'{recording.path} holds no scan to compare with')
    missing = [entry.stamp for entry in entries if entry.stamp not in scans]
    if missing:
        raise BagError(
            f'{recording.path}: no scan has the stamp {missing[0]} ns that the experiment names'
        )
    bodies = carried_bodies(experiment.finger_body) if recording.cells else {}
    chosen = [scans[entry.stamp] for entry in entries]
    if len({scan.stamp for scan in chosen}) < len(chosen):
        raise BagError(f'{recording.path}: the experiment names a scan twice; name each once')
    return tuple(
        _hold(recording, experiment, replace(entry, stamp=scan.stamp), scan, pose, bodies)
        for entry, scan in zip(entries, chosen, strict=True)
    )


def _hold(
    recording: Recording,
    experiment: Experiment,
    entry: ScanEntry,
    scan: RecordedScan,
    given: Pose | None,
    bodies: Mapping[int, FingerBody],
) -> Hold:
    pose = given or recording.pose_at(entry.stamp)
    if pose is None:
        numbers = entry.object_pose or experiment.object_pose
        pose = IDENTITY if numbers is None else pose_of(list(numbers))
    contacts: HeldContacts | None = None
    notes: tuple[str, ...] = ()
    if entry.held:
        first, last = entry.window or (entry.stamp - DEFAULT_WINDOW_NS, entry.stamp)
        chosen = [sample for sample in recording.samples if first <= sample.stamp <= last]
        # The object may shift a little within a hold: every sample has its own pose.
        placed = [
            in_object_frame(sample, given or recording.pose_at(sample.stamp) or pose)
            for sample in chosen
        ]
        contacts = mean_contacts(placed)
        if contacts is None:
            raise BagError(
                f'{recording.path}: nothing touches in the {(last - first) * 1e-9:.2f} s of the '
                f'hold around the scan at {entry.stamp} ns ({len(chosen)} samples'
                f'{_refused(placed)})'
            )
        felt = [cells for cells in recording.cells if first <= cells.stamp <= last]
        contacts, notes = _with_cells(contacts, felt, bodies)
    return Hold(entry, pose, pose.to_object(scan.points), contacts, notes)


def _with_cells(
    contacts: HeldContacts, felt: list[TouchCells], bodies: Mapping[int, FingerBody]
) -> tuple[HeldContacts, tuple[str, ...]]:
    """The contacts with what their touch cells felt, and which of these do not count, and why."""
    if not felt:
        return contacts, ()
    if not bodies:
        return contacts, ('hand/tactile is not used: experiment.yaml names no finger_body',)
    cells, notes = felt_in(felt, bodies)
    shapes, told = {}, [f'hand/tactile: {note}' for note in notes]
    for k, finger in enumerate(contacts.finger.tolist()):
        shape, why = shape_of(
            of_finger(bodies, finger),
            cells.get(finger),
            float(contacts.push[k]),
            contacts.normal[k],
            contacts.along[k],
        )
        if shape is not None:
            shapes[finger] = shape
        elif why:
            told.append(f'hand/tactile: finger {finger} {why}, so its push lies evenly')
    if shapes:
        whose = ', '.join(map(str, shapes))
        told.append(f'the push of finger {whose} lies where its touch cells felt it')
    return replace(contacts, cells=cells, shapes=shapes), tuple(told)


def _refused(samples: list[ContactSample]) -> str:
    """How many of the samples cannot be used, and why the first one cannot; empty if all can."""
    reasons = []
    for sample in samples:
        try:
            usable(sample)
        except SampleError as error:
            reasons.append(str(error))
    return f', {len(reasons)} of them unusable: {reasons[0]}' if reasons else ''


def mean_contacts(samples: list[ContactSample]) -> HeldContacts | None:
    """Means over the fingers that touch in most of the samples; None when none does."""
    rows: list[ContactSample] = []
    for sample in samples:
        try:
            rows.append(usable(sample))
        except SampleError:
            continue
    fingers = np.concatenate([row.finger for row in rows]) if rows else np.zeros(0, np.int64)
    numbers, counts = np.unique(fingers, return_counts=True)
    kept = numbers[counts > 0.5 * len(rows)] if len(rows) else numbers
    if len(kept) == 0:
        return None

    def stack(name: str, finger: int) -> Array:
        return np.stack(
            [np.asarray(getattr(row, name)[row.finger == finger][0], float) for row in rows
             if finger in row.finger]
        )  # fmt: skip

    def means(name: str) -> Array:
        return np.stack([stack(name, int(finger)).mean(axis=0) for finger in kept])

    normal = means('normal')
    return HeldContacts(
        finger=kept,
        point=means('point'),
        normal=normal / np.linalg.norm(normal, axis=1)[:, None],
        push=np.array([stack('push', int(finger)).mean() for finger in kept]),
        sigma=np.array(
            [np.sqrt(np.mean(stack('sigma_normal', int(finger)) ** 2)) for finger in kept]
        ),
        radius=means('radius'),
        travel=means('travel'),
        along=means('along'),
        samples=len(rows),
        saturated=bool(any(np.any(row.flags & FLAG_SATURATED) for row in rows)),
    )
