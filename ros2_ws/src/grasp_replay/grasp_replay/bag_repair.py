# SPDX-License-Identifier: Apache-2.0
"""Examines the MCAP files of a bag byte by byte and saves what is sound into a new bag."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from grasp_common import bounded_yaml
from grasp_replay.bag_writer import BagWriter
from grasp_replay.errors import BagError
from grasp_replay.mcap_blocks import Channel, Damage, Definitions, block_messages, load_block
from grasp_replay.mcap_scan import Scan, scan_file
from grasp_replay.packed import is_packed, unpacked

LARGEST_ATTACHMENT = 2**28
"""An attachment of more bytes is not copied: the library that writes it needs it in memory."""

PROGRESS_STEP = 1000
OWN_RECORD = 'rosbag2'
"""The metadata record that a recorder writes about its own file; a new bag gets one of its own."""


OWN_REMARKS = ('offered_qos_profiles', 'topic_type_hash')
"""What the channels of every recorder say; a new bag writes it itself."""


@dataclass(frozen=True)
class LostSpan:
    """Bytes [start, end) of `file` that cannot be used.

    `after` and `before` are the log times (ns) of the nearest sound messages around them, None
    where there is none: what was lost lies between.
    """

    file: str
    start: int
    end: int
    reason: str
    after: int | None
    before: int | None

    def sentence(self, origin: int) -> str:
        """What was lost, with times in seconds after `origin` (ns)."""
        left = 'the beginning' if self.after is None else f'{(self.after - origin) * 1e-9:.3f} s'
        right = 'the end' if self.before is None else f'{(self.before - origin) * 1e-9:.3f} s'
        where = f'bytes {self.start} to {self.end}'
        if self.start == self.end:
            where = f'byte {self.start}'
        return f'{self.file}, {where}, between {left} and {right}: {self.reason}'


@dataclass(frozen=True)
class Examination:
    """What the files of a bag hold; `declared` is the sum of what sound summaries declare."""

    files: tuple[Path, ...]
    scans: tuple[Scan, ...]
    lost: tuple[LostSpan, ...]
    nameless: int
    declared: int | None

    @property
    def sound(self) -> bool:
        """True when every file is whole and every message has a topic."""
        return all(scan.sound for scan in self.scans) and not self.nameless

    @property
    def message_count(self) -> int:
        """Messages that can be used."""
        return sum(scan.message_count for scan in self.scans) - self.nameless

    @property
    def start(self) -> int:
        """Log time (ns) of the first sound message, 0 when there is none."""
        return min((block.start for scan in self.scans for block in scan.blocks), default=0)

    @property
    def end(self) -> int:
        """Log time (ns) of the last sound message, 0 when there is none."""
        return max((block.end for scan in self.scans for block in scan.blocks), default=0)


def examine(
    files: Sequence[Path], progress: Callable[[float, str], None] | None = None
) -> Examination:
    """Read every byte of MCAP `files`, verify it, and find what is lost; raises BagError."""
    scans: list[Scan] = []
    lost: list[LostSpan] = []
    nameless = 0
    done = 0
    for file in files:

        def show(position: int, file: Path = file, done: int = done) -> None:
            if progress is not None:
                progress(done + position, file.name)

        try:
            with file.open('rb') as stream:
                scan = scan_file(stream, show)
        except OSError as error:
            raise BagError(f'{file} cannot be read: {error.strerror}') from error
        except Damage as damage:
            raise BagError(f'{file} changed while it was read: {damage}') from damage
        scans.append(scan)
        done += scan.size
        lost += _lost_spans(file, scan)
        nameless += sum(
            count
            for block in scan.blocks
            for channel_id, count in block.counts.items()
            if channel_id not in scan.definitions.channels
        )
    counts = [scan.declared_count for scan in scans]
    declared = None if None in counts else sum(count or 0 for count in counts)
    return Examination(tuple(files), tuple(scans), tuple(lost), nameless, declared)


def _lost_spans(file: Path, scan: Scan) -> list[LostSpan]:
    spans = []
    for lost in scan.lost:
        earlier = [block.end for block in scan.blocks if block.block.offset < lost.start]
        later = [block.start for block in scan.blocks if block.block.offset >= lost.end]
        spans.append(
            LostSpan(
                file.name,
                lost.start,
                lost.end,
                lost.reason,
                max(earlier, default=None),
                min(later, default=None),
            )
        )
    return spans


@dataclass(frozen=True)
class Recovered:
    """How much was written into a new bag; `left` says what was not, and why."""

    messages: int
    attachments: int
    metadata: int
    left: tuple[str, ...]


def recover(
    examination: Examination,
    directory: Path,
    progress: Callable[[float, str], None] | None = None,
    custom_data: Mapping[str, str] | None = None,
) -> Recovered:
    """Write every message of a sound block into the new bag `directory`, and what stands beside.

    Topics, QoS, times and sequence numbers stay as they were; messages that were compressed one
    by one are unpacked; `custom_data` is what metadata.yaml says under that name. Messages whose
    topic is not defined anywhere are left out (`Examination.nameless`). The new bag is read back
    and held against what was found; raises BagError.
    """
    written = attachments = records = 0
    left: list[str] = []
    custom = {**_own_custom_data(examination), **(custom_data or {})}
    custom['recovered_from'] = _origin(examination)
    with BagWriter(directory, custom_data=custom) as writer:
        topics: dict[Hashable, int] = {}
        for file, scan in zip(examination.files, examination.scans, strict=True):
            for message in _sound_messages(file, scan, writer, topics):
                writer.write(*message)
                written += 1
                if progress is not None and written % PROGRESS_STEP == 0:
                    progress(written, directory.name)
            attachments += _copy_attachments(file, scan, writer, left)
            for name, table in scan.metadata:
                if name == OWN_RECORD:
                    continue
                writer.add_record(name, table)
                records += 1
    check = examine([writer.file])
    if not check.sound or check.message_count != written:
        raise BagError(f'{directory} does not read back as it was written; the disk is at fault')
    return Recovered(written, attachments, records, tuple(left))


def _sound_messages(
    file: Path, scan: Scan, writer: BagWriter, topics: dict[Hashable, int]
) -> Iterator[tuple[int, bytes, int, int, int]]:
    """The messages of the sound blocks of one file, as `BagWriter.write` takes them."""
    channels = scan.definitions.channels
    numbers = {
        channel.id: _topic_number(writer, topics, channel, scan.definitions)
        for channel in channels.values()
    }
    with file.open('rb') as stream:
        for checked in scan.blocks:
            try:
                stored = block_messages(load_block(stream, checked.block), None)
            except Damage as damage:
                raise BagError(f'{file} changed while it was read: {damage}') from damage
            for channel_id, sequence, log_time, publish_time, data in stored:
                if channel_id in numbers:
                    content = bytes(data)
                    if channels[channel_id].encoding == 'cdr' and is_packed(content):
                        content = _content(content)
                    yield numbers[channel_id], content, log_time, publish_time, sequence


def _content(packed: bytes) -> bytes:
    """A compressed message unpacked, or as it is when that fails: nothing is lost here."""
    try:
        return unpacked(packed)
    except Damage:
        return packed


def _copy_attachments(file: Path, scan: Scan, writer: BagWriter, left: list[str]) -> int:
    copied = 0
    with file.open('rb') as stream:
        for item in scan.attachments:
            if item.size > LARGEST_ATTACHMENT:
                left.append(f'attachment {item.name!r} of {item.size} bytes is too large to copy')
                continue
            stream.seek(item.offset)
            data = stream.read(item.size)
            writer.attach(item.name, item.media_type, data, item.log_time, item.create_time)
            copied += 1
    return copied


def strings_of(table: object) -> dict[str, str]:
    """The entries of a table from a file that are strings; none of what is no table."""
    items = table.items() if isinstance(table, dict) else ()
    return {k: v for k, v in items if isinstance(k, str) and isinstance(v, str)}


def _own_custom_data(examination: Examination) -> dict[str, str]:
    """What the recorder's own record in the files says of custom data."""
    found: dict[str, str] = {}
    for scan in examination.scans:
        for name, table in scan.metadata:
            if name != OWN_RECORD:
                continue
            try:
                document = bounded_yaml.load(table.get('serialized_metadata', ''))
            except yaml.YAMLError:
                continue
            if isinstance(document, dict):
                found |= strings_of(document.get('custom_data'))
    return found


def _origin(examination: Examination) -> str:
    return ', '.join(file.name for file in examination.files)


def _topic_number(
    writer: BagWriter,
    topics: dict[Hashable, int],
    channel: Channel,
    definitions: Definitions,
) -> int:
    schema = definitions.schemas.get(channel.schema_id)
    name, text, kind = (schema.name, schema.text, schema.encoding) if schema else ('', b'', '')
    remarks = {key: said for key, said in channel.metadata.items() if key not in OWN_REMARKS}
    key = (channel.topic, name, text, channel.encoding, tuple(sorted(remarks.items())))
    if key not in topics:
        topics[key] = writer.add_topic(
            channel.topic,
            name,
            channel.metadata.get('offered_qos_profiles', ''),
            definition=text,
            definition_encoding=kind,
            type_hash=channel.metadata.get('topic_type_hash', ''),
            encoding=channel.encoding,
            remarks=remarks,
        )
    return topics[key]
