# SPDX-License-Identifier: Apache-2.0
"""Writes a bag in rosbag2's layout: one MCAP file and `metadata.yaml` version 9.

Crash safety: a chunk is written out whenever the messages in it span more than a second or more
than `CHUNK_BYTES`, and `flush` writes the one in progress. What was flushed survives a kill -9 of
this process and is recovered by `bag_check`. A full disk ends the recording with a valid bag:
space for the last chunk and the index is set aside at the start.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from grasp_common import bounded_yaml
from grasp_replay.errors import BagError
from grasp_replay.qos import plain_yaml
from grasp_replay.ros_types import definition_of

CHUNK_BYTES = 2**20
CHUNK_NANOSECONDS = 1_000_000_000
RESERVE_BYTES = 8 * 2**20
NO_SCHEMA = 0
BAG_VERSION = 9
ROS_DISTRO = 'jazzy'
COMPRESSIONS = {
    'none': CompressionType.NONE,
    'lz4': CompressionType.LZ4,
    'zstd': CompressionType.ZSTD,
}
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class DiskFull(BagError):
    """The disk is full; the bag was closed and is valid up to its last message."""


class BagWriter:
    """A bag being written; use as a context manager. Leaving it by an exception closes it too.

    `directory` must not exist. Raises BagError when it does or cannot be made. The bytes written
    depend only on the calls made: no clock is read.
    """

    def __init__(
        self,
        directory: str | Path,
        *,
        compression: str = 'zstd',
        custom_data: dict[str, str] | None = None,
        reserve_bytes: int = RESERVE_BYTES,
        open_file: Callable[[Path], Any] = lambda path: path.open('xb', buffering=0),
    ) -> None:
        self.directory = Path(directory)
        if compression not in COMPRESSIONS:
            raise BagError(f'unknown compression {compression!r}: one of {sorted(COMPRESSIONS)}')
        self.file = self.directory / f'{self.directory.name}_0.mcap'
        self._custom_data = custom_data or {}
        self._channels: dict[int, dict[str, Any]] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._sequence: dict[int, int] = {}
        self._chunk_start: int | None = None
        self._span: tuple[int, int] | None = None
        self._closed = False
        try:
            self.directory.mkdir(parents=True)
            self._output = _Output(open_file(self.file), self.directory, reserve_bytes)
        except FileExistsError as error:
            raise BagError(
                f'{self.directory} exists already; a bag is never overwritten'
            ) from error
        except OSError as error:
            raise BagError(f'{self.directory} cannot be written: {error.strerror}') from error
        self._writer = Writer(
            self._output,  # type: ignore[arg-type]
            chunk_size=CHUNK_BYTES,
            compression=COMPRESSIONS[compression],
        )
        self._writer.start(profile='ros2', library='grasp_replay')

    @property
    def message_count(self) -> int:
        """Messages taken so far."""
        return sum(channel['message_count'] for channel in self._channels.values())

    @property
    def size(self) -> int:
        """Bytes in the file so far, the chunk in progress left out."""
        return self._output.position

    def add_topic(
        self,
        name: str,
        type_name: str,
        qos: str = '',
        *,
        definition: str | bytes | None = None,
        definition_encoding: str = 'ros2msg',
        type_hash: str = '',
        encoding: str = 'cdr',
        remarks: Mapping[str, str] | None = None,
    ) -> int:
        """Declare a topic and get the number to write its messages with.

        `qos` is rosbag2's YAML list of offered profiles (`qos.qos_text` makes one). The definition
        and the type hash are looked up when no definition is given. `remarks` are what else its
        channel says.
        """
        if definition is None:
            definition, known_hash = definition_of(type_name)
            type_hash = type_hash or known_hash
        text = definition.encode() if isinstance(definition, str) else definition
        key = (type_name, text)
        if not type_name:
            self._schemas[key] = NO_SCHEMA
        elif key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                type_name, definition_encoding if text else '', text
            )
        metadata = {**(remarks or {}), 'offered_qos_profiles': qos}
        if type_hash:
            metadata['topic_type_hash'] = type_hash
        number = self._writer.register_channel(name, encoding, self._schemas[key], metadata)
        self._channels[number] = {
            'topic_metadata': {
                'name': name,
                'type': type_name,
                'serialization_format': encoding,
                'offered_qos_profiles': _profiles(qos),
                'type_description_hash': type_hash,
            },
            'message_count': 0,
        }
        self._sequence[number] = 0
        return number

    def write(
        self,
        topic: int,
        data: bytes,
        log_time: int,
        publish_time: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Append a message: `topic` from `add_topic`, its CDR bytes, times in ns.

        Raises DiskFull (the bag is closed and valid then) or BagError.
        """
        if self._closed:
            raise BagError(f'{self.directory} is closed; nothing more can be written')
        if self._chunk_start is not None and log_time - self._chunk_start >= CHUNK_NANOSECONDS:
            self.flush()
        if self._chunk_start is None:
            self._chunk_start = log_time
        self._sequence[topic] += 1
        self._call(
            lambda: self._writer.add_message(
                topic,
                log_time=log_time,
                data=data,
                publish_time=log_time if publish_time is None else publish_time,
                sequence=self._sequence[topic] if sequence is None else sequence,
            )
        )
        self._channels[topic]['message_count'] += 1
        first, last = self._span or (log_time, log_time)
        self._span = (min(first, log_time), max(last, log_time))
        self._stop_if_full()

    def attach(
        self, name: str, media_type: str, data: bytes, log_time: int, create_time: int
    ) -> None:
        """Add an attachment, which stands beside the messages; times in ns."""
        self._call(
            lambda: self._writer.add_attachment(create_time, log_time, name, media_type, data)
        )
        self._stop_if_full()

    def add_record(self, name: str, table: dict[str, str]) -> None:
        """Add a metadata record: named strings that stand beside the messages."""
        self._call(lambda: self._writer.add_metadata(name, table))

    def flush(self) -> None:
        """Write out the chunk in progress: what came before survives the end of this process."""
        self._chunk_start = None
        self._call(self._writer.flush)
        self._stop_if_full()

    def close(self) -> None:
        """Write the index and metadata.yaml. Closing twice is harmless."""
        if self._closed:
            return
        self._closed = True
        try:
            self._call(self._finish)
            text = plain_yaml({'rosbag2_bagfile_information': self._metadata()})
            temporary = self.directory / 'metadata.yaml.part'
            temporary.write_text(text)
            temporary.replace(self.directory / 'metadata.yaml')
        except OSError as error:
            raise self._failure(error) from error
        finally:
            self._output.close()

    def _finish(self) -> None:
        information = plain_yaml(self._metadata())
        self._writer.add_metadata('rosbag2', {'serialized_metadata': information})
        self._writer.finish()
        self._output.release_reserve()

    def _call(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError as error:
            self._closed = True
            self._output.close()
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> BagError:
        return BagError(
            f'{self.file} cannot be written further: {error.strerror}; what was flushed before is '
            f'in the file, save it with `bag_check {self.file.name} --recover NEW_DIRECTORY`'
        )

    def _stop_if_full(self) -> None:
        if self._output.full and not self._closed:
            self.close()
            raise DiskFull(
                f'the disk is full: {self.directory} was closed with {self.message_count} '
                'messages and is valid; free some space and record into a new directory'
            )

    def _metadata(self) -> dict[str, Any]:
        first, last = self._span or (0, 0)
        times = {
            'starting_time': {'nanoseconds_since_epoch': first},
            'duration': {'nanoseconds': last - first},
            'message_count': self.message_count,
        }
        return {
            'version': BAG_VERSION,
            'storage_identifier': 'mcap',
            **times,
            'topics_with_message_count': list(self._channels.values()),
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file.name],
            'files': [{'path': self.file.name, **times}],
            'custom_data': dict(self._custom_data) or None,
            'ros_distro': ROS_DISTRO,
        }

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()


def _profiles(qos: str) -> list[Any]:
    """Offered profiles as metadata.yaml has them; none of a text that is no list in YAML."""
    try:
        found = bounded_yaml.load(qos) if qos else []
    except yaml.YAMLError:
        return []
    return found if isinstance(found, list) else []


class _Output:
    """The file under the writer: every write is complete, or the file ends where it ended before.

    `full` turns True when the disk refused a write that then fitted into the reserve.
    """

    def __init__(self, stream: Any, directory: Path, reserve_bytes: int) -> None:
        self._stream = stream
        self.position = 0
        self.full = False
        self._reserve = directory / '.reserve'
        if reserve_bytes:
            with self._reserve.open('xb') as reserve:
                os.posix_fallocate(reserve.fileno(), 0, reserve_bytes)

    def tell(self) -> int:
        return self.position

    def flush(self) -> None:
        """Nothing waits here: each write goes to the operating system at once."""

    def write(self, data: bytes) -> int:
        try:
            self._write_all(data)
        except OSError as error:
            self._stream.truncate(self.position)
            if error.errno not in FULL or not self._reserve.exists():
                raise
            self.full = True
            self.release_reserve()
            self._stream.seek(self.position)
            self._write_all(data)
        self.position += len(data)
        return len(data)

    def _write_all(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._stream.write(rest) :]

    def release_reserve(self) -> None:
        self._reserve.unlink(missing_ok=True)

    def close(self) -> None:
        self.release_reserve()
        self._stream.close()
