# SPDX-License-Identifier: Apache-2.0
"""Text for terminals: foreign names made harmless, plain numbers, tables, progress."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

Item = TypeVar('Item')

QUIET_SECONDS = 2.0
"""Work that ends sooner shows no bar."""

LINE_PERIOD = 0.2


def printable(text: str, most: int = 500) -> str:
    """`text` for a terminal or a log: what steers one is shown as its escape, never obeyed.

    Controls, line ends, direction marks and broken Unicode become `\\x1b`, `\\n`, `\\u202e`;
    what is longer than `most` characters is cut.
    """
    if len(text) > most:
        text = f'{text[:most]} ... ({len(text)} characters)'
    if text.isprintable():
        return text
    return ''.join(
        one if one.isprintable() else one.encode('unicode_escape').decode() for one in text
    )


def in_picture(text: str) -> str:
    """`text` for a picture of matplotlib: none of it steers, and a dollar begins no formula."""
    return printable(text).replace('$', r'\$')


def fixed(value: float, digits: int) -> str:
    """`value` with so many decimals; zero has no sign."""
    text = f'{value:.{digits}f}'
    return text.lstrip('-') if text.startswith('-') and not text.strip('-0.') else text


def significant(value: float, digits: int, beside: float) -> str:
    """`value` with so many significant digits; what is rounding `beside` a larger one is 0."""
    return f'{value:.{digits}g}' if abs(value) > 1e-9 * abs(beside) else '0'


def counted(number: int, noun: str) -> str:
    """`1 rim`, `2 rims`."""
    return f'{number} {noun}' if number == 1 else f'{number} {noun}s'


def complain(program: str, error: object) -> None:
    """One sentence on stderr, as every program here ends that cannot do its job."""
    print(f'{program}: {printable(str(error), 4000)}', file=sys.stderr, flush=True)


def say(text: str) -> None:
    """Text on stdout whose lines may hold foreign names."""
    print('\n'.join(printable(line, len(line)) for line in text.split('\n')))


def print_table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    title: str = '',
    stream: TextIO | None = None,
) -> None:
    """A table of plain text: brackets are brackets, columns of numbers stand right."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    body = [[printable(cell) for cell in row] for row in rows]
    table = Table(box=box.SIMPLE_HEAD, title=Text(printable(title)) if title else None)
    for index, heading in enumerate(headings):
        numbers = [_is_number(row[index]) for row in body if row[index]]
        right = bool(numbers) and all(numbers)
        table.add_column(Text(heading), justify='right' if right else 'left', overflow='fold')
    for row in body:
        table.add_row(*(Text(cell) for cell in row))
    console(stream or sys.stdout).print(table)


def console(stream: TextIO) -> Console:
    """A rich console that neither colours numbers nor obeys markup; wide where no terminal is."""
    from rich.console import Console

    width = None if stream.isatty() else 200
    return Console(file=stream, highlight=False, markup=False, emoji=False, width=width)


def _is_number(text: str) -> bool:
    try:
        float(text.split(' ')[0])
    except ValueError:
        return text in ('-', '')
    return True


@contextmanager
def progress_bar(title: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Gives a function (done so far, note='') that moves a bar on stderr; none without a terminal.

    The bar comes once 2 s have passed, also while the work is in one long call; without `total`
    it tells only that work goes on and for how long.
    """
    if not sys.stderr.isatty():
        yield lambda done, note='': None
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    bar = Progress(
        TextColumn('{task.description}', markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn('{task.fields[note]}', markup=False),
        console=console(sys.stderr),
        transient=True,
    )
    task = bar.add_task(printable(title), total=total or None, note='')
    timer = threading.Timer(QUIET_SECONDS, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda done, note='': bar.update(task, completed=done, note=printable(note))
    finally:
        timer.cancel()
        timer.join()
        bar.stop()


def tracked(items: Sequence[Item], title: str) -> Iterator[Item]:
    """`items` one by one under a progress bar."""
    with progress_bar(title, len(items)) as show:
        for done, item in enumerate(items):
            show(done)
            yield item


@contextmanager
def status_line() -> Iterator[Callable[[str], None]]:
    """Gives a function that rewrites one line on stderr, at most five times a second."""
    last = 0.0

    def show(text: str) -> None:
        nonlocal last
        now = time.monotonic()
        if sys.stderr.isatty() and now - last > LINE_PERIOD:
            last = now
            sys.stderr.write(f'\r\033[K{printable(text)}')
            sys.stderr.flush()

    try:
        yield show
    finally:
        if last:
            sys.stderr.write('\r\033[K')
            sys.stderr.flush()
