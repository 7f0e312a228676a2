# SPDX-License-Identifier: Apache-2.0
"""Damaged bags opened and read as `replay` does; used by the tests and the long runs."""

from __future__ import annotations

import random
import resource
import sqlite3
from dataclasses import dataclass
from pathlib import Path

import mcap_bytes as m
from bag_damage import damage
from bag_samples import library_file, write_strings
from mcap.writer import CompressionType

from grasp_replay.bag_reader import open_bag
from grasp_replay.errors import BagError
from grasp_replay.mcap_blocks import zstd

MEMORY_SLACK = 100 * 2**20
"""Bytes that the peak of the process may grow while small damaged bags are read."""


@dataclass(frozen=True)
class Seed:
    """A small bag: what is damaged, what lies beside it, and whether checksums prove messages."""

    name: str
    content: bytes
    beside: dict[str, bytes]
    proven: bool


def seeds(folder: Path) -> list[Seed]:
    """Bags of every form that is read, made in an empty `folder`."""
    texts = [(f'/t{k % 2}', k * 10**8, f'message {k} ' * 3) for k in range(12)]
    found = []
    for compression in ('none', 'zstd', 'lz4'):
        bag = write_strings(folder / compression, texts, compression=compression, chunk_every=5)
        found.append(Seed('x.mcap', (bag / f'{compression}_0.mcap').read_bytes(), {}, True))
    for chunked, indexed in ((False, True), (True, False)):
        path = library_file(
            folder / f'{chunked}.mcap',
            12,
            compression=CompressionType.ZSTD,
            chunked=chunked,
            indexed=indexed,
        )
        found.append(Seed('x.mcap', path.read_bytes(), {}, False))
    packed = m.message(5, zstd.compress(m.cdr('packed'))) + m.attachment('a', b'text')
    loose = m.header() + m.schema() + m.channel() + packed + m.metadata('by', {'who': 'anna'})
    found.append(Seed('x.mcap', m.whole(loose), {}, False))
    database = _database(folder / 'a.db3')
    found.append(Seed('x.db3', database, {}, False))
    metadata = (folder / 'zstd' / 'metadata.yaml').read_bytes()
    found.append(Seed('metadata.yaml', metadata, {'zstd_0.mcap': found[1].content}, True))
    return found


def _database(path: Path) -> bytes:
    base = sqlite3.connect(path)
    base.executescript(
        'PRAGMA page_size=512; CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
        'serialization_format TEXT, offered_qos_profiles TEXT);'
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
        f'data BLOB); INSERT INTO topics VALUES(1, "/a", "{m.STRING}", "cdr", "");'
    )
    rows = [(1, k, m.cdr(f'message {k}')) for k in range(8)]
    base.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)', rows)
    base.commit()
    base.close()
    return path.read_bytes()


def read_or_refuse(folder: Path) -> set[bytes] | None:
    """The messages of a damaged bag, None where it is refused; all but BagError escapes."""
    try:
        with open_bag(folder) as bag:
            found = set()
            for message in bag.messages():
                found.add(message.data)
                try:
                    bag.decode(message)
                except BagError:
                    continue
            return found
    except BagError:
        return None


def run(count: int, seed: int, folder: Path) -> tuple[int, int]:
    """Open `count` damaged bags, of every form in turn, in an empty `folder`.

    Returns how many were read and by how much the peak memory of the process grew [bytes]; raises
    whatever is no BagError, and AssertionError for a message that no recording held.
    """
    generator = random.Random(seed)
    (folder / 'seeds').mkdir()
    bags = seeds(folder / 'seeds')
    places, whole = [], []
    for number, bag in enumerate(bags):
        place = folder / str(number)
        place.mkdir()
        for name, content in {bag.name: bag.content, **bag.beside}.items():
            (place / name).write_bytes(content)
        places.append(place)
        messages = read_or_refuse(place)
        assert messages, bag.name
        whole.append(messages)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = 0
    for step in range(count):
        bag, place = bags[step % len(bags)], places[step % len(bags)]
        content, _, _ = damage(bag.content, generator)
        (place / bag.name).write_bytes(content)
        found = read_or_refuse(place)
        read += found is not None
        if bag.proven and found is not None:
            assert found <= whole[step % len(bags)], f'invented by {content!r}'
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    assert grown < MEMORY_SLACK
    return read, grown
