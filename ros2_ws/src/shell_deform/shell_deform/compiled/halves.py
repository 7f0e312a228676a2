# SPDX-License-Identifier: Apache-2.0
"""Two halves of one piece of work at the same time: the second in a helper thread.

Kernels release the interpreter lock. Each thread that calls has a helper of its own, which it
starts itself and which so inherits its scheduling class: the solver runs in two of them in turn
(`live/background/courtesy.py`). The caller works on the first half meanwhile: the processor time
of its thread still says whether it gets on.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar('T')

_own = threading.local()
_one_core = False


def keep_to_one_core() -> None:
    """From now on this process works on both halves itself: one of many, each has its own core.

    Halves are summed in the same order, so that no result changes.
    """
    global _one_core
    _one_core = True


def one_core() -> bool:
    """Whether this process has no second core for other work."""
    return _one_core or len(os.sched_getaffinity(0)) < 2


def _forget() -> None:
    """In a forked child the helper's thread does not exist."""
    global _own
    _own = threading.local()


os.register_at_fork(after_in_child=_forget)


def in_halves(part: Callable[[int, int], T], middle: int, count: int) -> tuple[T, T]:
    """What `part` gives from 0 up to `middle` and from there up to `count`, at the same time."""
    return both(lambda: part(0, middle), lambda: part(middle, count))


def both(first: Callable[[], T], second: Callable[[], T]) -> tuple[T, T]:
    """What both give; `second` runs in the helper. Raises what either raises, `first` before."""
    if _one_core:
        return first(), second()
    helper: ThreadPoolExecutor | None = getattr(_own, 'helper', None)
    if helper is None:
        helper = _own.helper = ThreadPoolExecutor(1, 'half')
    other = helper.submit(second)
    try:
        return first(), other.result()
    finally:
        # Nothing may still write where the caller goes on.
        other.exception()
