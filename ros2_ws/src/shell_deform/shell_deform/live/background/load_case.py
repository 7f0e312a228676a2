# SPDX-License-Identifier: Apache-2.0
"""A load case on its way from the tick to the background solver."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.cell_load import CellShape
from shell_deform.live.background.contact_tracking import Touch
from shell_deform.live.exchange import MAX_GRIPS
from shell_deform.live.pose import Pose, pose_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Load:
    """A load case as the mailbox carries it, in the frame of the contacts.

    Attributes:
        touches: the fingers in contact. drive: 0 by force, else by motion where it is known.
        generation: the set of contacts that `rigid` and the displacements refer to.
        rigid: amplitudes of the free rigid motions. tendon: stretch [m/N].
        pose: of the object, or None to infer it at first touch.
        stamp: of the sample [ns]. reset: start from the undeformed shell.
        jump: time has jumped: the fingers touch anew, the last equilibrium is only a start.
        grips: (MAX_GRIPS, 6) motions of the object's grips, in its own frame.
        friction: coefficient of bodies on the object. hurried: others wait behind it.
    """

    touches: tuple[Touch, ...]
    drive: int
    generation: int
    rigid: Array
    tendon: float
    pose: Pose | None
    stamp: int
    reset: bool = False
    jump: bool = False
    grips: Array = field(default_factory=lambda: np.zeros((MAX_GRIPS, 6)))
    friction: float = 0.0
    hurried: bool = False


def load_of(request: np.void, resets: int = 0, jumps: int = 0) -> Load:
    """Read a mailbox record.

    It counts the resets and jumps so far, since load cases are overtaken; `resets` and `jumps` of
    them were obeyed already.
    """
    touches = tuple(
        Touch(
            int(t['finger']),
            t['point'].copy(),
            t['normal'].copy(),
            float(t['radius']),
            float(t['force']),
            float(t['travel']),
            float(t['displacement']),
            t['along'].copy(),
            _shape(t),
        )
        for t in request['touch'][: int(request['contacts'])]
    )
    return Load(
        touches=touches,
        drive=int(request['drive']),
        generation=int(request['generation']),
        rigid=request['rigid'].copy(),
        tendon=float(request['tendon']),
        pose=pose_of(request['pose']) if request['placed'] else None,
        stamp=int(request['stamp']),
        reset=int(request['resets']) > resets,
        jump=int(request['jumps']) > jumps,
        grips=request['grip'].copy(),
        friction=float(request['friction']),
        hurried=bool(request['hurried']),
    )


def _shape(touch: np.void) -> CellShape | None:
    count = int(touch['cells'])
    if not count:
        return None
    return CellShape(touch['cell'][:count].copy(), touch['share'][:count].copy())
