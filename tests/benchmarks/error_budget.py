# SPDX-License-Identifier: Apache-2.0
"""Error budget of the recorded ball: `python tests/benchmarks/error_budget.py`.

Noise of the scanner, occlusion by pins and fingers, merging of views, the error of the measured
force and the neglect of the sealed air are switched off one at a time. The truth is the kept
solid solution of the recording, the scans are synthetic, the models are solved by shell_deform
with the modulus fitted on the recording's own first row.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bags.grasps import LINK_RADIUS_M, PIN_RADIUS_M  # noqa: E402
from bags.scanner import ErrorSources, Obstacle, Scanner, View, scan  # noqa: E402
from bags.settings import Z_TO_X  # noqa: E402
from bags.surfaces import BallTruth  # noqa: E402

from grasp_replay.pipeline import Outcome, PipelineOptions, run  # noqa: E402
from grasp_replay.pipeline import Row as LoadedRow  # noqa: E402
from grasp_replay.theories import TheorySet  # noqa: E402
from scan_compare.deformed_surface import DeformedSurface  # noqa: E402
from scan_compare.error_budget import Budget, error_budget, model_surfaces  # noqa: E402
from scan_compare.scan import Scan  # noqa: E402
from shell_deform.building import build_model  # noqa: E402
from shell_deform.objects import Gas  # noqa: E402

BAG = ROOT / 'bags/tennis_ball_two_finger'
VIEWS = [View(azimuth, elevation) for azimuth in range(0, 360, 72) for elevation in (-25, 25)]
PIN_LENGTH_M = 0.04
SEED = 9


def obstacles(outer_half_width: float) -> list[Obstacle]:
    """Pins along x that touch the ball, and the links of the fingers behind them."""
    found = []
    for side in (-1.0, 1.0):
        tip = np.array([side * outer_half_width, 0.0, 0.0])
        foot = tip + [side * PIN_LENGTH_M, 0.0, 0.0]
        found.append(Obstacle(tip, foot, PIN_RADIUS_M))
        found.append(Obstacle(foot, foot + [0.0, 0.0, -0.06], LINK_RADIUS_M))
    return found


def without_air(shell: TheorySet, row: LoadedRow) -> TheorySet:
    """The same shell on the same mesh, its air open to the outside."""
    gas = Gas('none', 0.0, shell.shell.gas.ambient_pa)
    contacts = row.contacts
    travel = np.nan_to_num(contacts.travel)
    at_rest = contacts.point - travel[:, None] * contacts.normal
    plain = replace(shell.shell, gas=gas)
    model = build_model(plain, refine_at=at_rest, refine_radius=float(contacts.radius.min()))
    return TheorySet(plain, {'koiter': model.with_theory('koiter')})


def solved(shell: TheorySet, row: LoadedRow, push: np.ndarray) -> DeformedSurface:
    """The shell under `push` [N] of each finger, reached in steps from rest."""
    patches = shell.patches(row.contacts)
    state = None
    for share in np.linspace(0.25, 1.0, 4):
        answer = shell.solve('koiter', patches, share * push, state)
        state = answer.state
    if answer.surface is None:
        raise SystemExit(f'{shell.shell.name}: {push.tolist()} N are not carried')
    return answer.surface


def budget_of(outcome: Outcome, number: int) -> Budget:
    """The budget of load `number` (from 1) of the recorded ball."""
    row = outcome.rows[number - 1]
    described = yaml.safe_load((BAG / 'truth.yaml').read_text())['scans'][number]
    true_force = np.full(len(row.contacts.push), float(described['force_n']))
    truth = BallTruth()
    surface = truth.surface(float(described['force_n'])).moved(Z_TO_X, np.zeros(3))
    half_width = float(np.abs(surface.vertices[-2:, 0]).max())
    hidden_by = obstacles(half_width)

    def make_scan(on: frozenset[str]) -> Scan:
        errors = ErrorSources(
            noise='noise' in on, occlusion='occlusion' in on, registration='merging' in on
        )
        seen = scan(
            surface, VIEWS, hidden_by, np.zeros(3), Scanner(errors=errors), SEED * 1000 + number
        )
        return Scan(seen.points.astype(float), None, 'm', False, f'synthetic, load {number}')

    open_shell = without_air(outcome.shell, row)
    models = model_surfaces(
        solved(open_shell, row, row.contacts.push),
        solved(open_shell, row, true_force),
        solved(outcome.shell, row, row.contacts.push),
        solved(outcome.shell, row, true_force),
    )
    return error_budget(make_scan, models)


def budgets() -> Iterator[tuple[LoadedRow, Budget]]:
    """Every load of the recording and its budget."""
    outcome = run(BAG, PipelineOptions())
    for load in outcome.rows:
        yield load, budget_of(outcome, load.number)


def as_table(found: list[tuple[LoadedRow, Budget]]) -> str:
    """Budgets side by side: mean over the scan / over the dent [mm], as in docs/accuracy.md."""
    lines = ['| | ' + ' | '.join(f'{load.force:.1f} N' for load, _ in found) + ' |']
    lines.append('|---' * (1 + len(found)) + '|')
    for kind in zip(*(budget.rows for _, budget in found), strict=True):
        cells = [f'{1e3 * row.mean_error_m:.3f} / {_milli(row.dent_mean_error_m)}' for row in kind]
        lines.append(f'| {kind[0].cause} | ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def _milli(metres: float | None) -> str:
    return '-' if metres is None else f'{1e3 * metres:.3f}'


def main() -> None:
    """Print each load's budget as it comes, then all of them side by side."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = []
    for load, budget in budgets():
        found.append((load, budget))
        print(f'load {load.number}, {load.force:.1f} N\n{budget.text()}', flush=True)
    print(as_table(found))


if __name__ == '__main__':
    main()
