# SPDX-License-Identifier: Apache-2.0
"""Work in another process, beside what this one does meanwhile."""

from __future__ import annotations

import multiprocessing
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from shell_deform.compiled.first_use import end_with_parent
from shell_deform.compiled.halves import one_core

T = TypeVar('T')


@contextmanager
def meanwhile(job: Callable[..., T], *arguments: object) -> Iterator[Callable[[], T]]:
    """Gives a function that returns what `job` of the `arguments` did, or raises what it raised.

    A forked child works on it from now on, and ends with the block, also where that fails. Where
    this process has one core to itself, or may have no children (as a worker of Dask), it does the
    job when it is asked for the result.
    """
    if one_core() or multiprocessing.current_process().daemon:
        yield lambda: job(*arguments)
        return
    with warnings.catch_warnings():
        # Python 3.12 warns of locks that other threads may hold: ours hold none while they wait.
        warnings.simplefilter('ignore', DeprecationWarning)
        pool = multiprocessing.get_context('fork').Pool(1, _begin)
    with pool:
        yield pool.apply_async(job, arguments).get


def _begin() -> None:
    """A child of ours ends with its parent, and leaves it to the parent to be interrupted."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
