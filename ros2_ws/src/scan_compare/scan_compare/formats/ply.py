"""PLY, ASCII and binary of both byte orders: vertex positions and faces, the rest skipped."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan_compare.formats.raw import (
    RawMesh,
    ScanFileError,
    checked_triangles,
    chunks_of_lines,
    parse_numbers,
    triangles_from_polygons,
)

LARGEST_HEADER = 2**16
PIECE = 2**18
"""Numbers or bytes of faces of mixed sizes that are gathered at once."""

_TYPES = {
    **dict.fromkeys(('char', 'int8'), 'i1'),
    **dict.fromkeys(('uchar', 'uint8'), 'u1'),
    **dict.fromkeys(('short', 'int16'), 'i2'),
    **dict.fromkeys(('ushort', 'uint16'), 'u2'),
    **dict.fromkeys(('int', 'int32'), 'i4'),
    **dict.fromkeys(('uint', 'uint32'), 'u4'),
    **dict.fromkeys(('float', 'float32'), 'f4'),
    **dict.fromkeys(('double', 'float64'), 'f8'),
}
_ORDERS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    count_type: str | None


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def lists(self) -> list[_Property]:
        return [item for item in self.properties if item.count_type is not None]


def read_ply(data: bytes) -> RawMesh:
    """Read PLY; raises ScanFileError if the header is malformed or promises more than is there."""
    order, elements, body = _header(data)
    vertex = [element for element in elements if element.name == 'vertex']
    if len(vertex) != 1 or vertex[0].lists:
        raise ScanFileError('PLY needs one element "vertex" with scalar properties only')
    if {'x', 'y', 'z'} - {item.name for item in vertex[0].properties}:
        raise ScanFileError('PLY vertices without properties x, y and z')
    table: _BinaryBody | _AsciiBody = (
        _BinaryBody(data, body, order) if order else _AsciiBody(data, body)
    )
    points = np.empty((0, 3))
    triangles = None
    for element in elements:
        if element.name == 'vertex':
            points = table.points(element)
        elif element.name == 'face' and len(element.lists) == 1:
            sizes, corners = table.polygons(element)
            triangles = triangles_from_polygons(sizes, corners)
        else:
            table.skip(element)
    if triangles is not None:
        triangles = checked_triangles(triangles, len(points)) if len(triangles) else None
    return RawMesh(points, triangles)


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """Return byte order ('' for ASCII), elements and the offset of the body."""
    end = data.find(b'end_header', 0, LARGEST_HEADER)
    if not data.startswith(b'ply') or end < 0:
        raise ScanFileError('PLY header without "ply" at its start or "end_header" at its end')
    body = end + len(b'end_header')
    body += 2 if data[body : body + 2] == b'\r\n' else 1
    order = None
    elements: list[_Element] = []
    for line in data[3:end].decode('latin-1').replace('\r', '\n').split('\n'):
        words = line.split()
        if not words or words[0] in ('comment', 'obj_info'):
            continue
        try:
            if words[0] == 'format':
                order = _ORDERS[words[1]]
            elif words[0] == 'element':
                elements.append(_Element(words[1], _count(words[2]), []))
            elif words[0] == 'property':
                elements[-1].properties.append(_property(words))
            else:
                raise ScanFileError(f'PLY header line not understood: {line[:60]!r}')
        except (KeyError, IndexError):
            raise ScanFileError(f'PLY header line not understood: {line[:60]!r}') from None
    if order is None:
        raise ScanFileError('PLY header without a format line')
    return order, elements, body


def _count(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 19):
        raise ScanFileError(f'PLY element count {word[:40]!r} is not a number of elements')
    return int(word)


def _property(words: list[str]) -> _Property:
    if words[1] == 'list':
        count_type = _TYPES[words[2]]
        if count_type.startswith('f'):
            raise ScanFileError('PLY list with a count that is not an integer type')
        return _Property(words[4], _TYPES[words[3]], count_type)
    return _Property(words[2], _TYPES[words[1]], None)


def _missing(element: _Element, present: int) -> ScanFileError:
    return ScanFileError(
        f'PLY declares {element.count} elements "{element.name}" but holds about {present}; '
        'the file is cut or its header is wrong'
    )


class _BinaryBody:
    """Reads elements one after the other from bytes, each checked against what is left."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data = data
        self._position = min(start, len(data))
        self._order = order

    def _records(self, element: _Element, fields: list[tuple[str, str]]) -> np.ndarray:
        record = np.dtype([(f'f{k}', self._order + kind) for k, (_, kind) in enumerate(fields)])
        if element.count == 0 or record.itemsize == 0:
            return np.empty(0, record)
        left = len(self._data) - self._position
        if element.count * record.itemsize > left:
            raise _missing(element, left // record.itemsize)
        table = np.frombuffer(self._data, record, element.count, self._position)
        self._position += element.count * record.itemsize
        return table

    def points(self, element: _Element) -> np.ndarray:
        names = [item.name for item in element.properties]
        table = self._records(element, [(item.name, item.type) for item in element.properties])
        points = np.empty((len(table), 3))
        for axis, name in enumerate('xyz'):
            points[:, axis] = table[f'f{names.index(name)}']
        return points

    def polygons(self, element: _Element) -> tuple[np.ndarray, np.ndarray]:
        triangles = self._all_triangles(element)
        if triangles is not None:
            return np.full(len(triangles), 3, np.int32), triangles.reshape(-1)
        kind = np.dtype(self._order + element.lists[0].type)
        stored = np.frombuffer(self._data, np.uint8)
        return _corners(
            *self._walk(element),
            kind.itemsize,
            lambda place: stored[place].view(kind),
        )

    def _all_triangles(self, element: _Element) -> np.ndarray | None:
        """Read (m, 3) at once when every face has three corners; None if one has not."""
        fields: list[tuple[str, str]] = []
        column = 0
        for item in element.properties:
            if item.count_type is None:
                fields.append((item.name, item.type))
                continue
            column = len(fields)
            fields += [('count', item.count_type)] + [('corner', item.type)] * 3
        start = self._position
        try:
            table = self._records(element, fields)
        except ScanFileError:
            return None
        if not np.all(table[f'f{column}'] == 3):
            self._position = start
            return None
        return np.column_stack([_integers(table[f'f{column + k}']) for k in (1, 2, 3)])

    def _walk(self, element: _Element) -> tuple[np.ndarray, np.ndarray]:
        """Find every list of an element of mixed sizes: its length, and its first byte."""
        data, position = self._data, self._position
        sizes, starts = array('i'), array('q')
        steps = [
            (item.count_type and struct.Struct(self._order + np.dtype(item.count_type).char),
             np.dtype(item.type).itemsize)
            for item in element.properties
        ]  # fmt: skip
        if element.count > len(data) - position:
            raise _missing(element, len(data) - position)
        for face in range(element.count):
            for reader, item_bytes in steps:
                count, start = 1, position
                if reader:
                    start += reader.size
                    if start > len(data):
                        raise _missing(element, face)
                    (count,) = reader.unpack_from(data, position)
                position = start + count * item_bytes
                if count < 0 or position > len(data):
                    raise _missing(element, face)
                if reader:
                    sizes.append(count)
                    starts.append(start)
        self._position = position
        return np.array(sizes, np.int32), np.array(starts, np.int64)

    def skip(self, element: _Element) -> None:
        if not element.lists:
            self._records(element, [(item.name, item.type) for item in element.properties])
        else:
            self._walk(element)


class _AsciiBody:
    """Reads elements one after the other from the numbers of the text."""

    def __init__(self, data: bytes, start: int) -> None:
        pieces = [parse_numbers(chunk, 'ASCII PLY') for chunk in chunks_of_lines(data, start)]
        self._numbers = np.concatenate(pieces) if pieces else np.empty(0)
        self._position = 0

    def points(self, element: _Element) -> np.ndarray:
        names = [item.name for item in element.properties]
        table = self._table(element, len(names))
        return table[:, [names.index(axis) for axis in 'xyz']]

    def _table(self, element: _Element, columns: int) -> np.ndarray:
        stop = self._position + element.count * columns
        if stop > self._numbers.size:
            raise _missing(element, (self._numbers.size - self._position) // max(columns, 1))
        table = self._numbers[self._position : stop].reshape(-1, max(columns, 1))
        self._position = stop
        return table

    def polygons(self, element: _Element) -> tuple[np.ndarray, np.ndarray]:
        column = [item.count_type is not None for item in element.properties].index(True)
        columns = len(element.properties) + 3
        start = self._position
        if start + element.count * columns <= self._numbers.size:
            table = self._table(element, columns)
            if np.all(table[:, column] == 3):
                corners = _integers(table[:, column + 1 : column + 4])
                return np.full(len(table), 3, np.int32), corners.reshape(-1)
            self._position = start
        return _corners(*self._walk(element), 1, lambda place: self._numbers[place])

    def _walk(self, element: _Element) -> tuple[np.ndarray, np.ndarray]:
        """Find every list of an element of mixed sizes: its length, and its first number."""
        numbers, position = self._numbers, self._position
        sizes, starts = array('i'), array('q')
        steps = [item.count_type is not None for item in element.properties]
        if element.count > numbers.size - position:
            raise _missing(element, numbers.size - position)
        for face in range(element.count):
            for is_list in steps:
                count = 1
                if is_list:
                    count = _list_length(numbers, position)
                    position += 1
                    sizes.append(count)
                    starts.append(position)
                position += count
            if position > numbers.size:
                raise _missing(element, face)
        self._position = position
        return np.array(sizes, np.int32), np.array(starts, np.int64)

    def skip(self, element: _Element) -> None:
        if not element.lists:
            self._table(element, len(element.properties))
        else:
            self._walk(element)


def _corners(
    sizes: np.ndarray, starts: np.ndarray, step: int, read: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return `sizes` (p,) and the corners of all polygons in their order.

    starts (p,): place of the first corner of each; step: places per corner; read: (k, places) ->
    (k, corners). Polygons of one size are read together, a piece at a time.
    """
    ends = np.cumsum(sizes, dtype=np.int64)
    corners = np.empty(int(ends[-1]) if len(ends) else 0, np.int32)
    for size in np.unique(sizes[sizes > 0]).tolist():
        members = np.flatnonzero(sizes == size)
        per_piece = max(1, PIECE // (step * size))
        for first in range(0, len(members), per_piece):
            piece = members[first : first + per_piece]
            values = read(starts[piece, None] + np.arange(step * size))
            corners[(ends[piece] - size)[:, None] + np.arange(size)] = _integers(values)
    return sizes, corners


def _list_length(numbers: np.ndarray, position: int) -> int:
    if position >= numbers.size or not 0 <= numbers[position] <= numbers.size:
        raise ScanFileError('ASCII PLY with a face whose number of corners is missing or absurd')
    return int(numbers[position])


def _integers(values: np.ndarray) -> np.ndarray:
    """Return vertex indices as int32; raises ScanFileError for one that is no whole number."""
    if values.dtype.kind == 'f':
        if not np.all(np.isfinite(values)) or np.any(np.abs(values) > 2**31):
            raise ScanFileError('PLY face with an index that is not a 32-bit integer')
        if np.any(values != np.floor(values)):
            raise ScanFileError('PLY face with a fraction for a vertex index')
    # what is no vertex of 32 bits turns negative here and is refused with the faces
    return values.astype(np.int32)
