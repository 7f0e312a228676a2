# SPDX-License-Identifier: Apache-2.0
"""PLY, ASCII and binary of both byte orders: vertex positions and faces, the rest skipped."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from itertools import islice

import numpy as np

from grasp_common.formats.ply_header import Element, missing, read_header
from grasp_common.formats.ply_polygons import LARGEST_LIST, PIECE, POLYGONS, integers, list_length
from grasp_common.formats.raw import (
    CHUNK_FACES,
    RawMesh,
    Rows,
    ScanFileError,
    checked_triangles,
    chunks_of_lines,
    chunks_of_words,
    parse_numbers,
    refuse_swapped,
    triangles_from_polygons,
)

MOST_BYTE_FACES = 2**20
"""Most faces whose indices have one byte: they cannot name more than 256 vertices."""


def read_ply(data: bytes) -> RawMesh:
    """Read PLY; raises ScanFileError if the header is malformed or promises more than is there."""
    order, elements, body = read_header(data)
    types = _vertex_types(elements)
    if order and {types[axis] for axis in 'xyz'} & {'i1', 'u1'}:
        raise ScanFileError('PLY coordinates of 8 bits are no scan; export float')
    table: _BinaryBody | TextBody = (
        _BinaryBody(data, body, order) if order else TextBody(data, body)
    )
    try:
        points, triangles, notes = _elements(table, elements)
        if isinstance(table, TextBody) and table.rest():
            raise ScanFileError(f'ASCII PLY with more numbers than its {_counts(elements)}')
    except ScanFileError:
        # several lists a face: writers are known whose lines end in more than they declare
        if order or not any(len(element.lists) > 1 for element in elements):
            raise
        points, faces = _by_line(data, body, elements)
        triangles = [faces]
        notes = ['PLY lines hold more than their header says; what follows the corners left out']
    if isinstance(table, _BinaryBody):
        notes += table.surplus(elements)
    found = [piece for piece in triangles if len(piece)]
    if not found:
        return RawMesh(points, None, tuple(notes))
    joined = found[0] if len(found) == 1 else np.concatenate(found)
    return RawMesh(points, checked_triangles(joined, len(points)), tuple(notes))


def _vertex_types(elements: list[Element]) -> dict[str, str]:
    """The types of the properties of vertices by name; raises ScanFileError without x, y, z."""
    vertex = [element for element in elements if element.name == 'vertex']
    if len(vertex) != 1:
        raise ScanFileError(
            f'PLY with {len(vertex) or "no"} elements "vertex" in its header; export it again'
        )
    if vertex[0].lists:
        raise ScanFileError(
            f'PLY whose vertices have a list "{vertex[0].lists[0].name[:40]}": the line "element '
            'face" seems to be missing from its header; export it again'
        )
    types = {item.name: item.type for item in vertex[0].properties}
    if {'x', 'y', 'z'} - set(types):
        found = ', '.join(types)[:60] or 'none'
        raise ScanFileError(f'PLY vertices without properties x, y and z; they have {found}')
    return types


def _counts(elements: list[Element]) -> str:
    counts = ', '.join(f'{element.count} "{element.name[:40]}"' for element in elements)
    return f'header declares ({counts}): a count is wrong; export it again'


def _elements(
    table: _BinaryBody | TextBody, elements: list[Element]
) -> tuple[np.ndarray, list[np.ndarray], list[str]]:
    """Read all elements: points (n, 3), pieces of triangles (m, 3), and what was left out."""
    points = np.empty((0, 3))
    triangles: list[np.ndarray] = []
    notes: list[str] = []
    for element in elements:
        if element.name == 'vertex':
            points = table.points(element)
        elif element.name in POLYGONS and element.corners is not None:
            triangles.append(table.triangles(element))
        else:
            table.skip(element)
            if element.lists:
                notes.append(f'{element.count} PLY elements "{element.name[:40]}" left out')
    return points, triangles, notes


class _BinaryBody:
    """Reads elements one after the other from bytes, each checked against what is left."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data = data
        self._position = min(start, len(data))
        self._order = order

    def _records(self, element: Element, fields: list[tuple[str, str]], count: int) -> np.ndarray:
        """Read the next `count` of the element's records, all of one size."""
        record = np.dtype([(f'f{k}', self._order + kind) for k, (_, kind) in enumerate(fields)])
        if count == 0 or record.itemsize == 0:
            return np.empty(0, record)
        left = len(self._data) - self._position
        if count * record.itemsize > left:
            raise missing(element, left // record.itemsize)
        table = np.frombuffer(self._data, record, count, self._position)
        self._position += count * record.itemsize
        return table

    def _scalars(self, element: Element) -> np.ndarray:
        fields = [(item.name, item.type) for item in element.properties]
        return self._records(element, fields, element.count)

    def points(self, element: Element) -> np.ndarray:
        names = [item.name for item in element.properties]
        table = self._scalars(element)
        points = np.empty((len(table), 3))
        for axis, name in enumerate('xyz'):
            column = table[f'f{names.index(name)}']
            refuse_swapped(column, 'binary PLY')
            points[:, axis] = column
        return points

    def triangles(self, element: Element) -> np.ndarray:
        corners = element.corners
        assert corners is not None
        kind = np.dtype(self._order + element.lists[corners].type)
        if kind.itemsize == 1 and element.count > MOST_BYTE_FACES:
            raise ScanFileError(
                f'PLY declares {element.count} faces whose indices of 8 bits name 256 vertices at '
                'most; export with indices of 32 bits'
            )
        stored = np.frombuffer(self._data, np.uint8)
        triangles = Rows(np.int32, 3)
        for count in _pieces(element.count):
            piece = None
            if len(element.lists) == 1 and element.name == 'face':
                piece = self._all_triangles(element, count)
            if piece is None:
                sizes, starts = self._walk(element, count)
                step = len(element.lists)
                piece = POLYGONS[element.name](
                    sizes[corners::step],
                    starts[corners::step],
                    kind.itemsize,
                    lambda place: stored[place].view(kind),
                )
            triangles.add(piece)
        return triangles.table()

    def _all_triangles(self, element: Element, faces: int) -> np.ndarray | None:
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
        return np.column_stack([integers(table[f'f{column + k}']) for k in (1, 2, 3)])

    def _walk(self, element: Element, faces: int) -> tuple[np.ndarray, np.ndarray]:
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
                        raise missing(element, face)
                    (count,) = reader.unpack_from(data, position)
                position = start + count * item_bytes
                if count < 0 or position > len(data):
                    raise missing(element, face)
                if reader:
                    sizes.append(min(count, LARGEST_LIST))
                    starts.append(start)
        self._position = position
        return np.array(sizes, np.int32), np.array(starts, np.int64)

    def skip(self, element: Element) -> None:
        if not element.lists:
            self._scalars(element)
            return
        for count in _pieces(element.count):
            self._walk(element, count)

    def surplus(self, elements: list[Element]) -> list[str]:
        """Notes on the bytes after the last element; raises ScanFileError if it goes on there."""
        rest = self._data[self._position :]
        last = elements[-1]
        if rest.strip(b'\0\r\n ') and last.properties:
            corners = 3 if last.name == 'face' else 0
            size = sum(
                np.dtype(item.type).itemsize * (corners if item.count_type else 1)
                + np.dtype(item.count_type or 'V0').itemsize
                for item in last.properties
            )
            if size and len(rest) % size == 0 and (not last.lists or self._goes_on(last)):
                raise ScanFileError(f'binary PLY with more than its {_counts(elements)}')
        return [f'{len(rest)} bytes after the last element ignored'] if rest else []

    def _goes_on(self, element: Element) -> bool:
        """Does another element with lists follow?"""
        try:
            return bool(self._walk(element, 1)[0].max() > 0)
        except ScanFileError:
            return False


class TextBody:
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

    def rest(self) -> bool:
        """Whether numbers follow the last element that was read."""
        return self._fill(1) > 0

    def _rows(self, element: Element, done: int, columns: int) -> np.ndarray:
        """Read some of the rows (k, columns) that follow the first `done` of the element."""
        most = min(element.count - done, CHUNK_FACES)
        present = self._fill(most * columns) // columns
        if present == 0:
            raise missing(element, done)
        stop = self._position + min(most, present) * columns
        return self._numbers[self._position : stop].reshape(-1, columns)

    def _scalars(self, element: Element) -> Iterator[np.ndarray]:
        """Read an element without lists, piece by piece."""
        done = 0
        while done < element.count and element.properties:
            rows = self._rows(element, done, len(element.properties))
            yield rows
            self._position += rows.size
            done += len(rows)

    def points(self, element: Element) -> np.ndarray:
        """Read x, y and z (n, 3) of an element without lists; raises ScanFileError."""
        names = [item.name for item in element.properties]
        points = Rows(np.float64, 3)
        for rows in self._scalars(element):
            points.add(rows[:, [names.index(axis) for axis in 'xyz']])
        return points.table()

    def triangles(self, element: Element) -> np.ndarray:
        """Read the corners (m, 3) of an element of polygons or strips; raises ScanFileError."""
        corners, step = element.corners, len(element.lists)
        assert corners is not None
        plain = step == 1 and element.name == 'face'
        column = [item.count_type is not None for item in element.properties].index(True)
        columns = len(element.properties) + 3
        triangles = Rows(np.int32, 3)
        done = 0
        while done < element.count:
            if plain and self._fill(columns) >= columns:
                rows = self._rows(element, done, columns)
                if np.all(rows[:, column] == 3):
                    triangles.add(integers(rows[:, column + 1 : column + 4]))
                    self._position += rows.size
                    done += len(rows)
                    continue
            faces, sizes, starts = self._walk(element, done)
            polygons = POLYGONS[element.name]
            read = self._numbers.__getitem__
            triangles.add(polygons(sizes[corners::step], starts[corners::step], 1, read))
            done += faces
        return triangles.table()

    def _walk(self, element: Element, done: int) -> tuple[int, np.ndarray, np.ndarray]:
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
                raise missing(element, done)
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
                count = list_length(numbers[position])
                position += 1
                found.append((count, position))
            position += count
        if position > numbers.size:
            return None
        self._position = position
        return found

    def skip(self, element: Element) -> None:
        """Pass an element; raises ScanFileError."""
        if not element.lists:
            for _ in self._scalars(element):
                pass
            return
        done = 0
        while done < element.count:
            done += self._walk(element, done)[0]


def _by_line(data: bytes, start: int, elements: list[Element]) -> tuple[np.ndarray, np.ndarray]:
    """Read points (n, 3) and triangles (m, 3) of text in which each element has its own line.

    Raises ScanFileError if a vertex does not have the columns it declares, or a line too many is
    there.
    """
    chunks = chunks_of_lines(data, start)
    lines = (line.split() for chunk in chunks for line in chunk.split(b'\n'))
    full = (words for words in lines if words)
    points, triangles = np.empty((0, 3)), np.empty((0, 3), np.int32)
    for element in elements:
        rows = list(islice(full, element.count))
        if len(rows) < element.count:
            raise missing(element, len(rows))
        if element.name == 'vertex':
            columns = len(element.properties)
            if any(len(words) != columns for words in rows):
                raise ScanFileError(f'PLY vertex that has not the {columns} numbers it declares')
            names = [item.name for item in element.properties]
            axes = [names.index(axis) for axis in 'xyz']
            words = b' '.join(words[axis] for words in rows for axis in axes)
            points = parse_numbers(words, 'PLY vertex').reshape(-1, 3)
        elif element.name == 'face' and element.corners is not None:
            corners = [_corners_of(words, element) for words in rows]
            sizes = np.array([len(row) for row in corners], np.int32)
            triangles = triangles_from_polygons(sizes, integers(np.concatenate(corners)))
    if next(full, None) is not None:
        raise ScanFileError('ASCII PLY with more lines than its header declares')
    return points, triangles


def _corners_of(words: list[bytes], element: Element) -> np.ndarray:
    """The corners of one face from the words of its line; raises ScanFileError."""
    place = 0
    wanted = element.lists[element.corners or 0]
    for item in element.properties:
        count = 1
        if item.count_type is not None:
            count = list_length(
                float(parse_numbers(words[place] if place < len(words) else b'-1', 'PLY list')[0])
            )
            place += 1
        if item is wanted:
            if place + count > len(words):
                raise ScanFileError('PLY face with fewer corners on its line than it declares')
            return parse_numbers(b' '.join(words[place : place + count]), 'PLY face')
        place += count
    return np.empty(0)


def _pieces(count: int) -> Iterator[int]:
    """Split a number of faces into pieces."""
    for start in range(0, count, CHUNK_FACES):
        yield min(CHUNK_FACES, count - start)
