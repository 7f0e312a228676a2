# SPDX-License-Identifier: Apache-2.0
"""Every command line of the READMEs is run as written, or stands here with the reason why not.

A line runs in a folder with what its page speaks of: the recordings, a table, a scan, an object of
one's own. Nodes are started and ended when they say that they are ready. What takes minutes runs
with `make soak`, by the same table.
"""

from __future__ import annotations

import os
import shlex
import shutil
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.executables import executable
from tests.test_readmes import ROOT, calls

READMES = [ROOT / 'README.md', *sorted(ROOT.glob('ros2_ws/src/*/README.md'))]
LINES = sorted({' '.join(call).strip() for page in READMES for call in calls(page)})

# What a node says when it is there.
NODES = {
    'deformation --ros-args -p object:=tennis_ball': 'serving',
    'scan_compare --ros-args -p object:=tennis_ball': 'waiting for scans',
    'scan_compare --ros-args -p object:=tennis_ball -p report_directory:=/tmp/reports': 'waiting',
    'grasp_view': 'page ready',
    'grasp_view --ros-args -p host:=0.0.0.0': 'page ready',
    'grasp_view --ros-args -p what_if:=true': 'page ready',
    'grasp_view --ros-args -p what_if:=true -p object:=tennis_ball': 'page ready',
    'hand_bridge --ros-args -p backend:=emulator -p initialize_on_start:=true '
    '-p emulator_object:=$(pwd)/ros2_ws/src/barrett_hand_bridge/config/squeezed_ball.yaml': (
        'connected to a'
    ),
    'hand_emulator --hand 280': '239.74.163.2',
    'replay bags/tennis_ball_two_finger --loop': 'nobody listens to',
}
# What they need is not here: they end with a sentence that names it.
ALONE = {
    'hand_bridge --ros-args -p port:=/dev/ttyUSB0 -p calibration:=hand.yaml': '/dev/ttyUSB0',
    'hand_bridge --ros-args -p backend:=serial -p port:=/dev/ttyUSB0 '
    '-p calibration:=$HOME/hand.yaml': '/dev/ttyUSB0',
    'hand_bridge --ros-args -p backend:=can -p calibration:=hand.yaml': 'can0',
    'replay my_grasp --clock --wait-for /hand/contacts': 'nobody listened to /hand/contacts',
}
RECORDS = (
    'record -o my_bag /hand/contacts /hand/joint_states /scan/points /object_pose',
    'record /hand/contacts /scan/points --output my_grasp',
    'record --all --exclude-topics /rosout --use-sim-time --time header',
    'record hand/finger_1/gauge_counts',
)
QUICK = (
    'shell_solve --object tennis_ball --displacement-sweep 0:0.01:20 --picture ball.png',
    'shell_solve --object half_soda_can --force 0.2,0.5,0.756 --json',
    'shell_solve --object tennis_ball --force 20',
    'shell_verify --references',
    'object_prepare scan.stl --unit mm --thickness 0.002 --young 2e6 --poisson 0.45 --out cup',
    'shell_identify squeeze.csv --object tennis_ball --plot fit.png',
    'shell_objects --copy tennis_ball',
    'deformation --help',
    'bag_check my_grasp',
    'bag_check broken.mcap --recover saved',
    'hand_calibrate weights.csv --calibration hand.yaml --serial-number 1234 --plot fit.png',
)
LONG = (
    'shell_solve --object tube.yaml --twist 0:60:12 --json',
    'shell_solve --object tube.yaml --bend 0:40:20 --about 0,1,0',
    'shell_solve --object can.yaml --axial -40 --twist 0:5:5',
    'shell_solve --object ball.yaml --displacement-sweep 0:0.006:6 --hold 600',
    'shell_verify',
    'shell_verify --group snap --all-rows',
    'shell_verify --group thick',
    'shell_verify --experiments',
    'shell_verify --solid',
    'shell_verify --solid --plot thick.png',
    'shell_identify my_bag --object cup/scan.yaml --fit-pressure --json',
    'shell_identify squeeze.csv --object tennis_ball --fit-thickness --scan-unit mm',
    'shell_identify my_bag --object tennis_ball --relaxation --until 60 --plot hold.png',
    'grasp_map tennis_ball --hand two_pins --mu 0.5 --mass 0.058 --number 5000 --processes 2 '
    '--out map',
    'grasp_map tennis_ball --hand two_fingertips --number 200 --processes 2 --out tips',
    'grasp_report bags/published/table1.yaml --out table_one',
    'grasp_report bags/tennis_ball_two_finger --out out',
    'grasp_report bags/tennis_ball_two_finger bags/half_soda_can '
    '--grid thickness_m=0.0024,0.0026 --processes 2 --out out',
    'grasp_report my_bag --object my_object.yaml --out report',
    'replay my_grasp --rate 4 --start-offset 5 --topics /hand/contacts '
    '--remap hand/contacts:=/left/contacts',
)
# Never run, and why; that their options are there is tested in `test_readmes.py`.
NOT_RUN = {
    'grasp_report bags/tennis_ball_two_finger bags/half_soda_can --scheduler tcp://host:8786 '
    '--out out': 'host stands for a machine of the reader; test_campaign.py has a scheduler',
    'object_prepare scan.stl --unit mm --thickness 0.002 …': 'cut short; the whole line is above',
    'replay my_grasp --lockstep hand/contacts:=deformation/linear': 'test_live_recording.py',
    'scan_error SCAN [SCAN ...] --object tennis_ball [--surface DEFORMED] [--rest REST] '
    '[--undeformed SCAN]': 'a usage; test_scan_error.py runs it',
    # Names of a command with an option, in a sentence.
    **dict.fromkeys(
        ('shell_solve --json', 'replay --lockstep', 'scan_error --out', 'bag_check --recover',
         'replay'), 'a name, no line'
    ),
}  # fmt: skip


def test_every_line_is_run_or_excused_and_none_of_them_is_old() -> None:
    ways = (*NODES, *ALONE, *RECORDS, *QUICK, *LONG, *NOT_RUN)
    assert sorted(ways) == sorted(set(ways))
    assert sorted(set(LINES) - set(ways)) == []
    assert sorted(set(ways) - set(LINES)) == []


@pytest.fixture(scope='module')
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the pages speak of."""
    import trimesh

    folder = tmp_path_factory.mktemp('desk')
    bags = ROOT / 'bags'
    (folder / 'bags').symlink_to(bags)
    for name, kept in (('my_grasp', 'tennis_ball_two_finger'), ('my_bag', 'long_hold')):
        (folder / name).symlink_to(bags / kept)
    cut = (bags / 'gauge_drift' / 'gauge_drift_0.mcap').read_bytes()
    (folder / 'broken.mcap').write_bytes(cut[: len(cut) // 2])
    trimesh.creation.icosphere(4, radius=32.5).export(folder / 'scan.stl')
    for name, kept in (
        ('tube.yaml', 'tube_bend'),
        ('can.yaml', 'cap_unscrew'),
        ('ball.yaml', 'long_hold'),
        ('my_object.yaml', 'long_hold'),
    ):
        shutil.copy(bags / kept / 'object.yaml', folder / name)
    (folder / 'ros2_ws').symlink_to(ROOT / 'ros2_ws')
    shutil.copy(bags / 'tennis_ball_two_finger' / 'calibration.yaml', folder / 'hand.yaml')
    # The published Table I.
    rows = ('force_n,displacement_m', '10.631,2.56e-3', '16.503,6.05e-3', '20.373,9.12e-3')
    (folder / 'squeeze.csv').write_text('\n'.join(rows) + '\n')
    return folder


def split(line: str, folder: Path) -> tuple[str, list[str]]:
    """Command and words of a line, as a shell in that folder makes them."""
    text = line.replace('$(pwd)', str(folder)).replace('$HOME', str(folder))
    command, *words = shlex.split(text)
    return command, words


def ran(line: str, folder: Path) -> None:
    command, words = split(line, folder)
    with (folder / 'log').open('w+') as log:
        done = subprocess.run(
            [executable(command), *words], cwd=folder, stdout=log, stderr=log, check=False,
            env={**os.environ, 'MPLBACKEND': 'Agg'},
        )  # fmt: skip
        log.seek(0)
        text = log.read()
    # A damaged bag is told by its exit code, also when all that is sound was saved.
    wanted = 1 if line.startswith('bag_check broken') else 0
    assert done.returncode == wanted, text
    assert 'Traceback' not in text and 'is called' not in text


@pytest.mark.timeout(300)
@pytest.mark.parametrize('line', QUICK)
def test_a_line_runs_as_written(line: str, desk: Path) -> None:
    if line.startswith('hand_calibrate'):
        # As the page says: weights hung on an emulated hand.
        ran('hand_emulator --weigh weights.csv --once', desk)
    ran(line, desk)


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize('line', LONG)
def test_a_long_line_runs_as_written(line: str, desk: Path) -> None:
    ran(line, desk)


@pytest.mark.timeout(300)
@pytest.mark.parametrize('line', NODES)
def test_a_node_starts_as_written_and_ends(
    line: str, desk: Path, start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(desk)
    command, words = split(line, desk)
    if command == 'grasp_view':
        # The page's own port may be taken on a machine that is not a reader's.
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            port = f'port:={free.getsockname()[1]}'
        words += ['-p', port] if '--ros-args' in words else ['--ros-args', '-p', port]
    running = start(command, *words)
    running.wait_for(NODES[line], 120)
    assert running.stop() in (0, 1), running.text
    assert 'Traceback' not in running.text


@pytest.mark.parametrize('line', ALONE)
def test_a_line_without_what_it_needs_ends_with_a_sentence(
    line: str, desk: Path, domain_id: int
) -> None:
    command, words = split(line, desk)
    done = subprocess.run(
        [executable(command), *words],
        cwd=desk,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1 and 'Traceback' not in done.stderr
    assert ALONE[line] in done.stderr.strip().splitlines()[-1]


@pytest.mark.parametrize('line', RECORDS)
def test_a_recording_begins_as_written_and_is_a_bag_when_it_ends(
    line: str,
    tmp_path: Path,
    start: Callable[..., Any],
    wait_until: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    running = start(*shlex.split(line))
    wait_until(lambda: any(tmp_path.glob('*/*.mcap')), 60, lambda: running.text)
    assert running.stop() == 0, running.text
    (bag,) = (path.parent for path in tmp_path.glob('*/metadata.yaml'))
    assert 'Traceback' not in running.text and any(bag.glob('*.mcap'))
