# SPDX-License-Identifier: Apache-2.0
"""PCD, the point clouds of PCL and ROS: ascii, binary and binary_compressed, any field types.

Ours because the packages that read it on the index pull in a compiler or PCL itself; the format is
a table in numpy's terms, and its compression (LZF) two dozen lines.
"""

from __future__ import annotations

import io

import numpy as np

from grasp_common.formats.raw import (
    RawMesh,
    Rows,
    ScanFileError,
    chunks_of_lines,
    refuse_swapped,
    tokens_per_line,
)

LARGEST_HEADER = 2**14
LARGEST_ELEMENTS = 2**16
_KINDS = {('F', 4), ('F', 8), *(('I', n) for n in (1, 2, 4, 8)), *(('U', n) for n in (1, 2, 4, 8))}
_CUT = 'the file is cut: copy or export it again'


class _Header:
    """The lines in front of the data, by their first word, and where the data begin."""

    def __init__(self, data: bytes) -> None:
        self.lines: dict[str, list[str]] = {}
        position = 0
        while position < min(len(data), LARGEST_HEADER):
            end = data.find(b'\n', position)
            end = len(data) if end < 0 else end
            words = data[position:end].decode('latin-1').split()
            position = end + 1
            if words and not words[0].startswith('#'):
                self.lines[words[0].upper()] = words[1:]
                if words[0].upper() == 'DATA':
                    break
        if 'DATA' not in self.lines:
            raise ScanFileError('PCD header without its DATA line')
        self.end = position

    def numbers(self, key: str, count: int, default: int | None = None) -> list[int]:
        """Return the whole numbers of a line; raises ScanFileError if they are not `count`."""
        words = self.lines.get(key)
        if words is None and default is not None:
            return [default] * count
        if (
            words is None
            or len(words) != count
            or not all(w.isascii() and w.isdigit() and len(w) < 19 for w in words)
        ):
            raise ScanFileError(f'PCD header line {key} is missing or not {count} whole numbers')
        return [int(word) for word in words]


def read_pcd(data: bytes) -> RawMesh:
    """Read the points of a PCD file; raises ScanFileError for fewer than it declares."""
    header = _Header(data)
    names = [name.lower() for name in header.lines.get('FIELDS', [])]
    if {'x', 'y', 'z'} - set(names):
        raise ScanFileError(
            f'PCD without fields x, y and z; it has {" ".join(names)[:60] or "none"}'
        )
    sizes = header.numbers('SIZE', len(names))
    counts = header.numbers('COUNT', len(names), 1)
    kinds = header.lines.get('TYPE', [])
    if len(kinds) != len(names) or not set(zip(kinds, sizes, strict=True)) <= _KINDS:
        raise ScanFileError('PCD header lines TYPE and SIZE name no numbers')
    if max(counts) > LARGEST_ELEMENTS:
        raise ScanFileError(f'PCD field of {max(counts)} elements a point')
    (width,), (height,) = header.numbers('WIDTH', 1), header.numbers('HEIGHT', 1, 1)
    (count,) = header.numbers('POINTS', 1, width * height)
    if count != width * height:
        raise ScanFileError(f'PCD header declares {count} points and {width} x {height}')
    types = [
        np.dtype((f'<{kind.lower()}{size}', (n,)))
        for kind, size, n in zip(kinds, sizes, counts, strict=True)
    ]
    axes = [names.index(axis) for axis in 'xyz']
    if any(counts[axis] != 1 for axis in axes):
        raise ScanFileError('PCD coordinate of more than one element')
    storage = (header.lines['DATA'] or [''])[0].lower()
    if storage == 'ascii':
        points = _ascii(data, header.end, count, counts, axes)
    elif storage == 'binary':
        points = _binary(data, header.end, count, types, axes)
    elif storage == 'binary_compressed':
        points = _compressed(data, header.end, count, types, axes)
    else:
        raise ScanFileError(
            f'PCD with DATA {storage[:40]!r}; known: ascii, binary, binary_compressed'
        )
    return RawMesh(points, None, _notes(header))


def _notes(header: _Header) -> tuple[str, ...]:
    viewpoint = header.lines.get('VIEWPOINT', [])
    if viewpoint and viewpoint != ['0', '0', '0', '1', '0', '0', '0']:
        return ('PCD VIEWPOINT not applied: points stay in the frame of the sensor',)
    return ()


def _missing(count: int, present: int) -> ScanFileError:
    cause = _CUT if present < count else 'its header is wrong: export it again'
    return ScanFileError(f'PCD declares {count} points but holds {present}; {cause}')


def _ascii(data: bytes, start: int, count: int, counts: list[int], axes: list[int]) -> np.ndarray:
    columns = tuple(sum(counts[:axis]) for axis in axes)
    points = Rows(np.float64, 3)
    for chunk in chunks_of_lines(data, start):
        different = set(tokens_per_line(chunk).tolist()) - {sum(counts)}
        if different:
            raise ScanFileError(
                f'PCD with a line of {different.pop()} numbers, not the {sum(counts)} of its '
                f'header; {_CUT}'
            )
        if chunk.isspace():
            continue
        try:
            points.add(np.loadtxt(io.BytesIO(chunk), usecols=columns, ndmin=2, encoding='latin-1'))
        except ValueError as error:
            raise ScanFileError(f'PCD: {str(error).splitlines()[0]}') from None
    if len(points) != count:
        raise _missing(count, len(points))
    return points.table()


def _binary(
    data: bytes, start: int, count: int, types: list[np.dtype], axes: list[int]
) -> np.ndarray:
    record = np.dtype([(f'f{k}', kind) for k, kind in enumerate(types)])
    present, surplus = divmod(len(data) - start, record.itemsize)
    # zeros at the end are padding
    more = present > count and not surplus and data[start + count * record.itemsize :].strip(b'\0')
    if present < count or more:
        raise _missing(count, present)
    table = np.frombuffer(data, record, count, start)
    points = np.empty((count, 3))
    for column, axis in enumerate(axes):
        refuse_swapped(table[f'f{axis}'], 'binary PCD')
        points[:, column] = table[f'f{axis}'][:, 0]
    return points


def _compressed(
    data: bytes, start: int, count: int, types: list[np.dtype], axes: list[int]
) -> np.ndarray:
    """Read compressed data: they hold all values of the first field, then of the next one."""
    stored, size = np.frombuffer(data[start : start + 8].ljust(8, b'\0'), '<u4').tolist()
    if len(data) - start - 8 < stored:
        raise ScanFileError(f'PCD declares {stored} compressed bytes but holds fewer; {_CUT}')
    if size != count * sum(kind.itemsize for kind in types):
        raise ScanFileError(f'PCD whose {size} bytes do not fit its {count} points')
    plain = _lzf(data[start + 8 : start + 8 + stored], size)
    points = np.empty((count, 3))
    offset = 0
    for place, kind in enumerate(types):
        if place in axes:
            values = np.frombuffer(plain, kind.base, count, offset)
            points[:, axes.index(place)] = values
        offset += count * kind.itemsize
    return points


def _lzf(data: bytes, size: int) -> bytes:
    """Unpack LZF (Lehmann): runs of literals, and copies of what came before."""
    out = bytearray()
    place, end = 0, len(data)
    try:
        while place < end:
            control = data[place]
            place += 1
            if control < 32:
                if place + control + 1 > end:
                    raise IndexError
                out += data[place : place + control + 1]
                place += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[place]
                place += 1
            length += 2
            begin = len(out) - ((control & 31) << 8) - data[place] - 1
            place += 1
            if begin < 0:
                raise IndexError
            # a copy may run into itself and then repeats
            piece = out[begin : begin + length]
            while len(piece) < length:
                piece += piece[: length - len(piece)]
            out += piece
            if len(out) > size:
                raise IndexError
    except IndexError:
        raise ScanFileError(
            'PCD whose compressed data are damaged; copy or export it again'
        ) from None
    if len(out) != size:
        raise ScanFileError(f'PCD whose data unpack to {len(out)} bytes, not {size}; {_CUT}')
    return bytes(out)
