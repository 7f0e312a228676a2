# SPDX-License-Identifier: Apache-2.0
"""How firmly an object sits between fingers that stand still, and what squeezing it has cost.

A wrench on the object, spread over its wall as its weight is, moves it against the fingers. The
compliance here is that motion, by the tangent of the deformed shell: symmetric, because it is the
motion that does the work of the same wrench.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GraspStiffness:
    """Of the object against fingers that stand still.

    Attributes:
        matrix: (6, 6) wrench [N, N m] per motion [m, rad] of the object about its middle.
        smallest: smallest eigenvalue with turns counted at `length` [N/m]; negative where the
            grasp is unstable.
        direction: (6,) motion of it. length: [m].
    """

    matrix: Array
    smallest: float
    direction: Array
    length: float


def grasp_stiffness(compliance: Array, length: float) -> GraspStiffness:
    """Stiffness from the compliance (6, 6) [m/N, rad/N, m/(N m), rad/(N m)]."""
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    even = 0.5 * (compliance + compliance.T) * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(even)
    stiff = 1.0 / np.where(np.abs(values) > 0.0, values, 1e-300)
    weakest = int(np.argmin(stiff))
    matrix = (vectors * stiff) @ vectors.T * np.outer(scale, scale)
    direction = vectors[:, weakest] / scale
    return GraspStiffness(matrix, float(stiff[weakest]), direction, length)


def adversary_work(compliance: Array, force: float) -> float:
    """Most energy [J] that a push of `force` [N] at the object's middle puts into the grasp.

    What the fingers must withstand from an adversary finger (Jia, Guo & Lin, IJRR 33(8), 2014),
    here with fingers that stand still; less is better.
    """
    pushes = 0.5 * (compliance[:3, :3] + compliance[:3, :3].T)
    return float(0.5 * force**2 * np.linalg.eigvalsh(pushes)[-1])


def rigid_share(point: Array, motion: Array) -> float:
    """Share of the contacts' motion (k, 3) that moves the object as a body: 0 in a pure squeeze.

    By least squares over the rigid motions at the points (k, 3); 0 where nothing moves.
    """
    size = float(np.linalg.norm(motion))
    if not size > 0.0:
        return 0.0
    offset = point - point.mean(axis=0)
    length = float(np.sqrt((offset**2).sum() / len(point))) or 1.0
    rows = np.zeros((len(point), 3, 6))
    rows[:, :, :3] = np.eye(3)
    for axis in range(3):
        rows[:, :, 3 + axis] = np.cross(np.eye(3)[axis], offset / length)
    flat = rows.reshape(-1, 6)
    found = np.linalg.lstsq(flat, motion.reshape(-1), rcond=1e-9)[0]
    return min(float(np.linalg.norm(flat @ found)) / size, 1.0)


def squeeze_work(displacement: Array, force: Array) -> float:
    """Work [J] of the pushes (s, k) [N] along the motions (s, k) [m] of a squeeze, from rest on.

    By the trapezoid rule over the s states, the first of which is at rest.
    """
    steps = np.diff(displacement, axis=0)
    return float(np.sum(0.5 * (force[1:] + force[:-1]) * steps))
