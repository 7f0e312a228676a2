"""PLY, ASCII and binary of both byte orders: vertex positions and faces, the rest skipped."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from scan_compare.formats.raw import (
    CHUNK_FACES,
    RawMesh,
    Rows,
    ScanFileError,
    checked_triangles,
    chunks_of_words,
    parse_numbers,
    triangles_from_polygons,
)

LARGEST_HEADER = 2**16
PIECE = 2**18
"""Numbers, bytes or vertices that are gathered at once."""

LARGEST_LIST = 2**20
"""Most items of one list in a file whose lists are walked through."""

MOST_BYTE_FACES = 2**20
"""Most faces whose indices have one byte: they cannot name more than 256 vertices."""

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
    types = {item.name: item.type for item in vertex[0].properties}
    if {'x', 'y', 'z'} - set(types):
        raise ScanFileError('PLY vertices without properties x, y and z')
    if order and {types[axis] for axis in 'xyz'} & {'i1', 'u1'}:
        raise ScanFileError('PLY coordinates of 8 bits are no scan; export float')
    table: _BinaryBody | _AsciiBody = (
        _BinaryBody(data, body, order) if order else _AsciiBody(data, body)
    )
    points = np.empty((0, 3))
    triangles = None
    for element in elements:
        if element.name == 'vertex':
            points = table.points(element)
        elif element.name == 'face' and len(element.lists) == 1:
            triangles = table.triangles(element)
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

    def _records(self, element: _Element, fields: list[tuple[str, str]], count: int) -> np.ndarray:
        """Read the next `count` of the element's records, all of one size."""
        record = np.dtype([(f'f{k}', self._order + kind) for k, (_, kind) in enumerate(fields)])
        if count == 0 or record.itemsize == 0:
            return np.empty(0, record)
        left = len(self._data) - self._position
        if count * record.itemsize > left:
            raise _missing(element, left // record.itemsize)
        table = np.frombuffer(self._data, record, count, self._position)
        self._position += count * record.itemsize
        return table

    def _scalars(self, element: _Element) -> np.ndarray:
        fields = [(item.name, item.type) for item in element.properties]
        return self._records(element, fields, element.count)

    def points(self, element: _Element) -> np.ndarray:
        names = [item.name for item in element.properties]
        table = self._scalars(element)
        points = np.empty((len(table), 3))
        for axis, name in enumerate('xyz'):
            points[:, axis] = table[f'f{names.index(name)}']
        return points

    def triangles(self, element: _Element) -> np.ndarray:
        kind = np.dtype(self._order + element.lists[0].type)
        if kind.itemsize == 1 and element.count > MOST_BYTE_FACES:
            raise ScanFileError(
                f'PLY declares {element.count} faces whose indices of 8 bits name 256 vertices at '
                'most; export with indices of 32 bits'
            )
        stored = np.frombuffer(self._data, np.uint8)
        triangles = Rows(np.int32, 3)
        for count in _pieces(element.count):
            piece = self._all_triangles(element, count)
            if piece is None:
                piece = _fans(
                    *self._walk(element, count),
                    kind.itemsize,
                    lambda place: stored[place].view(kind),
                )
            triangles.add(piece)
        return triangles.table()

    def _all_triangles(self, element: _Element, faces: int) -> np.ndarray | None:
        """Read (faces, 3) at once when each has three corners; None if one has not."""
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
            table = self._records(element, fields, faces)
        except ScanFileError:
            return None
        if not np.all(table[f'f{column}'] == 3):
            self._position = start
            return None
        return np.column_stack([_integers(table[f'f{column + k}']) for k in (1, 2, 3)])

    def _walk(self, element: _Element, faces: int) -> tuple[np.ndarray, np.ndarray]:
        """Find every list of the next `faces` elements: its length, and its first byte."""
        data, position = self._data, self._position
        sizes, starts = array('i'), array('q')
        steps = [
            (item.count_type and struct.Struct(self._order + np.dtype(item.count_type).char),
             np.dtype(item.type).itemsize)
            for item in element.properties
        ]  # fmt: skip
        for face in range(faces):
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
                    sizes.append(min(count, LARGEST_LIST))
                    starts.append(start)
        self._position = position
        return np.array(sizes, np.int32), np.array(starts, np.int64)

    def skip(self, element: _Element) -> None:
        if not element.lists:
            self._scalars(element)
            return
        for count in _pieces(element.count):
            self._walk(element, count)


class _AsciiBody:
    """Reads elements one after the other from the numbers of the text, a piece at a time."""

    def __init__(self, data: bytes, start: int) -> None:
        self._chunks = chunks_of_words(data, start)
        self._numbers = np.empty(0)
        self._position = 0

    def _fill(self, wanted: int) -> int:
        """Read on until `wanted` numbers lie ahead, or the text ends; returns how many do."""
        ahead = [self._numbers[self._position :]]
        count = ahead[0].size
        if count < wanted:
            for chunk in self._chunks:
                ahead.append(parse_numbers(chunk, 'ASCII PLY'))
                count += ahead[-1].size
                if count >= wanted:
                    break
            self._numbers = np.concatenate(ahead)
            self._position = 0
        return count

    def _rows(self, element: _Element, done: int, columns: int) -> np.ndarray:
        """Read some of the rows (k, columns) that follow the first `done` of the element."""
        most = min(element.count - done, CHUNK_FACES)
        present = self._fill(most * columns) // columns
        if present == 0:
            raise _missing(element, done)
        stop = self._position + min(most, present) * columns
        return self._numbers[self._position : stop].reshape(-1, columns)

    def _scalars(self, element: _Element) -> Iterator[np.ndarray]:
        """Read an element without lists, piece by piece."""
        done = 0
        while done < element.count and element.properties:
            rows = self._rows(element, done, len(element.properties))
            yield rows
            self._position += rows.size
            done += len(rows)

    def points(self, element: _Element) -> np.ndarray:
        names = [item.name for item in element.properties]
        points = Rows(np.float64, 3)
        for rows in self._scalars(element):
            points.add(rows[:, [names.index(axis) for axis in 'xyz']])
        return points.table()

    def triangles(self, element: _Element) -> np.ndarray:
        column = [item.count_type is not None for item in element.properties].index(True)
        columns = len(element.properties) + 3
        triangles = Rows(np.int32, 3)
        done = 0
        while done < element.count:
            if self._fill(columns) >= columns:
                rows = self._rows(element, done, columns)
                if np.all(rows[:, column] == 3):
                    triangles.add(_integers(rows[:, column + 1 : column + 4]))
                    self._position += rows.size
                    done += len(rows)
                    continue
            faces, sizes, starts = self._walk(element, done)
            triangles.add(_fans(sizes, starts, 1, lambda place: self._numbers[place]))
            done += faces
        return triangles.table()

    def _walk(self, element: _Element, done: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Pass some elements after the first `done`: how many, their lists' lengths and starts."""
        steps = [item.count_type is not None for item in element.properties]
        most = min(element.count - done, CHUNK_FACES)
        wanted = PIECE
        while True:
            present = self._fill(wanted)
            sizes, starts = array('i'), array('q')
            passed = 0
            while passed < most and (lists := self._lists(steps)) is not None:
                for size, start in lists:
                    sizes.append(size)
                    starts.append(start)
                passed += 1
            if passed:
                return passed, np.array(sizes, np.int32), np.array(starts, np.int64)
            if present < wanted:
                raise _missing(element, done)
            wanted *= 2

    def _lists(self, steps: list[bool]) -> list[tuple[int, int]] | None:
        """Pass one element; lengths and first numbers of its lists, None if it is not whole."""
        numbers, position = self._numbers, self._position
        found = []
        for is_list in steps:
            count = 1
            if is_list:
                if position >= numbers.size:
                    return None
                count = _list_length(numbers[position])
                position += 1
                found.append((count, position))
            position += count
        if position > numbers.size:
            return None
        self._position = position
        return found

    def skip(self, element: _Element) -> None:
        if not element.lists:
            for _ in self._scalars(element):
                pass
            return
        done = 0
        while done < element.count:
            done += self._walk(element, done)[0]


def _pieces(count: int) -> Iterator[int]:
    """Split a number of faces into pieces."""
    for start in range(0, count, CHUNK_FACES):
        yield min(CHUNK_FACES, count - start)


def _fans(
    sizes: np.ndarray, starts: np.ndarray, step: int, read: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return the triangles (m, 3) of polygons of `sizes` (p,) corners.

    starts (p,): place of the first corner of each; step: places per corner; read: (k, places) ->
    (k, corners). Polygons of one size are read together, a piece at a time.
    """
    ends = np.cumsum(sizes, dtype=np.int64)
    total = int(ends[-1]) if len(ends) else 0
    if total > max(LARGEST_LIST, 8 * len(sizes)):
        raise ScanFileError(
            f'{len(sizes)} PLY faces in a row have {total} corners or more; export triangles'
        )
    corners = np.empty(total, np.int32)
    for size in np.unique(sizes[sizes > 0]).tolist():
        members = np.flatnonzero(sizes == size)
        per_piece = max(1, PIECE // (step * size))
        for first in range(0, len(members), per_piece):
            piece = members[first : first + per_piece]
            values = read(starts[piece, None] + np.arange(step * size))
            corners[(ends[piece] - size)[:, None] + np.arange(size)] = _integers(values)
    return triangles_from_polygons(sizes, corners)


def _list_length(number: float) -> int:
    if not 0 <= number <= LARGEST_LIST:
        raise ScanFileError('ASCII PLY with a list whose length is missing or absurd')
    return int(number)


def _integers(values: np.ndarray) -> np.ndarray:
    """Return vertex indices as int32; raises ScanFileError for one that is no whole number."""
    if values.dtype.kind == 'f':
        if not np.all(np.isfinite(values)) or np.any(np.abs(values) > 2**31):
            raise ScanFileError('PLY face with an index that is not a 32-bit integer')
        if np.any(values != np.floor(values)):
            raise ScanFileError('PLY face with a fraction for a vertex index')
    # what is no vertex of 32 bits turns negative here and is refused with the faces
    return values.astype(np.int32)
