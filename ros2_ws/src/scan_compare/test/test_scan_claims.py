# SPDX-License-Identifier: Apache-2.0
"""What a scan file says of itself is held against what it holds: counts, columns, ends, kinds."""

from __future__ import annotations

import codecs
import struct

import numpy as np
import pytest

from scan_compare.scan_file import ScanFileError, parse_scan

CORNERS = np.array([[0.0, 0, 0], [65, 0, 0], [0, 65, 0], [0, 0, 65]])
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
SPHERE = 20.0 * np.random.default_rng(3).standard_normal((40, 3))


def _refused(data: bytes | str, suffix: str, words: str) -> None:
    content = data.encode() if isinstance(data, str) else data
    with pytest.raises(ScanFileError, match=words):
        parse_scan(content, suffix, f'a{suffix}', 'mm')


def _table(numbers: np.ndarray, mark: str = ' ', text: str = '{:.3f}') -> str:
    return ''.join(mark.join(text.format(v) for v in row) + '\n' for row in numbers)


# ---- tables


@pytest.mark.parametrize('first', [0, 1])
@pytest.mark.parametrize('mark', [' ', ',', ';'])
def test_a_column_that_numbers_the_points_is_no_coordinate(first: int, mark: str) -> None:
    rows = [f'{first + k}{mark}{_table(p[None], mark)}' for k, p in enumerate(SPHERE)]
    _refused(''.join(rows), '.xyz', 'first column numbers the points')
    named = parse_scan((mark.join('nxyz') + '\n' + ''.join(rows)).encode(), '.xyz', 'x', 'mm')
    assert np.allclose(named.points * 1e3, SPHERE, atol=1e-3)


def test_a_column_of_times_is_no_coordinate() -> None:
    rows = [f'{0.1 * k:.2f} {_table(p[None])}' for k, p in enumerate(SPHERE)]
    _refused(''.join(rows), '.xyz', 'first column numbers the points')


def test_a_heading_counts_whatever_separates_its_names() -> None:
    rows = _table(SPHERE[:, ::-1], ';')
    for heading in ('z,y,x', 'z y x', 'z\ty\tx'):
        found = parse_scan(f'{heading}\n{rows}'.encode(), '.csv', 'x', 'mm').points
        assert np.allclose(found * 1e3, SPHERE, atol=1e-3)
    assert len(parse_scan(_table(SPHERE, '|').encode(), '.txt', 'x', 'mm').points) == 40


def test_decimal_commas_in_vrml_are_refused_and_commas_between_points_read() -> None:
    scene = (
        '#VRML V2.0 utf8\nShape {{ geometry PointSet {{ coord Coordinate {{ point [ {} ] }} }} }}'
    )
    _refused(
        scene.format(_table(SPHERE, ' ', '{:.1f}').replace('.', ',')), '.wrl', 'decimal comma'
    )
    whole = ','.join(' '.join(f'{v:.0f}' for v in p) for p in SPHERE)
    assert len(parse_scan(scene.format(whole).encode(), '.wrl', 'x', 'mm').points) == 40


def test_a_grid_whose_x_counts_up_is_read() -> None:
    grid = np.stack(np.meshgrid(np.arange(3), np.arange(30)), -1).reshape(-1, 2)
    rows = np.column_stack([grid, grid.sum(axis=1) * 0.5, np.ones(len(grid))])
    assert len(parse_scan(_table(rows, text='{:g}').encode(), '.xyz', 'x', 'mm').points) == 90


def test_decimal_commas_between_commas_are_refused_whatever_their_digits() -> None:
    numbers = np.abs(SPHERE)
    for text in (_table(numbers, ', '), _table(numbers.round(2), ', ', '{:g}')):
        _refused(text.replace('.', ','), '.csv', 'decimal commas')
    _refused(_table(numbers, ',', '{:.2f}').replace('.', ','), '.csv', 'both decimal')
    numbers[5] = 3.05, 2.5, 1.0
    dropped = _table(numbers.round(2), ',', '{:g}').replace('.', ',')
    rows = [row for row in dropped.split('\n') if row.count(',') == 5]
    _refused('\n'.join(['3,05,2,5,1,0', *rows]), '.csv', 'both decimal')


def test_a_count_that_is_too_small_is_named_as_wrong() -> None:
    _refused(f'20 \r\n{_table(SPHERE)}', '.pts', 'declares 20 points but 40 follow; its count')
    _refused(f'40\x1f\n{_table(SPHERE)}', '.pts', 'a line with 1 columns')
    _refused(f'40\t\n{_table(SPHERE[:20])}', '.pts', 'declares 40 points but 20 follow.*cut')


def test_two_scans_in_one_pts_file_are_named() -> None:
    text = _table(SPHERE)
    _refused(f'40\n{text}40\n{text}', '.pts', 'several scans follow each other')


# ---- declared counts of meshes and clouds


def _ply(count: int, faces: int, body: bytes) -> bytes:
    head = f'ply\nformat binary_little_endian 1.0\nelement vertex {count}\n'
    head += ''.join(f'property float {axis}\n' for axis in 'xyz')
    if faces:
        head += f'element face {faces}\nproperty list uchar int vertex_indices\n'
    return f'{head}end_header\n'.encode() + body


POINTS = CORNERS.astype('<f4').tobytes()
TRIANGLES = b''.join(struct.pack('<Biii', 3, *face) for face in FACES)


def test_a_binary_ply_with_more_than_it_declares_is_refused() -> None:
    _refused(_ply(3, 0, POINTS), '.ply', 'more than its header declares.*3 "vertex"')
    _refused(_ply(4, 2, POINTS + TRIANGLES), '.ply', 'more than its header declares.*2 "face"')


@pytest.mark.parametrize('rest', [b'\n', bytes(26), b'rest'])
def test_other_bytes_after_a_binary_ply_are_noted(rest: bytes) -> None:
    scan = parse_scan(_ply(4, 4, POINTS + TRIANGLES + rest), '.ply', 'x', 'mm')
    assert scan.triangles is not None and len(scan.triangles) == 4
    assert f'{len(rest)} bytes after the last element ignored' in scan.notes


def _pcd(count: int, storage: str, body: bytes) -> bytes:
    head = 'VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n'
    return f'{head}WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA {storage}\n'.encode() + body


def test_a_pcd_with_more_than_it_declares_is_refused() -> None:
    _refused(_pcd(3, 'binary', POINTS), '.pcd', 'declares 3 points but holds 4; its header')
    _refused(_pcd(3, 'ascii', _table(CORNERS).encode()), '.pcd', 'declares 3 .* holds 4; its')
    assert len(parse_scan(_pcd(4, 'binary', POINTS + bytes(24)), '.pcd', 'x', 'mm').points) == 4


def test_a_pcd_line_of_other_columns_is_refused() -> None:
    text = _table(np.column_stack([CORNERS, CORNERS])).encode()
    _refused(_pcd(4, 'ascii', text), '.pcd', 'a line of 6 numbers, not the 3')
    commas = _table(CORNERS + 0.5).replace('.', ',').encode()
    _refused(_pcd(4, 'ascii', commas), '.pcd', "'0,500'")


def test_a_pcd_in_the_other_byte_order_is_named() -> None:
    _refused(_pcd(4, 'binary', CORNERS.astype('>f4').tobytes()), '.pcd', 'other byte order')


def test_a_pcd_size_that_only_looks_like_a_number_is_refused() -> None:
    _refused(_pcd(4, 'ascii', b'').replace(b'SIZE 4', b'SIZE \xb2'), '.pcd', 'SIZE')


def test_an_off_with_broken_lines_is_read_and_one_with_more_refused() -> None:
    points = _table(CORNERS, '\n')
    faces = ''.join(f'3 {a}\n{b}\n{c}\n\n' for a, b, c in FACES)
    scan = parse_scan(f'OFF\n4 4 0\n{points}{faces}'.encode(), '.off', 'x', 'mm')
    assert scan.triangles is not None and len(scan.triangles) == 4
    rows = _table(CORNERS) + ''.join(f'3 {a} {b} {c}\n' for a, b, c in FACES)
    _refused(f'OFF\n4 2 0\n{rows}', '.off', '4 vertices and 2 faces but holds 4 and 4')


def test_an_ascii_stl_without_its_end_is_noted_and_one_without_facets_refused() -> None:
    text = 'solid a\n'
    for face in FACES:
        vertices = ''.join('vertex {:g} {:g} {:g}\n'.format(*CORNERS[k]) for k in face)
        text += f'facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n'
    cut = parse_scan(text.encode(), '.stl', 'x', 'mm')
    assert any('may be cut' in note for note in cut.notes)
    whole = parse_scan((text + 'endsolid a').replace('\n', '\r').encode(), '.stl', 'x', 'mm')
    assert not any('may be cut' in note for note in whole.notes)
    _refused('solid a\nendsolid a\n' + ' ' * 90, '.stl', 'without any facet')


def test_a_ply_header_that_lost_a_line_is_named() -> None:
    _refused(_ply(4, 4, POINTS).replace(b'element face 4\n', b''), '.ply', 'element face.*missing')
    _refused(_ply(4, 0, POINTS).replace(b'vertex', b'corner'), '.ply', 'no elements "vertex"')


# ---- what is no scan


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (codecs.BOM_UTF8 + b'<!DOCTYPE html>', 'web page'),
        ('\ufeff<html>'.encode('utf-16-le'), 'web page'),
        (b'<?xml version="1.0"?>\n<!DOCTYPE html PUBLIC>', 'web page'),
        (b'<!-- saved -->\n<head>', 'web page'),
        (b'404: Not Found', 'a server'),
        (b'<?xml version="1.0"?><Error><Code>AccessDenied</Code>', 'a server'),
        ('\ufeffversion https://git-lfs.github.com/spec/v1\n'.encode('utf-16'), 'git lfs pull'),
        (b'{"message": "Not Found"}', 'JSON'),
        (b'<?xml version="1.0"?><note/>', 'XML'),
        (b'ISO-10303-21;\nHEADER;', 'STEP'),
        (b'ncols 4\nnrows 3\n1 2 3 4\n', 'grid of heights'),
        (b'a.stl'.ljust(257, b'\0') + b'ustar', 'tar archive'),
        (b'SQLite format 3\0', 'grasp_report'),
        (b'\x93NUMPY\1\0', 'numpy'),
    ],
)
@pytest.mark.parametrize('suffix', ['.ply', '.stl', '.xyz', '.obj', '.wrl'])
def test_another_kind_of_file_is_named_under_any_name(
    content: bytes, words: str, suffix: str
) -> None:
    _refused(content, suffix, words)


def test_a_vrml_scene_of_other_shapes_names_them() -> None:
    text = '#VRML V2.0 utf8\nShape { geometry Sphere { radius 2 } }\n'
    _refused(text, '.wrl', 'VRML Sphere left out.*export a mesh')
