# SPDX-License-Identifier: Apache-2.0
"""What a reader returns, the error it raises, and parsing of large blocks of numbers in text."""

from __future__ import annotations

import re
import warnings
from array import array
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

CHUNK_BYTES = 2**20
"""Text is parsed in pieces of about this size, so that working memory does not grow with it."""

CHUNK_FACES = 2**16
"""Faces of mixed sizes are cut into triangles in pieces of this many."""

LARGEST_MEAN_FAN = 6
FEW_TRIANGLES = 100_000
"""Faces of a piece may have any size up to this many triangles; beyond it, LARGEST_MEAN_FAN
triangles each: a corner of two bytes would otherwise become a triangle of twelve."""

LOOKED_AT = 2**16
"""Bytes of a text that tell how its numbers are written."""

_DECIMAL_COMMA = re.compile(rb'[+-]?\d+,\d+,?\Z')
_WHITE_SPACE = bytes.maketrans(b'\r\v\f', b'\n  ')


class ScanFileError(ValueError):
    """A scan file that cannot be read; the message names the file, the cause and the way out."""


@dataclass(frozen=True)
class RawMesh:
    """Content of a file in file units: `points` (n, 3), `triangles` (m, 3) or None, `notes`.

    Indices are checked to lie inside `points`; nothing else is repaired yet.
    """

    points: np.ndarray
    triangles: np.ndarray | None
    notes: tuple[str, ...] = ()


class Rows:
    """A table that grows by pieces in one block of memory: joining them needs no second one."""

    def __init__(self, kind: type[np.float64] | type[np.int32], columns: int) -> None:
        self._kind = kind
        self._columns = columns
        self._store = array('d' if kind is np.float64 else 'i')

    def add(self, piece: np.ndarray) -> None:
        """Append rows (k, columns)."""
        self._store.frombytes(piece.astype(self._kind).tobytes())

    def __len__(self) -> int:
        return len(self._store) // self._columns

    def table(self) -> np.ndarray:
        """Return all rows (n, columns); none may be added afterwards."""
        if not self._store:
            return np.empty((0, self._columns), self._kind)
        return np.frombuffer(self._store, self._kind).reshape(-1, self._columns)


def parse_numbers(text: bytes, what: str) -> np.ndarray:
    """Parse white-space separated numbers; raises ScanFileError naming `what` if one is not.

    `nan` and `inf` are numbers here: a scanner may mark holes with them.
    """
    if not text or text.isspace():
        return np.empty(0)
    with warnings.catch_warnings():
        # NumPy announces unreadable text by a DeprecationWarning, later by a ValueError
        warnings.simplefilter('error', DeprecationWarning)
        try:
            return np.fromstring(text, sep=' ')
        except (DeprecationWarning, ValueError):
            raise ScanFileError(f'{what}: {_first_bad_token(text)} is not a number') from None


def _first_bad_token(text: bytes) -> str:
    for token in re.finditer(rb'\S+', text):
        try:
            float(token[0])
        except ValueError:
            found = repr(token[0][:40].decode('latin-1'))
            if re.fullmatch(rb'[+-]?\d*,\d+', token[0]):
                return f'{found}, with a decimal comma,'
            return found
    return 'a token'


def refuse_decimal_commas(text: bytes, what: str) -> None:
    """Raise ScanFileError where a format takes commas for blanks and nearly every word has one."""
    words = text[:LOOKED_AT].split()
    commas = sum(map(bool, map(_DECIMAL_COMMA.match, words)))
    if len(words) >= 3 and b'.' not in text and 3 * commas > 2 * len(words):
        found = b' '.join(words[:3])[:60].decode('latin-1')
        raise ScanFileError(
            f'{what} with decimal commas, as in {found!r}; export it with decimal points'
        )


def refuse_swapped(values: np.ndarray, what: str) -> None:
    """Raise ScanFileError if floats as stored make lengths only with their bytes in reverse."""
    if values.dtype.kind != 'f' or values.dtype.itemsize == 1 or len(values) == 0:
        return
    sample = values[:: max(1, len(values) // 1000)].ravel()
    sample = sample[sample != 0.0]
    if len(sample) and _lengths(sample) < 0.5 and _lengths(sample.byteswap()) > 0.9:
        raise ScanFileError(
            f'{what} whose numbers are stored in the other byte order than its header says; '
            'correct the header or export it again'
        )


def _lengths(values: np.ndarray) -> float:
    """Share of values that a coordinate in some unit can have; a swapped float has any size."""
    with np.errstate(all='ignore'):
        size = np.abs(values.astype(np.float64))
        return float(np.mean((size > 1e-9) & (size < 1e9)))


def chunks_of_lines(data: bytes, start: int = 0) -> Iterator[bytes]:
    """Yield `data` from `start` in pieces of whole lines.

    Line ends are unified to a line feed, vertical tabs and form feeds to a blank. Raises
    ScanFileError for a line longer than a piece.
    """
    return _chunks(data, start, b'\n\r', 'line')


def chunks_of_words(data: bytes, start: int = 0) -> Iterator[bytes]:
    """Yield `data` as `chunks_of_lines` does, but cut between any two words."""
    return _chunks(data, start, b'\n\r \t,', 'word')


def _chunks(data: bytes, start: int, ends: bytes, what: str) -> Iterator[bytes]:
    end = len(data)
    while start < end:
        stop = min(start + CHUNK_BYTES, end)
        if stop < end:
            stop = 1 + max(data.rfind(bytes((character,)), start, stop) for character in ends)
            if stop == 0:
                raise ScanFileError(
                    f'a {what} of more than {CHUNK_BYTES} bytes is no part of a scan; '
                    'export it again'
                )
        yield data[start:stop].translate(_WHITE_SPACE)
        start = stop


def tokens_per_line(text: bytes) -> np.ndarray:
    """Count the tokens of each line that has any; `text` is separated by blanks and line feeds."""
    characters = np.frombuffer(text, np.uint8)
    is_space = (characters == 32) | ((characters >= 9) & (characters <= 13))
    starts = ~is_space
    starts[1:] &= is_space[:-1]
    line_ends = np.flatnonzero(characters == 10)
    token_lines = np.searchsorted(line_ends, np.flatnonzero(starts))
    counts = np.bincount(token_lines, minlength=1)
    return counts[counts > 0]


def triangles_from_polygons(sizes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Cut polygons into fans of triangles.

    sizes: (p,) corners of each polygon; corners: (sum of sizes,) their vertex indices in order.
    Returns (m, 3) in the polygons' orientation; polygons of fewer than three corners vanish.
    Raises ScanFileError for many polygons of many corners each.
    """
    if np.all(sizes == 3):
        return corners.reshape(-1, 3)
    fans = np.maximum(sizes - 2, 0)
    total = int(fans.sum(dtype=np.int64))
    if total > max(FEW_TRIANGLES, LARGEST_MEAN_FAN * len(sizes)):
        raise ScanFileError(
            f'{len(sizes)} faces in a row have {int(sizes.sum(dtype=np.int64))} corners; '
            'export triangles'
        )
    first = np.repeat(np.cumsum(sizes, dtype=np.int64) - sizes, fans)
    step = np.arange(total) - np.repeat(np.cumsum(fans, dtype=np.int64) - fans, fans)
    return np.column_stack((corners[first], corners[first + step + 1], corners[first + step + 2]))


def checked_triangles(triangles: np.ndarray, n_points: int) -> np.ndarray:
    """Return `triangles` as int32 (m, 3); raises ScanFileError if an index has no vertex."""
    if len(triangles) == 0:
        return np.empty((0, 3), np.int32)
    low, high = int(triangles.min()), int(triangles.max())
    if low < 0 or high >= n_points:
        bad = low if low < 0 else high
        raise ScanFileError(f'a face names vertex {bad}; the file has {n_points} vertices')
    return np.ascontiguousarray(triangles, np.int32)
