# SPDX-License-Identifier: Apache-2.0
"""Wavefront OBJ: vertices and faces of all groups; textures, normals and materials ignored."""

from __future__ import annotations

import re

import numpy as np

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

_NOT_A_VERTEX = re.compile(rb'^(?![ \t]*v[ \t])[^\n]*$', re.MULTILINE)
_NOT_A_FACE = re.compile(rb'^(?![ \t]*f[ \t])[^\n]*$', re.MULTILINE)
_KEYWORD = re.compile(rb'^[ \t]*[vf](?=[ \t])', re.MULTILINE)
_COMMENT = re.compile(rb'#[^\n]*')
_AFTER_SLASH = re.compile(rb'/[^\s]*')


def read_obj(data: bytes) -> RawMesh:
    """Read the vertices and polygons of an OBJ file.

    Indices count from one, negative ones back from the last vertex read so far. Columns after
    z (weights, colours) are ignored. Raises ScanFileError for anything unreadable.
    """
    if b'\\' in data:
        data = data.replace(b'\\\r\n', b' ').replace(b'\\\n', b' ')
    points = Rows(np.float64, 3)
    triangles = Rows(np.int32, 3)
    for chunk in chunks_of_lines(data):
        text = _COMMENT.sub(b'', chunk) if b'#' in chunk else chunk
        before = len(points)
        lines_v = _KEYWORD.sub(b'', _NOT_A_VERTEX.sub(b'', text))
        columns = tokens_per_line(lines_v)
        if columns.size:
            points.add(_coordinates(lines_v, columns))
        lines_f = _KEYWORD.sub(b'', _NOT_A_FACE.sub(b'', text))
        if lines_f and not lines_f.isspace():
            indices = parse_numbers(_AFTER_SLASH.sub(b'', lines_f), 'OBJ face')
            sizes = tokens_per_line(lines_f)
            if int(sizes.sum()) != indices.size:
                raise ScanFileError('OBJ face with a corner that has no vertex index')
            corners = _absolute(indices, sizes, text, before)
            triangles.add(triangles_from_polygons(sizes, corners))
    if not len(points):
        raise ScanFileError('OBJ file without any vertex')
    if not len(triangles):
        return RawMesh(points.table(), None)
    return RawMesh(points.table(), checked_triangles(triangles.table(), len(points)))


def _coordinates(text: bytes, columns: np.ndarray) -> np.ndarray:
    if int(columns.min()) < 3:
        raise ScanFileError(f'OBJ vertex with {int(columns.min())} coordinates; 3 are needed')
    numbers = parse_numbers(text, 'OBJ vertex')
    first = np.cumsum(columns) - columns
    return numbers[first[:, None] + np.arange(3)]


def _absolute(
    indices: np.ndarray, sizes: np.ndarray, text: bytes, points_before: int
) -> np.ndarray:
    """Turn one-based and relative indices (k,) into zero-based ones."""
    if not np.all(np.isfinite(indices)) or np.any(np.abs(indices) > 2**31 - 2):
        raise ScanFileError('OBJ face with an index that is not a 32-bit integer')
    whole = indices.astype(np.int64)
    if np.any(whole == 0) or np.any(whole != indices):
        raise ScanFileError('OBJ face with index 0 or a fraction; indices count from 1')
    if np.all(whole > 0):
        return (whole - 1).astype(np.int32)
    seen = _vertices_before_each_face(text, points_before)
    return np.where(whole > 0, whole - 1, whole + np.repeat(seen, sizes)).astype(np.int32)


def _vertices_before_each_face(text: bytes, points_before: int) -> np.ndarray:
    keywords = re.findall(rb'^[ \t]*([vf])[ \t]+[^\s]', text, re.MULTILINE)
    is_face = np.array([keyword == b'f' for keyword in keywords], bool)
    return points_before + np.cumsum(~is_face)[is_face]
