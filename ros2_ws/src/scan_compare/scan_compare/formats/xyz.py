"""XYZ and its relatives (.txt, .asc, .csv, .pts): one point per line, coordinates first."""

from __future__ import annotations

import re

import numpy as np

from scan_compare.formats.raw import (
    RawMesh,
    Rows,
    ScanFileError,
    chunks_of_lines,
    parse_numbers,
    tokens_per_line,
)

_COMMENT = re.compile(rb'(#|//)[^\n]*')
_SEPARATORS = bytes.maketrans(b',;\t', b'   ')
_COLUMN_NAMES = re.compile(rb'\A\s*"?[A-Za-z_][^\n]*(\n|\Z)')
_COUNT_LINE = re.compile(rb'\A\s*\d+[ \t]*\n')


def read_xyz(data: bytes) -> RawMesh:
    """Read points from text of three or more columns separated by blanks, commas or semicolons.

    Comments (`#`, `//`), one line of column names and one leading line with the number of points
    are skipped; columns after the third (colour, intensity, normal) are ignored. Raises
    ScanFileError if a token is not a number or lines differ in their number of columns.
    """
    points = Rows(np.float64, 3)
    columns = 0
    for chunk in chunks_of_lines(data):
        text = _COMMENT.sub(b'', chunk) if b'#' in chunk or b'//' in chunk else chunk
        text = text.translate(_SEPARATORS)
        if not len(points):
            text = _COUNT_LINE.sub(b'', _COLUMN_NAMES.sub(b'', text))
        counts = tokens_per_line(text)
        if counts.size == 0:
            continue
        columns = columns or int(counts[0])
        if columns < 3:
            raise ScanFileError(f'XYZ line with {columns} columns; x, y and z are needed')
        different = np.flatnonzero(counts != columns)
        if different.size:
            raise ScanFileError(
                f'XYZ lines have {columns} columns at first and {int(counts[different[0]])} '
                'later; the file is cut or not a table of points'
            )
        numbers = parse_numbers(text, 'XYZ coordinate').reshape(-1, columns)
        points.add(numbers[:, :3])
    if not len(points):
        raise ScanFileError('XYZ file without any point')
    return RawMesh(points.table(), None)
