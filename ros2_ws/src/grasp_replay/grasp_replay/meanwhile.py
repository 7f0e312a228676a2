# SPDX-License-Identifier: Apache-2.0
"""Work in another process, beside what this one does meanwhile."""

from __future__ import annotations

import multiprocessing
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import TypeVar

from grasp_common.watchdog import end_with_parent
from shell_deform.compiled.halves import one_core

T = TypeVar('T')


@contextmanager
def meanwhile(job: Callable[..., T], *arguments: object) -> Iterator[Callable[[], T]]:
    """Gives a function that returns what `job` of the `arguments` did, or raises what it raised.

    A forked child works on it from now on, and ends with the block, also where that fails. Where
    this process has one core to itself, or may have no children (as a worker of Dask), it does the
    job when it is asked for the result; also where the child was killed.
    """
    if one_core() or multiprocessing.current_process().daemon:
        yield lambda: job(*arguments)
        return
    # One pipe and no pool: its threads and locks would have to outlive a child that is ended.
    forked = multiprocessing.get_context('fork')
    ours, theirs = forked.Pipe(duplex=False)
    child = forked.Process(target=_do, args=(theirs, job, arguments), daemon=True)
    with warnings.catch_warnings():
        # Python 3.12 warns of locks that other threads may hold: ours hold none while they wait.
        warnings.simplefilter('ignore', DeprecationWarning)
        child.start()
    theirs.close()

    def result() -> T:
        try:
            value, error = ours.recv()
        except EOFError:
            return job(*arguments)
        if error is not None:
            raise error
        return value

    try:
        yield result
    finally:
        child.kill()
        child.join()
        ours.close()


def _do(answer: Connection, job: Callable[..., object], arguments: tuple[object, ...]) -> None:
    """A child of ours ends with its parent, and leaves it to the parent to be interrupted."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        answer.send((job(*arguments), None))
    except Exception as error:
        answer.send((None, error))
