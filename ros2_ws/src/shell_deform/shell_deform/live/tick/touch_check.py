# SPDX-License-Identifier: Apache-2.0
"""Measured touch cells against those that the equilibrium expects: which finger contradicts.

Cells measure along their own normals, each about a hundredth of the force; what is compared is
what they are worth together: the push of a finger, where its centre lies, and how far it spreads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.body_file import FingerBody
from shell_deform.contact.cell_load import cell_pitch, cell_shares
from shell_deform.contact.finger_bodies import of_finger
from shell_deform.live.exchange import TAXEL_FIELDS
from shell_deform.live.tick.sample import MOST_FORCE, SampleError

Array = NDArray[np.float64]

SIGMA_RELATIVE, SIGMA_N = 0.05, 0.05
"""Of a cell: gain, and noise [N]."""

SMALLEST_PUSH = 0.3
"""Below this push [N] cells say nothing about where it is."""

ALIKE = 1.5
"""Cells that together feel this many times more or less than the gauge of their finger are dead,
stuck or at their end: where they feel it is not where the finger presses."""

OLDEST_NS = 500_000_000
"""Cells measured longer before or after a sample say nothing of it [ns]."""

STEEPEST = 0.99
"""Cosine of a finger to its own normal from which it says no more how it lies."""


@dataclass(frozen=True)
class TouchCells:
    """One sample of the cells: who measured what.

    Attributes:
        stamp: [ns]. finger, cell: (c,) whose. force: (c,) along its normal, on the object [N].
    """

    stamp: int
    finger: NDArray[np.int64]
    cell: NDArray[np.int64]
    force: Array

    def of(self, finger: int) -> Array:
        """(c,) what the cells of one finger measure [N], in the order of their numbers."""
        mine = self.finger == finger
        return self.force[mine][np.argsort(self.cell[mine])]


@dataclass(frozen=True)
class TouchJudgement:
    """By how many standard deviations the cells of the worst finger are off, and what of them.

    Attributes:
        value: root mean square of what is compared [-]. suspect: '' below 1, else in words.
    """

    value: float
    suspect: str


@dataclass(frozen=True)
class _Summary:
    """Push [N], centre (3,) [m], spread [m] of a finger's cells, and the variance of each."""

    push: float
    centre: Array
    spread: float
    push_variance: float
    place_variance: float


def check_cells(cells: TouchCells, bodies: Mapping[int, FingerBody]) -> None:
    """Raise SampleError for cells that no body has, twice or missing ones, impossible forces."""
    for finger in np.unique(cells.finger).tolist():
        body = of_finger(bodies, finger)
        own = np.sort(cells.cell[cells.finger == finger])
        count = 0 if body is None else len(body.cells)
        if not np.array_equal(own, np.arange(count)):
            raise SampleError(
                f'hand/tactile has {len(own)} cells of finger {finger}, numbers {own.min()} to '
                f'{own.max()}; its body has {count}, each needed once, so they are not used'
            )
    bad = ~(np.abs(cells.force) < MOST_FORCE)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise SampleError(
            f'cell {cells.cell[row]} of finger {cells.finger[row]} measures {cells.force[row]} N; '
            f'a finite force below {MOST_FORCE:g} N is needed, so the cells are not used'
        )


def judged(cells: TouchCells, taxels: Array, bodies: Mapping[int, FingerBody]) -> TouchJudgement:
    """Measured cells against rows of `TAXEL_FIELDS`, finger by finger."""
    worst = TouchJudgement(0.0, '')
    column = {name: k for k, name in enumerate(TAXEL_FIELDS)}
    for finger in np.unique(cells.finger).tolist():
        rows = taxels[taxels[:, column['finger']] == finger]
        body = of_finger(bodies, finger)
        if body is None or len(rows) != len(body.cells):
            continue
        measured = cells.of(finger)
        expected = np.einsum('ci,ci->c', rows[:, 6:9], rows[:, 3:6])
        found = compared(measured, expected, body.cells)
        if found is not None and found[0] > worst.value:
            worst = TouchJudgement(found[0], f'{found[1]} of the cells of finger {finger}')
    return worst if worst.value > 1.0 else TouchJudgement(worst.value, '')


def felt_shape(force: Array, push: float, normal: Array, along: Array) -> tuple[Array, str]:
    """(c,) shares of a finger's push by what its cells felt (c,) [N]; why none can be told, or ''.

    `push` [N]: by its gauge; along its (3,) `normal`, with (3,) `along` to its tip.
    """
    felt = float(np.maximum(force, 0.0).sum())
    if not len(force):
        return force, 'has none'
    if not np.isfinite(along).all() or abs(float(along @ normal)) >= STEEPEST:
        return force, 'does not say how it lies (ax ay az)'
    if felt < SMALLEST_PUSH:
        return force, f'feels less than {SMALLEST_PUSH:g} N by them'
    if push > SMALLEST_PUSH and not 1.0 / ALIKE < felt / push < ALIKE:
        return force, f'feels {felt:.2f} N by them and {push:.2f} N by its gauge'
    return cell_shares(force), ''


def write_shapes(
    request: np.void, cells: TouchCells | None, bodies: Mapping[int, FingerBody]
) -> dict[int, str]:
    """Give the fingers of a load case the shapes that their cells felt.

    Returns for each finger why it got none and presses evenly, '' where it got one.
    """
    touch = request['touch'][: int(request['contacts'])]
    touch['cells'] = 0
    told = {}
    late = cells is None or abs(int(request['stamp']) - cells.stamp) > OLDEST_NS
    for row in touch:
        finger = int(row['finger'])
        body = of_finger(bodies, finger)
        if late or cells is None or body is None:
            told[finger] = 'has none of the last half second'
            continue
        shares, told[finger] = felt_shape(
            cells.of(finger), float(row['force']), row['normal'], row['along']
        )
        if not told[finger]:
            row['cells'] = len(shares)
            row['cell'][: len(shares)] = body.cells
            row['share'][: len(shares)] = shares
    return told


def _summary(force: Array, places: Array) -> _Summary:
    push = float(force.sum())
    share = np.maximum(force, 0.0)
    share = share / max(float(share.sum()), 1e-12)
    centre = share @ places
    away = np.sum((places - centre) ** 2, axis=1)
    noise = np.hypot(SIGMA_N, SIGMA_RELATIVE * force) ** 2
    scale = max(push, SMALLEST_PUSH) ** 2
    place = cell_pitch(places) ** 2 / 12.0 + float(noise @ away) / scale
    return _Summary(push, centre, float(np.sqrt(share @ away)), float(noise.sum()), place)


def compared(felt: Array, wanted: Array, places: Array) -> tuple[float, str] | None:
    """By how many sigmas cells at `places` (c, 3) [m] that `felt` (c,) [N] miss the `wanted` ones.

    Root mean square of the normalised differences, and the largest of them; None where neither
    says anything.
    """
    measured, expected = _summary(felt, places), _summary(wanted, places)
    if max(measured.push, expected.push) < SMALLEST_PUSH:
        return None
    place = measured.place_variance + expected.place_variance
    shift = float(np.sum((measured.centre - expected.centre) ** 2)) / (2.0 * place)
    push = (measured.push - expected.push) ** 2
    push /= measured.push_variance + expected.push_variance + (0.05 * expected.push) ** 2
    spread = (measured.spread - expected.spread) ** 2 / place
    parts = {'centre': shift, 'push': push, 'extent': spread}
    return float(np.sqrt(np.mean(list(parts.values())))), max(parts, key=lambda n: parts[n])
