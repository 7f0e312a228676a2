# SPDX-License-Identifier: Apache-2.0
"""A recorded grasp as arrays: contact samples, object poses and scans, from any bag."""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_common.point_cloud import CloudReader, MessageError
from grasp_replay.bag import Bag
from grasp_replay.bag_reader import bag_files, open_bag, read_metadata
from grasp_replay.cdr import header_stamp
from grasp_replay.errors import BagError
from grasp_replay.recorded_times import (
    Recorded,
    by_log_time,
    fault_of_stamps,
    frame_of,
    without_copies,
)
from grasp_replay.topic_selection import listed
from shell_deform.live.pose import IDENTITY, Pose, PoseError, pose_of
from shell_deform.live.tick.contact_cloud import CellReader, ContactReader
from shell_deform.live.tick.sample import FLAG_STALE, ContactSample
from shell_deform.live.tick.touch_check import TouchCells

Array = NDArray[np.float64]

CONTACTS, SCANS, POSES = 'hand/contacts', 'scan/points', 'object_pose'
CELLS = 'hand/tactile'
CLOUD, POSE = 'sensor_msgs/msg/PointCloud2', 'geometry_msgs/msg/PoseStamped'


@dataclass(frozen=True)
class RecordedScan:
    """A scan in its own frame: stamp and header stamp in ns, points (n, 3) in m as recorded."""

    stamp: int
    points: Array
    header_stamp: int = 0


@dataclass(frozen=True)
class Recording:
    """Everything the offline pipeline takes from a bag, in the order of the stamps.

    `cells`: what the touch cells of fingers felt, where they were recorded. `poses` are (stamp in
    ns, pose of the object in the frame of the contacts). The frames are the names in the headers,
    empty where they are; `notes` say by which clock the messages go and what was left out.
    """

    path: Path
    start: int
    duration: float
    samples: tuple[ContactSample, ...]
    poses: tuple[tuple[int, Pose], ...]
    scans: tuple[RecordedScan, ...]
    contact_frame: str = ''
    scan_frame: str = ''
    notes: tuple[str, ...] = ()
    cells: tuple[TouchCells, ...] = ()

    @property
    def frames_differ(self) -> bool:
        """Are scans and contacts in two frames? A frame without a name is taken for the other."""
        return bool(
            self.scan_frame and self.contact_frame and self.scan_frame != self.contact_frame
        )

    def pose_at(self, stamp: int) -> Pose | None:
        """The last pose at or before `stamp`, else the first; None without poses."""
        if not self.poses:
            return None
        place = bisect_right(self.poses, stamp, key=lambda item: item[0])
        return self.poses[max(0, place - 1)][1]


def read_recording(path: Path) -> Recording:
    """Read the contacts, object poses and scans of a bag, by the ends of their topic names.

    Messages go by their header stamps; where those are zero or cannot tell messages apart, by the
    times of recording, which is noted. Raises BagError when the bag has no contacts or no scans, a
    message is damaged, or neither clock tells what belongs together.
    """
    with open_bag(path) as bag:
        found = _messages(bag)
        start, duration = bag.start, bag.duration
    try:
        notes = _settle_times(found)
        contact_frame, scan_frame = (frame_of(kind, found[kind]) for kind in ('contacts', 'scans'))
        pose_frame = frame_of('object poses', found['poses'])
        if pose_frame and contact_frame and pose_frame != contact_frame:
            raise BagError(
                f'object_pose is in the frame {pose_frame}, hand/contacts in {contact_frame}; '
                'record the pose in the frame of the contacts, or give --object-pose'
            )
    except BagError as error:
        raise BagError(f'{path}: {error}') from error
    samples = [replace(item.value, stamp=item.stamp) for item in found['contacts']]
    scans = [RecordedScan(item.stamp, item.value, item.header) for item in found['scans']]
    poses = [(item.stamp, item.value) for item in found['poses']]
    cells = [replace(item.value, stamp=item.stamp) for item in found['cells']]
    return Recording(
        path,
        start,
        duration,
        tuple(sorted(samples, key=lambda sample: sample.stamp)),
        tuple(sorted(poses, key=lambda item: item[0])),
        tuple(sorted(scans, key=lambda scan: scan.stamp)),
        contact_frame,
        scan_frame,
        notes,
        tuple(sorted(cells, key=lambda one: one.stamp)),
    )


def _messages(bag: Bag) -> dict[str, list[Recorded[Any]]]:
    """The decoded messages of a bag by kind; raises BagError."""
    topics = {
        kind: _topic(bag, name, type_name)
        for kind, name, type_name in (
            ('contacts', CONTACTS, CLOUD),
            ('scans', SCANS, CLOUD),
            ('poses', POSES, POSE),
            ('cells', CELLS, CLOUD),
        )
    }
    for kind, name in (('contacts', CONTACTS), ('scans', SCANS)):
        if topics[kind] is None:
            raise BagError(f'{bag.path} has no topic {name}; it has {listed(bag.topics)}')
    kinds = {name: kind for kind, name in topics.items() if name is not None}
    found: dict[str, list[Recorded[Any]]] = {kind: [] for kind in topics}
    contacts, cells, cloud = ContactReader(), CellReader(), CloudReader('scan/points')
    for message in bag.messages(list(kinds)):
        stamp, kind = header_stamp(message.data), kinds[message.topic]
        decoded = bag.decode(message)
        value: Any
        stale = False
        try:
            if kind == 'contacts':
                value = contacts.read(decoded, stamp)
                stale = bool(np.all(value.flags & FLAG_STALE))
            elif kind == 'cells':
                value = cells.read(decoded, stamp)
            elif kind == 'scans':
                value = cloud.read_columns(decoded, ('x', 'y', 'z'))
            else:
                value = _pose(decoded)
        except (MessageError, PoseError) as error:
            raise BagError(f'{bag.path}: {message.topic} at {stamp} ns: {error}') from error
        frame = str(decoded.header.frame_id).strip('/')
        digest = hashlib.sha256(message.data).digest()
        found[kind].append(Recorded(stamp, message.log_time, frame, digest, value, stale, stamp))
    return found


def _settle_times(found: dict[str, list[Recorded[Any]]]) -> tuple[str, ...]:
    """Leave out copies and choose the clock, in place; what the user should know of it."""
    notes = []
    faults = []
    words = {
        'contacts': 'contact samples',
        'scans': 'scans',
        'poses': 'object poses',
        'cells': 'samples of touch cells',
    }
    for kind, messages in found.items():
        kept = without_copies(messages)
        if len(kept) < len(messages):
            notes.append(f'{len(messages) - len(kept)} {words[kind]} recorded twice, taken once')
        found[kind] = kept
        # one pose alone holds throughout, whatever its stamp
        if kind in ('contacts', 'scans') or len(kept) > 1:
            faults.append(fault_of_stamps(words[kind], kept))
    fault = next(filter(None, faults), '')
    if fault:
        for kind, messages in found.items():
            found[kind] = by_log_time(words[kind], messages, fault)
        notes.append(f'{fault}: all messages go by the times at which they were recorded')
    return tuple(notes)


def _topic(bag: Bag, name: str, type_name: str) -> str | None:
    """The topic of a type whose name ends so; the shortest when several do."""
    found = [
        topic.name
        for topic in bag.topics.values()
        if topic.type_name == type_name and f'/{topic.name}'.endswith(f'/{name}')
    ]
    return min(found, key=len) if found else None


def _pose(message: Any) -> Pose:
    place, turn = message.pose.position, message.pose.orientation
    return pose_of([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])


def in_object_frame(sample: ContactSample, pose: Pose = IDENTITY) -> ContactSample:
    """The sample with points, normals and forces turned into the object's frame."""
    return replace(
        sample,
        point=pose.to_object(sample.point),
        normal=sample.normal @ pose.rotation,
        force=sample.force @ pose.rotation,
        along=sample.along @ pose.rotation,
    )


def bag_sha256(path: Path) -> str:
    """SHA-256 over the bytes of the bag's files (storage and metadata.yaml) in name order."""
    metadata, _ = read_metadata(path)
    files = list(bag_files(path, metadata))
    if path.is_dir() and (path / 'metadata.yaml').is_file():
        files.append(path / 'metadata.yaml')
    digest = hashlib.sha256()
    for file in sorted(files, key=lambda file: file.name):
        with file.open('rb') as stream:
            while block := stream.read(2**20):
                digest.update(block)
    return digest.hexdigest()
