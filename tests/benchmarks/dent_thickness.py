# SPDX-License-Identifier: Apache-2.0
"""Wall thickness and modulus from scanned dents: `python tests/benchmarks/dent_thickness.py`.

Two truths that share no code with the model. Shells of 2, 2.5 and 3 mm by the axisymmetric solver,
scanned with noise and a misplaced scan, fitted from 2.5 mm. The recorded two-finger grasp, a
finite-element solid of 2.5 mm: its scans are registered by the pipeline, with a model of the
thickness that the fit starts from, and `shell_identify --fit-thickness` reads them from a table.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import trimesh
import yaml

from grasp_replay.pipeline import Outcome, PipelineOptions, run
from shell_deform import objects
from shell_deform.commands import shell_identify
from shell_deform.identify.dent_profile import DentScan, fit_thickness
from shell_deform.identify.force_curve import ForceCurve
from shell_deform.objects import load_object
from shell_deform.theory.gas import Gas
from shell_deform.verification.axisymmetric import PinnedSphere, outer_meridians

BAG = Path(__file__).parents[2] / 'bags/tennis_ball_two_finger'
NOISE_M, REGISTRATION_M, POINTS = 0.127e-3, 5e-5, 30_000
"""Stated accuracy of the published scanner; misplacement of each scan."""


def scanned(meridian: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Noisy points (n, 3) [m] of the face whose quadrant is (p, 2) radius and height [m]."""
    direction = generator.normal(size=(POINTS, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    away = np.arccos(np.abs(direction[:, 0]))
    distance = np.interp(away, np.arctan2(*meridian.T), np.hypot(*meridian.T))
    distance += NOISE_M * generator.normal(size=POINTS)
    return direction * distance[:, None] + REGISTRATION_M * generator.normal(size=3)


def shells(seeds: int) -> None:
    """Errors of the thickness of shells that an independent solver squeezed."""
    ball = load_object('tennis_ball')
    outer = 0.5 * ball.surface.outer_diameter_m  # type: ignore[union-attr]
    curve = ForceCurve(ball)
    for thickness in (2.0e-3, 2.5e-3, 3.0e-3):
        young = ball.young_modulus_pa * (ball.thickness_m / thickness) ** 2.5
        truth = PinnedSphere(
            outer - 0.5 * thickness, thickness, young, 0.5, curve.pin_radius, gas=Gas('sealed')
        )
        for depths in ([2.5e-3], [2e-3, 4e-3], [7e-3]):
            faces = outer_meridians(truth, np.array(depths))
            error, share = [], []
            for seed in range(seeds):
                generator = np.random.default_rng(seed)
                scans = [
                    DentScan(f'{1e3 * depth:g} mm', scanned(face, generator), depth)
                    for depth, face in zip(depths, faces, strict=True)
                ]
                found = fit_thickness(curve, scans, ball.young_modulus_pa, NOISE_M, REGISTRATION_M)
                error.append(100.0 * (found.thickness / thickness - 1.0))
                share.append((found.thickness - thickness) / found.sigma)
            print(
                f'h {1e3 * thickness:.1f} mm, dents {[1e3 * depth for depth in depths]} mm: '
                f'{min(error):+.1f} to {max(error):+.1f} %, at most {np.abs(share).max():.2f} '
                'sigma',
                flush=True,
            )


def recorded(start_m: float, folder: Path) -> None:
    """What the command says of the recorded grasp when the object file states `start_m` [m]."""
    content = yaml.safe_load((Path(objects.__file__).parent / 'tennis_ball.yaml').read_text())
    # the modulus of the file belongs to its thickness
    young = 'object' if start_m == content['thickness_m'] else 'fit'
    outcome = run(BAG, PipelineOptions(young=young, changes={'thickness_m': start_m}))
    shell = folder / 'ball.yaml'
    shell.write_text(yaml.safe_dump({**content, 'thickness_m': start_m}))
    shell_identify.main([str(_table(outcome, folder)), '--object', str(shell), '--fit-thickness'])


def _table(outcome: Outcome, folder: Path) -> Path:
    """Force, displacement and registered scan of every load."""
    lines = ['force_n,displacement_m,scan']
    for row in outcome.rows:
        name = f'row_{row.number}.ply'
        trimesh.PointCloud(row.reference.points).export(folder / name)
        lines.append(f'{row.force:.4f},{np.mean(row.contacts.travel):.6f},{name}')
    table = folder / 'squeeze.csv'
    table.write_text('\n'.join(lines) + '\n')
    return table


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=5, help='per shell (default %(default)s)')
    shells(parser.parse_args().seeds)
    for start_m in (2.5e-3, 2.0e-3):
        print(f'recorded grasp, started from {1e3 * start_m} mm', flush=True)
        with tempfile.TemporaryDirectory() as folder:
            recorded(start_m, Path(folder))


if __name__ == '__main__':
    main()
