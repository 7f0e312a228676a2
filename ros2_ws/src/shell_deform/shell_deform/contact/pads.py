# SPDX-License-Identifier: Apache-2.0
"""Rigid pads: round bars with a flat end or a cap of a sphere, and how far a point is from one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pad:
    """A rigid pad before it moves.

    Attributes:
        apex: (3,) its foremost point, touching the outer face [m].
        axis: (3,) unit direction in which it moves, into the object.
        radius: of its rim [m]. curvature: of its face [1/m], 0 for a flat one.
    """

    apex: Array
    axis: Array
    radius: float
    curvature: float = 0.0


@dataclass(frozen=True)
class Gap:
    """Distance of p points from a pad [m], its gradient and second derivative.

    Attributes:
        value: (p,). normal: (p, 3) gradient: unit vectors away from the pad.
        along: (p, 3) unit vectors in the meridian plane, across `normal`.
        bend: (p,) second derivative along `along` [1/m]. around: (p, 3) unit vectors around the
            axis. turn: (p,) second derivative along `around` [1/m].
    """

    value: Array
    normal: Array
    along: Array
    bend: Array
    around: Array
    turn: Array

    def hessian_times(self, direction: Array) -> Array:
        """(p, 3) second derivative times a direction (3,)."""
        return (self.bend * (self.along @ direction))[:, None] * self.along + (
            self.turn * (self.around @ direction)
        )[:, None] * self.around

    def hessian(self) -> Array:
        """(p, 3, 3) second derivative [1/m]."""
        return np.einsum('p,pi,pj->pij', self.bend, self.along, self.along) + np.einsum(
            'p,pi,pj->pij', self.turn, self.around, self.around
        )


def gap(pad: Pad, depth: float, points: Array) -> Gap:
    """Distance of points (p, 3) from the pad moved by `depth` [m] along its axis."""
    away = points - pad.apex - depth * pad.axis
    height = away @ pad.axis
    outward = away - height[:, None] * pad.axis
    reach = np.linalg.norm(outward, axis=1)
    safe = np.maximum(reach, 1e-12 * pad.radius)
    outward = outward / safe[:, None]
    if pad.curvature:
        ball = 1.0 / pad.curvature
        from_centre = np.hypot(reach, height + ball)
        sine = reach / from_centre
        face = (reach <= pad.radius * pad.curvature * from_centre) & (height > -ball)
        value, slope = from_centre - ball, (height + ball) / from_centre
        bend = 1.0 / from_centre
        rim_height = height + ball - np.sqrt(ball**2 - pad.radius**2)
    else:
        face = reach <= pad.radius
        value, slope, sine = height, np.ones_like(height), np.zeros_like(height)
        bend, rim_height = np.zeros_like(height), height
    beside = reach - pad.radius
    edge = np.hypot(beside, np.maximum(rim_height, 0.0))
    small = np.maximum(edge, 1e-12 * pad.radius)
    rim = ~face
    value = np.where(rim, edge, value)
    sine = np.where(rim, beside / small, sine)
    slope = np.where(rim, np.maximum(rim_height, 0.0) / small, slope)
    bend = np.where(rim, np.where(rim_height > 0.0, 1.0 / small, 0.0), bend)
    normal = sine[:, None] * outward + slope[:, None] * pad.axis
    along = slope[:, None] * outward - sine[:, None] * pad.axis
    turn = np.where(reach > safe * (1.0 - 1e-9), sine / safe, bend)
    return Gap(value, normal, along, bend, np.cross(outward, pad.axis), turn)
