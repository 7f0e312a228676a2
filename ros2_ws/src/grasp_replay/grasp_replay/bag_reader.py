"""Opens any recorded bag: finds its files, says what kind they are, and refuses what is no bag.

MCAP is read by our own blocks (`mcap_blocks` says why), SQLite through the rosbags library.
ROS 1 bags are named and refused.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import yaml

from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.errors import BagError
from grasp_replay.mcap_bag import McapBag
from grasp_replay.mcap_blocks import zstd
from grasp_replay.sqlite_bag import SqliteBag

__all__ = ['Bag', 'BagError', 'Message', 'Topic', 'bag_files', 'open_bag', 'read_metadata']

ROS1_MAGIC = b'#ROSBAG V2.0'
SQLITE_MAGIC = b'SQLite format 3\x00'
MCAP_MAGIC = b'\x89MCAP'


def open_bag(path: str | Path) -> Bag:
    """Open a bag directory, an `.mcap` file or a `.db3` file; raises BagError."""
    path = Path(path)
    metadata, notes = read_metadata(path)
    files = bag_files(path, metadata)
    kinds = {file: _kind(file) for file in files}
    for file, kind in kinds.items():
        if kind == 'ros1':
            raise BagError(
                f'{file} is a ROS 1 bag; convert it first: '
                f'rosbags-convert --src {file.name} --dst {file.stem}'
            )
    mode = str(metadata.get('compression_mode') or 'none').lower()
    if mode == 'file':
        raise BagError(
            f'{path} was compressed file by file; unpack its files first (`zstd -d`) and correct '
            'relative_file_paths and compression_mode in metadata.yaml'
        )
    if set(kinds.values()) == {'sqlite3'}:
        bag: Bag = SqliteBag(path, files)
    else:
        for file, kind in kinds.items():
            if kind != 'mcap':
                raise BagError(f'{file} is no bag that can be read: it is not MCAP')
        bag = McapBag(path, files)
    if mode == 'message':
        bag = _MessageCompressedBag(bag)
    bag.notes = notes + bag.notes
    declared = metadata.get('message_count')
    if isinstance(declared, int) and declared != bag.message_count:
        bag.notes.append(
            f'metadata.yaml declares {declared} messages, the files hold {bag.message_count}'
        )
    return bag


def read_metadata(path: Path) -> tuple[dict[str, Any], list[str]]:
    """What metadata.yaml says (empty if unusable) and notes on what is wrong with it."""
    if not path.is_dir():
        return {}, []
    file = path / 'metadata.yaml'
    if not file.exists():
        return {}, ['metadata.yaml is missing; files are read in the order of their names']
    try:
        document = yaml.safe_load(file.read_text())
        information = document['rosbag2_bagfile_information']
        if isinstance(information, dict):
            return information, []
        reason = 'it holds no table'
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return {}, [f'metadata.yaml cannot be used ({reason}); files are read by name']


def bag_files(path: Path, metadata: dict[str, Any]) -> list[Path]:
    """The storage files of a bag in their order; raises BagError when there is none."""
    if not path.exists():
        raise BagError(f'{path} does not exist; give a bag directory or an .mcap file')
    if not path.is_dir():
        return [path]
    names = metadata.get('relative_file_paths')
    if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
        # Old versions of rosbag2 wrote the directory in front of the name.
        files = [path / Path(name).name for name in names]
        missing = [file.name for file in files if not file.is_file()]
        if missing:
            raise BagError(
                f'{path} lacks {", ".join(missing)}, which its metadata.yaml names; copy it back, '
                'or delete metadata.yaml to read the files that are there'
            )
        return files
    files = sorted(
        file for file in path.iterdir() if file.suffix in ('.mcap', '.db3') and file.is_file()
    )
    if not files:
        raise BagError(f'{path} holds no .mcap and no .db3 file: it is no bag')
    return files


def _kind(file: Path) -> str:
    try:
        with file.open('rb') as stream:
            head = stream.read(16)
    except OSError as error:
        raise BagError(f'{file} cannot be read: {error.strerror}') from error
    if head.startswith(ROS1_MAGIC):
        return 'ros1'
    if head.startswith(SQLITE_MAGIC):
        return 'sqlite3'
    if head.startswith(MCAP_MAGIC):
        return 'mcap'
    return 'mcap' if file.suffix == '.mcap' else 'unknown'


class _MessageCompressedBag(Bag):
    """A bag whose every message rosbag2 compressed with zstd, around the bag that stores them."""

    def __init__(self, stored: Bag) -> None:
        super().__init__(stored.path)
        self._stored = stored
        self.topics, self.start, self.end = stored.topics, stored.start, stored.end
        self.storage, self.files = stored.storage, stored.files

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[Message]:
        """As `Bag.messages`."""
        for message in self._stored.messages(topics, start, stop):
            try:
                data = zstd.decompress(message.data)
            except zstd.ZstdError as error:
                raise BagError(
                    f'{self.path}: a message on {message.topic} does not decompress ({error})'
                ) from error
            yield message._replace(data=data)

    def close(self) -> None:
        """Close the files."""
        self._stored.close()
