# SPDX-License-Identifier: Apache-2.0
"""OFF (Geomview) in text: vertices and polygons; colours, normals and textures ignored.

Not from trimesh, which reads plain `OFF` alone: scanners and MeshLab write `COFF` and `NOFF`.
"""

from __future__ import annotations

import re

import numpy as np

from grasp_common.formats.ply import TextBody
from grasp_common.formats.ply_header import Element, Property
from grasp_common.formats.raw import (
    RawMesh,
    Rows,
    ScanFileError,
    checked_triangles,
    chunks_of_lines,
    parse_numbers,
    tokens_per_line,
    triangles_from_polygons,
)

_HEADER = re.compile(rb'\s*(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z])[ \t]*(BINARY)?')
_COMMENT = re.compile(rb'#[^\n\r]*')
_VERTEX = [Property(axis, 'f8', None) for axis in 'xyz']
_FACE = [Property('vertex_indices', 'i4', 'i4')]
_COUNTS = re.compile(rb'\s*(\d{1,18})\s+(\d{1,18})(\s+\d{1,18})?[ \t]*(?=[\r\n]|\Z)')


def read_off(data: bytes) -> RawMesh:
    """Read OFF; raises ScanFileError if it is malformed or shorter than it declares."""
    if b'#' in data:
        data = _COMMENT.sub(b'', data)
    header = _HEADER.match(data)
    start = header.end() if header else 0
    if header and (header[4] or header[5] or header[6]):
        raise ScanFileError('OFF in binary or in more than three dimensions; export PLY')
    counts = _COUNTS.match(data, start)
    if not counts:
        raise ScanFileError('OFF without its line of vertices, faces and edges')
    wanted = int(counts[1]), int(counts[2])
    try:
        points, triangles = _by_line(data, counts.end(), wanted)
    except ScanFileError:
        # without colours and normals the numbers alone tell, wherever lines are broken
        free = None if header and any(header.groups()) else _free(data, counts.end(), wanted)
        if free is None:
            raise
        points, triangles = free
    if not len(triangles):
        return RawMesh(points, None)
    return RawMesh(points, checked_triangles(triangles, len(points)))


def _free(
    data: bytes, start: int, wanted: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Points and triangles of numbers in lines of any length; None where they do not fit."""
    body = TextBody(data, start)
    try:
        points = body.points(Element('vertex', wanted[0], _VERTEX))
        triangles = body.triangles(Element('face', wanted[1], _FACE))
        return None if body.rest() else (points, triangles)
    except ScanFileError:
        return None


def _by_line(data: bytes, start: int, wanted: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and triangles (m, 3) of a file with a line for each; raises ScanFileError."""
    points, triangles, faces, surplus = Rows(np.float64, 3), Rows(np.int32, 3), 0, 0
    for chunk in chunks_of_lines(data, start):
        sizes = tokens_per_line(chunk)
        if sizes.size == 0:
            continue
        numbers = parse_numbers(chunk, 'OFF number')
        firsts = np.cumsum(sizes) - sizes
        vertices = min(wanted[0] - len(points), len(sizes))
        if vertices:
            if int(sizes[:vertices].min()) < 3:
                raise ScanFileError('OFF vertex with fewer than 3 coordinates')
            points.add(numbers[firsts[:vertices, None] + np.arange(3)])
        rows = slice(vertices, min(len(sizes), vertices + wanted[1] - faces))
        if firsts[rows].size:
            corners = _counts_of(numbers, firsts[rows], sizes[rows])
            places = np.repeat(firsts[rows] + 1, corners) + _steps(corners)
            triangles.add(triangles_from_polygons(corners, _indices(numbers[places])))
            faces += len(corners)
        surplus += len(sizes) - rows.stop
    if (len(points), faces, surplus) != (*wanted, 0):
        raise ScanFileError(
            f'OFF declares {wanted[0]} vertices and {wanted[1]} faces but holds {len(points)} and '
            f'{faces + surplus}; the file is cut or its header is wrong: export it again'
        )
    return points.table(), triangles.table()


def _counts_of(numbers: np.ndarray, firsts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """How many corners (f,) each face has, of `sizes` numbers; raises ScanFileError."""
    corners = numbers[firsts]
    if not np.all((corners >= 0) & (corners == np.floor(corners)) & (corners < sizes)):
        raise ScanFileError('OFF face whose number of corners does not fit its line')
    return corners.astype(np.int64)


def _steps(counts: np.ndarray) -> np.ndarray:
    """0, 1, ... within each of the given counts, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)


def _indices(values: np.ndarray) -> np.ndarray:
    if not np.all((values == np.floor(values)) & (values >= 0) & (values < 2**31)):
        raise ScanFileError('OFF face with an index that is no vertex')
    return values.astype(np.int32)
