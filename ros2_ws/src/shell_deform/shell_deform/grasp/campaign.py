# SPDX-License-Identifier: Apache-2.0
"""Maps of thousands of grasps, on processes here or on a Dask cluster; resumable after a kill.

Each grasp is a file of its own, which appears as a whole, in a folder named by what goes in
(request, object, code). What is there already is not worked out again: a killed worker loses the
grasp in its hands, and neither the number of workers nor their order changes a byte.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from grasp_common.worker_pool import worker_pool
from shell_deform.compiled.halves import keep_to_one_core
from shell_deform.contact.finger_bodies import read_finger_bodies
from shell_deform.grasp.mapping import MapRequest, described, map_grasp
from shell_deform.grasp.sampling import FINGERTIPS

ATTEMPTS = 3
BATCH = 8
"""Grasps that a worker takes at once; each of them is kept when it is done."""


class CampaignError(RuntimeError):
    """A map that cannot be made; one sentence."""


def map_key(request: MapRequest) -> str:
    """Sixteen hexadecimal digits of everything that determines the grasps, but their number."""
    digest = hashlib.sha256()
    choice = described(request)
    choice.pop('number')
    digest.update(json.dumps(choice, sort_keys=True).encode())
    named = Path(request.object_name)
    digest.update(named.read_bytes() if named.is_file() else b'-')
    if request.hand in FINGERTIPS:
        digest.update(pickle.dumps(read_finger_bodies(request.body).loaded()))
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob('*')):
        if path.suffix in ('.py', '.yaml') and path.is_file():
            digest.update(path.relative_to(root).as_posix().encode() + b'\0')
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def run_batch(request: MapRequest, numbers: list[int], folder: str) -> list[int]:
    """Work out grasps into their files; in a worker, so it takes and returns plain data only."""
    for number in numbers:
        path = _file(Path(folder), number)
        if not path.is_file():
            text = json.dumps(map_grasp(request, number), allow_nan=False) + '\n'
            temporary = path.with_name(f'.{path.name}.{os.getpid()}.part')
            temporary.write_text(text, encoding='utf-8')
            os.replace(temporary, path)
    return numbers


def run_map(
    request: MapRequest,
    out: Path,
    processes: int = 1,
    scheduler: str | None = None,
    show: Callable[[float, str], None] = lambda _share, _note: None,
) -> list[dict[str, Any]]:
    """All grasps of a map by number; `scheduler` is a Dask address, else processes are started.

    Raises CampaignError where workers die again and again or no scheduler answers.
    """
    folder = (out / 'grasps' / map_key(request)).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for part in folder.glob('.*.part'):
        part.unlink(missing_ok=True)
    open_ones = [n for n in range(request.number) if not _file(folder, n).is_file()]
    batches = [open_ones[i : i + BATCH] for i in range(0, len(open_ones), BATCH)]
    done = request.number - len(open_ones)
    work = _on_dask if scheduler else _on_processes
    for finished in work(request, batches, str(folder), scheduler or processes):
        done += len(finished)
        show(done / request.number, f'{done} of {request.number} grasps')
    return [json.loads(_file(folder, n).read_text()) for n in range(request.number)]


def _file(folder: Path, number: int) -> Path:
    return folder / f'{number:06d}.json'


def _on_processes(
    request: MapRequest, batches: list[list[int]], folder: str, processes: Any
) -> Iterator[list[int]]:
    """Batches as they come; a broken pool is replaced and what is open repeated."""
    waiting = {number: batch for number, batch in enumerate(batches)}
    for _ in range(ATTEMPTS):
        if not waiting:
            return
        most = max(1, min(int(processes), len(waiting)))
        with worker_pool(most, keep_to_one_core) as pool:
            futures = {
                pool.submit(run_batch, request, batch, folder): number
                for number, batch in waiting.items()
            }
            for future in as_completed(futures):
                try:
                    finished = future.result()
                except BrokenProcessPool:
                    continue
                del waiting[futures[future]]
                yield finished
    if waiting:
        raise CampaignError(
            f'the workers were killed {ATTEMPTS} times; what is done is kept: start again'
        )


def _on_dask(
    request: MapRequest, batches: list[list[int]], folder: str, scheduler: Any
) -> Iterator[list[int]]:
    try:
        from distributed import Client
        from distributed import as_completed as dask_as_completed
    except ImportError as error:
        raise CampaignError(
            'a scheduler address needs the package `distributed`; install dask[distributed], or '
            'leave --scheduler out to use processes'
        ) from error
    try:
        client = Client(scheduler, timeout='20s')
    except (OSError, ValueError) as error:
        raise CampaignError(f'no Dask scheduler answers at {scheduler}: {error}') from error
    with client:
        futures = [
            client.submit(run_batch, request, batch, folder, retries=ATTEMPTS, pure=False)
            for batch in batches
        ]
        for future in dask_as_completed(futures):
            problem = future.exception()
            if problem is not None:
                raise CampaignError(f'a batch of grasps failed: {problem}')
            yield future.result()
