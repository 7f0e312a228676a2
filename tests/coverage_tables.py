# SPDX-License-Identifier: Apache-2.0
"""How often stated uncertainties hold: known truth beside truths that no estimator knows.

Writes docs/coverage.md. Draws hands and scans from seeds that no test and no figure used before;
every row says how many. `--quick` takes few draws and writes nothing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / 'ros2_ws' / 'src' / 'scan_compare' / 'test'))

from scan_shells import occlude, odd_body, scan_points  # noqa: E402

from barrett_hand_bridge.emulator.misfit import MISFITS  # noqa: E402
from barrett_hand_bridge.trial import (  # noqa: E402
    bias_counts,
    force_errors,
    travel_errors,
)
from scan_compare.distance import measure  # noqa: E402
from scan_compare.registration import register  # noqa: E402
from scan_compare.uncertainty import pose_sigma  # noqa: E402

TABLE = ROOT / 'docs' / 'coverage.md'
FIRST_SEED = 410_000
LEVEL = 1.6449
LOADS_N = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0)
TRAVEL_LOADS_N = (15.0, 2.0, 5.0, 10.0, 15.0)
VIEW_M, LINE_M, LINE_SIGMA_M = 0.05e-3, 1e-3, 0.05e-3
SCANS = {
    'white noise, all seen': 'known',
    'white noise, 30 % seen': 'known',
    'ten views off by 0.05 mm, numbered': 'known',
    'ten views off by 0.1 mm, numbered': 'misfit: views times two',
    'ten views off by 0.05 mm, not numbered': 'misfit: nobody says which view',
    'overlapping views off by 0.05 mm, not numbered': 'misfit: nobody says which view',
    'noise alike along laser lines': 'misfit: 0.05 mm for each millimetre of height',
    'fringes at edges, missing rows': 'misfit: 5 % of the points 0.3 mm out, a third of the rows',
}


def shares(ratio: np.ndarray) -> tuple[str, str]:
    """Share within the 90 % level, and root mean square, of errors over their sigma."""
    return (
        f'{100 * np.mean(np.abs(ratio) < LEVEL):.1f} %',
        f'{np.sqrt(np.mean(np.square(ratio))):.2f}',
    )


def hands(count: int) -> Iterator[list[str]]:
    """The 90 % level of the finger forces, on known hands and on others."""
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    for name, misfit in MISFITS.items():
        errors = force_errors(seeds, loads_n=LOADS_N, misfit=name)
        ratio = np.array([error.error_n / error.sigma_n for error in errors])
        yield [
            'force of a finger', misfit.meaning, f'{count} hands, {len(errors)} readings',
            *shares(ratio),
            f'bias at most {bias_counts(errors):.1f} counts',
        ]  # fmt: skip


def travels(count: int) -> Iterator[list[str]]:
    """The 90 % level of what two opposed fingers have travelled since first touch.

    Before a release has shown the tendons' play, and after that of one hard squeeze.
    """
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    for name, misfit in MISFITS.items():
        errors = travel_errors(seeds, loads_n=TRAVEL_LOADS_N, misfit=name)
        for when, chosen in (
            ('first squeeze', [error for error in errors if not error.releases]),
            ('later ones', [error for error in errors if error.releases]),
        ):
            if not chosen:
                continue
            ratio = np.array([error.error_m / error.sigma_m for error in chosen])
            yield [
                f'travel of two fingers together, {when}', misfit.meaning,
                f'{count} hands, {len(chosen)} squeezes', *shares(ratio),
                f'mean error {1e3 * np.mean([error.error_m for error in chosen]):+.3f} mm',
            ]  # fmt: skip


def scanned(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Points (n, 3) [m] of one drawn scan in the object's frame, and the numbers of its views."""
    generator = np.random.default_rng([seed, 5])
    if '30 %' in kind:
        return occlude(scan_points(odd_body(), 8_333, seed=seed), 0.7,
                       generator.standard_normal(3)), None  # fmt: skip
    points = scan_points(odd_body(), 2_500, seed=seed)
    if 'views' in kind:
        z = np.linspace(-0.9, 0.9, 10)
        turn = 2.4 * np.arange(10) + generator.uniform(0.0, 6.0)
        flat = np.sqrt(1.0 - z**2)
        towards = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
        seen = points @ towards.T / np.linalg.norm(points, axis=1)[:, None]
        if 'overlapping' in kind:
            seen = np.where(seen > 0.3, generator.random(seen.shape), seen - 2.0)
        view = np.argmax(seen, axis=1)
        size = VIEW_M * (2.0 if '0.1 mm' in kind else 1.0)
        points = points + (size * generator.standard_normal((10, 3)))[view]
        return points, None if 'not numbered' in kind else view
    outward = points / np.linalg.norm(points, axis=1)[:, None]
    if 'lines' in kind:
        line = np.floor((points[:, 2] + 0.1) / LINE_M).astype(int)
        return points + (LINE_SIGMA_M * generator.standard_normal(200))[line, None] * outward, None
    if 'fringes' in kind:
        row = np.floor((points[:, 2] + 0.1) / LINE_M).astype(int)
        fringe = generator.random(len(points)) < 0.05
        points = points + 0.3e-3 * fringe[:, None] * outward
        return points[(row % 3 != 0)], None
    return points, None


def poses(count: int) -> Iterator[list[str]]:
    """The error of surface points under the registered pose over its stated sigma."""
    surface = odd_body()
    for kind, truth in SCANS.items():
        ratios = []
        for seed in range(FIRST_SEED, FIRST_SEED + count):
            points, view = scanned(kind, seed)
            found = register(points, surface, views=view)
            chosen = np.random.default_rng(seed).choice(len(points), 5)
            at = measure(surface, found.pose.apply(points[chosen]))
            for foot, normal in zip(at.foot, at.normal, strict=True):
                error = (foot - found.pose.inverse().apply(foot[None])[0]) @ normal
                ratios.append(error / pose_sigma((found,), foot, normal))
        ratio = np.array(ratios)
        yield [
            f'pose of a scan: {kind}', truth, f'{count} scans, {len(ratio)} points',
            *shares(ratio), '',
        ]  # fmt: skip


def main() -> int:
    """Draw, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hands', type=int, default=200)
    parser.add_argument('--scans', type=int, default=200)
    parser.add_argument('--quick', action='store_true', help='few draws, nothing written')
    options = parser.parse_args()
    lines = [
        '# Coverage of stated uncertainties',
        '',
        'Made by `python tests/coverage_tables.py`: seeds from 410 000 on, used nowhere else. The',
        '90 % level is 1.645 sigma. "Known" truths are drawn from the numbers that the estimators',
        'assume: they test the algebra. The others change a law that the estimators do not know.',
        '',
        '| quantity | truth | draws | within the 90 % level | rms of error over sigma | |',
        '|---|---|---|---|---|---|',
    ]
    few = (3, 2) if options.quick else (options.hands, options.scans)
    for rows in (hands(few[0]), travels(few[0]), poses(few[1])):
        for row in rows:
            lines.append('| ' + ' | '.join(row) + ' |')
            print(lines[-1], flush=True)
    if not options.quick:
        TABLE.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
