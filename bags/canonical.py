# SPDX-License-Identifier: Apache-2.0
"""A raw recording put in canonical order, so that equal experiments give equal messages.

The recorder writes messages as they arrive from several processes; here they are checked for
completeness, given their own stamps as log and publish times, and sorted by time and topic.
Bytes are taken as they are. One kind is left out: the bridge waits for its hand in wall time, so
on a busy machine it declares samples stale that on simulated time are not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_writer import BagWriter
from grasp_replay.cdr import header_stamp

UNSTAMPED = 'std_msgs/msg/Float64'
ORDER = ('/object_pose', '/hand/joint_states', '/hand/finger', '/hand/contacts', '/scan/points')
CONTACTS = '/hand/contacts'
FLAG_STALE = 4
PER_SAMPLE = ('/hand/', '/object_pose')


class IncompleteRecordingError(RuntimeError):
    """A topic lacks messages or has some too many; the recording must be made again."""


def _rank(topic: str) -> int:
    return next((i for i, start in enumerate(ORDER) if topic.startswith(start)), len(ORDER))


def _is_stale(contacts: Any) -> bool:
    flags = next(field.offset for field in contacts.fields if field.name == 'flags')
    return bool(contacts.data[flags] & FLAG_STALE)


def _difference(name: str, stamps: list[int], expected: list[int]) -> str:
    lost = sorted(set(expected) - set(stamps))
    extra = len(stamps) - len(set(stamps))
    strange = sorted(set(stamps) - set(expected))
    return (
        f'{name}: of {len(expected)} samples {len(lost)} lack their message (first at '
        f'{lost[0] if lost else None}), {extra} have it twice, {len(strange)} messages belong to '
        f'none (first at {strange[0] if strange else None})'
    )


def write_canonical(
    raw: Path, out: Path, sample_stamps: list[int], scans: int, custom_data: dict[str, str]
) -> int:
    """Write the bag `out` from the bag `raw`; returns the number of messages.

    Every hand topic must hold one message per sample, the n-th with the n-th stamp; messages
    without a header get that stamp. Diagnostics from before the first sample are left out.
    Raises IncompleteRecordingError.
    """
    with open_bag(raw) as bag:
        found: dict[str, list[tuple[int, bytes]]] = {name: [] for name in bag.topics}
        for message in bag.messages():
            if message.topic != CONTACTS or not _is_stale(bag.decode(message)):
                found[message.topic].append((message.log_time, message.data))
        rows = []
        for name in sorted(found, key=lambda name: (_rank(name), name)):
            stamped = bag.topics[name].type_name != UNSTAMPED
            messages = [(header_stamp(data) if stamped else 0, data) for _, data in found[name]]
            if name.startswith(PER_SAMPLE):
                # The cycle in which the bridge was asked to tare came before the clock ran.
                messages = messages[-len(sample_stamps) :]
                stamps = [time for time, _ in messages] if stamped else sample_stamps
                if len(messages) != len(sample_stamps):
                    raise IncompleteRecordingError(
                        f'{name}: {len(messages)} messages for {len(sample_stamps)} samples'
                    )
                if stamps != sample_stamps:
                    raise IncompleteRecordingError(_difference(name, stamps, sample_stamps))
                messages = [
                    (time, data) for time, (_, data) in zip(sample_stamps, messages, strict=True)
                ]
            elif name == '/scan/points' and len(messages) != scans:
                raise IncompleteRecordingError(f'{len(messages)} of {scans} scans were recorded')
            kept = [row for row in messages if row[0] >= sample_stamps[0]]
            rows += [(time, _rank(name), name, data) for time, data in kept]
        rows.sort(key=lambda row: row[:3])
        with BagWriter(out, custom_data=custom_data, reserve_bytes=0) as writer:
            numbers = {}
            for name in dict.fromkeys(row[2] for row in rows):
                topic = bag.topics[name]
                numbers[name] = writer.add_topic(
                    name,
                    topic.type_name,
                    topic.qos,
                    definition=topic.definition,
                    definition_encoding=topic.definition_encoding,
                    type_hash=topic.type_hash,
                )
            for time, _, name, data in rows:
                writer.write(numbers[name], data, time)
    return len(rows)
