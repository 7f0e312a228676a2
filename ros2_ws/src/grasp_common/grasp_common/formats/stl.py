# SPDX-License-Identifier: Apache-2.0
"""STL, binary and ASCII. Every corner is stored anew: vertices are welded by the caller."""

from __future__ import annotations

import re

import numpy as np

from grasp_common.formats.raw import (
    RawMesh,
    Rows,
    ScanFileError,
    chunks_of_lines,
    parse_numbers,
    refuse_swapped,
)

HEADER_BYTES = 80
FACE = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])

_NOT_A_VERTEX_LINE = re.compile(rb'^(?![ \t\f\v]*vertex\s)[^\n]*$', re.IGNORECASE | re.MULTILINE)
_VERTEX = re.compile(rb'^[ \t\f\v]*vertex', re.IGNORECASE | re.MULTILINE)
_END = re.compile(rb'[\r\n]\s*end\s*solid\b', re.IGNORECASE)
_NO_END = 'ASCII STL without "endsolid" at its end: it may be cut there'
_FACET = re.compile(rb'^\s*facet\b', re.IGNORECASE | re.MULTILINE)


def read_stl(data: bytes) -> RawMesh:
    """Read STL; a file whose size fits its binary face count is binary, whatever it begins with.

    Raises ScanFileError if faces are missing, cut or unreadable.
    """
    if len(data) >= HEADER_BYTES + 4:
        declared = int.from_bytes(data[HEADER_BYTES : HEADER_BYTES + 4], 'little')
        if len(data) == HEADER_BYTES + 4 + declared * FACE.itemsize:
            return _read_binary(data, declared)
    named_solid = data[:512].lstrip()[:5].lower() == b'solid'
    if named_solid and _FACET.search(data[:8192].replace(b'\r', b'\n')):
        return _read_ascii(data)
    if named_solid and b'\0' not in data:
        raise ScanFileError('ASCII STL without any facet; export the object again')
    if len(data) < HEADER_BYTES + 4:
        raise ScanFileError(
            f'{len(data)} bytes are neither ASCII STL nor a binary header of 84 bytes'
        )
    return _read_binary(data, declared)


def _read_binary(data: bytes, declared: int) -> RawMesh:
    present, surplus = divmod(len(data) - HEADER_BYTES - 4, FACE.itemsize)
    if not surplus and present and int.from_bytes(data[80:84], 'big') == present:
        raise ScanFileError(
            f'binary STL whose {present} faces are stored in big-endian byte order, which the '
            'format does not have; export it again'
        )
    if not surplus and declared < present:
        raise ScanFileError(
            f'binary STL declares {declared} faces but holds {present}: its count is wrong; '
            'export it again'
        )
    if present < declared:
        raise ScanFileError(
            f'binary STL declares {declared} faces but holds {present}; export or copy it again'
        )
    faces = np.frombuffer(data, FACE, declared, HEADER_BYTES + 4)
    refuse_swapped(faces['corners'], 'binary STL')
    points = faces['corners'].reshape(-1, 3).astype(float)
    notes: tuple[str, ...] = ()
    surplus = len(data) - HEADER_BYTES - 4 - declared * FACE.itemsize
    if surplus:
        notes = (f'{surplus} bytes after the last face ignored',)
    return RawMesh(points, np.arange(len(points), dtype=np.int32).reshape(-1, 3), notes)


def _read_ascii(data: bytes) -> RawMesh:
    coordinates = Rows(np.float64, 1)
    facets = 0
    for chunk in chunks_of_lines(data):
        facets += len(_FACET.findall(chunk))
        vertices = _VERTEX.sub(b'', _NOT_A_VERTEX_LINE.sub(b'', chunk))
        coordinates.add(parse_numbers(vertices, 'ASCII STL vertex'))
    if len(coordinates) != 9 * facets:
        raise ScanFileError(
            f'ASCII STL opens {facets} facets, which need {9 * facets} vertex coordinates, '
            f'but holds {len(coordinates)}; the file is cut or malformed'
        )
    points = coordinates.table().reshape(-1, 3)
    notes = () if _END.search(data, max(0, len(data) - 8192)) else (_NO_END,)
    return RawMesh(points, np.arange(len(points), dtype=np.int32).reshape(-1, 3), notes)
