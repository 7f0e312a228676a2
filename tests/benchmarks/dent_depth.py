# SPDX-License-Identifier: Apache-2.0
"""Measured dent depths beside the truth: `python tests/benchmarks/dent_depth.py [BAG ...]`.

Every recording with scans under load through the offline pipeline, and the same loads scanned
again by seeds that nothing else uses, by the scanner of the recording or by one that no estimator
knows (`--misfit`). Depths are extrapolated under the pins; z is their error in printed standard
deviations. `--at-travel`: fresh scans alone, against the shell solved at the true travel under the
contacts of its object file, which takes seconds where the pipeline takes minutes. `--solids`: the
extrapolation alone, on noise-free faces of solid spheres.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib import resources
from itertools import chain
from pathlib import Path

import numpy as np
import yaml
from figures import Row, show
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bags.experiments import EXPERIMENTS  # noqa: E402
from bags.scanner import MISFITS, scan  # noqa: E402
from bags.stage import Stage  # noqa: E402

from grasp_replay.experiment import read_experiment  # noqa: E402
from grasp_replay.pipeline import Outcome, PipelineOptions, run  # noqa: E402
from scan_compare.comparison import Comparison, Setup, compare  # noqa: E402
from scan_compare.deformed_surface import DeformedSurface  # noqa: E402
from scan_compare.dent import (  # noqa: E402
    EXTRAPOLATION_SHARE,
    FIT_RADIUS,
    PROFILE_RADIUS,
    Contacts,
    Wall,
    under_pin,
)
from scan_compare.scan import Scan  # noqa: E402
from shell_deform import verification  # noqa: E402
from shell_deform.building import build_model, object_contacts  # noqa: E402
from shell_deform.objects import load_object  # noqa: E402
from shell_deform.solve.equilibrium import displaced  # noqa: E402
from shell_deform.solve.newton import EquilibriumSolver  # noqa: E402

RECORDINGS = (
    *('tennis_ball_two_finger', 'tennis_ball_three_finger', 'cup_off_axis', 'half_soda_can'),
    *('gauge_drift', 'gauge_saturation', 'regrasp_sliding'),
)
FIRST_SEED = 450_000
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


def true_scans(name: str) -> list[dict]:
    """What is true at each scanned load of a recording."""
    described = yaml.safe_load((ROOT / 'bags' / name / 'truth.yaml').read_text())['scans']
    return [row for row in described if row['force_n'] > 0.0]


class Again:
    """A recording's object and fingers, to be scanned as often as one likes."""

    def __init__(self, name: str, misfit: str | None) -> None:
        self.experiment = EXPERIMENTS[name]
        self.stage = Stage(
            self.experiment.setting(), self.experiment.seed, self.experiment.imperfections
        )
        scanner = self.experiment.scanner
        if misfit is not None:
            scanner = replace(MISFITS[misfit], most_points=scanner.most_points)
        # A scan is thinned to less than a tenth of its points: a quarter of them will do.
        self.scanner = replace(scanner, density=0.25)

    def close(self) -> None:
        """Give the emulated hand's port back."""
        self.stage.port.stop()

    def scene(self, force: float, slip: np.ndarray) -> tuple:
        """Surface, obstacles and origin (hand), and the rotation of the object's frame there."""
        stage = self.stage
        if force:
            stage.step(stage.counts_for(force), 0.0)
        rotation, origin = (
            stage.grip() if force else (stage.setting.rotation, stage.setting.origin)
        )
        truth = stage.setting.truth.surface(stage.force() if force else 0.0)
        surface = truth.moved(rotation @ stage.setting.from_solution, origin)
        return surface, stage.obstacles() if force else [], origin, rotation @ slip

    def look(self, scene: tuple, seed: int) -> Scan:
        """One scan of a scene, in the object's frame but for the scanner's own placement."""
        surface, obstacles, origin, rotation = scene
        found = scan(surface, list(self.experiment.views), obstacles, origin, self.scanner, seed)
        points = (found.points.astype(float) - origin) @ rotation
        return Scan(points, None, 'm', False, f'seed {seed}')


def slip_of(again: Again, row: dict) -> np.ndarray:
    """How the object has turned under the pins (3, 3) since first touch, from its true pose."""
    grip = again.stage.grip()[0]
    return grip.T @ Rotation.from_quat(row['object_pose'][3:]).as_matrix()


Model = tuple[DeformedSurface | None, Contacts]


def of_pipeline(outcome: Outcome) -> list[Model]:
    """The surface that a scan is laid on at every load, and where the hand told its contacts."""
    return [
        (row.reference.surface, outcome.shell.contacts_at_rest(row.patches))
        for row in outcome.rows
    ]


def at_travel(name: str) -> list[Model]:
    """The same at the true travel under the contacts of the object file."""
    experiment = read_experiment(ROOT / 'bags' / name)
    shell = load_object(str(experiment.object_file))
    model = build_model(shell)
    pins = object_contacts(shell, model, pins_slide=experiment.pins_slide)
    solver = EquilibriumSolver(model)
    axes = np.array([pin.axis for pin in pins])
    points = np.array([pin.point for pin in pins]) - 0.5 * shell.thickness_m * axes
    contacts = Contacts(points, axes, np.array([pin.radius for pin in pins]))
    cases = [
        displaced(pins, [row['displacement_middle_m']] * len(pins)) for row in true_scans(name)
    ]
    return [
        (DeformedSurface(model.surface, model.rest, s.positions, shell.thickness_m), contacts)
        for s in solver.sweep(cases)
    ]


def scanned_again(
    name: str, models: list[Model], seeds: range, misfit: str | None
) -> Iterator[tuple[str, Comparison, float]]:
    """Every load of a recording by every seed, against the surfaces of a model."""
    again = Again(name, misfit)
    try:
        rest, at_rest = again.scene(0.0, np.eye(3)), {}
        for number, (true, (surface, contacts)) in enumerate(
            zip(true_scans(name), models, strict=True), start=1
        ):
            if surface is None:
                continue
            again.scene(true['force_n'], np.eye(3))
            scene = again.scene(true['force_n'], slip_of(again, true))
            setup = Setup(contacts=contacts)
            for seed in seeds:
                at = 100 * seed + number
                if seed not in at_rest:
                    at_rest[seed] = again.look(rest, 100 * seed)
                found = compare(again.look(scene, at), surface, at_rest[seed], setup)
                yield f'{name}, {true["force_n"]:.1f} N', found, true['displacement_outer_m']
    finally:
        again.close()


def shares(z: list[float]) -> str:
    """Share within one, two and 1.645 sigma, mean and root mean square."""
    size = np.abs(z)
    within = [f'{np.mean(size <= limit):.0%}' for limit in (1.0, 1.645, 2.0)]
    return (
        f'{" / ".join(within)} within 1 / 1.645 / 2 sigma; mean {np.mean(z):+.2f}, '
        f'rms {np.sqrt(np.mean(np.square(z))):.2f}'
    )


def scatter(drawn: dict[tuple[str, int], list[tuple[float, float]]]) -> float:
    """Of depths and sigma without extrapolation: root mean square about the mean of each place."""
    ratios = []
    for place in drawn.values():
        apex, sigma = np.array(place).T
        if len(apex) > 1:
            unbiased = np.sqrt(len(apex) / (len(apex) - 1.0))
            ratios.append(unbiased * (apex - apex.mean()) / sigma)
    return float(np.sqrt(np.mean(np.square(np.concatenate(ratios)))))


def rows(names: list[str], depths_each: int, misfit: str | None, show_all: bool) -> Iterator[Row]:
    """All depths, then how their errors compare with the printed standard deviations."""
    z: list[float] = []
    for name in names:
        outcome = run(ROOT / 'bags' / name, PipelineOptions())
        for row, true in zip(outcome.rows, true_scans(name), strict=True):
            what = f'{name}, {row.force:.2f} N'
            shown, own = depths(what, row.reference, true['displacement_outer_m'])
            z += own
            yield shown
        yield from again_rows(name, of_pipeline(outcome), depths_each, misfit, show_all)
    yield Row(f'{len(z)} recorded depths', shares(z))


def again_rows(
    name: str, models: list[Model], depths_each: int, misfit: str | None, show_all: bool
) -> Iterator[Row]:
    """Depths of fresh scans of one recording's loads."""
    places = sum(len(contacts.point) for _, contacts in models)
    seeds = range(FIRST_SEED, FIRST_SEED + -(-depths_each // places))
    fresh: list[float] = []
    drawn: dict[tuple[str, int], list[tuple[float, float]]] = {}
    for what, found, truth in scanned_again(name, models, seeds, misfit):
        shown, own = depths(what, found, truth)
        fresh += own
        for place, profile in enumerate(found.profiles):
            part = profile.apex_sigma_m**2 - profile.extrapolation_sigma_m**2
            drawn.setdefault((what, place), []).append((profile.apex_m, np.sqrt(part)))
        if show_all:
            yield shown
    if fresh:
        yield Row(f'{name}: {len(fresh)} fresh depths', shares(fresh), 'rms 0.8 to 1.2')
        if len(seeds) > 1:
            yield Row('of it, scatter over what its part of sigma says', f'{scatter(drawn):.2f}')


def solids() -> Iterator[Row]:
    """What the extrapolation misses on noise-free faces, as a share of the rise under the pin.

    The ball of R/h 12.5 under a pin of 1 mm is the recorded one: printed, not counted.
    """
    text = resources.files(verification).joinpath('solid_faces.json').read_text()
    counted = []
    for ball in json.loads(text)['balls']:
        h, pin = ball['thickness_m'], ball['pin_radius_m']
        outer = ball['middle_radius_m'] + 0.5 * h
        wall = Wall(h, pin, 0.0, np.eye(2) / outer)
        for level in ball['levels']:
            r, z = np.array(level['face_m']).T
            near = (r < PROFILE_RADIUS) & (np.gradient(r) > 0.0) & (z > 0.0)
            seen = np.sqrt(np.linspace((2.0 * pin) ** 2, FIT_RADIUS**2, 3000))
            turn = 2.4 * np.arange(len(seen))
            across = seen[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
            depth = np.interp(seen, r[near], np.sqrt(outer**2 - r[near] ** 2) - z[near])
            apex, _, rise = under_pin(across, depth, 2.0 * pin, wall, pin)
            share = (apex - level['travel_m']) / rise
            recorded = (ball['radius_over_thickness'], pin) == (12.5, 0.001)
            counted += [] if recorded else [share]
            yield Row(
                f'R/h {ball["radius_over_thickness"]}, pin {1e3 * pin:.0f} mm, '
                f'{1e3 * level["travel_m"]:.2f} mm',
                f'{share:+.3f} of the rise, {100 * (apex / level["travel_m"] - 1.0):+.2f} %',
            )
    rms = float(np.sqrt(np.mean(np.square(counted))))
    yield Row('root mean square', f'{rms:.3f}', f'{EXTRAPOLATION_SHARE}')


def main() -> int:
    """Print every depth; returns 1 when one is further than three sigma from the truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('bags', nargs='*', default=RECORDINGS, help='names of recordings')
    parser.add_argument('--depths', type=int, default=100, help='fresh depths of each recording')
    parser.add_argument('--misfit', choices=MISFITS, help='a scanner that no estimator knows')
    parser.add_argument('--at-travel', action='store_true', help='fresh scans, no pipeline')
    parser.add_argument('--solids', action='store_true', help='the extrapolation alone')
    parser.add_argument('--all', action='store_true', help='print every fresh depth')
    options = parser.parse_args()
    if options.solids:
        return int(show(solids()) > 0)
    if options.at_travel:
        asked = options.depths, options.misfit, options.all
        parts = (again_rows(name, at_travel(name), *asked) for name in options.bags)
        return int(show(chain.from_iterable(parts)) > 0)
    found = rows(list(options.bags), options.depths, options.misfit, options.all)
    return int(show(found) > 0)


if __name__ == '__main__':
    sys.exit(main())
