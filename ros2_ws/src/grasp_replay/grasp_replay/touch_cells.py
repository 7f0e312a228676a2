# SPDX-License-Identifier: Apache-2.0
"""What the touch cells of fingers felt in a hold, `hand/tactile`, and what that says of the grasp.

As the live node does: the push of a finger lies over its cells in the shares that they felt, and
the cells are held against those that its rigid body would feel.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_replay.errors import BagError
from shell_deform.contact.body_file import FingerBody
from shell_deform.contact.cell_load import CellShape
from shell_deform.contact.contact_field import Touch
from shell_deform.contact.finger_bodies import of_finger, read_finger_bodies
from shell_deform.contact.taxels import cell_forces
from shell_deform.live.tick.sample import SampleError
from shell_deform.live.tick.touch_check import TouchCells, check_cells, compared, felt_shape
from shell_deform.objects import ObjectError

Array = NDArray[np.float64]


def carried_bodies(finger_body: str) -> dict[int, FingerBody]:
    """The bodies that `experiment.yaml` names, by finger; raises BagError."""
    try:
        return read_finger_bodies(finger_body).loaded()
    except (ObjectError, OSError) as error:
        raise BagError(f'finger_body: {error}') from error


def felt_in(
    samples: list[TouchCells], bodies: Mapping[int, FingerBody]
) -> tuple[dict[int, Array], tuple[str, ...]]:
    """(c,) median force of each cell [N] by finger, and why samples were left out."""
    kept: dict[int, list[Array]] = {}
    reasons: list[str] = []
    for cells in samples:
        try:
            check_cells(cells, bodies)
        except SampleError as error:
            reasons.append(str(error))
            continue
        for finger in np.unique(cells.finger).tolist():
            kept.setdefault(finger, []).append(cells.of(finger))
    medians = {finger: np.median(np.stack(rows), axis=0) for finger, rows in kept.items()}
    if not reasons:
        return medians, ()
    return medians, (f'{len(reasons)} of {len(samples)} samples of the hold: {reasons[0]}',)


def shape_of(
    body: FingerBody | None, felt: Array | None, push: float, normal: Array, along: Array
) -> tuple[CellShape | None, str]:
    """Where a finger pushes by its cells, or None and why they do not tell."""
    if felt is None or body is None or not len(body.cells):
        return None, ''
    shares, why = felt_shape(felt, push, normal, along)
    return (None, why) if why else (CellShape(body.cells, shares), '')


def touch_document(
    fingers: list[int],
    touches: tuple[Touch, ...],
    bodies: Mapping[int, FingerBody],
    felt: Mapping[int, Array],
) -> dict[str, Any]:
    """Measured cells beside those that the bodies of `touches` feel.

    `contradiction` [sigma] is that of the worst finger, which `suspect` names above one.
    """
    told, worst, suspect = [], 0.0, ''
    for finger, touch in zip(fingers, touches, strict=True):
        body, measured = of_finger(bodies, finger), felt.get(finger)
        if body is None or measured is None:
            continue
        normal = body.shape.distance(body.cells).normal
        expected = -np.einsum('ci,ci->c', cell_forces(touch, body.cells), normal)
        found = compared(measured, expected, body.cells)
        if found is not None and found[0] > worst:
            worst, suspect = found[0], f'{found[1]} of the cells of finger {finger}'
        told.append(
            {
                'finger': finger,
                'cells_n': measured.tolist(),
                'expected_cells_n': expected.tolist(),
                'contradiction': None if found is None else found[0],
            }
        )
    return {
        'contradiction': worst,
        'suspect': suspect if worst > 1.0 else '',
        'fingers': told,
    }


def sentence(touch: Mapping[str, Any]) -> str:
    """What `touch_document` says, for a page and a terminal."""
    parts = [
        f'finger {one["finger"]} feels {sum(one["cells_n"]):.2f} N by its cells, its body '
        f'{sum(one["expected_cells_n"]):.2f} N'
        for one in touch['fingers']
    ]
    verdict = f'the {touch["suspect"]} contradicts' if touch['suspect'] else 'nothing contradicts'
    return '; '.join([*parts, f'{verdict} ({touch["contradiction"]:.2f} sigma)'])
