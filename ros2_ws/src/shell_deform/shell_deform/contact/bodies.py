# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies that touch a shell: how far points are from them, in any pose.

A shape lives in a frame of its own whose origin lies on its surface and whose z axis points out of
it there, at the object. A body is a shape with a pose, a direction in which it is pushed, and a
coefficient of friction. Every shape is convex, so that nearest points are unique outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.spatial
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Lengths below this share of a shape's size are none.
SMALL = 1e-12
# Faces whose normals differ by less count as one, in radians.
FLAT = 1e-6


class BodyError(ValueError):
    """A body that cannot be: the message says what is wrong with it."""


@dataclass(frozen=True)
class Distance:
    """Distance of p points from a body [m], its gradient and second derivative.

    Attributes:
        value: (p,), negative inside. normal: (p, 3) gradient: unit vectors away from the body.
        hessian: (p, 3, 3) second derivative [1/m].
    """

    value: Array
    normal: Array
    hessian: Array

    def turned(self, turn: Array) -> Distance:
        """The same seen from a frame in which the columns of `turn` (3, 3) are the axes."""
        return Distance(self.value, self.normal @ turn.T, turn @ self.hessian @ turn.T)


class Shape(Protocol):
    """A convex solid in its own frame."""

    @property
    def size(self) -> float:
        """What lies further than this from the origin is not touched [m]."""

    @property
    def front(self) -> float:
        """Nor is what lies further than this along z [m]."""

    def distance(self, points: Array) -> Distance:
        """Distance of points (p, 3) in the shape's frame."""


@dataclass(frozen=True)
class RoundBar:
    """A round bar about -z with a flat end at z = 0, or a cap of a sphere that ends there.

    Attributes:
        radius: of its rim [m]. curvature: of its face [1/m], 0 for a flat one.
    """

    radius: float
    curvature: float = 0.0

    @property
    def size(self) -> float:
        """Unbounded: a bar has no other end."""
        return float(np.inf)

    @property
    def front(self) -> float:
        """See `Shape`."""
        return 0.0

    def distance(self, points: Array) -> Distance:
        """Distance of points (p, 3); beside and behind the rim from the bar's side."""
        height = points[:, 2]
        reach = np.hypot(points[:, 0], points[:, 1])
        safe = np.maximum(reach, SMALL * self.radius)
        outward = points * [1.0, 1.0, 0.0] / safe[:, None]
        if self.curvature:
            ball = 1.0 / self.curvature
            from_centre = np.hypot(reach, height + ball)
            sine, slope = reach / from_centre, (height + ball) / from_centre
            face = (reach <= self.radius * self.curvature * from_centre) & (height > -ball)
            value, bend = from_centre - ball, 1.0 / from_centre
            rim_height = height + ball - np.sqrt(ball**2 - self.radius**2)
        else:
            face = reach <= self.radius
            value, slope, sine = height, np.ones_like(height), np.zeros_like(height)
            bend, rim_height = np.zeros_like(height), height
        beside = reach - self.radius
        edge = np.hypot(beside, np.maximum(rim_height, 0.0))
        small = np.maximum(edge, SMALL * self.radius)
        value = np.where(face, value, edge)
        sine = np.where(face, sine, beside / small)
        slope = np.where(face, slope, np.maximum(rim_height, 0.0) / small)
        bend = np.where(face, bend, np.where(rim_height > 0.0, 1.0 / small, 0.0))
        turn = np.where(reach > safe * (1.0 - 1e-9), sine / safe, bend)
        axis = np.array([0.0, 0.0, 1.0])
        along = slope[:, None] * outward - sine[:, None] * axis
        around = np.cross(outward, axis)
        hessian = np.einsum('p,pi,pj->pij', bend, along, along)
        hessian += np.einsum('p,pi,pj->pij', turn, around, around)
        return Distance(value, sine[:, None] * outward + slope[:, None] * axis, hessian)


@dataclass(frozen=True)
class RoundedHull:
    """The convex hull of corners, grown by a radius: rounded plates, fingertips, balls, rods.

    Attributes:
        corners: (c, 3) [m]. rounding: the radius [m].
    """

    corners: Array
    rounding: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.corners).all() and np.isfinite(self.rounding)):
            raise BodyError('a body has corners or a rounding that are not finite')
        if len(self.corners) < 4 and not self.rounding > 0.0:
            raise BodyError('a body without volume needs a rounding above 0')

    @property
    def size(self) -> float:
        """Distance of its furthest point from the origin [m]."""
        return float(np.linalg.norm(self.corners, axis=1).max()) + self.rounding

    @property
    def front(self) -> float:
        """See `Shape`."""
        return float(self.corners[:, 2].max()) + self.rounding

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array]:
        """Triangles (f, 3, 3), their outward normals (f, 3), edges (e, 2, 3) between faces."""
        corners = self.corners
        if len(corners) < 4:
            pairs = [(i, j) for i in range(len(corners)) for j in range(i)] or [(0, 0)]
            return np.zeros((0, 3, 3)), np.zeros((0, 3)), corners[np.array(pairs)]
        try:
            hull = scipy.spatial.ConvexHull(corners)
        except scipy.spatial.QhullError as error:
            raise BodyError('the corners of a body lie in one plane') from error
        normals = hull.equations[:, :3]
        edges = []
        for face, others in enumerate(hull.neighbors):
            for corner, other in enumerate(others):
                # Across the edge opposite to its corner lies each neighbour.
                if other > face and np.arccos(min(1.0, normals[face] @ normals[other])) > FLAT:
                    edges.append(np.delete(hull.simplices[face], corner))
        return corners[hull.simplices], normals, corners[np.array(edges)]

    def distance(self, points: Array) -> Distance:
        """Distance of points (p, 3); inside the hull to the nearest plane."""
        value, normal = np.full(len(points), np.inf), np.zeros_like(points)
        hessian = np.zeros((len(points), 3, 3))
        near = np.flatnonzero(np.linalg.norm(points, axis=1) < 2.0 * self.size)
        far = np.setdiff1d(np.arange(len(points)), near)
        # Too far to be touched: the bounding ball is near enough.
        away = np.linalg.norm(points[far], axis=1)
        value[far], normal[far] = away - self.size, points[far] / away[:, None]
        if len(near):
            value[near], normal[near], hessian[near] = self._near(points[near])
        return Distance(value - self.rounding, normal, hessian)

    def _near(self, points: Array) -> tuple[Array, Array, Array]:
        triangles, normals, edges = self._parts
        start = edges[:, 0]
        along = edges[:, 1] - start
        length = np.maximum(np.einsum('ei,ei->e', along, along), 1e-300)
        share = np.einsum('pei,ei->pe', points[:, None] - start, along) / length
        share = np.clip(share, 0.0, 1.0)
        away = points[:, None] - start - share[..., None] * along
        distance = np.linalg.norm(away, axis=2)
        edge = np.argmin(distance, axis=1)
        row = np.arange(len(points))
        value = np.maximum(distance[row, edge], SMALL * self.size)
        normal = away[row, edge] / value[:, None]
        hessian = (np.eye(3) - np.einsum('pi,pj->pij', normal, normal)) / value[:, None, None]
        inner = (share[row, edge] > 0.0) & (share[row, edge] < 1.0)
        unit = along[edge] / np.sqrt(length[edge])[:, None]
        straight = np.einsum('pi,pj->pij', unit, unit) / value[:, None, None]
        hessian -= np.where(inner[:, None, None], straight, 0.0)
        if len(triangles):
            height = points @ normals.T - np.einsum('fi,fi->f', normals, triangles[:, 0])
            plane = np.argmax(height, axis=1)
            inside = height[row, plane] <= 0.0
            above = _heights_over(points, triangles, height)
            face = np.where(inside, plane, np.argmax(above, axis=1))
            over = inside | (above[row, face] <= value * (1.0 + SMALL))
            over &= inside | np.isfinite(above[row, face])
            value = np.where(over, height[row, face], value)
            normal = np.where(over[:, None], normals[face], normal)
            hessian = np.where(over[:, None, None], 0.0, hessian)
        return value, normal, hessian


def _heights_over(points: Array, triangles: Array, height: Array) -> Array:
    """(p, f) heights over the faces, -inf where a point is beside one or under it."""
    inside = height > 0.0
    for a in range(3):
        corner, side = triangles[:, a], triangles[:, (a + 1) % 3] - triangles[:, a]
        third = triangles[:, (a + 2) % 3] - corner
        across = (
            third
            - (np.einsum('fi,fi->f', third, side) / np.einsum('fi,fi->f', side, side))[:, None]
            * side
        )
        level = points @ across.T - np.einsum('fi,fi->f', corner, across)
        inside &= level >= -1e-12 * np.einsum('fi,fi->f', across, across)
    return np.where(inside, height, -np.inf)


@dataclass(frozen=True)
class Body:
    """A rigid body before it moves.

    Attributes:
        shape: what it is. origin: (3,) where its frame lies: on the outer face at first touch [m].
        turn: (3, 3) columns: the axes of its frame; z points at the object.
        axis: (3,) unit direction in which it is pushed. friction: coefficient, 0 for none.
    """

    shape: Shape
    origin: Array
    turn: Array
    axis: Array
    friction: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.friction) and self.friction >= 0.0):
            raise BodyError(
                f'the coefficient of friction is {self.friction}; it must be 0 or more'
            )

    def posed(self, depth: float, motion: Array) -> Pose:
        """Where it is after `depth` [m] along its axis and `motion` (6,): shift [m], turn [rad].

        The turn is a rotation vector about the origin of its frame.
        """
        turn = Rotation.from_rotvec(motion[3:]).as_matrix() @ self.turn
        return Pose(self.origin + depth * self.axis + motion[:3], turn)


@dataclass(frozen=True)
class Pose:
    """A frame: its origin (3,) [m], its axes the columns of `turn` (3, 3)."""

    origin: Array
    turn: Array

    def inside(self, points: Array) -> Array:
        """World points (p, 3) seen from the frame."""
        return (points - self.origin) @ self.turn

    def outside(self, points: Array) -> Array:
        """Points (p, 3) of the frame in the world."""
        return points @ self.turn.T + self.origin

    def distance(self, shape: Shape, points: Array) -> Distance:
        """Distance of world points (p, 3) from a shape in this frame."""
        return shape.distance(self.inside(points)).turned(self.turn)

    def at_least(self, shape: Shape, points: Array) -> Array:
        """(p,) which no distance of world points (p, 3) from a shape here is below [m]."""
        inside = self.inside(points)
        ahead = inside[:, 2] - shape.front
        if not np.isfinite(shape.size):
            return np.asarray(ahead)
        return np.maximum(ahead, np.sqrt(np.einsum('pi,pi->p', inside, inside)) - shape.size)


def frame_of(normal: Array, along: Array | None = None) -> Array:
    """Axes (3, 3) with z along `normal` (3,), x as near to `along` (3,) as that allows."""
    z = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    wish = np.eye(3)[int(np.argmin(np.abs(z)))] if along is None else np.asarray(along, float)
    x = wish - (wish @ z) * z
    if np.linalg.norm(x) < 1e-6 * np.linalg.norm(wish):
        raise BodyError(f'a direction {wish.tolist()} along the normal turns a body nowhere')
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def ball(radius: float) -> RoundedHull:
    """A sphere that touches with its foremost point."""
    return RoundedHull(np.array([[0.0, 0.0, -radius]]), radius)


def rod(radius: float, length: float) -> RoundedHull:
    """A cylinder with round ends that lies along x, `length` [m] between the ends' centres."""
    half = 0.5 * length
    return RoundedHull(np.array([[-half, 0.0, -radius], [half, 0.0, -radius]]), radius)


def plate(width: float, length: float, rounding: float) -> RoundedHull:
    """A flat plate of `width` (y) and `length` (x) [m] with edges rounded by `rounding` [m]."""
    x, y = 0.5 * length - rounding, 0.5 * width - rounding
    if not min(x, y, rounding) > 0.0:
        raise BodyError(
            f'a plate of {width} m by {length} m cannot have edges rounded by {rounding} m'
        )
    deep = max(width, length)
    corners = [[sx * x, sy * y, z] for sx in (-1, 1) for sy in (-1, 1) for z in (-rounding, -deep)]
    return RoundedHull(np.array(corners), rounding)
