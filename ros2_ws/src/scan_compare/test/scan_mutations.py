# SPDX-License-Identifier: Apache-2.0
"""Damaged scan files: seeds, random mutations and cuts; used by the tests and the long runs."""

from __future__ import annotations

import gzip
import resource
import struct
import tracemalloc
from collections.abc import Iterator

import numpy as np

from scan_compare.scan_file import ScanFileError, parse_scan

MEMORY_SLACK = 100 * 2**20
MEMORY_FACTOR = 8

_POINTS = np.array([[0.0, 0, 0], [30, 0, 0], [0, 40, 0], [0, 0, 50], [7, 8, 9]])
_FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 4)]
_WORDS = [
    b'nan', b'-1', b'0', b'4294967295', b'1e400', b'99999999999999999999', b'vertex',
    b'end_header', b'element vertex 10000000\n', b'element face 10000000\n',
    b'property list uchar int x\n',
    b'format ascii 1.0\n', b'{', b'}', b'[', b']', b'"', b'#', b'\\\n', b'\r', b'\0', b'\xff\xfe',
    b'USE S', b'DEF S ', b'f 1 2 3\n', b'f -1 -2 -3 -4\n', b'v 1 2 3\n', b'facet normal 0 0 1\n',
    b'\xb2', b'\x1f', b'\x85', '\u0663'.encode(), b',', b';', b'\t', b'-0',
]  # fmt: skip


def seeds() -> dict[str, tuple[str, bytes]]:
    """Small valid files of every format: name -> (suffix, bytes)."""
    lines = '\n'.join(' '.join(f'{v:g}' for v in p) for p in _POINTS)
    ply_head = (
        'ply\nformat {} 1.0\ncomment c\nelement vertex 5\nproperty float x\nproperty float y\n'
        'property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n'
    )
    faces = '\n'.join(f'3 {a} {b} {c}' for a, b, c in _FACES)
    files: dict[str, tuple[str, bytes]] = {
        'xyz': ('.xyz', (lines + '\n').encode()),
        'ply ascii': ('.ply', (ply_head.format('ascii') + lines + '\n' + faces + '\n').encode()),
    }
    for order, word in (('<', 'little'), ('>', 'big')):
        body = b''.join(struct.pack(order + 'fff', *p) for p in _POINTS)
        body += b''.join(struct.pack(order + 'Biii', 3, *f) for f in _FACES)
        head = ply_head.format(f'binary_{word}_endian').encode()
        files[f'ply {word}'] = ('.ply', head + body)
    stl = b'binary'.ljust(80) + struct.pack('<I', len(_FACES))
    text = 'solid a\n'
    for face in _FACES:
        corners = [float(v) for k in face for v in _POINTS[k]]
        stl += struct.pack('<12fH', 0, 0, 1, *corners, 0)
        text += 'facet normal 0 0 1\n outer loop\n'
        text += ''.join(' vertex {:g} {:g} {:g}\n'.format(*_POINTS[k]) for k in face)
        text += ' endloop\nendfacet\n'
    files['stl binary'] = ('.stl', stl)
    files['stl ascii'] = ('.stl', (text + 'endsolid a\n').encode())
    obj = ''.join('v {:g} {:g} {:g}\n'.format(*p) for p in _POINTS) + 'g a\nvt 0 0\n'
    obj += ''.join(f'f {a + 1}/1 {b + 1}/1 {c + 1}/1\n' for a, b, c in _FACES) + 'f -1 -2 -3 -4\n'
    files['obj'] = ('.obj', obj.encode())
    index = ', '.join(f'{a}, {b}, {c}, -1' for a, b, c in _FACES)
    files['vrml'] = (
        '.wrl',
        (
            '#VRML V2.0 utf8\nDEF S Transform { translation 1 0 0 rotation 0 0 1 0.5 children [\n'
            f'Shape {{ geometry IndexedFaceSet {{ coord Coordinate {{ point [ {lines} ] }}\n'
            f'coordIndex [ {index} ] }} }} ] }}\nROUTE A.b TO C.d\nUSE S\n'
        ).encode(),
    )
    cloud = ''.join('{:g};{:g};{:g};7\n'.format(*p) for p in _POINTS)
    files['csv'] = ('.csv', ('x;y;z;i\n' + cloud).replace('.', ',').encode())
    files['pts'] = ('.pts', f'5\n{lines}\n'.encode())
    files['utf-16'] = ('.txt', lines.encode('utf-16'))
    files['off'] = (
        '.off',
        f'COFF\n5 4 0\n{lines}\n{faces}\n'.encode(),
    )
    strip = [0, 2, 1, 3, -1, 0, 3, 4]
    files['ply strips'] = (
        '.ply',
        (
            ply_head.format('ascii')
            .replace('face 4', 'tristrips 1')
            .replace('list uchar', 'list int')
            + f'{lines}\n8 {" ".join(map(str, strip))}\n'
        ).encode(),
    )
    wedge = ply_head.format('binary_little_endian').replace(
        'end_header', 'property list uchar float texcoord\nend_header'
    )
    body = b''.join(struct.pack('<fff', *p) for p in _POINTS)
    body += b''.join(struct.pack('<BiiiB6f', 3, *f, 6, *range(6)) for f in _FACES)
    files['ply wedges'] = ('.ply', wedge.encode() + body)
    files.update(_pcd_seeds(lines))
    files['gzip'] = ('.stl', gzip.compress(files['stl binary'][1], mtime=0))
    return files


def _pcd_seeds(lines: str) -> dict[str, tuple[str, bytes]]:
    head = (
        '# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 5\n'
        'HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 5\nDATA '
    )
    plain = _POINTS.astype('<f4').T.tobytes()
    # runs of 32 literals, and a copy of four bytes that runs into itself
    packed = b'\x1f' + plain[:32] + b'\x1b' + plain[32:]
    sizes = struct.pack('<II', len(packed), len(plain))
    return {
        'pcd ascii': ('.pcd', f'{head}ascii\n{lines}\n'.encode()),
        'pcd binary': ('.pcd', f'{head}binary\n'.encode() + _POINTS.astype('<f4').tobytes()),
        'pcd packed': ('.pcd', f'{head}binary_compressed\n'.encode() + sizes + packed),
    }


def mutate(data: bytes, generator: np.random.Generator) -> bytes:
    """Return `data` with one to four random changes."""
    changed = bytearray(data)
    for _ in range(int(generator.integers(1, 5))):
        place = int(generator.integers(0, len(changed) + 1))
        kind = int(generator.integers(0, 6))
        if kind == 0 and place < len(changed):
            changed[place] = int(generator.integers(0, 256))
        elif kind == 1:
            changed[place:place] = _WORDS[int(generator.integers(0, len(_WORDS)))]
        elif kind == 2:
            del changed[place : place + int(generator.integers(1, 20))]
        elif kind == 3:
            piece = changed[place : place + int(generator.integers(1, 60))]
            changed[place:place] = piece * int(generator.integers(1, 4))
        elif kind == 4 and place < len(changed):
            changed[place] ^= 1 << int(generator.integers(0, 8))
        elif kind == 5:
            changed = changed[:place]
    return bytes(changed)


def read_or_refuse(data: bytes, suffix: str) -> bool:
    """Read damaged bytes; True if read, False if refused by ScanFileError; others escape."""
    try:
        scan = parse_scan(data, suffix, 'damaged', 'mm')
    except ScanFileError:
        return False
    assert np.all(np.isfinite(scan.points))
    if scan.triangles is not None:
        assert scan.triangles.min() >= 0
        assert scan.triangles.max() < len(scan.points)
    return True


def run(count: int, seed: int) -> tuple[int, int]:
    """Read `count` mutations of every kind of file in turn.

    Returns how many were read and the largest memory one of them took [bytes]; raises whatever is
    no ScanFileError, and AssertionError if memory exceeds its bound.
    """
    read, largest = 0, 0
    tracemalloc.start()
    try:
        for suffix, damaged in mutations(count, seed):
            tracemalloc.reset_peak()
            read += read_or_refuse(damaged, suffix)
            peak = tracemalloc.get_traced_memory()[1]
            assert peak < MEMORY_FACTOR * len(damaged) + MEMORY_SLACK
            largest = max(largest, peak)
    finally:
        tracemalloc.stop()
    return read, largest


def run_fast(count: int, seed: int) -> tuple[int, int]:
    """As `run`, in a process of its own: its peak memory stands for that of every mutation.

    Returns how many were read and by how much the peak of the process grew [bytes].
    """
    for suffix, data in seeds().values():
        read_or_refuse(data, suffix)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = sum(read_or_refuse(damaged, suffix) for suffix, damaged in mutations(count, seed))
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    assert grown < MEMORY_SLACK
    return read, grown


def mutations(count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Yield suffix and bytes of `count` damaged files, of every kind in turn."""
    generator = np.random.default_rng(seed)
    files = list(seeds().values())
    for number in range(count):
        suffix, data = files[number % len(files)]
        yield suffix, mutate(data, generator)
