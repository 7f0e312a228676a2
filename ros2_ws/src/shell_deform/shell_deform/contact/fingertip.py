# SPDX-License-Identifier: Apache-2.0
"""A fingertip: a pad that is flat along the finger, then bends back in arcs around its end.

A convex profile in the plane of the finger, drawn out to a width, with edges rounded by a radius.
A convex set is as far from a point as the furthest of its supporting lines; those of a profile
made of arcs and straight lines turn about the arcs' centres alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.bodies import BodyError, Distance

Array = NDArray[np.float64]

# Lengths below this share of the rounding are none.
SMALL = 1e-12


@dataclass(frozen=True)
class Fingertip:
    """A pad with a rounded end; its frame has x along the finger to the tip, z out of the pad.

    Attributes:
        heel: where the pad begins, flat_to: where its flat ends, touch: which place of it is the
            origin of the frame, all along the finger from any zero [m].
        arcs: (radius [m], turn [rad]) of the arcs between the flat and the end, in order.
        width: across the finger, height: behind the flat [m]. rounding: radius of the edges [m].
    """

    heel: float
    flat_to: float
    touch: float
    arcs: tuple[tuple[float, float], ...]
    width: float
    height: float
    rounding: float

    def __post_init__(self) -> None:
        flat = self.flat_to - self.heel
        if not (0.0 < self.rounding < 0.5 * min(self.width, self.height) and flat > self.rounding):
            raise BodyError(
                f'edges rounded by {self.rounding:g} m do not fit a fingertip of {self.width:g} m '
                f'by {self.height:g} m with a flat of {flat:g} m'
            )
        if any(not (radius >= self.rounding and turn > 0.0) for radius, turn in self.arcs):
            raise BodyError(
                f'every arc of a fingertip turns by more than 0 at a radius of at least the '
                f'rounding of its edges, {self.rounding:g} m'
            )
        turned = sum(turn for _, turn in self.arcs)
        if turned > 0.75 * np.pi:
            raise BodyError(
                f'the arcs of a fingertip turn by {np.degrees(turned):g} degrees; 135 is the most'
            )
        x, z, radius, _, angle = self._inner[-4]
        below = z + radius * np.cos(angle) < self.rounding - self.height
        if below or self._inner[-3, 0] < self.heel + self.rounding:
            raise BodyError(
                'the arcs of a fingertip end behind its back or its heel; take smaller ones'
            )
        if not self.heel + self.rounding <= self.touch <= self.flat_to + self._reach:
            raise BodyError(
                f'a fingertip touches at {self.touch:g} m, which lies on none of its pad, '
                f'{self.heel + self.rounding:g} to {self.flat_to + self._reach:g} m'
            )

    @cached_property
    def _inner(self) -> Array:
        """(a, 5) arcs of the profile less the rounding: centre x, z, radius, from, to [rad].

        Angles of the outward normal from z towards x; over one whole turn, flats between arcs.
        """
        at, angle, arcs = np.array([self.flat_to, -self.rounding]), 0.0, []
        for full, turn in self.arcs:
            radius = full - self.rounding
            centre = at - radius * _direction(angle)
            arcs.append([*centre, radius, angle, angle + turn])
            angle += turn
            at = centre + radius * _direction(angle)
        if angle < 0.5 * np.pi:
            arcs.append([*at, 0.0, angle, 0.5 * np.pi])
            angle = 0.5 * np.pi
        back, heel = self.rounding - self.height, self.heel + self.rounding
        # From the end straight on to the back.
        tip = at[0] + (at[1] - back) * np.cos(angle) / np.sin(angle)
        arcs.append([tip, back, 0.0, angle, np.pi])
        arcs.append([heel, back, 0.0, np.pi, 1.5 * np.pi])
        arcs.append([heel, -self.rounding, 0.0, 1.5 * np.pi, 2.0 * np.pi])
        return np.array(arcs)

    @cached_property
    def _reach(self) -> float:
        """How far along the finger the arcs go beyond the flat [m], up to a normal along it."""
        reach, angle = 0.0, 0.0
        for radius, turn in self.arcs:
            reach += radius * (np.sin(min(angle + turn, 0.5 * np.pi)) - np.sin(angle))
            angle = min(angle + turn, 0.5 * np.pi)
        return float(reach)

    def foot(self, along: float) -> tuple[Array, float]:
        """The pad's place at `along` the finger: with its height over the flat (2,) [m], its turn.

        That turn [rad] is how far its normal leans from that of the flat to the tip.
        """
        ahead, at, angle = along - self.flat_to, np.array([along, 0.0]), 0.0
        for radius, turn in self.arcs if ahead > 0.0 else ():
            end = min(angle + turn, 0.5 * np.pi)
            step = radius * (np.sin(end) - np.sin(angle))
            if ahead < step:
                end = float(np.arcsin(ahead / radius + np.sin(angle)))
            at[1] -= radius * (np.cos(angle) - np.cos(end))
            ahead, angle = ahead - step, end
            if ahead <= 0.0:
                break
        return at, angle

    @cached_property
    def _origin(self) -> tuple[Array, float]:
        """Where the frame lies on the profile, and how far it has turned there."""
        return self.foot(self.touch)

    def placed(self, along: Array, across: Array) -> Array:
        """(c, 3) places of the pad `along` the finger and `across` it (c,) [m], in the frame."""
        feet = np.array([self.foot(float(x))[0] for x in along])
        x, z = self._turned(feet - self._origin[0]).T
        return np.column_stack([x, across, z])

    def _turned(self, away: Array) -> Array:
        sine, cosine = np.sin(self._origin[1]), np.cos(self._origin[1])
        return away @ np.array([[cosine, sine], [-sine, cosine]])

    @cached_property
    def _arcs(self) -> Array:
        """`_inner` in the frame of the body."""
        arcs = self._inner.copy()
        arcs[:, :2] = self._turned(arcs[:, :2] - self._origin[0])
        arcs[:, 3:] -= self._origin[1]
        return arcs

    @cached_property
    def size(self) -> float:
        """Distance of its furthest point from the origin, at most [m]."""
        share = np.linspace(0.0, 1.0, 9)[:, None]
        x, z, radius, start, end = self._arcs.T
        angle = start + share * (end - start)
        reach = np.hypot(x + radius * np.sin(angle), z + radius * np.cos(angle)).max()
        return float(np.hypot(reach, 0.5 * self.width) + self.rounding)

    @property
    def front(self) -> float:
        """See `Shape`: the frame lies where the pad is foremost along its normal."""
        return 0.0

    def distance(self, points: Array) -> Distance:
        """Distance of points (p, 3)."""
        beside = np.abs(points[:, 1]) - (0.5 * self.width - self.rounding)
        ahead, angle, bend = self._profile(points[:, [0, 2]])
        a, b = np.maximum(ahead, 0.0), np.maximum(beside, 0.0)
        outside = (a > 0.0) | (b > 0.0)
        far = np.maximum(np.hypot(a, b), SMALL * self.rounding)
        # Inside the nearer of profile and side counts alone.
        first = np.where(outside, a / far, ahead >= beside)
        second = np.where(outside, b / far, ahead < beside)
        out, side = np.zeros_like(points), np.zeros_like(points)
        out[:, 0], out[:, 2] = np.sin(angle), np.cos(angle)
        side[:, 1] = np.where(points[:, 1] < 0.0, -1.0, 1.0)
        along = np.stack([out[:, 2], np.zeros(len(out)), -out[:, 0]], axis=1)
        normal = first[:, None] * out + second[:, None] * side
        across = second[:, None] * out - first[:, None] * side
        edge = np.where((a > 0.0) & (b > 0.0), 1.0 / far, 0.0)
        hessian = np.einsum('p,pi,pj->pij', edge, across, across)
        hessian += np.einsum('p,pi,pj->pij', first * bend, along, along)
        value = np.where(outside, far, np.maximum(ahead, beside))
        return Distance(value - self.rounding, normal, hessian)

    def _profile(self, points: Array) -> tuple[Array, Array, Array]:
        """Signed distance (p,) from the inner profile, angle of its normal, its bend [1/m]."""
        arcs = self._arcs
        away = points[:, None] - arcs[:, :2]
        seen = np.arctan2(away[..., 0], away[..., 1])
        start, end = arcs[:, 3], arcs[:, 4]
        middle = 0.5 * (start + end)
        seen = middle + (seen - middle + np.pi) % (2.0 * np.pi) - np.pi
        normal = np.clip(seen, start, end)
        height = away[..., 0] * np.sin(normal) + away[..., 1] * np.cos(normal) - arcs[:, 2]
        best, row = np.argmax(height, axis=1), np.arange(len(points))
        inner = (seen > start) & (seen < end)
        reach = np.maximum(np.linalg.norm(away[row, best], axis=1), SMALL * self.rounding)
        bend = np.where(inner[row, best], 1.0 / reach, 0.0)
        return height[row, best], normal[row, best], bend


def _direction(angle: float) -> Array:
    return np.array([np.sin(angle), np.cos(angle)])
