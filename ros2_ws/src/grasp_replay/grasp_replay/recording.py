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
from grasp_replay.topic_selection import listed
from shell_deform.live.pose import IDENTITY, Pose, PoseError, pose_of
from shell_deform.live.tick.contact_cloud import ContactReader
from shell_deform.live.tick.sample import ContactSample

Array = NDArray[np.float64]

CONTACTS, SCANS, POSES = 'hand/contacts', 'scan/points', 'object_pose'
CLOUD, POSE = 'sensor_msgs/msg/PointCloud2', 'geometry_msgs/msg/PoseStamped'


@dataclass(frozen=True)
class RecordedScan:
    """A scan in the frame of the contacts: stamp in ns, points (n, 3) in m."""

    stamp: int
    points: Array


@dataclass(frozen=True)
class Recording:
    """Everything the offline pipeline takes from a bag, in the order of the stamps.

    `poses` are (stamp in ns, pose of the object in the frame of the contacts).
    """

    path: Path
    start: int
    duration: float
    samples: tuple[ContactSample, ...]
    poses: tuple[tuple[int, Pose], ...]
    scans: tuple[RecordedScan, ...]

    def pose_at(self, stamp: int) -> Pose | None:
        """The last pose at or before `stamp`, else the first; None without poses."""
        if not self.poses:
            return None
        place = bisect_right(self.poses, stamp, key=lambda item: item[0])
        return self.poses[max(0, place - 1)][1]


def read_recording(path: Path) -> Recording:
    """Read the contacts, object poses and scans of a bag, by the ends of their topic names.

    Raises BagError when the bag has no contacts or no scans, or a message is damaged.
    """
    with open_bag(path) as bag:
        topics = {
            kind: _topic(bag, name, type_name)
            for kind, name, type_name in (
                ('contacts', CONTACTS, CLOUD),
                ('scans', SCANS, CLOUD),
                ('poses', POSES, POSE),
            )
        }
        for kind, name in (('contacts', CONTACTS), ('scans', SCANS)):
            if topics[kind] is None:
                raise BagError(f'{path} has no topic {name}; it has {listed(bag.topics)}')
        samples: list[ContactSample] = []
        scans: list[RecordedScan] = []
        poses: list[tuple[int, Pose]] = []
        contacts, cloud = ContactReader(), CloudReader('scan/points')
        for message in bag.messages([name for name in topics.values() if name is not None]):
            stamp = header_stamp(message.data)
            decoded = bag.decode(message)
            try:
                if message.topic == topics['contacts']:
                    samples.append(contacts.read(decoded, stamp))
                elif message.topic == topics['scans']:
                    points = cloud.read_columns(decoded, ('x', 'y', 'z'))
                    scans.append(RecordedScan(stamp, points))
                else:
                    poses.append((stamp, _pose(decoded)))
            except (MessageError, PoseError) as error:
                raise BagError(f'{path}: {message.topic} at {stamp} ns: {error}') from error
        samples.sort(key=lambda sample: sample.stamp)
        return Recording(
            path,
            bag.start,
            bag.duration,
            tuple(samples),
            tuple(sorted(poses, key=lambda item: item[0])),
            tuple(sorted(scans, key=lambda scan: scan.stamp)),
        )


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
