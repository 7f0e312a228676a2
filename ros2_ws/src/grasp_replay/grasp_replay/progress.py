"""Progress on a terminal: a bar for work of known length, a line for work without end."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

# Work that ends sooner shows no bar.
QUIET_SECONDS = 2.0


@contextmanager
def progress_bar(title: str, total: float) -> Iterator[Callable[[float, str], None]]:
    """Gives a function (done so far, note) that draws a bar on stderr once 2 s have passed.

    Nothing is drawn when stderr is no terminal.
    """
    bar = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn('{task.fields[note]}'),
        console=Console(stderr=True),
        transient=True,
    )
    task = bar.add_task(title, total=total or None, note='')
    begin = time.monotonic()
    visible = False

    def show(done: float, note: str = '') -> None:
        nonlocal visible
        if not sys.stderr.isatty():
            return
        if not visible and time.monotonic() - begin > QUIET_SECONDS:
            visible = True
            bar.start()
        bar.update(task, completed=done, note=note)

    try:
        yield show
    finally:
        if visible:
            bar.stop()


@contextmanager
def status_line() -> Iterator[Callable[[str], None]]:
    """Gives a function that rewrites one line on stderr, at most five times a second."""
    last = 0.0

    def show(text: str) -> None:
        nonlocal last
        now = time.monotonic()
        if sys.stderr.isatty() and now - last > 0.2:
            last = now
            sys.stderr.write(f'\r\033[K{text}')
            sys.stderr.flush()

    try:
        yield show
    finally:
        if last:
            sys.stderr.write('\r\033[K')
            sys.stderr.flush()
