# SPDX-License-Identifier: Apache-2.0
"""Many runs at once: the same bytes, nothing twice, nothing lost."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from pathlib import Path
from typing import Any

import pytest
from grasp_samples import write_grasp

from grasp_replay.campaign import CampaignResult, Task, parse_grid, run_campaign, task_key
from grasp_replay.commands.grasp_report import main
from grasp_replay.errors import BagError

COARSE = ('control_vertices', 200.0)


@pytest.fixture(scope='module')
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_grasp(tmp_path_factory.mktemp('campaign') / 'grasp', (10.0,))


def _tasks(grasp: Path, count: int = 2) -> list[Task]:
    return [
        Task(
            grasp,
            (COARSE, ('young_modulus_pa', 11e6 + 1e6 * k)),
            young='object',
            page=False,
            samples=False,
            # Which theories are solved is nothing to a campaign; this one takes longest.
            thick=False,
        )
        for k in range(count)
    ]


def _bytes(result: CampaignResult) -> list[dict[str, bytes]]:
    assert not result.failed
    return [
        {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
        for folder in result.folders
    ]


@pytest.fixture(scope='module')
def alone(grasp: Path, tmp_path_factory: pytest.TempPathFactory) -> CampaignResult:
    return run_campaign(_tasks(grasp), tmp_path_factory.mktemp('alone'), processes=1)


def test_the_number_of_processes_changes_no_byte(
    grasp: Path, alone: CampaignResult, tmp_path: Path
) -> None:
    two = run_campaign(_tasks(grasp), tmp_path, processes=2)
    assert _bytes(alone) == _bytes(two)
    assert len(two.folders) == 2


def test_what_is_there_is_not_computed_again(grasp: Path, alone: CampaignResult) -> None:
    stamps = [(folder / 'results.json').stat().st_mtime_ns for folder in alone.folders]
    again = run_campaign(_tasks(grasp), alone.folders[0].parent)
    assert (alone.reused, again.reused) == (0, 2)
    assert [(f / 'results.json').stat().st_mtime_ns for f in again.folders] == stamps


def test_a_killed_worker_loses_nothing(grasp: Path, tmp_path: Path, wait_until: Any) -> None:
    results: list[CampaignResult] = []
    thread = threading.Thread(
        target=lambda: results.append(
            run_campaign(_tasks(grasp, 3), tmp_path / 'out', processes=2)
        )
    )
    thread.start()
    wait_until(lambda: list((tmp_path / 'out').glob('*/results.json')), 90)
    os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGKILL)
    thread.join(100)
    assert not thread.is_alive()
    assert results[0].failed == {}
    assert len(results[0].folders) == 3
    assert not list((tmp_path / 'out').rglob('.part'))


def test_the_key_depends_on_everything_that_goes_in(grasp: Path, tmp_path: Path) -> None:
    copy = tmp_path / 'grasp'
    copy.mkdir()
    for file in grasp.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    task = Task(grasp)
    assert task_key(Task(copy)) == task_key(task)
    assert task_key(Task(grasp, (('thickness_m', 0.002),))) != task_key(task)
    assert task_key(Task(grasp, young='object')) != task_key(task)
    table = copy / 'table.yaml'
    table.write_text('rows: []')
    assert task_key(Task(grasp, published=table)) != task_key(task)
    (copy / 'experiment.yaml').write_text((copy / 'experiment.yaml').read_text() + '\n')
    assert task_key(Task(copy)) != task_key(task)


def test_a_grid_is_every_combination() -> None:
    assert parse_grid(['thickness_m=0.002,0.003', 'poisson_ratio=0.5']) == [
        (('thickness_m', 0.002), ('poisson_ratio', 0.5)),
        (('thickness_m', 0.003), ('poisson_ratio', 0.5)),
    ]
    assert parse_grid([]) == [()]


@pytest.mark.parametrize('rule', ['colour=1', 'thickness_m', 'thickness_m=thin'])
def test_a_malformed_grid_is_refused(rule: str) -> None:
    with pytest.raises(BagError, match='the grid rule'):
        parse_grid([rule])


def test_a_task_that_fails_is_named_and_the_others_are_done(
    grasp: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / 'empty'
    empty.mkdir()
    code = main(
        [str(grasp), str(empty), '--out', str(tmp_path / 'out'), '--no-page', '--no-samples',
         '--no-thick', '--grid', 'control_vertices=200']
    )  # fmt: skip
    captured = capsys.readouterr()
    assert code == 1
    assert '1 of 2 tasks failed; task 1' in captured.err
    assert '1 of 2 tasks done' in captured.out
    tasks = json.loads((tmp_path / 'out' / 'campaign.json').read_text())['tasks']
    assert 'mean_error_m' in tasks[0]
    assert 'holds no .mcap' in tasks[1]['failed']


def test_a_scheduler_without_dask_is_one_sentence(
    grasp: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(BagError, match=r'install dask\[distributed\]'):
        run_campaign(_tasks(grasp, 1), tmp_path / 'out', scheduler='tcp://127.0.0.1:1')


@pytest.mark.filterwarnings('ignore')
def test_a_dask_cluster_gives_the_same_bytes(
    grasp: Path, alone: CampaignResult, tmp_path: Path
) -> None:
    distributed = pytest.importorskip('distributed', reason='dask.distributed is optional')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        address = cluster.scheduler_address
        there = run_campaign(_tasks(grasp), tmp_path / 'there', scheduler=address)
    assert _bytes(alone) == _bytes(there)


@pytest.mark.filterwarnings('ignore')
def test_a_killed_dask_worker_loses_nothing(
    grasp: Path, alone: CampaignResult, tmp_path: Path, wait_until: Any
) -> None:
    distributed = pytest.importorskip('distributed', reason='dask.distributed is optional')
    results: list[CampaignResult] = []
    out = tmp_path / 'there'
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        address = cluster.scheduler_address
        thread = threading.Thread(
            target=lambda: results.append(run_campaign(_tasks(grasp, 4), out, scheduler=address))
        )
        thread.start()
        wait_until(lambda: list(out.glob('*/results.json')), 90)
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        thread.join(100)
        assert not thread.is_alive()
    assert results[0].failed == {}
    assert _bytes(results[0])[:2] == _bytes(alone)
    assert len(results[0].folders) == 4
