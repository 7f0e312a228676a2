# SPDX-License-Identifier: Apache-2.0
"""What belongs to a scan that arrived: its start pose, and remarks for its reader."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scan_compare.parameters import pose
from scan_compare.rigid import IDENTITY, Pose
from scan_compare.surface_history import StampedSurface

MOST_FINGERS = 8
CONTACT_FIELDS = ('finger', 'fx', 'fy', 'fz')


def start_pose(
    values: Mapping[str, Any], scan_frame: str, surface: StampedSurface | None
) -> Pose | None:
    """Return where registration starts by the parameters `values`; None searches all rotations."""
    way = values['scan_start']
    if way == 'given':
        return pose('scan_pose', values['scan_pose'])
    if way == 'search':
        return None
    if surface is None or (scan_frame and scan_frame == surface.frame):
        return IDENTITY
    if scan_frame in ('', values['object_frame']):
        return pose('object_pose', values['object_pose'])
    return None


def finger_forces(rows: np.ndarray) -> dict[int, float]:
    """Return the force [N] of each finger from contacts (n, 4) of CONTACT_FIELDS.

    Rows of one finger (tactile cells) are summed as vectors; forces that are not finite count
    nothing.
    """
    force: dict[int, np.ndarray] = {}
    for finger, *components in rows:
        if 0 <= finger < MOST_FINGERS:
            own = force.setdefault(int(finger), np.zeros(3))
            if np.all(np.isfinite(components)):
                own += components
    return {finger: float(np.linalg.norm(total)) for finger, total in sorted(force.items())}


def remarks(
    stamp_ns: int,
    surface: StampedSurface | None,
    tolerance_s: float,
    forces: Mapping[int, float],
) -> tuple[str, ...]:
    """Say which surface a scan of `stamp_ns` met, and under which `forces` [N] it was taken."""
    notes = []
    if surface is None:
        notes.append('no deformation/surface received: compared with the object at rest')
    elif stamp_ns:
        late = 1e-9 * (surface.stamp_ns - stamp_ns)
        if abs(late) > tolerance_s:
            when = 'later' if late > 0 else 'earlier'
            notes.append(f'the surface is {abs(late):.3g} s {when} than the scan')
    if forces:
        shown = ', '.join(f'finger {finger}: {force:.2f} N' for finger, force in forces.items())
        notes.append(f'forces when the scan arrived: {shown}')
    return tuple(notes)
