"""What a reader returns, the error it raises, and parsing of large blocks of numbers in text."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

CHUNK_BYTES = 4 * 2**20
"""Text is parsed in pieces of about this size, so that working memory does not grow with it."""

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
            return repr(token[0][:40].decode('latin-1'))
    return 'a token'


def chunks_of_lines(data: bytes, start: int = 0) -> Iterator[bytes]:
    """Yield `data` from `start` in pieces of whole lines.

    Line ends are unified to a line feed, vertical tabs and form feeds to a blank.
    """
    end = len(data)
    while start < end:
        stop = min(start + CHUNK_BYTES, end)
        if stop < end:
            cut = max(data.rfind(b'\n', start, stop), data.rfind(b'\r', start, stop))
            if cut >= start:
                stop = cut + 1
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
    """
    fans = np.maximum(sizes - 2, 0)
    if np.all(sizes == 3):
        return corners.reshape(-1, 3)
    first = np.repeat(np.cumsum(sizes) - sizes, fans)
    step = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans)
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
