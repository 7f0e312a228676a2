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
sys.path.insert(0, str(ROOT / 'tests' / 'benchmarks'))
sys.path.insert(0, str(ROOT))

from bags.drawn_squeezes import solid_ball, squeezes, thin_ball  # noqa: E402
from bags.live_bias import Wall  # noqa: E402
from bags.scanner import MISFITS as SCANNERS  # noqa: E402
from dent_depth import of_pipeline, scanned_again  # noqa: E402
from scan_shells import SCANNER_SIGMA, occlude, odd_body, scan_points  # noqa: E402

from barrett_hand_bridge.contacts import FLAG_CONTACT  # noqa: E402
from barrett_hand_bridge.emulator.misfit import MISFITS  # noqa: E402
from barrett_hand_bridge.observer import Observation  # noqa: E402
from barrett_hand_bridge.trial import (  # noqa: E402
    BALL,
    Trial,
    bias_counts,
    force_errors,
    travel_errors,
)
from grasp_replay.pipeline import PipelineOptions, run  # noqa: E402
from scan_compare.distance import measure  # noqa: E402
from scan_compare.registration import register  # noqa: E402
from scan_compare.uncertainty import mean_error_sigma, pose_sigma  # noqa: E402
from shell_deform.identify.modulus import identify  # noqa: E402
from shell_deform.identify.squeeze_bag import binned  # noqa: E402
from shell_deform.objects import load_object  # noqa: E402
from shell_deform.theory import DEFAULT_THEORY  # noqa: E402

TABLE = ROOT / 'docs' / 'coverage.md'
FIRST_SEED = 660_000
LEVEL = 1.6449
LOADS_N = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0)
TRAVEL_LOADS_N = (15.0, 2.0, 5.0, 10.0, 15.0)
SURFACE_LOADS_N = (5.0, 10.0, 16.0)
RECORDED = ('tennis_ball_two_finger', 'tennis_ball_three_finger', 'cup_off_axis', 'half_soda_can')
SOLID_WALL = Wall('thick', 14.196e6, 0.49)
VIEW_M, LINE_M, LINE_SIGMA_M = 0.05e-3, 1e-3, 0.05e-3
ROUND_M, ROUND_SIGMA_M, WAVE_M, WAVE_HEIGHT_M = 0.1e-3, 0.02e-3, 8e-3, 0.07e-3
SCANS = {
    'white noise, all seen': 'known',
    'white noise, 30 % seen': 'known',
    'ten views off by 0.05 mm, numbered': 'known',
    'ten views off by 0.1 mm, numbered': 'misfit: views times two',
    'ten views off by 0.05 mm, not numbered': 'misfit: nobody says which view',
    'overlapping views off by 0.05 mm, not numbered': 'misfit: nobody says which view',
    'noise alike along laser lines': 'misfit: 0.05 mm for each millimetre of height',
    'fringes at edges, missing rows': 'misfit: 5 % of the points 0.3 mm out, a third of the rows',
    'heavy tails': "misfit: Student's noise of three degrees, as large as the usual one",
    'rounded': 'misfit: coordinates in steps of 0.1 mm, hardly any noise beside',
    'stripes': 'misfit: waves of 0.07 mm, 8 mm long, beside the noise',
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


class KnownBall:
    """The force curve of the ball that the emulated hands squeeze, for any modulus: no theory."""

    shell_object = load_object('tennis_ball')
    force_sigma = 0.0
    excess_stiffness = 0.0

    def force(self, displacement: np.ndarray, young: float, _gauge: float) -> np.ndarray:
        """Push [N] at displacements (n,) [m] of a contact; the modulus scales it."""
        known = np.interp(displacement, BALL.displacement_m, BALL.force_n)
        return young / self.shell_object.young_modulus_pa * known


def squeezed(trial: Trial, load_n: float) -> np.ndarray:
    """Travel, push and their sigmas (n, 4), means of two fingers, on the way in to a load."""
    rows: list[np.ndarray] = []

    def watch(seen: Observation) -> None:
        contacts = [seen.fingers[finger].contact for finger in (1, 2)]
        if all(contact.flags & FLAG_CONTACT and contact.travel_m > 0.0 for contact in contacts):
            values = [
                (c.travel_m, c.force @ c.normal, c.sigma_normal_n, c.sigma_travel_m)
                for c in contacts
            ]
            rows.append(np.mean(values, axis=0))

    trial.close_slowly(load_n, watch=watch)
    return np.array(rows)


def moduli(count: int) -> Iterator[list[str]]:
    """The 90 % interval of the modulus from one squeeze, after a release has shown the tendons."""
    true = KnownBall.shell_object.young_modulus_pa
    for name, misfit in MISFITS.items():
        ratios, inside = [], []
        for seed in range(FIRST_SEED, FIRST_SEED + count):
            trial = Trial(seed, misfit=name)
            if trial.tare():
                continue
            squeezed(trial, 15.0)
            data = binned(*squeezed(trial, 15.0).T)
            if data is None:
                continue
            found = identify(KnownBall(), data)
            low, high = found.interval('young_modulus_pa')
            inside.append(low <= true <= high)
            ratios.append(np.log(found.values[0] / true) / (found.sigma[0] / found.values[0]))
        yield [
            'modulus from one squeeze', misfit.meaning, f'{len(ratios)} hands',
            f'{100 * np.mean(inside):.1f} %', shares(np.array(ratios))[1],
            f'of the statistics: the curve is that of the ball; mean z {np.mean(ratios):+.2f}',
        ]  # fmt: skip


def depths(count: int) -> Iterator[list[str]]:
    """The depth under the pins of recordings, scanned again, by the whole comparison."""
    for name in RECORDED:
        outcome = run(ROOT / 'bags' / name, PipelineOptions())
        models = of_pipeline(outcome)
        places = sum(len(contacts.point) for _, contacts in models)
        seeds = range(FIRST_SEED, FIRST_SEED + -(-count // places))
        for misfit in (None, *SCANNERS):
            ratio = np.array(
                [
                    (profile.apex_m - truth) / profile.apex_sigma_m
                    for _, found, truth in scanned_again(name, models, seeds, misfit)
                    for profile in found.profiles
                ]
            )
            yield [
                f'depth under the pin, {name}',
                'a solid, the scanner that is assumed' if misfit is None else f'misfit: {misfit}',
                f'{len(ratio)} depths', *shares(ratio), f'mean z {np.mean(ratio):+.2f}',
            ]  # fmt: skip


def surfaces(count: int) -> Iterator[list[str]]:
    """The served surface under drawn hands that squeeze a ball: known truths and others."""
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    pins, camera = ('fingers', ', pose told by the pins'), ('elsewhere', ', pose of a camera')
    thick = 'a solid, as a thick wall of its own modulus'
    for ball, wall, misfit, (pose_from, pose), truth in (
        (thin_ball(), Wall(), 'none', pins, 'the thin ball that the node assumes'),
        (thin_ball(), Wall(), 'none', camera, 'the thin ball that the node assumes'),
        (thin_ball(), Wall(), 'tendon', pins,
         'the same in the hand of ' + MISFITS['tendon'].meaning),
        (solid_ball(), Wall(), 'none', pins, 'misfit: a solid where thin-shell theory is assumed'),
        (solid_ball(), SOLID_WALL, 'none', pins, thick),
        (solid_ball(), SOLID_WALL, 'none', camera, thick),
        (solid_ball(), Wall(DEFAULT_THEORY), 'none', pins,
         'a solid, by the default theory and file'),
    ):  # fmt: skip
        found = list(squeezes(ball, seeds, SURFACE_LOADS_N, wall, misfit, pose_from))
        ratio = np.concatenate([one.served / one.sigma for one in found])
        dent = np.concatenate([one.dent for one in found])
        yield [
            'served surface of a ball', truth + pose,
            f'{count} hands, {len(found)} squeezes, {len(ratio)} vertices', *shares(ratio),
            f'in the dents {shares(ratio[dent])[0]}',
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
    if kind in ('heavy tails', 'rounded'):
        exact = scan_points(
            odd_body(), 2_500, 0.0 if kind == 'heavy tails' else ROUND_SIGMA_M, seed
        )
        if kind == 'rounded':
            return ROUND_M * np.round(exact / ROUND_M), None
        drawn = generator.standard_t(3, exact.shape) / np.sqrt(3.0)
        return exact + SCANNER_SIGMA * drawn, None
    if kind == 'stripes':
        across = generator.standard_normal(3)
        phase = points @ across / np.linalg.norm(across) / WAVE_M + generator.random()
        return points + WAVE_HEIGHT_M * np.sin(2.0 * np.pi * phase)[:, None] * outward, None
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
        ratios, means, sigmas = [], [], []
        for seed in range(FIRST_SEED, FIRST_SEED + count):
            points, view = scanned(kind, seed)
            found = register(points, surface, views=view)
            distances = measure(surface, found.pose.apply(points))
            means.append(float(np.mean(np.abs(distances.distance))))
            sigmas.append(mean_error_sigma(distances, np.ones(len(points), bool), found, view))
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
        yield [
            f'mean error of a scan: {kind}', truth, f'{count} scans',
            *shares((np.array(means) - np.mean(means)) / np.array(sigmas)),
            'about the mean of all draws',
        ]  # fmt: skip


QUANTITIES = {
    'forces': (hands, 'hands', 3), 'travels': (travels, 'hands', 3),
    'moduli': (moduli, 'hands', 3), 'poses': (poses, 'scans', 2),
    'depths': (depths, 'depths', 8), 'surfaces': (surfaces, 'hands', 1),
}  # fmt: skip
"""What is drawn how often: the rows, the option that says how many, and the few of --quick."""


def main() -> int:
    """Draw, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--hands', type=int, default=200)
    parser.add_argument('--scans', type=int, default=200)
    parser.add_argument('--depths', type=int, default=100, help='of each recording and scanner')
    parser.add_argument('--only', nargs='*', default=list(QUANTITIES), choices=QUANTITIES)
    parser.add_argument('--quick', action='store_true', help='few draws, nothing written')
    options = parser.parse_args()
    lines = [
        '# Coverage of stated uncertainties',
        '',
        'Made by `python tests/coverage_tables.py`: seeds that nothing else uses. The',
        '90 % level is 1.645 sigma. "Known" truths are drawn from the numbers that the estimators',
        'assume: they test the algebra. The others change a law that the estimators do not know.',
        '',
        '| quantity | truth | draws | seeds from | within 90 % level | rms error over sigma | |',
        '|---|---|---|---|---|---|---|',
    ]
    for name in options.only:
        rows, draws, few = QUANTITIES[name]
        for row in rows(few if options.quick else getattr(options, draws)):
            lines.append('| ' + ' | '.join([*row[:3], f'{FIRST_SEED:_}', *row[3:]]) + ' |')
            print(lines[-1], flush=True)
    if not options.quick and set(options.only) == set(QUANTITIES):
        TABLE.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
