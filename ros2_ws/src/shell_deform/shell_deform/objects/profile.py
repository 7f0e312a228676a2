# SPDX-License-Identifier: Apache-2.0
"""Meridians of surfaces of revolution: smooth pieces, moved in by half the wall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .shell_object import ObjectError

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

FloatArray = npt.NDArray[np.float64]

CREASE_ANGLE = np.deg2rad(40.0)
"""Turning of a profile from which it counts as a sharp edge."""

SAMPLES = 1500


@dataclass(frozen=True)
class Piece:
    """One smooth piece of a meridian.

    Attributes:
        curve: arc length [m] -> (r, z) [m].
        length: its arc length [m].
    """

    curve: CubicSpline
    length: float

    def starts_on_axis(self) -> bool:
        """True if the lower end is a pole."""
        return bool(self.curve(0.0)[0] <= 1e-9 * self.length)

    def ends_on_axis(self) -> bool:
        """True if the upper end is a pole."""
        return bool(self.curve(self.length)[0] <= 1e-9 * self.length)

    def arc_of_height(self) -> tuple[FloatArray, FloatArray]:
        """Conformal height (integral of ds / r, zero in the middle) and arc length [m], tables.

        Towards a pole the height grows like the logarithm of the distance; the tables stop
        there at a distance of 1e-7 of the length.
        """
        share = np.geomspace(1e-7, 0.5, SAMPLES)
        lower = share if self.starts_on_axis() else np.linspace(0.0, 0.5, SAMPLES)
        upper = share if self.ends_on_axis() else np.linspace(0.0, 0.5, SAMPLES)
        arc = self.length * np.concatenate([lower, 1.0 - upper[-2::-1]])
        middle = 0.5 * (arc[1:] + arc[:-1])
        height = np.concatenate([[0.0], np.cumsum(np.diff(arc) / self.curve(middle)[:, 0])])
        return height - height[SAMPLES - 1], arc

    def frame(self, arc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (p, 2) and outward unit normals (p, 2) in the (r, z) plane."""
        tangent = self.curve(arc, 1)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        return self.curve(arc), np.column_stack([tangent[:, 1], -tangent[:, 0]])


def middle_profile(outer: FloatArray, depth: float) -> list[Piece]:
    """Smooth pieces of the meridian `depth` inside an outer profile (n, 2) of (r, z) [m].

    The profile is split where it turns sharply; each piece is a cubic spline through its points.

    Raises:
        ObjectError: the profile closes in a tip, or is too tight for the depth.
    """
    pieces = [_moved_in(points, depth) for points in _smooth_groups(outer)]
    for first in range(len(pieces) - 1):
        pieces[first], pieces[first + 1] = _joined(pieces[first], pieces[first + 1], depth)
    return [_spline(points) for points in pieces]


def _smooth_groups(outer: FloatArray) -> list[FloatArray]:
    step = np.diff(outer, axis=0)
    direction = np.arctan2(step[:, 1], step[:, 0])
    turning = np.abs((np.diff(direction) + np.pi) % (2.0 * np.pi) - np.pi)
    sharp = 1 + np.flatnonzero(turning > CREASE_ANGLE)
    bounds = [0, *sharp.tolist(), len(outer) - 1]
    return [outer[a : b + 1] for a, b in zip(bounds[:-1], bounds[1:], strict=True)]


def _moved_in(points: FloatArray, depth: float) -> FloatArray:
    """Dense samples of one piece, moved in along its normals."""
    piece = _spline(points)
    for pole, tangent in (
        (piece.starts_on_axis(), piece.curve(0.0, 1)),
        (piece.ends_on_axis(), piece.curve(piece.length, 1)),
    ):
        if pole and abs(tangent[1]) > 0.6 * np.linalg.norm(tangent):
            raise ObjectError(
                'the profile reaches the axis in a tip; let it arrive at a right angle to the axis'
            )
    arc = np.linspace(0.0, piece.length, SAMPLES)
    place, normal = piece.frame(arc)
    inner = place - depth * normal
    if (np.einsum('ij,ij->i', np.diff(inner, axis=0), np.diff(place, axis=0)) <= 0.0).any():
        raise ObjectError('the profile is rounded more tightly than half the wall')
    inner[0, 0] = 0.0 if piece.starts_on_axis() else inner[0, 0]
    inner[-1, 0] = 0.0 if piece.ends_on_axis() else inner[-1, 0]
    if (inner[1:-1, 0] <= 0.0).any() or (inner[:, 0] < 0.0).any():
        raise ObjectError('the wall is thicker than the profile is wide')
    return inner


def _joined(lower: FloatArray, upper: FloatArray, depth: float) -> tuple[FloatArray, FloatArray]:
    """Cut or lengthen two neighbouring curves to their common point."""
    first = _lengthened(lower, 2.0 * depth)
    second = _lengthened(upper[::-1], 2.0 * depth)
    found = _crossing(first, second)
    if found is None:
        raise ObjectError('the wall does not fit into a corner of the profile')
    i, j, place = found
    return np.vstack([first[: i + 1], place]), np.vstack([second[: j + 1], place])[::-1]


def _lengthened(points: FloatArray, length: float) -> FloatArray:
    end = points[-1] - points[-2]
    extra = points[-1] + np.linspace(0.0, length, 50)[1:, None] * end / np.linalg.norm(end)
    return np.vstack([points, extra])


def _crossing(first: FloatArray, second: FloatArray) -> tuple[int, int, FloatArray] | None:
    """Segment numbers and place where two polylines cross, looking from their ends."""
    a, da = first[:-1, None], np.diff(first, axis=0)[:, None]
    b, db = second[None, :-1], np.diff(second, axis=0)[None]
    determinant = da[..., 0] * db[..., 1] - da[..., 1] * db[..., 0]
    away = b - a
    with np.errstate(divide='ignore', invalid='ignore'):
        s = (away[..., 0] * db[..., 1] - away[..., 1] * db[..., 0]) / determinant
        t = (away[..., 0] * da[..., 1] - away[..., 1] * da[..., 0]) / determinant
    hits = np.argwhere((s > 0.0) & (s <= 1.0) & (t > 0.0) & (t <= 1.0))
    if len(hits) == 0:
        return None
    i, j = (int(k) for k in hits[np.argmax(hits.sum(axis=1))])
    return i, j, first[i] + s[i, j] * (first[i + 1] - first[i])


def _spline(points: FloatArray) -> Piece:
    """A cubic spline through points, in arc length, at a right angle to the axis at poles."""
    # Deferred: it takes a quarter of the start of a process that builds a ball.
    from scipy.interpolate import CubicSpline

    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    keep = np.concatenate([[True], np.diff(chord) > 1e-9 * chord[-1]])
    points, chord = points[keep], chord[keep]
    if len(points) == 2:
        ends: tuple = ('not-a-knot', 'not-a-knot')
    else:
        ends = _end_conditions(points)
    rough = CubicSpline(chord, points, bc_type=ends if len(points) > 2 else 'natural')
    fine = np.unique(np.concatenate([chord, np.linspace(0.0, chord[-1], 4 * SAMPLES)]))
    speed = np.linalg.norm(rough(0.5 * (fine[1:] + fine[:-1]), 1), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(speed * np.diff(fine))])
    if len(points) == 2:
        return Piece(CubicSpline(arc[[0, -1]], points, bc_type='natural'), float(arc[-1]))
    even = np.linspace(0.0, chord[-1], SAMPLES)
    places = rough(even)
    return Piece(CubicSpline(np.interp(even, fine, arc), places, bc_type=ends), float(arc[-1]))


def _end_conditions(points: FloatArray) -> tuple:
    """Horizontal ends of the right sign at poles that are nearly so, else free ends."""
    conditions: list = []
    for end, step in ((points[0], points[1] - points[0]), (points[-1], points[-1] - points[-2])):
        flat = end[0] == 0.0 and abs(step[1]) < 0.6 * np.linalg.norm(step)
        conditions.append((1, np.array([np.sign(step[0]), 0.0])) if flat else 'not-a-knot')
    if isinstance(conditions[0], str) != isinstance(conditions[1], str) or not isinstance(
        conditions[0], str
    ):
        conditions = [
            (2, np.zeros(2)) if isinstance(one, str) and len(points) == 3 else one
            for one in conditions
        ]
    return conditions[0], conditions[1]


class RevolvedTarget:
    """A surface of revolution about z, made of smooth pieces."""

    def __init__(self, pieces: list[Piece]) -> None:
        self.pieces = pieces
        arcs = [np.linspace(0.0, piece.length, 2 * SAMPLES) for piece in pieces]
        self._owner = np.repeat(np.arange(len(pieces)), 2 * SAMPLES)
        self._arc = np.concatenate(arcs)
        samples = [piece.curve(arc) for piece, arc in zip(pieces, arcs, strict=True)]
        self._tree = cKDTree(np.concatenate(samples))

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (p, 3) [m] and outward unit normals (p, 3)."""
        radius = np.hypot(points[:, 0], points[:, 1])
        radial = np.zeros_like(points)
        away = np.where(radius > 0.0, radius, 1.0)
        radial[:, :2] = points[:, :2] / away[:, None]
        plane = np.column_stack([radius, points[:, 2]])
        nearest = self._tree.query(plane)[1]
        foot, normal = np.empty_like(plane), np.empty_like(plane)
        for number, piece in enumerate(self.pieces):
            mine = np.flatnonzero(self._owner[nearest] == number)
            if len(mine) == 0:
                continue
            arc = self._arc[nearest[mine]]
            for _ in range(4):
                place, slope, bend = (piece.curve(arc, k) for k in range(3))
                gap = place - plane[mine]
                first = np.einsum('ij,ij->i', gap, slope)
                second = (slope**2).sum(axis=1) + np.einsum('ij,ij->i', gap, bend)
                second = np.maximum(second, 0.1 * (slope**2).sum(axis=1))
                arc = np.clip(arc - first / second, 0.0, piece.length)
            foot[mine], normal[mine] = piece.frame(arc)
        up = np.array([0.0, 0.0, 1.0])
        return (
            foot[:, :1] * radial + foot[:, 1:] * up,
            normal[:, :1] * radial + normal[:, 1:] * up,
        )

    def outline(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points of the open ends' circles, and the radial and axial direction."""
        ends = []
        if not self.pieces[0].starts_on_axis():
            ends.append(self.pieces[0].curve(0.0))
        if not self.pieces[-1].ends_on_axis():
            ends.append(self.pieces[-1].curve(self.pieces[-1].length))
        if not ends:
            return points, np.zeros((len(points), 2, 3))
        radius = np.hypot(points[:, 0], points[:, 1])
        gaps = [np.hypot(radius - r, points[:, 2] - z) for r, z in ends]
        end = np.array(ends)[np.argmin(gaps, axis=0)]
        radial = np.zeros_like(points)
        radial[:, :2] = points[:, :2] / radius[:, None]
        up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        return end[:, :1] * radial + end[:, 1:] * up, np.stack([radial, up], axis=1)
