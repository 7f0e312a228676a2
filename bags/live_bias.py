# SPDX-License-Identifier: Apache-2.0
"""The served surface against the solids: `python -m bags.live_bias [RECORDING ...]`.

Contacts and object poses of the recordings go through tick and background solver as in the node,
at its default parameters. At every held scan the served outer face is compared with the solid's
face along its normals: as served in the frame of the hand, and after the best rigid motion, which
leaves the shape. What is left is the bias of the shell model together with the errors of the hand
(pins, tendons, gauges): what `sigma` has to cover.

`--theory thick` with `--young-modulus-pa 14.196e6 --poisson-ratio 0.49`, those of the solid, shows
what a wall with a thickness leaves. `--compliance-m-per-n` shows what a thin wall lacks: with the
shear dent taken from the travel as the stretch of a tendon is, and the modulus of the solid, the
bias that is left is that of bending alone. With `--true-contacts` the hand makes no error: places,
travels and forces of the contacts are the solid's own, and what is left is the theory's alone.
With `--true-places` travels and forces are what the hand measured, and what comes on top is
theirs; what then is still missing comes from where the hand believes object and fingers to be.
`--pins-slide` is the parameter `pins_slide` of the node: fingers that do not rub, as the pins of
the solids do not.

The recording with a slip is left out, since its truth does not say where the pins hold, and the
fast squeeze, which is not scanned while it is held.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bags.experiments import EXPERIMENTS
from bags.stage import Setting
from bags.surfaces import Surface
from grasp_replay.experiment import read_experiment
from grasp_replay.recording import read_recording
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.live.pose import Pose, pose_of
from shell_deform.live.tick.estimator import Served
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.live.tick.sample import ContactSample
from shell_deform.node.parameters import PARAMETERS, settings
from shell_deform.objects import load_object
from shell_deform.theory import DEFAULT_THEORY

Array = NDArray[np.float64]

BAGS = Path(__file__).parent
SLIPS = 'regrasp_sliding'
UNSCANNED = 'fast_squeeze_release'
SAMPLES_PER_REFRESH = 10
# Parts of the way from one held scan to the next under the solid's own contacts.
PARTS = 20
NINETY = 1.645
DENT = 0.1
HEAD = (
    '| recording | push [N] | depth [mm] | its error | dent, mean | all, RMS | largest '
    '| shape, RMS | sigma, median / largest | in the 90 % band, all / dent |\n'
    '|---|' + 9 * '---|'
)
PLACES, CONTACTS = 'places', 'contacts'
"""What of the contacts may be the solid's own: places alone, or travels and forces, too."""


@dataclass(frozen=True)
class Difference:
    """Served minus solid at one held scan.

    Attributes:
        force: of the solid per contact [N]. depth: of the solid under the pin, mid-wall, and where
            the wall has a thickness on the outer face [m].
        depth_error: served minus solid depth, mean of the contacts [m].
        served, shape: (n,) along the outward normals, as served and after the best rigid motion
            [m]. sigma: (n,) as served [m]. dent: (n,) vertices in the dents.
    """

    force: float
    depth: float
    depth_error: float
    served: Array
    shape: Array
    sigma: Array
    dent: NDArray[np.bool_]


def along_normals(points: Array, face: Surface) -> tuple[Array, Array]:
    """Signed distance of points (n, 3) outside a finely meshed face, and its normals there."""
    _, nearest = cKDTree(face.vertices).query(points)
    normal = face.normals[nearest]
    return np.einsum('ij,ij->i', points - face.vertices[nearest], normal), normal


def without_rigid(points: Array, normal: Array, distance: Array) -> Array:
    """What a small rigid motion of the points (n, 3) cannot take away of the distances (n,)."""
    design = np.concatenate([normal, np.cross(points - points.mean(axis=0), normal)], axis=1)
    return distance - design @ np.linalg.lstsq(design, distance, rcond=None)[0]


@dataclass(frozen=True)
class Wall:
    """What the live shell is made of instead of what the object file says; None: as there.

    Attributes:
        young [Pa], poisson_ratio [-]. compliance: how far a contact goes into the wall without
            bending it [m/N]. pins_slide: whether nothing holds it sideways under a pin.
    """

    theory: str = 'koiter'
    young: float | None = None
    poisson_ratio: float | None = None
    compliance: float = 0.0
    pins_slide: bool = False


class Playing:
    """A recording that is played through tick and solver."""

    def __init__(self, name: str, wall: Wall, true: str) -> None:
        folder = BAGS / name
        self.setting = EXPERIMENTS[name].setting()
        self.rows = read_experiment(folder)
        self.recording = read_recording(folder)
        self.shell = load_object(str(self.rows.object_file))
        self.shell = with_material(self.shell, wall.young, wall.poisson_ratio)
        model = build_model(self.shell, wall.theory)
        values = {one.name: one.default for one in PARAMETERS}
        values['tendon_compliance'] = wall.compliance
        self.live = Rehearsal(model, settings(values), pins_slide=wall.pins_slide)
        self.pins = object_contacts(self.shell, model)
        self._true = true
        self._reached, self._number = 0.0, 0
        self._error = np.zeros((2, len(self.pins)))

    def served(self, stamp: int, row: dict) -> Served:
        """What is served at a held scan."""
        if self._true:
            return self._under_true_contacts(stamp, row)
        samples, live = self.recording.samples, self.live
        while True:
            number, sample = self._number, samples[self._number]
            self._number += 1
            live.estimator.pose = self.recording.pose_at(sample.stamp)
            live.tick(sample)
            if number % SAMPLES_PER_REFRESH == 0:
                live.refresh()
            if sample.stamp >= stamp:
                return live.settle(sample)

    def _under_true_contacts(self, stamp: int, row: dict) -> Served:
        samples = self.recording.samples
        recorded = samples[int(np.searchsorted([one.stamp for one in samples], stamp))]
        pose, live = pose_of(row['object_pose']), self.live
        reached, self._reached = self._reached, float(row['force_n'])
        before, after = self._error, self._error
        if self._true == PLACES:
            whole = self._true_sample(recorded, pose, self._reached, 0.0 * before)
            seen = recorded.rows(recorded.touching)
            after = np.array([seen.travel - whole.travel, seen.push - whole.push])
        for share in np.linspace(0.0, 1.0, PARTS + 1)[1:]:
            force = reached + share * (self._reached - reached)
            error = before + share * (after - before)
            sample = self._true_sample(recorded, pose, force, error)
            live.estimator.pose = pose
            live.tick(sample)
            live.refresh()
        self._error = after
        return live.settle(sample)

    def _true_sample(
        self, recorded: ContactSample, pose: Pose, force: float, error: Array
    ) -> ContactSample:
        """The recorded sample with the places of the solid, and its travels and forces.

        `error` (2, k): what the hand measures too much of both [m], [N]; its sigmas stay where
        they are not the solid's.
        """
        touching = recorded.rows(recorded.touching)
        axes = np.array([pin.axis for pin in self.pins])
        outside = np.array([pin.point for pin in self.pins]) - 0.5 * self.shell.thickness_m * axes
        seen = (touching.point - pose.translation) @ pose.rotation
        pin = cKDTree(outside).query(seen)[1]
        travel = self.setting.truth.outer_displacement(force)
        normal = axes[pin] @ pose.rotation.T
        known = np.full(len(pin), 1e-3)
        sigmas = (known, 1e-3 * known)
        if self._true == PLACES:
            sigmas = (touching.sigma_normal, touching.sigma_travel)
        return replace(
            touching,
            point=(outside[pin] + travel * axes[pin]) @ pose.rotation.T + pose.translation,
            normal=normal,
            force=(force + error[1])[:, None] * normal,
            travel=travel + error[0],
            sigma_normal=sigmas[0],
            sigma_travel=sigmas[1],
        )


def outer_face(live: Rehearsal, served: Served, thickness: float) -> tuple[Array, Array]:
    """What is served of the vertices in use (n, fields), and their outer face (n, 3) [m]."""
    active = np.unique(live.memory.triangles)
    adopted, pose = live.estimator.adopted, live.estimator.pose_in_use
    assert adopted is not None
    packed = served.packed[active].astype(float)
    if live.memory.rest_outer is not None:
        return packed, packed[:, -3:]
    outward = adopted.slot.normals[active] @ pose.rotation.T
    return packed, packed[:, :3] + 0.5 * thickness * outward


def differences(name: str, wall: Wall = Wall(), true: str = '') -> Iterator[Difference]:
    """Play a recording through tick and solver; one difference per held scan, when it is reached.

    `true`: what is the solid's own, PLACES or CONTACTS, instead of what the hand told of them.
    """
    playing = Playing(name, wall, true)
    live, setting = playing.live, playing.setting
    for stamp, row in held_scans(name).items():
        served = playing.served(stamp, row)
        packed, points = outer_face(live, served, playing.shell.thickness_m)
        thick = live.memory.rest_outer is not None
        depth = float(np.mean(served.displacement))
        yield beside_solid(setting, row, packed, points, depth, thick)


def beside_solid(
    setting: Setting, row: dict, packed: Array, points: Array, depth: float, thick: bool
) -> Difference:
    """What is served at a held scan beside the solid of its truth `row`.

    `packed` (n, fields), outer face `points` (n, 3), `depth` under the pins [m]: of the middle
    surface, or of the outer face where the wall is `thick`.
    """
    true = row['displacement_outer_m' if thick else 'displacement_middle_m']
    place = pose_of(row['object_pose'])
    turn = place.rotation @ setting.from_solution
    face = setting.truth.surface(row['force_n']).moved(turn, place.translation)
    distance, normal = along_normals(points, face)
    return Difference(
        row['force_n'],
        true,
        depth - true,
        distance,
        without_rigid(points, normal, distance),
        packed[:, 7],
        packed[:, 6] > DENT * packed[:, 6].max(),
    )


def held_scans(name: str) -> dict[int, dict]:
    """Truth of the held scans of a recording by their stamps [ns], in their order."""
    truth = yaml.safe_load((BAGS / name / 'truth.yaml').read_text())['scans']
    scans = read_experiment(BAGS / name).scans
    held = {one.stamp: row for one, row in zip(scans, truth, strict=True) if one.held}
    return dict(sorted(held.items()))


def shown(found: Difference) -> str:
    """The figures of one held scan as cells of the table."""

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2)))

    millimetres = 1e3 * np.array(
        [
            found.depth,
            found.depth_error,
            found.served[found.dent].mean(),
            rms(found.served),
            np.abs(found.served).max(),
            rms(found.shape),
        ]
    )
    sigma = f'{1e3 * np.median(found.sigma):.3f} / {1e3 * found.sigma.max():.3f}'
    covered = 100.0 * (np.abs(found.served) <= NINETY * found.sigma)
    band = f'{covered.mean():.0f} / {covered[found.dent].mean():.0f} %'
    return ' | '.join(
        [f'{found.force:.2f}', *(f'{value:.3f}' for value in millimetres), sigma, band]
    )


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = [name for name in EXPERIMENTS if name not in (SLIPS, UNSCANNED)]
    parser.add_argument('recording', nargs='*', default=names, help=f'of {", ".join(names)}')
    parser.add_argument('--young-modulus-pa', type=float, help="instead of the object file's")
    parser.add_argument('--compliance-m-per-n', type=float, default=0.0, help='of the wall')
    parser.add_argument(
        '--theory', default=DEFAULT_THEORY, help='of the wall (default %(default)s)'
    )
    parser.add_argument('--poisson-ratio', type=float, help="instead of the object file's")
    parser.add_argument('--pins-slide', action='store_true', help='fingers do not rub')
    true = parser.add_mutually_exclusive_group()
    true.add_argument(
        '--true-contacts', dest='true', action='store_const', const=CONTACTS, default='',
        help='places, travels and forces of the solid',
    )  # fmt: skip
    true.add_argument(
        '--true-places', dest='true', action='store_const', const=PLACES, default='',
        help='places of the solid, travels and forces of the hand',
    )  # fmt: skip
    options = parser.parse_args()
    wanted = options.recording
    unknown = sorted(set(wanted) - set(names))
    if unknown:
        parser.error(f'no recording {", ".join(unknown)}; there are {", ".join(names)}')
    print(HEAD)
    covered = []
    wall = Wall(
        options.theory,
        options.young_modulus_pa,
        options.poisson_ratio,
        options.compliance_m_per_n,
        options.pins_slide,
    )
    for name in wanted:
        for one in differences(name, wall, options.true):
            print(f'| {name} | {shown(one)} |', flush=True)
            covered.append(np.abs(one.served) <= NINETY * one.sigma)
    print(f'\nin the 90 % band of sigma: {100 * np.concatenate(covered).mean():.1f} % of vertices')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
