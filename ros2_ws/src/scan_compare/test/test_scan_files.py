# SPDX-License-Identifier: Apache-2.0
"""Every scan format against trimesh and meshio, and oddities made by hand."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from scan_compare.scan_file import ScanFileError, parse_scan, read_mesh_file, read_scan

TETRAHEDRON = np.array([[0.0, 0, 0], [30, 0, 0], [0, 40, 0], [0, 0, 50]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def as_set(points: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(np.round(point, 4) + 0.0) for point in points}


def scan_of(text: str | bytes, suffix: str, unit: str = 'mm') -> np.ndarray:
    data = text if isinstance(text, bytes) else text.encode()
    return 1e3 * parse_scan(data, suffix, 'file' + suffix, unit).points


@pytest.fixture
def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=32.5)


@pytest.mark.parametrize(
    ('name', 'options'),
    [
        ('a.stl', {}),
        ('a.stl', {'file_type': 'stl_ascii'}),
        ('a.ply', {}),
        ('a.ply', {'encoding': 'ascii'}),
        ('a.obj', {}),
    ],
)
def test_a_mesh_written_by_trimesh_comes_back_welded(
    tmp_path: Path, ball: trimesh.Trimesh, name: str, options: dict[str, str]
) -> None:
    (tmp_path / name).write_bytes(_bytes(ball.export(**{'file_type': name[2:], **options})))
    scan = read_scan(tmp_path / name, 'mm')
    assert len(scan.points) == len(ball.vertices)
    assert scan.triangles is not None
    assert len(scan.triangles) == len(ball.faces)
    assert scan.vertex_areas().sum() == pytest.approx(1e-6 * ball.area, rel=1e-5)
    normals = scan.vertex_normals()
    outward = scan.points / np.linalg.norm(scan.points, axis=1, keepdims=True)
    assert np.min(np.einsum('ni,ni->n', normals, outward)) > 0.99


def _bytes(data: str | bytes) -> bytes:
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize(
    ('suffix', 'options'),
    [('stl', {'binary': True}), ('stl', {'binary': False}), ('ply', {'binary': True}),
     ('ply', {'binary': False}), ('obj', {})],
)  # fmt: skip
def test_a_mesh_written_by_meshio_comes_back(
    tmp_path: Path, ball: trimesh.Trimesh, suffix: str, options: dict[str, bool]
) -> None:
    path = tmp_path / f'a.{suffix}'
    meshio.Mesh(ball.vertices, [('triangle', ball.faces)]).write(path, **options)
    scan = read_scan(path, 'mm')
    assert len(scan.points) == len(ball.vertices)
    gap, _ = cKDTree(ball.vertices).query(1e3 * scan.points)
    assert gap.max() < 1e-4


def test_both_binary_orders_of_ply_read_alike() -> None:
    for order, word in (('<', 'little'), ('>', 'big')):
        header = (
            f'ply\nformat binary_{word}_endian 1.0\ncomment a\nelement vertex 4\n'
            'property double x\nproperty float q\nproperty double y\nproperty double z\n'
            'element face 4\nproperty list uchar int vertex_indices\nproperty uchar c\n'
            'end_header\n'
        )
        body = b''.join(struct.pack(f'{order}dfdd', p[0], 9.0, p[1], p[2]) for p in TETRAHEDRON)
        body += b''.join(struct.pack(f'{order}BiiiB', 3, *face, 7) for face in FACES)
        scan = parse_scan(header.encode() + body, '.ply', 'x', 'mm')
        assert np.allclose(1e3 * scan.points, TETRAHEDRON)
        assert np.array_equal(scan.triangles, FACES)


def test_polygons_are_cut_into_triangles_in_binary_and_ascii_ply() -> None:
    header = (
        'ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\n'
        'property float z\nelement face 2\nproperty list uchar int vertex_index\nend_header\n'
    )
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    binary = header.format('binary_little_endian').encode()
    binary += b''.join(struct.pack('<fff', *p) for p in square)
    binary += struct.pack('<Biiii', 4, 0, 1, 2, 3) + struct.pack('<Biii', 3, 0, 1, 3)
    ascii_text = header.format('ascii').encode()
    ascii_text += '\n'.join(' '.join(map(str, p)) for p in square).encode()
    ascii_text += b'\n4 0 1 2 3\n3 0 1 3\n'
    for data in (binary, ascii_text):
        triangles = parse_scan(data, '.ply', 'x', 'mm').triangles
        assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 3]]


def test_elements_that_are_not_vertices_or_faces_are_skipped_in_place() -> None:
    text = (
        'ply\nformat ascii 1.0\nelement camera 1\nproperty float a\nproperty list uchar int b\n'
        'element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n'
        '5 2 8 9\n0 0 0\n1 0 0\n0 1 0\n'
    )
    assert len(scan_of(text, '.ply')) == 3


def test_obj_groups_textures_negative_indices_and_continued_lines() -> None:
    text = (
        '# made by hand\r\nmtllib a.mtl\r\no thing\ng one\n'
        'v 0 0 0\nv 30 0 0 1.0 0.5 0.5 0.5\nvt 0 0\nvn 0 0 1\n  v\t0 40 0\n'
        'usemtl x\ns 1\nf 1/1/1 2//1 3/1\n'
        'g two\nv 0 0 50 # apex\nf -1 -2 \\\n -3\nf 1 2 4 3\n'
    )
    scan = parse_scan(text.encode(), '.obj', 'x', 'mm')
    assert as_set(1e3 * scan.points) == as_set(TETRAHEDRON)
    assert scan.triangles.tolist() == [[0, 1, 2], [3, 2, 1], [0, 1, 3], [0, 3, 2]]


@pytest.mark.parametrize(
    'text',
    [
        '1 2 3\n4 5 6\n',
        '1,2,3\r\n4,5,6\r\n',
        '1;2;3;255\r4;5;6;255\r',
        '# scan\n1\t2\t3\n// more\n\n4 5 6 # last',
        'x y z intensity\n1 2 3 9\n4 5 6 9\n',
        '2\n1 2 3\n4 5 6\n',
        '1e0 2E0 +3.0\n4. 5 6\nnan nan nan\n',
    ],
)
def test_xyz_in_every_dialect(text: str) -> None:
    assert scan_of(text, '.xyz').tolist() == [[1, 2, 3], [4, 5, 6]]


def test_obj_faces_after_a_form_feed_count_back_from_their_own_place() -> None:
    text = 'v 0 0 0\nv 30 0 0\nv 0 40 0\nf \x0c-3 -2 -1\nv 0 0 50\nf \x0b-4 -1 -3\n'
    scan = parse_scan(text.encode(), '.obj', 'x', 'mm')
    assert scan.triangles.tolist() == [[0, 1, 2], [0, 3, 1]]


def test_a_text_cloud_longer_than_one_piece_is_whole() -> None:
    points = np.random.default_rng(0).random((400_000, 3)).round(6)
    text = '\n'.join(f'{x:.6f} {y:.6f} {z:.6f}' for x, y, z in points)
    assert len(text) > 2 * 4 * 2**20
    assert np.allclose(scan_of(text, '.xyz', 'm'), 1e3 * points)


VRML = """#VRML V2.0 utf8
WorldInfo { info [ "a # b" ] title "scan" }
DEF SCAN Transform {
  translation 1 2 3  rotation 0 0 1 1.5707963  scale 2 2 2  # outer
  children [
    Shape {
      appearance Appearance { material Material { diffuseColor 1 0 0 } texture NULL }
      geometry IndexedFaceSet {
        solid FALSE ccw TRUE
        coord DEF C Coordinate { point [ 0 0 0, 1 0 0, 0 1 0, 0 0 1 ] }
        coordIndex [ 0 1 2 -1 0, 1, 3, 2, -1 ]
      }
    }
    Transform { translation 10 0 0 children Shape { geometry PointSet { coord USE C } } }
  ]
}
"""


def test_vrml_transforms_move_the_points() -> None:
    raw = parse_scan(VRML.encode(), '.wrl', 'x', 'm')
    local = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    both = np.concatenate((local, local + [10, 0, 0]))
    assert np.allclose(raw.points, 2.0 * both @ turn.T + [1, 2, 3], atol=1e-6)
    assert raw.triangles.tolist() == [[0, 1, 2], [0, 1, 3], [0, 3, 2]]


def test_vrml_clockwise_faces_are_turned_round() -> None:
    raw = parse_scan(VRML.replace('ccw TRUE', 'ccw FALSE').encode(), '.wrl', 'x', 'm')
    assert raw.triangles[0].tolist() == [2, 1, 0]


def test_vrml_scale_orientation_and_center_follow_the_standard() -> None:
    text = (
        '#VRML V2.0 utf8\nTransform { center 1 0 0 scale 2 1 1 '
        'scaleOrientation 0 0 1 1.5707963267948966 children Shape { geometry PointSet { '
        'coord Coordinate { point [ 1 0 0, 2 0 0, 1 1 0 ] } } } }'
    )
    points = 1e-3 * scan_of(text, '.wrl', 'm')
    assert np.allclose(points, [[1, 0, 0], [2, 0, 0], [1, 2, 0]])


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('#VRML V1.0 ascii\nSeparator { }', 'VRML V2.0'),
        ('#VRML V2.0 utf8\nShape { geometry USE NOTHING }', 'before its DEF'),
        ('#VRML V2.0 utf8\nPROTO A [ ] { }', 'PROTO'),
        ('#VRML V2.0 utf8\n' + 'Group { children ' * 3000, 'nested'),
        ('#VRML V2.0 utf8\n' + 'Group{}' * 60_000, 'more than'),
        ('#VRML V2.0 utf8\nShape { geometry IndexedFaceSet { coord Coordinate { point [ 0 0 0 ] '
         '} coordIndex [ 0 1 2 -1 ] } }', 'names vertex'),
        ('#VRML V2.0 utf8\nShape { geometry Sphere { } }', 'without any'),
        ('#VRML V2.0 utf8\nWorldInfo { title "open', 'quote'),
    ],
)  # fmt: skip
def test_vrml_that_is_no_scan_is_refused(text: str, words: str) -> None:
    with pytest.raises(ScanFileError, match=words):
        parse_scan(text.encode(), '.wrl', 'x', 'm')


def test_a_chain_of_vrml_uses_cannot_multiply_a_small_file() -> None:
    many = ' '.join(['0 0 1'] * 20_000)
    shape = f'Shape {{ geometry PointSet {{ coord Coordinate {{ point [{many}] }} }} }}'
    text = f'#VRML V2.0 utf8\nDEF S {shape}\n'
    with pytest.raises(ScanFileError, match='too often'):
        parse_scan((text + 'USE S\n' * 20_000).encode(), '.wrl', 'x', 'm')


@pytest.mark.parametrize('suffix', ['.ply', '.stl', '.obj', '.xyz', '.wrl'])
def test_an_empty_file_is_refused_by_name(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / ('nothing' + suffix)
    path.write_bytes(b'')
    with pytest.raises(ScanFileError, match='nothing.*empty'):
        read_scan(path, 'mm')


def test_a_missing_file_is_named() -> None:
    with pytest.raises(ScanFileError, match='no/such.stl: No such file'):
        read_scan('no/such.stl', 'mm')


def test_an_unknown_format_lists_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / 'a.scn').write_bytes(b'ours alone;')
    with pytest.raises(ScanFileError, match=r'\.scn.*export one of \.stl'):
        read_scan(tmp_path / 'a.scn', 'mm')


def test_a_ply_under_another_name_is_recognised(tmp_path: Path, ball: trimesh.Trimesh) -> None:
    (tmp_path / 'scan').write_bytes(_bytes(ball.export(file_type='ply')))
    assert len(read_scan(tmp_path / 'scan', 'mm').points) == len(ball.vertices)


def test_ten_million_declared_elements_in_a_small_file_are_refused() -> None:
    header = (
        'ply\nformat {} 1.0\nelement vertex 10000000\nproperty float x\nproperty float y\n'
        'property float z\nend_header\n0 0 0\n'
    )
    for order in ('ascii', 'binary_little_endian', 'binary_big_endian'):
        with pytest.raises(ScanFileError, match='declares 10000000 elements "vertex"'):
            parse_scan(header.format(order).encode(), '.ply', 'x', 'mm')
    stl = b'\0' * 80 + (10_000_000).to_bytes(4, 'little') + b'\0' * 500
    with pytest.raises(ScanFileError, match='declares 10000000 faces but holds 10'):
        parse_scan(stl, '.stl', 'x', 'mm')


def test_a_binary_stl_that_begins_with_solid_is_read_as_binary(ball: trimesh.Trimesh) -> None:
    data = _bytes(ball.export(file_type='stl'))
    data = b'solid facet normal vertex'.ljust(80) + data[80:]
    assert len(parse_scan(data, '.stl', 'x', 'mm').points) == len(ball.vertices)


def test_surplus_bytes_after_a_binary_stl_are_noted(ball: trimesh.Trimesh) -> None:
    scan = parse_scan(_bytes(ball.export(file_type='stl')) + b'extra', '.stl', 'x', 'mm')
    assert '5 bytes after the last face ignored' in scan.notes


def test_an_ascii_stl_cut_in_the_middle_is_refused() -> None:
    text = (
        b'solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n'
        b'endloop\nendfacet\nendsolid\n'
    )
    assert len(scan_of(text.upper(), '.stl')) == 3
    with pytest.raises(ScanFileError, match='opens 1 facets'):
        scan_of(text[:70], '.stl')


def test_nan_vertices_and_their_faces_are_dropped_and_counted() -> None:
    text = 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 2 3 4\n'
    scan = parse_scan(text.encode(), '.obj', 'x', 'mm')
    assert len(scan.points) == 3
    assert scan.triangles.tolist() == [[0, 1, 2]]
    assert any('1 points with NaN' in note for note in scan.notes)


def test_zero_area_and_repeated_faces_are_dropped_and_counted() -> None:
    text = 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 2 3 1\nf 1 2 4\nf 1 1 2\n'
    scan = parse_scan(text.encode(), '.obj', 'x', 'mm')
    assert scan.triangles.tolist() == [[0, 1, 2]]
    assert any('3 degenerate or repeated faces' in note for note in scan.notes)


def test_a_scan_of_only_nan_is_refused() -> None:
    with pytest.raises(ScanFileError, match='all 2 points are NaN'):
        scan_of('1 2 nan\nnan nan nan\n', '.xyz')


@pytest.mark.parametrize(
    ('text', 'suffix', 'words'),
    [
        ('1 2\n3 4\n', '.xyz', '2 columns'),
        ('1 2 3\n4 5\n', '.xyz', '3 columns at first and 2 later'),
        ('1 2 3\n4 5 b\n', '.xyz', "'b' is not a number"),
        ('v 1 2\n', '.obj', '2 coordinates'),
        ('v 0 0 0\nf 1 2 3\n', '.obj', 'names vertex'),
        ('v 0 0 0\nf 0 1 1\n', '.obj', 'index 0'),
        ('v 0 0 0\nf 1 1 1.5\n', '.obj', 'fraction'),
        ('v 0 0 0\nf /1 /1 /1\n', '.obj', 'no vertex index'),
        ('f -1 -2 -3 -4\n', '.obj', 'without any vertex'),
        ('ply\nformat ascii 1.0\nend_header\n', '.ply', 'vertex'),
        ('ply\nformat weird 1.0\nend_header\n', '.ply', 'not understood'),
        ('ply\nformat ascii 1.0\nelement vertex -3\nend_header\n', '.ply', "'-3'"),
    ],
)
def test_a_malformed_file_says_what_is_wrong(text: str, suffix: str, words: str) -> None:
    with pytest.raises(ScanFileError, match=words):
        scan_of(text, suffix)


def test_a_surface_file_keeps_order_and_repeated_vertices(tmp_path: Path) -> None:
    path = tmp_path / 'surface.obj'
    path.write_text('v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\n')
    assert len(read_mesh_file(path).points) == 4


def test_a_pipe_or_a_device_is_no_scan(tmp_path):
    os.mkfifo(tmp_path / 'scan.stl')
    for path in (tmp_path / 'scan.stl', Path('/dev/zero')):
        with pytest.raises(ScanFileError, match='no regular file'):
            read_mesh_file(path)
