# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_mutations import MEMORY_FACTOR, MEMORY_SLACK, read_or_refuse, run, seeds

from scan_compare.scan_file import ScanFileError, parse_scan, read_scan


@pytest.mark.parametrize('name', list(seeds()))
def test_every_seed_is_a_valid_scan(name: str) -> None:
    suffix, data = seeds()[name]
    assert read_or_refuse(data, suffix)


@pytest.mark.parametrize('name', list(seeds()))
def test_a_file_cut_at_any_byte_is_read_or_refused(name: str) -> None:
    suffix, data = seeds()[name]
    for length in range(len(data)):
        read_or_refuse(data[:length], suffix)


def test_ten_thousand_mutations_are_read_or_refused_within_bounded_memory() -> None:
    read, _ = run(10_000, seed=7)
    assert 500 < read < 9_500


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=400), st.sampled_from(['.ply', '.stl', '.obj', '.xyz', '.wrl']))
def test_arbitrary_bytes_are_read_or_refused(data: bytes, suffix: str) -> None:
    magic = {'.ply': b'ply\nformat ascii 1.0\n', '.wrl': b'#VRML V2.0 utf8\n'}
    read_or_refuse(magic.get(suffix, b'') + data, suffix)


PLY = (
    'ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n'
)
FACES = 'element face {n}\nproperty list uchar int vertex_indices\nend_header\n'
CORNERS = '0 0 0\n1 0 0\n0 1 0\n'
WRL = '#VRML V2.0 utf8\nShape {{ geometry IndexedFaceSet {{ coord Coordinate {{ point [ '


@pytest.mark.parametrize(
    ('suffix', 'head', 'line', 'tail'),
    [
        ('.xyz', '', '1 2 3\n', ''),
        ('.csv', '', '1,2,3\n', ''),
        ('.xyz', '0 1 2\n', '#\n', ''),
        ('.obj', '', 'v 1 2 3\n', ''),
        ('.obj', 'v 0 0 0\nv 0 0 1\nv 0 1 0\n', 'f 1 2 3\n', ''),
        ('.obj', 'v 0 0 0\nv 0 0 1\nv 0 1 0\n', 'f 1 2 \\\n3\n', ''),
        ('.ply', PLY.format('ascii', '{n}') + 'end_header\n', '1 2 3\n', ''),
        ('.ply', PLY.format('ascii', 3) + FACES + CORNERS, '3 0 1 2\n', ''),
        ('.ply', PLY.format('binary_little_endian', '{n}') + 'end_header\n', '  @A  @A  @B', ''),
        ('.stl', 'solid\n', 'facet\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\n', ''),
        ('.wrl', WRL, '1 2 3 ', '] } } }'),
        ('.wrl', WRL + '0 0 0 1 0 0 0 1 0 ] }} coordIndex [ ', '0 1 2 -1 ', '] } }'),
        ('.wrl', WRL + '0 0 0 ] }} color Color {{ color [', '0 ', '] } } }'),
    ],
)  # fmt: skip
def test_reading_a_file_takes_at_most_eight_bytes_for_each_of_its_bytes(
    tmp_path: Path, suffix: str, head: str, line: str, tail: str
) -> None:
    path = tmp_path / f'large{suffix}'
    sizes, peaks = [], []
    for megabytes in (1, 3):
        n = megabytes * 2**20 // len(line)
        path.write_text(head.format(n=n) + line * n + tail)
        tracemalloc.start()
        read_scan(path, 'mm')
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        sizes.append(path.stat().st_size)
    assert peaks[0] < MEMORY_SLACK
    assert peaks[1] - peaks[0] <= MEMORY_FACTOR * (sizes[1] - sizes[0])


@pytest.mark.parametrize(
    ('suffix', 'head', 'words'),
    [
        ('.xyz', '', 'a line of more than'),
        ('.obj', 'v 1 2 3\nf', 'a line of more than'),
        ('.ply', PLY.format('ascii', 3) + FACES.format(n=1) + CORNERS + '2000000', 'absurd'),
        ('.wrl', WRL.format() + '0 0 0 ] } coordIndex [', 'corners; export triangles'),
    ],
)
def test_a_face_or_a_line_without_end_is_refused(suffix: str, head: str, words: str) -> None:
    tail = '] } }' if suffix == '.wrl' else ''
    with pytest.raises(ScanFileError, match=words):
        parse_scan((head + ' 1' * 1_000_000 + tail).encode(), suffix, 'endless', 'mm')


def test_deep_vrml_nesting_does_not_exhaust_the_stack() -> None:
    data = b'#VRML V2.0 utf8\n' + b'Group { children [ ' * 100_000
    with pytest.raises(ScanFileError, match='nested deeper'):
        parse_scan(data, '.wrl', 'deep', 'mm')


def test_coordinates_beyond_any_length_are_dropped() -> None:
    scan = parse_scan(b'0 0 0\n1 1 1\n1e300 0 0\n', '.xyz', 'x', 'mm')
    assert np.all(np.abs(scan.points) < 1.0)
