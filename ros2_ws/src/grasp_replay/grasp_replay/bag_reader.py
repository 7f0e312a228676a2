# SPDX-License-Identifier: Apache-2.0
"""Opens any recorded bag: finds its files, says what kind they are, and refuses what is no bag.

MCAP is read by our own blocks (`mcap_blocks` says why), SQLite through the rosbags library.
ROS 1 bags are named and refused.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from grasp_common import bounded_yaml
from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.errors import BagError
from grasp_replay.mcap_bag import McapBag
from grasp_replay.sqlite_bag import SqliteBag

__all__ = [
    'Bag',
    'BagError',
    'Message',
    'Topic',
    'bag_files',
    'open_bag',
    'read_metadata',
    'storage_kind',
]

ROS1_MAGIC = b'#ROSBAG V2.0'
SQLITE_MAGIC = b'SQLite format 3\x00'
MCAP_MAGIC = b'\x89MCAP'
_OTHERS = {
    b'\x28\xb5\x2f\xfd': 'a bag compressed as a whole file; unpack it first: `zstd -d {name}`',
    b'\x04\x22\x4d\x18': 'a file compressed by lz4; unpack it first: `lz4 -d {name}`',
    b'\x1f\x8b': 'a file compressed by gzip; unpack it first: `gunzip {name}`',
    b'PK\x03\x04': 'a zip archive; unpack it first: `unzip {name}`',
    b'BZh': 'a file compressed by bzip2; unpack it first: `bunzip2 {name}`',
    b'\xfd7zXZ': 'a file compressed by xz; unpack it first: `unxz {name}`',
    b'version https://git-lfs': 'a pointer of Git LFS and not the bag; fetch it: `git lfs pull`',
    b'<!doctype html': 'a web page and not a bag; download the file itself',
    b'<html': 'a web page and not a bag; download the file itself',
}
"""What is met in place of a bag, by the bytes it begins with, and the way out."""

_PACKED_NAME = re.compile(r'\.(mcap|db3)\.\w+$')


def open_bag(path: str | Path) -> Bag:
    """Open a bag directory, an `.mcap` file or a `.db3` file; raises BagError."""
    path = Path(path)
    metadata, notes = read_metadata(path)
    files = bag_files(path, metadata)
    listed = metadata.get('relative_file_paths')
    if isinstance(listed, list) and len(listed) > len(files):
        notes.append('metadata.yaml lists a file twice; it is read once')
    mode = str(metadata.get('compression_mode') or 'none').lower()
    if mode == 'file':
        raise BagError(
            f'{path} was compressed file by file; unpack its files first (`zstd -d`) and correct '
            'relative_file_paths and compression_mode in metadata.yaml'
        )
    kinds = {file: storage_kind(file) for file in files}
    if {'mcap', 'sqlite3'} <= set(kinds.values()):
        raise BagError(
            f'{path} holds MCAP and SQLite files; give each kind a folder of its own, or the one '
            'file that is meant'
        )
    if set(kinds.values()) == {'sqlite3'}:
        bag: Bag = SqliteBag(path, files)
    else:
        for file, kind in kinds.items():
            if kind != 'mcap':
                raise BagError(f'{file} is no bag that can be read: it is not MCAP')
        bag = McapBag(path, files)
    bag.packed = mode == 'message'
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
    if not file.is_file():
        return {}, ['metadata.yaml is missing; files are read in the order of their names']
    try:
        document = bounded_yaml.read(file)
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
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagError(f'{path} is no regular file; give a bag directory or an .mcap file')
    names = metadata.get('relative_file_paths')
    if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
        files = [_named_file(path, name) for name in names]
        missing = [file.name for file in files if not file.is_file()]
        if missing:
            raise BagError(
                f'{path} lacks {", ".join(missing)}, which its metadata.yaml names; copy it back, '
                'or delete metadata.yaml to read the files that are there'
            )
        # A file that is listed twice would give each of its messages twice.
        return list({file.resolve(): file for file in reversed(files)}.values())[::-1]
    files = sorted(
        (file for file in path.iterdir() if file.suffix in ('.mcap', '.db3') and file.is_file()),
        key=_by_number,
    )
    if not files:
        for file in sorted(path.iterdir()):
            if file.is_file() and _PACKED_NAME.search(file.name):
                storage_kind(file)
        raise BagError(f'{path} holds no .mcap and no .db3 file: it is no bag')
    return files


def _named_file(folder: Path, name: str) -> Path:
    """The file that metadata.yaml means: beside it, or in a folder beside it.

    Old versions of rosbag2 wrote the directory of the bag in front of the name.
    """
    named = folder / name
    inside = named.is_file() and named.resolve().is_relative_to(folder.resolve())
    return named if inside else folder / Path(name).name


def _by_number(file: Path) -> list[tuple[int, str]]:
    """Sorts `bag_10` after `bag_2`."""
    parts = re.split(r'(\d+)', file.name)
    return [(int(part), '') if part.isdigit() else (-1, part) for part in parts]


def storage_kind(file: Path) -> str:
    """'mcap', 'sqlite3' or 'unknown'; raises BagError for what is known to be something else."""
    try:
        with file.open('rb') as stream:
            head = stream.read(512)
    except OSError as error:
        raise BagError(f'{file} cannot be read: {error.strerror}') from error
    if not head:
        raise BagError(f'{file} is empty; copy or record it again')
    if head.startswith(ROS1_MAGIC):
        raise BagError(
            f'{file} is a ROS 1 bag; convert it first: '
            f'rosbags-convert --src {file.name} --dst {file.stem}'
        )
    for magic, what in _OTHERS.items():
        if head.lstrip()[: len(magic)].lower() == magic.lower():
            raise BagError(f'{file} is {what.format(name=file.name)}')
    if head.startswith(SQLITE_MAGIC):
        return 'sqlite3'
    if head.startswith(MCAP_MAGIC):
        return 'mcap'
    return 'mcap' if file.suffix == '.mcap' else 'unknown'
