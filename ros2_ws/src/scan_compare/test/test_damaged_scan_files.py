from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_mutations import MEMORY_FACTOR, MEMORY_SLACK, read_or_refuse, run, seeds

from scan_compare.scan_file import ScanFileError, parse_scan


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


@pytest.mark.parametrize(
    ('suffix', 'head', 'line', 'repeat'),
    [
        ('.xyz', '', '0 0 0\n', 1_000_000),
        ('.obj', 'v 0 0 0\nv 0 0 1\nv 0 1 0\n', 'f 1 2 3\n', 500_000),
        ('.ply', 'ply\nformat ascii 1.0\nelement vertex 1000000\nproperty float x\n'
         'property float y\nproperty float z\nend_header\n', '0 0 0\n', 1_000_000),
        ('.stl', 'solid\n', 'facet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\n',
         100_000),
        ('.wrl', '#VRML V2.0 utf8\nShape { geometry PointSet { coord Coordinate { point [',
         '0 0 0 ', 1_000_000),
    ],
)  # fmt: skip
def test_large_files_stay_within_eight_times_their_size(
    suffix: str, head: str, line: str, repeat: int
) -> None:
    tail = '] } } }' if suffix == '.wrl' else ''
    data = (head + line * repeat + tail).encode()
    tracemalloc.start()
    try:
        parse_scan(data, suffix, 'large', 'mm')
    except ScanFileError as error:
        pytest.fail(str(error))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < (MEMORY_FACTOR - 1) * len(data) + MEMORY_SLACK


def test_deep_vrml_nesting_does_not_exhaust_the_stack() -> None:
    data = b'#VRML V2.0 utf8\n' + b'Group { children [ ' * 100_000
    with pytest.raises(ScanFileError, match='nested deeper'):
        parse_scan(data, '.wrl', 'deep', 'mm')


def test_coordinates_beyond_any_length_are_dropped() -> None:
    scan = parse_scan(b'0 0 0\n1 1 1\n1e300 0 0\n', '.xyz', 'x', 'mm')
    assert np.all(np.abs(scan.points) < 1.0)
