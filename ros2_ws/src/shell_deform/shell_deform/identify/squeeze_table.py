# SPDX-License-Identifier: Apache-2.0
"""Force and displacement pairs from a CSV table, and the scan that a row may name."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_common import bounded_yaml
from shell_deform.identify.force_curve import IdentificationError

Array = NDArray[np.float64]

SCAN = 'scan'
COMMENT = '#'


def read_table(path: Path) -> tuple[Array, list[Path | None]]:
    """(n, c) numbers of a CSV file, NaN for what is none, and the scan of each row or None.

    A first line without a number holds headings. Under the heading `scan` stand files, beside the
    table or with a path of their own.

    Raises IdentificationError for a file that is no text, holds no numbers or whose rows differ
    in length.
    """
    try:
        text = bounded_yaml.text_of(path, 'utf-8-sig')
    except UnicodeDecodeError as error:
        raise IdentificationError(f'{path}: no text; give a CSV table or a bag') from error
    lines = [line.split(COMMENT)[0] for line in text.splitlines()]
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines) if any(row)]
    column = None
    if rows and all(np.isnan(_number(cell)) for cell in rows[0]):
        headings = [cell.lower() for cell in rows.pop(0)]
        column = headings.index(SCAN) if SCAN in headings else None
    if not rows:
        raise IdentificationError(
            f'{path}: holds no numbers; give lines of force_n, displacement_m'
        )
    lengths = [len(row) for row in rows]
    if len(set(lengths)) > 1:
        odd = next(i for i, length in enumerate(lengths) if length != lengths[0])
        raise IdentificationError(
            f'{path}: rows differ in their number of columns: row 1 has {lengths[0]}, row '
            f'{odd + 1} has {lengths[odd]}'
        )
    scans: list[Path | None] = [None] * len(rows)
    if column is not None and column < lengths[0]:
        names = [row.pop(column) for row in rows]
        scans = [path.parent / name if name else None for name in names]
    return np.array([[_number(cell) for cell in row] for row in rows]), scans


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float('nan')
