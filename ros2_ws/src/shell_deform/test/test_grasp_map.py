# SPDX-License-Identifier: Apache-2.0
"""A map of grasps: the same bytes by any number of workers, nothing lost by a kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shell_deform.commands.grasp_map import main
from shell_deform.grasp.campaign import CampaignError, map_key, run_map
from shell_deform.grasp.map_files import write_map
from shell_deform.grasp.mapping import MapRequest, map_grasp, ranking, workplace
from shell_deform.grasp.sampling import SamplingError, sample_grasp

REQUEST = MapRequest('tennis_ball', number=10, mass=0.058, vertices=162)


SHOWN = []


@pytest.fixture(scope='module')
def alone(tmp_path_factory):
    SHOWN.clear()
    folder = tmp_path_factory.mktemp('alone')
    return _files(REQUEST, folder, show=lambda share, text: SHOWN.append((share, text)))


def _files(request, out, **options):
    grasps = run_map(request, out, **options)
    place = workplace(request.object_name, request.vertices, request.theory)
    write_map(request, grasps, place, out)
    return {name: (out / name).read_bytes() for name in ('map.json', 'map.csv', 'map.html')}


def test_progress_counts_up_to_every_grasp(alone):
    assert alone
    shares = [share for share, _text in SHOWN]
    assert shares == sorted(shares) and shares[0] > 0.0
    assert SHOWN[-1] == (1.0, f'{REQUEST.number} of {REQUEST.number} grasps')


@pytest.mark.parametrize('processes', [2, 3])
def test_the_number_of_processes_changes_no_byte(alone, tmp_path, processes):
    assert _files(REQUEST, tmp_path, processes=processes) == alone


@pytest.mark.filterwarnings('ignore')
def test_a_dask_cluster_gives_the_same_bytes(alone, tmp_path):
    distributed = pytest.importorskip('distributed', reason='dask.distributed is optional')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        there = _files(REQUEST, tmp_path, scheduler=cluster.scheduler_address)
    assert there == alone


def test_a_killed_map_goes_on_where_it_was(alone, tmp_path):
    code = (
        'from shell_deform.grasp.campaign import run_map\n'
        'from shell_deform.grasp.mapping import MapRequest\n'
        'from pathlib import Path\n'
        f'run_map({REQUEST!r}, Path({str(tmp_path)!r}))\n'
    )
    script = tmp_path / 'map.py'
    script.write_text(
        'if __name__ == "__main__":\n' + '\n'.join(f'    {x}' for x in code.split('\n'))
    )
    folder = tmp_path / 'grasps' / map_key(REQUEST)
    running = subprocess.Popen([sys.executable, str(script)], start_new_session=True)
    deadline = time.monotonic() + 120
    while len(list(folder.glob('*.json'))) < 2:
        assert time.monotonic() < deadline and running.poll() is None
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    kept = {path: path.stat().st_mtime_ns for path in folder.glob('*.json')}
    assert len(kept) >= 2
    assert _files(REQUEST, tmp_path) == alone
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in kept.items())
    assert not list(folder.glob('.*'))


def test_the_best_grasp_stands_first_and_holds_most(alone):
    told = json.loads(alone['map.json'])
    worst = [one['worst_capacity_n'] for one in told['grasps']]
    assert worst == sorted(worst, reverse=True)
    assert len(told['grasps']) + len(told['failed']) == REQUEST.number
    best = told['grasps'][0]
    assert best['closed'] and best['needed_friction'] < told['grasps'][-1]['needed_friction']
    assert alone['map.csv'].count(b'\n') == len(told['grasps']) + 1
    assert b'data:image/png;base64,' in alone['map.html']
    assert 'no gauge sees' in told['note']


def test_a_grasp_depends_on_its_number_alone():
    more = replace(REQUEST, number=500)
    assert map_grasp(more, 3) == map_grasp(REQUEST, 3)
    assert map_key(more) == map_key(REQUEST)
    assert map_key(replace(REQUEST, friction=0.4)) != map_key(REQUEST)


def test_a_squeeze_that_does_not_converge_is_told_and_not_ranked():
    deep = map_grasp(replace(REQUEST, depth=0.2), 0)
    assert deep['failed']
    assert ranking([deep]) == []


def test_a_thick_wall_is_mapped_too():
    found = map_grasp(replace(REQUEST, theory='thick', depth=1e-3), 0)
    assert 'failed' not in found
    thin = map_grasp(replace(REQUEST, depth=1e-3), 0)
    assert found['worst_slip_n'] > 0.0 and found['smallest_stiffness_n_m'] > 0.0
    assert found['push_n'] == pytest.approx(thin['push_n'], rel=0.3)
    assert 'compared with no solid' in found['stress_unresolved']
    assert 'ask for more control vertices' in thin['stress_unresolved']
    assert thin['stress_sigma_pa'] > thin['largest_stress_pa']


def test_three_pins_close_on_one_point_in_a_plane():
    place = workplace(REQUEST.object_name, REQUEST.vertices, REQUEST.theory)
    for number in range(5):
        grasp = sample_grasp(place.points, place.triangles, 'three_pins', 0.35, (1, number))
        assert grasp.axis.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
        assert np.linalg.matrix_rank(grasp.axis, 1e-9) == 2
    found = map_grasp(replace(REQUEST, hand='three_pins', depth=2e-3), 0)
    assert len(found['fingers']) == 3


def test_pins_lean_no_more_than_asked_and_close_on_each_other():
    place = workplace(REQUEST.object_name, REQUEST.vertices, REQUEST.theory)
    for number in range(20):
        grasp = sample_grasp(place.points, place.triangles, 'two_pins', 0.3, (2, number))
        line = grasp.at[1] - grasp.at[0]
        line /= np.linalg.norm(line)
        assert grasp.axis[0] == pytest.approx(line, abs=1e-9)
        inward = -grasp.at[0] / np.linalg.norm(grasp.at[0])
        assert line @ inward > np.cos(0.3) - 0.03


def test_a_flat_sheet_has_no_grasp():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    with pytest.raises(SamplingError, match='no line'):
        sample_grasp(points, np.array([[0, 1, 2]]), 'two_pins', 0.1, (0, 0))


def test_the_command_writes_its_files_and_json(tmp_path, capsys):
    arguments = ['tennis_ball', '--out', str(tmp_path), '--number', '2', '--vertices', '162']
    assert main([*arguments, '--force', '5', '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['grasps'][0]['push_n'] == pytest.approx(5.0, rel=0.1)
    assert Path(tmp_path / 'map.html').is_file()


def test_what_cannot_be_done_is_one_sentence(tmp_path, capsys):
    assert main(['no_such_object', '--out', str(tmp_path), '--number', '1']) == 1
    assert 'no_such_object' in capsys.readouterr().err
    wide = ['--number', '2', '--vertices', '162', '--pin-radius', '0.05']
    assert main(['tennis_ball', '--out', str(tmp_path), *wide]) == 1
    assert 'none of 2 grasps of tennis_ball could be squeezed' in capsys.readouterr().err


def test_a_scheduler_without_dask_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(CampaignError, match=r'install dask\[distributed\]'):
        run_map(REQUEST, tmp_path, scheduler='tcp://127.0.0.1:1')


TIPS = replace(REQUEST, hand='two_fingertips', depth=1e-3, friction=0.4, number=1)


def test_a_map_of_fingertips_tells_what_their_rings_hold():
    told = map_grasp(TIPS, 1)
    assert 'failed' not in told
    assert told['closed']
    assert told['contact_points'] > 0
    assert told['depth_m'] == pytest.approx(1e-3)
    # Along the line of two fingertips friction carries at most twice mu N.
    assert told['worst_capacity_n'] <= 2.0 * 0.4 * told['push_n'] * 1.001
    assert told['worst_slip_n'] > 0.0
    # What slips loses work, and few steps measure it coarsely.
    assert told['energy_j'] < told['squeeze_work_j'] < 1.5 * told['energy_j']
    assert 'no shell theory resolves' in told['stress_unresolved']


def test_another_body_is_another_map(tmp_path):
    body = tmp_path / 'ball.yaml'
    body.write_text('name: tip\nball: {radius_m: 0.008}\n')
    keys = [map_key(TIPS), map_key(replace(TIPS, body=str(body)))]
    body.write_text('name: tip\nball: {radius_m: 0.009}\n')
    assert len({*keys, map_key(replace(TIPS, body=str(body)))}) == 3


@pytest.mark.parametrize(
    ('options', 'text'),
    [
        (['--finger-body', 'barrett_fingertip'], 'two_pins carry none'),
        (['--hand', 'two_fingertips', '--finger-body', 'nosuch'], "no body 'nosuch'"),
        (
            ['--hand', 'three_fingertips', '--finger-body', '1: barrett_fingertip'],
            'not every finger of three_fingertips',
        ),
    ],
)
def test_bodies_that_nobody_carries_are_refused(options, text, tmp_path, capsys):
    assert main(['tennis_ball', '--out', str(tmp_path / 'map'), *options]) == 1
    assert text in capsys.readouterr().err
    assert not (tmp_path / 'map').exists()
