# SPDX-License-Identifier: Apache-2.0
"""Processes that share work, and end with whoever started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

from grasp_common.watchdog import end_with_parent

THREAD_VARIABLES = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')


@contextmanager
def worker_pool(
    processes: int, prepare: Callable[[], None] | None = None
) -> Iterator[ProcessPoolExecutor]:
    """A pool of fresh interpreters of one thread each; every one calls `prepare` first.

    What breaks into the work, an interrupt say, ends them as they stand.
    """
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, '1')
    with ProcessPoolExecutor(
        max_workers=processes,
        mp_context=multiprocessing.get_context('spawn'),
        initializer=_begin,
        initargs=(prepare,),
    ) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise


def _begin(prepare: Callable[[], None] | None) -> None:
    """What a worker does first.

    Workers wait for work on a pipe that they hold open for each other: left alone they outlive an
    owner that was killed. A terminal interrupts them together with their owner, who says so.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()
    owner = multiprocessing.parent_process()
    if owner is not None and not owner.is_alive():
        os._exit(1)
    if prepare is not None:
        prepare()
