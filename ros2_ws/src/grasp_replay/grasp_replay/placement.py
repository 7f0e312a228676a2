# SPDX-License-Identifier: Apache-2.0
"""Where the object is in a recording, and how scans and contacts find each other.

The pose of the object in the frame of the contacts is given, recorded, or stands in
experiment.yaml. Where nobody states it, the object may stand in that frame already; else it is
searched for with a scan. Scans in a frame of their own are searched for one by one, as the live
node does. Whatever was assumed or searched is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasp_common.formats import RawMesh
from grasp_replay.errors import BagError
from grasp_replay.experiment import Experiment
from grasp_replay.recording import Recording
from scan_compare.deformed_surface import DeformedSurface
from scan_compare.model_file import surface_of_object
from scan_compare.registration import Registration, RegistrationError, register
from scan_compare.rigid import IDENTITY, Pose
from scan_compare.scan_file import ScanFileError, scan_of
from shell_deform.live.pose import Pose as ObjectPose
from shell_deform.live.pose import pose_of
from shell_deform.live.tick.sample import FLAG_CONTACT
from shell_deform.objects import ObjectError

Array = NDArray[np.float64]

NEAR_SHARE = 0.05
"""Points this share of the object's size from its surface lie on it."""

MOST_SHARE = 0.5
"""A scan of which more than this share lies on the object stands in the object's frame."""

PRESSED_SHARE = 0.2
"""How deep contacts of unknown travel may have pressed the surface in, of the object's size."""

DENTED_SHARE = 0.2
"""... and of one that was taken under load, whose dents lie off the object at rest."""

AS_GOOD = 1.05
"""A pose whose rms is within this factor of the best one fits as well."""

WAY_OUT = (
    'record /object_pose, give --object-pose "x y z qx qy qz qw", or state it in experiment.yaml'
)


@dataclass(frozen=True)
class Placement:
    """What is known about poses before any scan is compared.

    Attributes:
        recording: with the poses that were searched, if any were.
        pose: of the object in the frame of the contacts, for the whole recording; None where the
            recording has poses of its own.
        scan_start: where the registration of each scan starts, in the object's frame; None
            searches all rotations.
        notes: what was searched or assumed.
    """

    recording: Recording
    pose: ObjectPose | None
    scan_start: Pose | None
    notes: tuple[str, ...]


def placement(
    recording: Recording,
    experiment: Experiment,
    object_name: str,
    given: ObjectPose | None,
    search: bool,
) -> Placement:
    """Find out where the object is; raises BagError when nothing tells.

    `given` and `search` are the user's choice: a pose, or to search whatever is recorded.
    """
    scan_start = None if recording.frames_differ else IDENTITY
    notes: tuple[str, ...] = ()
    if recording.frames_differ:
        notes = (
            f'scans are in the frame {recording.scan_frame}, contacts in '
            f'{recording.contact_frame}: each scan was searched on the object',
        )
    stated = any(entry.object_pose for entry in experiment.scans)
    if given is None and not search:
        if recording.poses or stated:
            return Placement(recording, None, scan_start, notes)
        if experiment.object_pose is not None:
            return Placement(recording, pose_of(list(experiment.object_pose)), scan_start, notes)
    if given is not None:
        return Placement(recording, given, scan_start, notes)
    try:
        surface = surface_of_object(object_name)
    except ObjectError as error:
        raise BagError(str(error)) from error
    if not search and _stands_in_frame(recording, surface):
        return Placement(recording, None, scan_start, notes)
    if recording.frames_differ:
        raise BagError(
            f'{recording.path}: no object_pose is recorded, the contacts do not lie on the object '
            f'as it stands in their frame {recording.contact_frame}, and scans in '
            f'{recording.scan_frame} cannot tell where it is; {WAY_OUT}'
        )
    reason = 'asked for' if search else 'no object_pose is recorded'
    poses, said = _searched(recording, surface)
    return Placement(
        replace(recording, poses=poses), None, scan_start, (*notes, f'{reason}: {said}')
    )


def _stands_in_frame(recording: Recording, surface: DeformedSurface) -> bool:
    """Do contacts or the first scan lie on the object as it stands in the contacts' frame?"""
    for sample in recording.samples:
        travel = np.where(np.isfinite(sample.travel), sample.travel, 0.0)
        at_rest = sample.point - travel[:, None] * sample.normal
        known = np.all(np.isfinite(at_rest), axis=1) & ((sample.flags & FLAG_CONTACT) != 0)
        if known.any():
            share = NEAR_SHARE if np.isfinite(sample.travel[known]).all() else PRESSED_SHARE
            if _near(at_rest[known], surface, share * surface.extent) > MOST_SHARE:
                return True
            break
    if recording.frames_differ or not recording.scans:
        return False
    points = recording.scans[0].points
    points = points[np.all(np.isfinite(points), axis=1)]
    return len(points) > 0 and (_near(points, surface, NEAR_SHARE * surface.extent) > MOST_SHARE)


def _near(points: Array, surface: DeformedSurface, within: float) -> float:
    """Share of the points (n, 3) that are no further than `within` [m] from the surface."""
    distance, _ = cKDTree(surface.samples.position).query(points)
    return float(np.mean(distance < within))


def _searched(
    recording: Recording, surface: DeformedSurface
) -> tuple[tuple[tuple[int, ObjectPose], ...], str]:
    """Poses of the object by its scans, and a sentence about them; raises BagError.

    All rotations are tried for the first scan, and the one of the contacts' frame is kept where
    none is better, as for a ball. The object shifts while it is gripped, so that each later scan
    starts where the one before has found it. Between two scans the pose changes half way: a hold
    lies nearer to its own scan.
    """
    poses: list[tuple[int, ObjectPose]] = []
    start: Pose | None = None
    others = ''
    since = 0
    for number, scan in enumerate(recording.scans):
        source = f'the scan at {scan.stamp} ns'
        try:
            points = scan_of(RawMesh(scan.points.copy(), None), source, 'm', surface.extent).points
            found = (
                _found(points, surface)
                if start is None
                else register(points, surface, start=start)
            )
        except (ScanFileError, RegistrationError) as error:
            raise BagError(
                f'{recording.path}: no object_pose is recorded, and the object is not found in '
                f'its scans ({error}); {WAY_OUT}'
            ) from error
        on_object = _near(found.pose.apply(points), surface, NEAR_SHARE * surface.extent)
        if on_object < (MOST_SHARE if start is None else DENTED_SHARE):
            raise BagError(
                f'{recording.path}: no object_pose is recorded, and only {100 * on_object:.0f} % '
                f'of {source} lies on the object at the best pose that was found; {WAY_OUT}'
            )
        if start is None and found.ambiguous_poses > 1:
            others = f', one of {found.ambiguous_poses} that fit equally well'
        start = found.pose
        pose = ObjectPose(found.rotation.T, -found.rotation.T @ found.translation)
        poses.append((since, pose))
        if number + 1 < len(recording.scans):
            since = (scan.stamp + recording.scans[number + 1].stamp) // 2
    numbers = ' '.join(f'{value:.4g}' for value in poses[0][1].numbers)
    return tuple(poses), (
        f'its pose was searched with every scan, at first {numbers}{others}; record /object_pose '
        'for better ones'
    )


def _found(points: Array, surface: DeformedSurface) -> Registration:
    """Register points (n, 3) of unknown pose; turned as they are if no rotation is better."""
    found = register(points, surface, start=None)
    middle = surface.samples.position.mean(axis=0) - points.mean(axis=0)
    try:
        unturned = register(points, surface, start=Pose(np.eye(3), middle))
    except RegistrationError:
        return found
    if unturned.rms_m > AS_GOOD * found.rms_m:
        return found
    return replace(unturned, ambiguous_poses=found.ambiguous_poses)
