# SPDX-License-Identifier: Apache-2.0
"""Many runs at once: bags times a grid of numbers, on processes here or on a Dask cluster.

A task is idempotent: its folder is named by what goes in (bag, description, object, options and
code), it appears as a whole, and what is there already is not computed again. So a killed worker
loses only the task in its hands, which is started again, and the number of workers changes no
byte.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Iterator
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from grasp_common.worker_pool import worker_pool
from grasp_replay.errors import BagError

ATTEMPTS = 3
CODE = ('grasp_replay', 'shell_deform', 'scan_compare')
GRID_KEYS = ('young_modulus_pa', 'thickness_m', 'poisson_ratio', 'control_vertices')


@dataclass(frozen=True)
class Task:
    """One bag with one choice of numbers.

    `changes` are numbers of the object to replace; `young`, `object_pose` (seven numbers),
    `search`, `scan_unit` and `thick` as in `PipelineOptions`; `page`,
    `samples` and `published` as in `Extent`.
    """

    bag: Path
    changes: tuple[tuple[str, float], ...] = ()
    object_name: str | None = None
    young: str = 'auto'
    page: bool = True
    samples: bool = True
    published: Path | None = None
    object_pose: tuple[float, ...] | None = None
    search: bool = False
    scan_unit: str = 'm'
    thick: bool = True


@dataclass
class CampaignResult:
    """Folders by task, in the order of the tasks; `failed` holds sentences by task number."""

    folders: list[Path] = field(default_factory=list)
    failed: dict[int, str] = field(default_factory=dict)
    reused: int = 0


def parse_grid(rules: list[str]) -> list[tuple[tuple[str, float], ...]]:
    """Rules `key=a,b,c` as every combination of their values; raises BagError."""
    axes = []
    for rule in rules:
        key, separator, values = rule.partition('=')
        if key not in GRID_KEYS or not separator:
            raise BagError(f'the grid rule {rule!r} is not KEY=A,B,... with KEY in {GRID_KEYS}')
        try:
            axes.append([(key, float(value)) for value in values.split(',')])
        except ValueError as error:
            raise BagError(f'the grid rule {rule!r} holds something that is no number') from error
    return [tuple(combination) for combination in itertools.product(*axes)]


def task_key(task: Task) -> str:
    """Sixteen hexadecimal digits of everything that determines the task's results."""
    from grasp_replay.experiment import FILE_NAME, read_experiment
    from grasp_replay.published import published_table
    from grasp_replay.recording import bag_sha256

    digest = hashlib.sha256()
    folder = task.bag if task.bag.is_dir() else task.bag.parent
    name = task.object_name or read_experiment(task.bag).object_file
    published = task.published or published_table(task.bag)
    for path in (folder / FILE_NAME, published, Path(name) if name else None):
        digest.update(path.read_bytes() if path is not None and path.is_file() else b'-')
    choice: list[Any] = [name, task.young, list(task.changes), task.page, task.samples]
    choice += [task.object_pose, task.search, task.scan_unit, task.thick]
    digest.update(json.dumps(choice).encode())
    digest.update(bag_sha256(task.bag).encode())
    digest.update(code_sha256().encode())
    return digest.hexdigest()[:16]


def code_sha256() -> str:
    """Digest of the sources that compute results."""
    digest = hashlib.sha256()
    for package in CODE:
        root = Path(str(files(package)))
        for path in sorted(root.rglob('*')):
            if path.suffix in ('.py', '.yaml', '.html', '.css', '.js') and path.is_file():
                digest.update(path.relative_to(root).as_posix().encode() + b'\0')
                digest.update(path.read_bytes())
    return digest.hexdigest()


def run_task(task: Task, folder: Path) -> bool:
    """Compute a task into its folder unless it is there already; returns whether it was.

    Runs in a worker: it takes and returns nothing but plain data. Raises BagError.
    """
    from grasp_replay.pipeline import PipelineOptions
    from grasp_replay.report_files import RESULTS, Extent, make_report
    from shell_deform.live.pose import pose_of

    if (folder / RESULTS).is_file():
        return True
    options = PipelineOptions(
        object_name=task.object_name,
        object_pose=None if task.object_pose is None else pose_of(list(task.object_pose)),
        search=task.search,
        scan_unit=task.scan_unit,
        young=task.young,
        changes=dict(task.changes),
        thick=task.thick,
    )
    make_report(task.bag, folder, options, Extent(task.page, task.samples, task.published))
    return False


def run_campaign(
    tasks: list[Task],
    out: Path,
    processes: int = 1,
    scheduler: str | None = None,
    show: Callable[[float, str], None] = lambda _share, _note: None,
) -> CampaignResult:
    """Run all tasks; `scheduler` is the address of a Dask scheduler, else processes are started.

    Writes `out/campaign.json`. Raises BagError when no executor can be had.
    """
    out.mkdir(parents=True, exist_ok=True)
    result = CampaignResult()
    work: dict[int, Work] = {}
    for number, task in enumerate(tasks):
        try:
            work[number] = task, (out / f'{task.bag.stem}_{task_key(task)}').resolve()
        except BagError as error:
            result.failed[number] = str(error)
    done: set[int] = set()
    source = _on_dask(work, scheduler) if scheduler else _on_processes(work, processes)
    for number, answer in source:
        if isinstance(answer, BagError):
            result.failed[number] = str(answer)
        else:
            done.add(number)
            result.reused += answer
        share = (len(done) + len(result.failed)) / len(tasks)
        show(share, f'{len(done)} of {len(tasks)} tasks done')
    folders = {number: out / work[number][1].name for number in sorted(done)}
    result.folders = list(folders.values())
    _write_summary(tasks, folders, result.failed, out)
    return result


Work = tuple[Task, Path]
Answer = bool | BagError


def _on_processes(work: dict[int, Work], processes: int) -> Iterator[tuple[int, Answer]]:
    """Each task's answer as it comes; a broken pool is replaced and its open tasks repeated."""
    waiting = dict(work)
    for attempt in range(ATTEMPTS):
        if not waiting:
            return
        with worker_pool(max(1, min(processes, len(waiting)))) as pool:
            futures: dict[Future[bool], int] = {
                pool.submit(run_task, *waiting[number]): number for number in waiting
            }
            for future in as_completed(futures):
                number = futures[future]
                try:
                    answer: Answer = future.result()
                except BagError as error:
                    answer = error
                except BrokenProcessPool:
                    if attempt + 1 < ATTEMPTS:
                        continue
                    answer = BagError(
                        f'{waiting[number][0].bag}: the worker was killed {ATTEMPTS} times'
                    )
                del waiting[number]
                yield number, answer


def _on_dask(work: dict[int, Work], scheduler: str) -> Iterator[tuple[int, Answer]]:
    try:
        from distributed import Client
        from distributed import as_completed as dask_as_completed
    except ImportError as error:
        raise BagError(
            'a scheduler address needs the package `distributed`; install dask[distributed], or '
            'leave --scheduler out to use processes'
        ) from error
    try:
        client = Client(scheduler, timeout='20s')
    except (OSError, ValueError) as error:
        raise BagError(f'no Dask scheduler answers at {scheduler}: {error}') from error
    with client:
        futures = {
            client.submit(run_task, task, folder, retries=ATTEMPTS, pure=False): number
            for number, (task, folder) in work.items()
        }
        for future in dask_as_completed(list(futures)):
            number, problem = futures[future], future.exception()
            if problem is None:
                yield number, future.result()
            elif isinstance(problem, BagError):
                yield number, problem
            else:
                yield number, BagError(f'{work[number][0].bag}: {problem}')


def _write_summary(
    tasks: list[Task], folders: dict[int, Path], failed: dict[int, str], out: Path
) -> None:
    from grasp_replay.report_files import RESULTS
    from grasp_replay.results import write_file

    entries: list[dict[str, Any]] = []
    for number, task in enumerate(tasks):
        entry: dict[str, Any] = {'bag': task.bag.name, 'changes': dict(task.changes)}
        if number in folders:
            results = json.loads((folders[number] / RESULTS).read_text())
            entry['folder'] = folders[number].name
            entry['young_modulus_pa'] = results['young_modulus_pa']
            entry['mean_error_m'] = {
                theory: [row['theories'][theory]['mean_error_m'] for row in results['rows']]
                for theory in results['rows'][0]['theories']
            }
        else:
            entry['failed'] = failed[number]
        entries.append(entry)
    write_file(out / 'campaign.json', json.dumps({'tasks': entries}, indent=1) + '\n')
