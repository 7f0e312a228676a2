# SPDX-License-Identifier: Apache-2.0
"""The one form in which benchmarks print: a Markdown table, also on the terminal."""

from collections.abc import Iterable
from typing import NamedTuple

HEADING = ('what', 'figure', 'goal')
WIDTHS = (60, 30, 14)


class Row(NamedTuple):
    """One figure: what was measured, its value, its goal, and whether that is met."""

    what: str
    value: str
    goal: str = ''
    met: bool = True


def _line(cells: Iterable[str], fill: str = ' ') -> str:
    padded = (cell.ljust(width, fill) for cell, width in zip(cells, WIDTHS, strict=True))
    return f'| {" | ".join(padded)} |'


def show(rows: Iterable[Row | tuple[str, str, str]]) -> int:
    """Print rows as they come; returns how many are short of their goal."""
    print(_line(HEADING), _line(('', '', ''), '-'), sep='\n', flush=True)
    short = 0
    for row in rows:
        what, value, goal, met = Row(*row)
        print(_line((what, value, goal if met else f'{goal} **short**')), flush=True)
        short += not met
    return short
