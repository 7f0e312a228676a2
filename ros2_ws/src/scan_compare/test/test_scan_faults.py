# SPDX-License-Identifier: Apache-2.0
"""Scan files as people have them: read rightly, or refused for what they are; never misread."""

from __future__ import annotations

import gzip
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scan_compare.scan_file import ScanFileError, parse_scan

RADIUS = 32.5


def _ball(count: int = 300) -> np.ndarray:
    """Points (n, 3) all over a sphere of 65 mm, in mm, moved off the origin a little."""
    k = np.arange(count) + 0.5
    angle, z = np.pi * (1 + 5**0.5) * k, 1 - 2 * k / count
    around = np.sqrt(1 - z * z)
    return np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1) * RADIUS + [
        1,
        2,
        3,
    ]


BALL = _ball()
TEXT = '\n'.join(' '.join(f'{v:.3f}' for v in p) for p in BALL) + '\n'


def _rows(*columns: np.ndarray, mark: str = ',', digits: int = 3) -> str:
    table = np.column_stack(columns)
    return '\n'.join(mark.join(f'{v:.{digits}f}' for v in row) for row in table) + '\n'


def _read(text: str | bytes, suffix: str = '.csv') -> np.ndarray:
    data = text if isinstance(text, bytes) else text.encode()
    return parse_scan(data, suffix, 'file' + suffix, None, 0.065).points * 1e3


# ---- tables


@pytest.mark.parametrize(
    ('heading', 'order'),
    [
        ('nx,ny,nz,x,y,z', 'nnnxyz'),
        ('"Distance","Points:0","Points:1","Points:2"', 'nxyz'),
        ('z,y,x', 'zyx'),
        ('Z [mm],X [mm],Y [mm]', 'zxy'),
        ('intensity,X_mm,Y_mm,Z_mm', 'nxyz'),
        ('y,pos_x,z', 'yxz'),
        ('position.x,position.z,position.y', 'xzy'),
        ('//R,G,B,X,Y,Z', 'nnnxyz'),
        ('# nx ny nz x y z', 'nnnxyz'),
    ],
)
def test_the_heading_decides_which_columns_are_read(heading: str, order: str) -> None:
    unit = (BALL - BALL.mean(axis=0)) / RADIUS
    columns = [
        BALL[:, 'xyz'.index(c)] if c != 'n' else unit[:, k % 3] for k, c in enumerate(order)
    ]
    assert np.allclose(_read(f'{heading}\n{_rows(*columns)}'), BALL, atol=1e-3)


@pytest.mark.parametrize(
    ('heading', 'words'),
    [
        ('a,b,c', 'does not name x, y and z'),
        ('nx,ny,nz', 'does not name x, y and z'),
        ('x,y', 'names 2 columns'),
        ('x,y,z,i', 'names 4 columns'),
        ('x,x,y', 'does not name x, y and z'),
    ],
)
def test_a_heading_that_does_not_tell_is_refused(heading: str, words: str) -> None:
    with pytest.raises(ScanFileError, match=words):
        _read(f'{heading}\n{_rows(BALL)}')


def test_a_line_of_words_in_front_is_passed_over_and_noted() -> None:
    scan = parse_scan(f'A scan of my ball\n{TEXT}'.encode(), '.txt', 'x', 'mm')
    assert len(scan.points) == len(BALL)
    assert any('passed over' in note for note in scan.notes)


@pytest.mark.parametrize('mark', [';', '\t'])
@pytest.mark.parametrize('digits', [1, 2, 4])
def test_a_comma_is_a_decimal_point_where_something_else_separates(mark: str, digits: int) -> None:
    text = _rows(BALL, mark=mark, digits=digits).replace('.', ',')
    for front in ('', mark.join('XYZ') + '\n'):
        assert np.allclose(_read(front + text), BALL, atol=0.6 * 10.0**-digits)


@pytest.mark.parametrize('digits', [1, 2, 4])
@pytest.mark.parametrize('mark', [' ', '  ', ','])
def test_decimal_commas_that_cannot_be_told_are_refused(mark: str, digits: int) -> None:
    text = _rows(BALL, mark=mark, digits=digits).replace('.', ',')
    for suffix in ('.xyz', '.csv', '.asc'):
        with pytest.raises(ScanFileError, match=r'decimal (commas|points)'):
            _read(text, suffix)


def test_a_decimal_comma_far_down_the_file_is_refused_with_its_line() -> None:
    lines = _rows(np.tile(BALL, (20, 1)) * (1 + 1e-4 * np.arange(6000)[:, None]), mark=';')
    lines = lines.split('\n')
    lines[5000] = lines[5000].replace('.', ',')
    with pytest.raises(ScanFileError, match='line 5001: x .* has a decimal comma'):
        _read('\n'.join(lines))


@pytest.mark.parametrize('mark', [',', ';', '\t'])
@pytest.mark.parametrize('column', [0, 1, 2])
def test_an_empty_field_is_refused_with_its_line_and_axis(mark: str, column: int) -> None:
    lines = _rows(BALL, np.arange(len(BALL)), mark=mark).split('\n')
    fields = lines[7].split(mark)
    fields[column] = ''
    lines[7] = mark.join(fields)
    with pytest.raises(ScanFileError, match=f'line 8: {"xyz"[column]} is missing'):
        _read('\n'.join(lines))


def test_an_empty_field_of_another_column_does_not_matter() -> None:
    text = _rows(BALL, np.arange(len(BALL))).replace(',7.000\n', ',\n')
    assert np.allclose(_read(text), BALL, atol=1e-3)


@pytest.mark.parametrize('suffix', ['.pts', '.xyz', '.txt'])
def test_a_table_shorter_than_its_first_line_says_is_refused(suffix: str) -> None:
    assert len(_read(f'{len(BALL)}\n{TEXT}', suffix)) == len(BALL)
    with pytest.raises(ScanFileError, match='declares 600 points but 300 follow'):
        _read(f'600\n{TEXT}', suffix)


def test_quoted_fields_are_read() -> None:
    quoted = '"x","y","z"\n' + ''.join('"{:.3f}","{:.3f}","{:.3f}"\n'.format(*p) for p in BALL)
    assert np.allclose(_read(quoted), BALL, atol=1e-3)


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'utf-16', 'utf-16-le', 'utf-16-be', 'utf-32'])
@pytest.mark.parametrize('suffix', ['.xyz', '.obj', '.wrl', '.stl', '.ply', '.off', '.csv'])
def test_text_in_any_encoding_is_read(encoding: str, suffix: str) -> None:
    points = ''.join('{:.3f} {:.3f} {:.3f}\n'.format(*p) for p in BALL)
    text = {
        '.obj': ''.join(f'v {line}\n' for line in points.splitlines()),
        '.wrl': '#VRML V2.0 utf8\nShape { geometry PointSet { coord Coordinate { point [ '
        + points + '] } } }',
        '.stl': 'solid a\n' + ''.join(
            'facet normal 0 0 1\nouter loop\n'
            + ''.join(f'vertex {line}\n' for line in points.splitlines()[k : k + 3])
            + 'endloop\nendfacet\n'
            for k in range(0, len(BALL), 3)
        ),
        '.ply': f'ply\nformat ascii 1.0\nelement vertex {len(BALL)}\nproperty float x\n'
        f'property float y\nproperty float z\nend_header\n{points}',
        '.off': f'OFF\n{len(BALL)} 0 0\n{points}',
    }.get(suffix, points)  # fmt: skip
    assert np.allclose(_read(text.encode(encoding), suffix), BALL, atol=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    mark=st.sampled_from([',', ';', '\t', ' ']),
    order=st.permutations('xyzab'),
    ends=st.sampled_from(['\n', '\r\n', '\r']),
    digits=st.integers(2, 6),
)
def test_every_table_with_names_gives_the_named_columns(
    mark: str, order: list[str], ends: str, digits: int
) -> None:
    named = dict(zip('xyz', BALL.T, strict=True), a=BALL[:, 0] + 5, b=BALL[:, 1] - 5)
    text = mark.join(order) + '\n' + _rows(*(named[c] for c in order), mark=mark, digits=digits)
    assert np.allclose(_read(text.replace('\n', ends)), BALL, atol=10.0**-digits)


# ---- meshes

TETRAHEDRON = np.array([[0, 0, 0], [65, 0, 0], [0, 65, 0], [0, 0, 65.0]])
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]


def _ply(tail: str, body: bytes, nl: str = '\n', order: str = 'little') -> bytes:
    head = f'ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\n'
    head += f'property float y\nproperty float z\n{tail}end_header\n'
    return head.replace('\n', nl).encode() + TETRAHEDRON.astype('<f4').tobytes() + body


def _faces(data: bytes, suffix: str = '.ply') -> int:
    triangles = parse_scan(data, suffix, 'x', 'mm').triangles
    return 0 if triangles is None else len(triangles)


CORNERS = 'property list uchar int vertex_indices\n'
TEXTURE = 'property list uchar float texcoord\n'


@pytest.mark.parametrize('corners_first', [True, False])
@pytest.mark.parametrize('name', ['vertex_indices', 'vertex_index'])
def test_a_second_list_of_each_face_is_passed_over(corners_first: bool, name: str) -> None:
    lists = [CORNERS.replace('vertex_indices', name), TEXTURE]
    pieces = [struct.pack('<Biii', 3, *f) for f in FACES]
    texture = struct.pack('<B6f', 6, *range(6))
    body = b''.join(p + texture if corners_first else texture + p for p in pieces)
    tail = 'element face 4\n' + ''.join(lists if corners_first else lists[::-1])
    assert _faces(_ply(tail, body)) == 4
    numbers = [f'3 {a} {b} {c}' for a, b, c in FACES]
    rows = [f'{n} 6 0 0 1 0 1 1' if corners_first else f'6 0 0 1 0 1 1 {n}' for n in numbers]
    text = _ply(tail, b'')[: -TETRAHEDRON.size * 4].replace(b'binary_little_endian', b'ascii')
    points = ''.join('{:g} {:g} {:g}\n'.format(*p) for p in TETRAHEDRON)
    assert _faces(text + (points + '\n'.join(rows) + '\n').encode()) == 4


def test_lines_of_faces_that_hold_more_than_their_header_says_are_read() -> None:
    tail = 'element face 4\n' + CORNERS + TEXTURE + 'property uchar red\n'
    head = _ply(tail, b'')[: -TETRAHEDRON.size * 4].replace(b'binary_little_endian', b'ascii')
    points = ''.join('{:g} {:g} {:g}\n'.format(*p) for p in TETRAHEDRON)
    rows = ''.join(f'3 {a} {b} {c} 6 0 0 1 0 1 1 9 1 1 1 1 1 1 1 1 1\n' for a, b, c in FACES)
    scan = parse_scan(head + (points + rows).encode(), '.ply', 'x', 'mm')
    assert scan.triangles is not None and len(scan.triangles) == 4
    assert any('PLY lines hold more than their header' in note for note in scan.notes)


@pytest.mark.parametrize('columns', ['1 2 3 255 0 0\n', '1 2 3\n1 2 3\n'])
def test_an_ascii_ply_with_more_than_it_declares_is_refused(columns: str) -> None:
    head = 'ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n'
    head += 'property float z\nend_header\n'
    with pytest.raises(ScanFileError, match='more numbers than its header declares'):
        parse_scan((head + columns * 4).encode(), '.ply', 'x', 'mm')


def test_a_header_comment_broken_into_two_lines_is_passed_over() -> None:
    body = b''.join(struct.pack('<Biii', 3, *f) for f in FACES)
    data = _ply('element face 4\n' + CORNERS, body)
    assert _faces(data.replace(b'1.0\n', b'1.0\ncomment made\nby Blender\n', 1)) == 4


def test_strips_of_triangles_are_read_with_one_side_out() -> None:
    strip = [0, 2, 1, 3, 0, -1, 0, 3, 2]
    body = struct.pack(f'<i{len(strip)}i', len(strip), *strip)
    tail = 'element tristrips 1\nproperty list int int vertex_indices\n'
    triangles = parse_scan(_ply(tail, body), '.ply', 'x', 'mm').triangles
    assert triangles is not None
    corners = TETRAHEDRON[triangles]
    volume = np.einsum('ti,ti->', corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert (len(triangles), round(volume)) == (4, round(65**3 / 6))


def test_faces_that_are_left_out_are_noted() -> None:
    body = struct.pack('<i3i', 3, 0, 1, 2)
    tail = 'element polygons 1\nproperty list int int vertex_indices\n'
    notes = parse_scan(_ply(tail, body), '.ply', 'x', 'mm').notes
    assert '1 PLY elements "polygons" left out' in notes


@pytest.mark.parametrize('nl', ['\n', '\r\n', ' \n', '\t\r\n', '\r'])
def test_every_line_end_of_a_ply_header_is_read(nl: str) -> None:
    body = b''.join(struct.pack('<Biii', 3, *f) for f in FACES)
    assert _faces(_ply('element face 4\n' + CORNERS, body, nl)) == 4


def test_numbers_in_the_other_byte_order_are_named() -> None:
    with pytest.raises(ScanFileError, match='other byte order'):
        _faces(_ply('', b'', order='big'))
    stl = bytes(80) + struct.pack('>I', 4)
    for face in FACES:
        stl += struct.pack('>12fH', 0, 0, 1, *TETRAHEDRON[list(face)].ravel(), 0)
    with pytest.raises(ScanFileError, match='big-endian'):
        _faces(stl, '.stl')


@pytest.mark.parametrize('count', [0, 1, 3])
def test_a_binary_stl_with_more_faces_than_it_counts_is_refused(count: int) -> None:
    stl = bytes(80) + struct.pack('<I', count)
    for face in FACES:
        stl += struct.pack('<12fH', 0, 0, 1, *TETRAHEDRON[list(face)].ravel(), 0)
    with pytest.raises(ScanFileError, match=f'declares {count} faces but holds 4'):
        _faces(stl, '.stl')


@pytest.mark.parametrize(
    'text',
    [
        'OFF\n4 4 6\n{p}{f}',
        'OFF 4 4 6\n{p}{f}',
        '# by hand\nCOFF\n4 4 0\n{c}{f}',
        'NOFF\n\n4 4 0\n{c}{f} # last',
        'STOFF\n4 4\n{p}{k}',
        '4 4 6\n{p}{f}',
    ],
)
def test_every_off_is_read(text: str) -> None:
    points = ''.join('{:g} {:g} {:g}\n'.format(*p) for p in TETRAHEDRON)
    faces = ''.join(f'3 {a} {b} {c}\n' for a, b, c in FACES)
    coloured = points.replace('\n', ' 0.5 0.5 0.5 1\n')
    filled = text.format(p=points, f=faces, c=coloured, k=faces.replace('\n', ' 255 0 0\n'))
    assert _faces(filled.encode(), '.off') == 4


def test_an_off_that_is_cut_is_refused() -> None:
    with pytest.raises(ScanFileError, match='declares 4 vertices and 4 faces but holds 4 and 1'):
        _faces(b'OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n', '.off')


PCD = (
    '# .PCD v0.7 - Point Cloud Data\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\n'
    'COUNT {counts}\nWIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n'
)


def _pcd(data: str, body: bytes, fields: str = 'rgb z x y n', n: int = len(BALL)) -> bytes:
    head = PCD.format(
        fields=fields, sizes='4 8 4 4 2', types='U F F F I', counts='1 1 1 1 3', n=n, data=data
    )
    return head.encode() + body


def _pcd_table() -> np.ndarray:
    kind = [('rgb', '<u4'), ('z', '<f8'), ('x', '<f4'), ('y', '<f4'), ('n', '<i2', 3)]
    table = np.zeros(len(BALL), kind)
    table['rgb'] = 77
    table['x'], table['y'], table['z'] = BALL.T
    return table


def _literal_lzf(data: bytes) -> bytes:
    """LZF that copies nothing, for it may always be written so."""
    pieces = [data[k : k + 32] for k in range(0, len(data), 32)]
    return b''.join(bytes([len(piece) - 1]) + piece for piece in pieces)


def test_every_storage_of_pcd_is_read() -> None:
    table = _pcd_table()
    text = ''.join(f'77 {z:.4f} {x:.4f} {y:.4f} 1 2 3\n' for x, y, z in BALL).encode()
    planes = b''.join(np.ascontiguousarray(table[name]).tobytes() for name in table.dtype.names)
    packed = _literal_lzf(planes)
    sizes = struct.pack('<II', len(packed), len(planes))
    for data in (
        _pcd('ascii', text),
        _pcd('binary', table.tobytes()),
        _pcd('binary_compressed', sizes + packed),
    ):
        assert np.allclose(_read(data, '.pcd'), BALL, atol=1e-3)


def test_a_pcd_copy_that_runs_into_itself_is_unpacked() -> None:
    head = PCD.format(fields='x y z', sizes='4 4 4', types='F F F', counts='1 1 1', n=3, data='{}')
    ones = struct.pack('<f', 1.0)
    # four literals, then 32 bytes from four back: x, y and z of three points are all 1
    packed = b'\x03' + ones + bytes([7 << 5, 32 - 9, 3])
    body = struct.pack('<II', len(packed), 36) + packed
    data = head.format('binary_compressed').encode() + body
    scan = parse_scan(data, '.pcd', 'x', 'm')
    assert scan.points.tolist() == [[1.0, 1.0, 1.0]]


def test_a_cut_pcd_is_refused_and_nan_holes_are_dropped() -> None:
    table = _pcd_table()
    for data in (
        _pcd('binary', table.tobytes()[:-1]),
        _pcd('ascii', b'77 1 2 3 1 2 3\n'),
        _pcd('binary_compressed', struct.pack('<II', 100, 26 * len(BALL)) + b'\x00a' * 20),
    ):
        with pytest.raises(ScanFileError, match='cut'):
            _read(data, '.pcd')
    table['z'][::2] = np.nan
    assert len(_read(_pcd('binary', table.tobytes()), '.pcd')) == len(BALL) // 2


def test_a_vrml_route_inside_a_node_is_passed_over() -> None:
    points = ' '.join(f'{v:.3f}' for v in BALL.ravel())
    shape = f'Shape {{ geometry PointSet {{ coord Coordinate {{ point [ {points} ] }} }} }}'
    text = (
        '#VRML V2.0 utf8\nTransform { children [ DEF T TimeSensor { } DEF P PositionInterpolator '
        f'{{ }} {shape} ]\nROUTE T.fraction_changed TO P.set_fraction }}\n'
    )
    assert len(_read(text, '.wrl')) == len(BALL)


@pytest.mark.parametrize('suffix', ['.xyz', '.stl', '.wrl'])
def test_gzip_under_the_plain_name_is_unpacked(suffix: str) -> None:
    stl = bytes(80) + struct.pack('<I', 4)
    for face in FACES:
        stl += struct.pack('<12fH', 0, 0, 1, *TETRAHEDRON[list(face)].ravel(), 0)
    content = {
        '.xyz': TEXT.encode(),
        '.stl': stl,
        '.wrl': b'#VRML V2.0 utf8\nShape { geometry PointSet { coord Coordinate { point [ '
        + TEXT.encode() + b' ] } } }',
    }[suffix]  # fmt: skip
    packed = gzip.compress(content[:50]) + gzip.compress(content[50:])
    plain = parse_scan(content, suffix, 'x', 'mm')
    scan = parse_scan(packed, suffix, 'x', 'mm')
    assert np.array_equal(scan.points, plain.points)
    assert 'unpacked with gzip' in scan.notes
    with pytest.raises(ScanFileError, match='gzip and cut'):
        parse_scan(packed[:-5], suffix, 'x', 'mm')


def test_a_small_file_that_unpacks_to_gigabytes_is_refused() -> None:
    with pytest.raises(ScanFileError, match='as no scan is'):
        parse_scan(gzip.compress(b'1 2 3\n' * 2**24), '.xyz', 'x', 'mm')


@pytest.mark.parametrize(
    ('content', 'suffix', 'words'),
    [
        (b'version https://git-lfs.github.com/spec/v1\nsize 3\n', '.ply', 'git lfs pull'),
        (b'<!DOCTYPE html>\n<html>', '.stl', 'web page'),
        (b'\n<html lang="en">', '.obj', 'web page'),
        (b'PK\x03\x04' + b'\0' * 30, '.3mf', '3MF'),
        (b'PK\x03\x04' + b'\0' * 30, '.stl', 'zip archive.*unzip'),
        (b'ASTM-E57\1\0\0\0', '.e57', 'E57'),
        (b'2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n', '.ptx', 'PTX'),
        (b'20\n30\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n', '.xyz', 'PTX'),
        (b'glTF\2\0\0\0', '.glb', 'glTF'),
        (b'#VRML V1.0 ascii\n', '.wrl', 'VRML 2'),
        (b'<?xml version="1.0"?>\n<COLLADA xmlns="x">', '.dae', 'COLLADA'),
        (b'\x28\xb5\x2f\xfd\0', '.ply', 'zstd -d'),
        (b'\x89MCAP0\r\n', '.ply', 'grasp_report'),
    ],
)
def test_what_is_no_scan_is_named_with_the_way_out(
    content: bytes, suffix: str, words: str
) -> None:
    with pytest.raises(ScanFileError, match=words):
        parse_scan(content, suffix, 'x' + suffix, 'mm')


# ---- welding


@pytest.mark.parametrize('power', [4, 6, 7, 9, 12])
def test_one_stray_point_neither_coarsens_the_scan_nor_sets_its_unit(power: int) -> None:
    points = _ball(2000)
    points[7] = 10.0**power
    text = '\n'.join(' '.join(f'{v:.4f}' for v in p) for p in points)
    scan = parse_scan(text.encode(), '.xyz', 'x', None, 0.065)
    assert len(scan.points) == 1999
    assert scan.unit == 'mm'
    assert any('1 points dropped' in note for note in scan.notes)


def test_a_scan_far_from_its_origin_keeps_all_its_points() -> None:
    text = '\n'.join(' '.join(f'{v:.3f}' for v in p + 5.4e6) for p in _ball(2000))
    assert len(_read(text, '.xyz')) == 2000
