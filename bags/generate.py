# SPDX-License-Identifier: Apache-2.0
"""Make the recordings again: `python bags/generate.py [names] [--solid]`.

Without --solid the kept solid solutions are used; with it CalculiX solves them again first.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import rclpy  # noqa: E402

from bags import describe, recording, solid_all  # noqa: E402
from bags.canonical import IncompleteRecordingError, write_canonical  # noqa: E402
from bags.experiments import EXPERIMENTS, Experiment  # noqa: E402
from bags.recording import BIN, Live, RecordingError, World  # noqa: E402
from bags.session import Session  # noqa: E402
from bags.stage import Stage  # noqa: E402

ATTEMPTS = 5


def parser() -> argparse.ArgumentParser:
    """The command line."""
    command = argparse.ArgumentParser(prog='generate.py', description=__doc__)
    command.add_argument('names', nargs='*', metavar='NAME', help=', '.join(EXPERIMENTS))
    command.add_argument(
        '--out', type=Path, default=ROOT / 'bags', help='where to (default: bags)'
    )
    command.add_argument(
        '--solid', action='store_true', help='solve the solid models again first (about 15 min)'
    )
    return command


def calibrate(seed: int, folder: Path) -> Path:
    """Hang known weights on the emulated hand's gauges and fit its calibration file."""
    weights, out = folder / 'weighings.csv', folder / 'calibration.yaml'
    for arguments in (
        ['hand_emulator', '--seed', str(seed), '--weigh', str(weights), '--once'],
        ['hand_calibrate', str(weights), '--calibration', str(out), '--serial-number', str(seed)],
    ):
        subprocess.run(
            [str(BIN / arguments[0]), *arguments[1:]],
            check=True,
            stdout=subprocess.DEVNULL,
            timeout=120,
        )
    return out


def record(experiment: Experiment, out: Path) -> None:
    """Record one experiment into `out/<name>`, replacing what is there."""
    with tempfile.TemporaryDirectory(prefix='recording_') as temporary:
        folder = Path(temporary)
        calibration = calibrate(experiment.seed, folder)
        for attempt in range(1, ATTEMPTS + 1):
            raw = folder / f'raw_{attempt}'
            try:
                session, parameters = _run(experiment, folder, calibration, raw)
                bag = folder / experiment.name
                write_canonical(
                    raw,
                    bag,
                    session.world.stamps,
                    len(session.scans),
                    {'label': 'synthetic', 'experiment': experiment.name},
                )
                break
            except IncompleteRecordingError as error:
                print(f'{experiment.name}: {error}; attempt {attempt} is thrown away', flush=True)
        else:
            raise RecordingError(f'{experiment.name}: {ATTEMPTS} attempts were incomplete')
        target = out / experiment.name
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        for file in bag.iterdir():
            shutil.copy(file, target / file.name)
        shutil.copy(calibration, target / 'calibration.yaml')
        describe.write(experiment, session, parameters, target)


def _run(
    experiment: Experiment, folder: Path, calibration: Path, raw: Path
) -> tuple[Session, dict]:
    stage = Stage(experiment.setting(), experiment.seed, experiment.imperfections)
    stage.port.start()
    live = Live(folder)
    world = None
    try:
        world = World(stage, live, experiment.period_s)
        parameters = recording.start_nodes(live, stage, calibration, experiment.period_s, raw)
        world.wait_for(lambda: 'connected to' in live.said('hand_bridge'), 'a connected hand')
        world.wait_until_recorded()
        # Asked to tare, the bridge takes one cycle before the clock runs: let it pass.
        world.settle(0.5)
        session = Session(stage, world, experiment.scanner, experiment.views)
        experiment.programme(session)
        world.settle()
    finally:
        live.stop()
        stage.port.stop()
        if world is not None:
            world.close()
    return session, parameters


def main(arguments: list[str] | None = None) -> int:
    """Run; returns the exit code."""
    options = parser().parse_args(arguments)
    unknown = [name for name in options.names if name not in EXPERIMENTS]
    if unknown:
        print(
            f'unknown recording {unknown[0]!r}: one of {", ".join(EXPERIMENTS)}', file=sys.stderr
        )
        return 1
    if options.solid:
        solid_all.solve()
    # Beyond the domains of tests and people: nothing else may speak on these topics.
    os.environ.setdefault('ROS_DOMAIN_ID', str(102 + os.getpid() % 100))
    rclpy.init()
    try:
        for name in options.names or EXPERIMENTS:
            begin = time.monotonic()
            record(EXPERIMENTS[name], options.out)
            size = sum(file.stat().st_size for file in (options.out / name).iterdir())
            print(f'{name}: {size / 1e6:.1f} MB in {time.monotonic() - begin:.0f} s', flush=True)
    except RecordingError as error:
        print(f'generate.py: {error}', file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
