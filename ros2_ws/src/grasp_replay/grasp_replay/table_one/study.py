# SPDX-License-Identifier: Apache-2.0
"""All of Table I from the published file alone: one document of numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grasp_common import bounded_yaml
from grasp_replay.errors import BagError
from grasp_replay.experiment import read_published
from grasp_replay.table_one.ball import (
    BALL,
    PRINTED,
    Ball,
    Rows,
    as_printed,
    from_all_rows,
    from_row_one,
    influences,
    pressure_scan,
)
from grasp_replay.table_one.can import CAN, can_rows
from grasp_replay.table_one.paper_setup import paper_setup
from shell_deform.identify.force_curve import IdentificationError


def table_one(
    path: Path,
    show: Callable[[float, str], None] = lambda _share, _note: None,
    control_vertices: int | None = None,
) -> dict[str, Any]:
    """Every number of the page from the published table in `path`, SI units; about a minute.

    `control_vertices` replaces the objects' own. Raises BagError when the table cannot be read or
    lacks the ball or the can.
    """
    ball_rows, can = read_published(path, BALL), read_published(path, CAN)
    if len(ball_rows) < 2 or len(can) != 1:
        raise BagError(
            f'{path}: needs at least two rows of {BALL} and one of {CAN}; it has '
            f'{len(ball_rows)} and {len(can)}'
        )
    try:
        accuracy = float(bounded_yaml.load(path.read_text())['scanner']['stated_accuracy_m'])
        rows = Rows(
            np.array([row['force_n'] for row in ball_rows]),
            np.array([row['measured_max_displacement_m'] for row in ball_rows]),
            accuracy,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise BagError(f'{path}: a number of the published table is missing ({error})') from error
    ball = Ball(BALL, control_vertices)
    found: dict[str, Any] = {
        'rows': ball_rows,
        'scanner_accuracy_m': accuracy,
        'thickness_m': ball.shell.thickness_m,
    }
    parts: list[tuple[str, float, str, Callable[[], Any]]] = [
        ('as_printed', 0.0, 'the printed modulus',
         lambda: as_printed(rows, Ball(PRINTED, control_vertices))),
        ('row_one', 0.03, 'modulus of row one', lambda: from_row_one(rows, ball, band=True)),
        ('all_rows', 0.1, 'fit on all rows', lambda: from_all_rows(rows, ball)),
        ('linear_row_one', 0.2, 'linear theory',
         lambda: from_row_one(rows, ball, 'linear', band=True)),
        ('linear_all_rows', 0.22, 'linear theory, all rows',
         lambda: from_all_rows(rows, ball, 'linear')),
        ('thick_row_one', 0.24, 'a wall with a thickness',
         lambda: from_row_one(rows, ball, 'thick')),
        ('without_air', 0.28, 'without air', lambda: from_row_one(rows, ball, gas='none')),
        ('pressure_scan', 0.3, 'pressure scan', lambda: pressure_scan(rows, ball)),
        ('influences', 0.5, 'pin radius and strain measure', lambda: influences(rows, ball)),
        ('paper_setup', 0.7, "the paper's set-up",
         lambda: paper_setup(rows, ball_rows, ball.pin_radius)),
        ('can', 0.75, 'supports of the can', lambda: can_rows(can[0], control_vertices)),
    ]  # fmt: skip
    for name, share, note, compute in parts:
        show(share, note)
        try:
            found[name] = compute()
        except IdentificationError as error:
            raise BagError(f'{path}: {note}: {error}') from error
    return found
