"""What every command does alike: one clear sentence on failure, progress on a terminal, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track

Item = TypeVar('Item')


class CommandError(Exception):
    """The job cannot be done; the message is the sentence the user reads."""


def run(program: str, job: Callable[[], None]) -> int:
    """Exit code of `job`: 0 when done, 1 with one sentence on stderr when it failed."""
    try:
        job()
    except (CommandError, ValueError, OSError) as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f'{program}: interrupted', file=sys.stderr)
        return 1
    return 0


def progress(items: Sequence[Item], description: str) -> Iterator[Item]:
    """`items` one by one, with a bar on stderr when that is a terminal."""
    console = Console(stderr=True)
    yield from track(items, description, console=console, disable=not console.is_terminal)


def print_json(document: Any) -> None:
    """One JSON document on stdout."""
    json.dump(document, sys.stdout, ensure_ascii=False, allow_nan=False)
    sys.stdout.write('\n')
