# SPDX-License-Identifier: Apache-2.0
"""Polygons and strips of PLY as triangles, whatever their corners are read from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from grasp_common.formats.raw import ScanFileError, triangles_from_polygons

PIECE = 2**18
"""Numbers, bytes or vertices that are gathered at once."""

LARGEST_LIST = 2**20
"""Most items of one list in a file whose lists are walked through."""


def strips(
    sizes: np.ndarray, starts: np.ndarray, step: int, read: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return the triangles (m, 3) of strips, in which -1 begins the next one; as `fans`.

    Every second triangle of a strip is turned, so that all show the same side.
    """
    found = [np.empty((0, 3), np.int32)]
    for size, start in zip(sizes.tolist(), starts.tolist(), strict=True):
        if size >= LARGEST_LIST:
            raise ScanFileError(f'PLY strip of {LARGEST_LIST} corners or more; export triangles')
        corners = integers(read(start + np.arange(step * size)))
        windows = np.lib.stride_tricks.sliding_window_view(corners, 3) if size > 2 else found[0]
        breaks = np.flatnonzero(corners == -1)
        begins = np.concatenate([[0], breaks + 1])
        place = np.arange(len(windows))
        turned = (place - begins[np.searchsorted(begins, place, 'right') - 1]) % 2 == 1
        triangles = np.where(turned[:, None], windows[:, [1, 0, 2]], windows)
        found.append(triangles[(windows >= 0).all(axis=1) | (windows < -1).any(axis=1)])
    return np.concatenate(found)


def fans(
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
            corners[(ends[piece] - size)[:, None] + np.arange(size)] = integers(values)
    return triangles_from_polygons(sizes, corners)


POLYGONS = {'face': fans, 'tristrips': strips}
"""How the corners of an element make triangles."""


def list_length(number: float) -> int:
    """Return the length of a list in text; raises ScanFileError for what is none."""
    if not 0 <= number <= LARGEST_LIST:
        raise ScanFileError('ASCII PLY with a list whose length is missing or absurd')
    return int(number)


def integers(values: np.ndarray) -> np.ndarray:
    """Return vertex indices as int32; raises ScanFileError for one that is no whole number."""
    if values.dtype.kind == 'f':
        if not np.all(np.isfinite(values)) or np.any(np.abs(values) > 2**31):
            raise ScanFileError('PLY face with an index that is not a 32-bit integer')
        if np.any(values != np.floor(values)):
            raise ScanFileError('PLY face with a fraction for a vertex index')
    # what is no vertex of 32 bits turns negative here and is refused with the faces
    return values.astype(np.int32)
