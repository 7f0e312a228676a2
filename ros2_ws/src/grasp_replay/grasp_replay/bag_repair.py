"""Examines the MCAP files of a bag byte by byte and saves what is sound into a new bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from grasp_replay.bag_writer import BagWriter
from grasp_replay.errors import BagError
from grasp_replay.mcap_blocks import Channel, Damage, Definitions, block_messages, load_block
from grasp_replay.mcap_scan import Scan, scan_file


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
        return (
            f'{self.file}, bytes {self.start} to {self.end}, between {left} and {right}: '
            f'{self.reason}'
        )


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


def recover(
    examination: Examination,
    directory: Path,
    progress: Callable[[float, str], None] | None = None,
) -> int:
    """Write every message of a sound block into the new bag `directory`; returns how many.

    Topics, QoS, times and sequence numbers stay as they were. Messages whose topic is not
    defined anywhere are left out (`Examination.nameless`). The new bag is read back and held
    against what was found; raises BagError.
    """
    written = 0
    with BagWriter(directory, custom_data={'recovered_from': _origin(examination)}) as writer:
        topics: dict[tuple[str, str, bytes, str], int] = {}
        for file, scan in zip(examination.files, examination.scans, strict=True):
            numbers = {
                channel.id: _topic_number(writer, topics, channel, scan.definitions)
                for channel in scan.definitions.channels.values()
            }
            with file.open('rb') as stream:
                for checked in scan.blocks:
                    try:
                        messages = block_messages(load_block(stream, checked.block), None)
                    except Damage as damage:
                        raise BagError(f'{file} changed while it was read: {damage}') from damage
                    for channel_id, sequence, log_time, publish_time, data in messages:
                        if channel_id in numbers:
                            writer.write(
                                numbers[channel_id], bytes(data), log_time, publish_time, sequence
                            )
                            written += 1
                    if progress is not None:
                        progress(written, directory.name)
    check = examine([writer.file])
    if not check.sound or check.message_count != written:
        raise BagError(f'{directory} does not read back as it was written; the disk is at fault')
    return written


def _origin(examination: Examination) -> str:
    return ', '.join(file.name for file in examination.files)


def _topic_number(
    writer: BagWriter,
    topics: dict[tuple[str, str, bytes, str], int],
    channel: Channel,
    definitions: Definitions,
) -> int:
    schema = definitions.schemas.get(channel.schema_id)
    name, text, kind = (schema.name, schema.text, schema.encoding) if schema else ('', b'', '')
    key = (channel.topic, name, text, channel.encoding)
    if key not in topics:
        topics[key] = writer.add_topic(
            channel.topic,
            name,
            channel.metadata.get('offered_qos_profiles', ''),
            definition=text.decode('utf-8', 'replace'),
            definition_encoding=kind,
            type_hash=channel.metadata.get('topic_type_hash', ''),
            encoding=channel.encoding,
        )
    return topics[key]
