# SPDX-License-Identifier: Apache-2.0
"""Measured dent depths beside the truth: `python tests/benchmarks/dent_depth.py [BAG ...]`.

Every recording with scans under load through the offline pipeline, and the loads of the two-finger
ball scanned again by other seeds. Depths are extrapolated under the pins; z is their error in
printed standard deviations.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml
from figures import Row, show

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bags.scanner import Scanner, scan  # noqa: E402
from bags.settings import Z_TO_X  # noqa: E402
from bags.surfaces import BallTruth  # noqa: E402
from error_budget import VIEWS, obstacles  # noqa: E402

from grasp_replay.pipeline import Outcome, PipelineOptions, run  # noqa: E402
from scan_compare.comparison import Comparison, Setup, compare  # noqa: E402
from scan_compare.scan import Scan  # noqa: E402

BALL = 'tennis_ball_two_finger'
RECORDINGS = (
    *(BALL, 'tennis_ball_three_finger', 'cup_off_axis', 'half_soda_can', 'fast_squeeze_release'),
    *('gauge_drift', 'gauge_saturation', 'regrasp_sliding'),
)
LARGEST_Z = 3.0


def depths(what: str, found: Comparison, truth: float) -> tuple[Row, list[float]]:
    """One row of the depth at every contact [mm], and their z."""
    z = [(profile.apex_m - truth) / profile.apex_sigma_m for profile in found.profiles]
    seen = ', '.join(
        f'{1e3 * profile.apex_m:.3f} +- {1e3 * profile.apex_sigma_m:.3f} (z {one:+.1f})'
        for profile, one in zip(found.profiles, z, strict=True)
    )
    worst = max(map(abs, z), default=np.inf)
    return Row(f'{what}, truth {1e3 * truth:.3f} mm', seen or 'no dent', '', worst <= LARGEST_Z), z


def true_depths(name: str) -> list[float]:
    """The true displacement [m] of the outer face at each scanned load of a recording."""
    described = yaml.safe_load((ROOT / 'bags' / name / 'truth.yaml').read_text())['scans']
    return [float(row['displacement_outer_m']) for row in described if row['force_n'] > 0.0]


def scanned_again(outcome: Outcome, seed: int) -> Iterator[tuple[str, Comparison, float]]:
    """The loads of the two-finger ball, simulated by another seed, against Koiter's surfaces."""
    truth = BallTruth()
    described = yaml.safe_load((ROOT / 'bags' / BALL / 'truth.yaml').read_text())['scans']

    def seen(force: float, number: int) -> Scan:
        surface = truth.surface(force).moved(Z_TO_X, np.zeros(3))
        half_width = float(np.abs(surface.vertices[-2:, 0]).max())
        hidden_by = obstacles(half_width) if force else []
        points = scan(surface, VIEWS, hidden_by, np.zeros(3), Scanner(), seed * 1000 + number)
        return Scan(points.points.astype(float), None, 'm', False, f'seed {seed}, load {number}')

    rest = seen(0.0, 0)
    for row in outcome.rows:
        force = float(described[row.number]['force_n'])
        surface = row.solved['koiter'].surface
        if surface is None:
            continue
        found = compare(
            seen(force, row.number),
            surface,
            rest,
            Setup(contacts=outcome.shell.contacts_at_rest(row.patches)),
        )
        depth = float(described[row.number]['displacement_outer_m'])
        yield f'{BALL}, {force:.1f} N, seed {seed}', found, depth


def rows(names: list[str], seeds: int) -> Iterator[Row]:
    """All depths, then how their errors compare with the printed standard deviations."""
    z: list[float] = []
    for name in names:
        truths = true_depths(name)
        if not truths:
            yield Row(name, 'no scan under load')
            continue
        outcome = run(ROOT / 'bags' / name, PipelineOptions())
        for row, truth in zip(outcome.rows, truths, strict=True):
            shown, own = depths(f'{name}, {row.force:.2f} N', row.reference, truth)
            z += own
            yield shown
        for seed in range(101, 101 + seeds) if name == BALL else ():
            for what, found, truth in scanned_again(outcome, seed):
                shown, own = depths(what, found, truth)
                z += own
                yield shown
    share = np.mean(np.abs(z) <= 1.0), np.mean(np.abs(z) <= 2.0)
    yield Row(f'{len(z)} depths within 1 / 2 sigma', f'{share[0]:.0%} / {share[1]:.0%}', '68 / 95')
    yield Row(
        'mean and root mean square of z',
        f'{np.mean(z):+.2f}, {np.sqrt(np.mean(np.square(z))):.2f}',
    )


def main() -> int:
    """Print every depth; returns 1 when one is further than three sigma from the truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('bags', nargs='*', default=RECORDINGS, help='names of recordings')
    parser.add_argument('--seeds', type=int, default=5, help='further seeds of the ball')
    options = parser.parse_args()
    return int(show(rows(list(options.bags), options.seeds)) > 0)


if __name__ == '__main__':
    sys.exit(main())
