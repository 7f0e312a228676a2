# SPDX-License-Identifier: Apache-2.0
"""Grips: parts of a surface that a rigid body holds and carries along, in any pose.

A clamp on an edge, a hand on the end of a tube, a glued patch. Every condition of a grip is linear
in the motion of the control points, and so is a rigid motion of all of them: moving the conditions
to where that motion takes them is exact for rotations of any size. The rows stay as they are.
Between two poses the turn follows the exponential map.

A grip may be free to shift along some axes, which it then does without force, or with the force
that is prescribed there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.supports.springs import SupportRows, joined

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Held vertices are in line where they spread less than this share sideways.
IN_LINE = 1e-3
# Turns whose axes differ by less, in radians, are about one axis.
SAME_AXIS = 1e-9
# In one step no grip turns further [rad].
LARGEST_TURN = np.pi / 6.0
# Grips whose motions differ by less, of a radian and of the object's size, move as one.
TOGETHER = 1e-12


class GripError(ValueError):
    """A grip that cannot hold, or a pose that it cannot take."""


@dataclass(frozen=True)
class Grip:
    """Part of a surface that moves as a rigid body.

    Attributes:
        name: what it is called in messages and results.
        rows: its conditions, what is free of them floating.
        origin: (3,) point about which it turns and its torque is told, moving along [m].
        free: (f, 3) world axes along which it may shift.
        patterns: (f, n, 3) nodal forces of a unit force [N] along each of them.
    """

    name: str
    rows: SupportRows
    origin: Array
    free: Array
    patterns: Array

    @property
    def nodes(self) -> Index:
        """Control points that it holds."""
        used = np.any(self.rows.coefficients != 0.0, axis=1)
        return np.unique(self.rows.nodes[used])

    def target(self, rest: Array, motion: Array) -> Array:
        """(k,) where its conditions are moved to by `motion` (6,): shift [m], turn [rad]."""
        return self.rows.motion(carried(rest, self.origin, motion) - rest)

    def affine_targets(self, rest: Array) -> Array:
        """(k, 12) `target` per number of `live.grip_motion.affine`: linear in them at any turn."""
        columns = []
        for axis in np.eye(3):
            for arm in (rest - self.origin).T:
                columns.append(self.rows.motion(arm[:, None] * axis))
        columns.extend(self.rows.motion(np.broadcast_to(axis, rest.shape)) for axis in np.eye(3))
        return np.stack(columns, axis=1)

    def shifted(self, rest: Array, positions: Array, motion: Array) -> Array:
        """(6,) `motion` with the shift along the free axes at control points (n, 3)."""
        if not len(self.free):
            return motion
        missing = self.rows.motion(positions - rest) - self.target(rest, motion)
        freely = np.stack([self._moved(axis) for axis in self.free], axis=1)
        weighted = self.rows.stiffness[:, None] * freely
        shift = np.linalg.solve(weighted.T @ freely, weighted.T @ missing)
        return np.concatenate([motion[:3] + shift @ self.free, motion[3:]])

    def wrench(self, reaction: Array, positions: Array, motion: Array) -> Array:
        """(6,) force [N] and torque [N m] about its moved origin, on the object.

        `reaction` (n, 3): nodal forces that the wall needs beside all other loads.
        """
        at = self.nodes
        arms = positions[at] - self.origin - motion[:3]
        return np.concatenate([reaction[at].sum(axis=0), np.cross(arms, reaction[at]).sum(axis=0)])

    def load(self, force: Array) -> Array:
        """(n, 3) nodal forces of a force (3,) [N] along the free axes.

        Raises GripError for a force where the grip is not free.
        """
        along = self.free @ force
        if np.linalg.norm(force - along @ self.free) > 1e-9 * np.linalg.norm(force):
            raise GripError(
                f'grip {self.name} is pushed with {np.round(force, 9).tolist()} N where its pose '
                'is prescribed; free it along that axis, or prescribe the pose there'
            )
        return np.einsum('f,fni->ni', along, self.patterns)

    def _moved(self, shift: Array) -> Array:
        """(k,) the rows of a shift (3,) of everything."""
        entries = np.concatenate([[0.0], np.cumsum(self.rows.coefficients @ shift)])
        return np.asarray(entries[self.rows.offsets[1:]] - entries[self.rows.offsets[:-1]])


def grip(
    name: str,
    shell: Discretisation,
    parts: Sequence[SupportRows],
    origin: Array,
    free: Array | None = None,
) -> Grip:
    """A grip of the conditions `parts` that turns about `origin` (3,) [m].

    `free` (f, 3): orthonormal world axes along which it may shift.
    """
    rows = joined(list(parts))
    if rows is None:
        raise GripError(f'grip {name} holds nothing')
    axes = np.zeros((0, 3)) if free is None else np.asarray(free, dtype=float).reshape(-1, 3)
    size = len(shell.mesh.vertices)
    bare = Grip(name, rows, np.asarray(origin, dtype=float), axes, np.zeros((0, size, 3)))
    if not len(axes):
        return bare
    freely = np.stack([bare._moved(axis) for axis in axes], axis=1)
    weighted = rows.stiffness[:, None] * freely
    values, vectors = np.linalg.eigh(weighted.T @ freely)
    if not values[0] > 1e-12 * values[-1]:
        raise GripError(f'grip {name} is free along an axis in which it holds nothing')
    inverse = vectors / values @ vectors.T
    floating = SupportRows(
        rows.offsets, rows.nodes, rows.coefficients, rows.stiffness,
        freely @ (vectors / np.sqrt(values)),
    )  # fmt: skip
    patterns = np.stack([rows.nodal(column, size) for column in (weighted @ inverse).T])
    return Grip(name, floating, bare.origin, axes, patterns)


def refuse_overlap(grips: Sequence[Grip], supports: SupportRows | None) -> None:
    """Raise GripError where two grips, or a grip and a support, hold the same control points."""
    taken: dict[int, str] = {}
    if supports is not None:
        held = supports.nodes[np.any(supports.coefficients != 0.0, axis=1)]
        taken = dict.fromkeys(held.tolist(), 'a support')
    for held_by in grips:
        for node in held_by.nodes.tolist():
            if node in taken:
                raise GripError(
                    f'grip {held_by.name} and {taken[node]} hold the same part of the surface: '
                    'move them apart, make them smaller, or take more control vertices'
                )
        taken.update(dict.fromkeys(held_by.nodes.tolist(), f'grip {held_by.name}'))


def refuse_few(name: str, points: Array, needed: str) -> None:
    """Raise GripError where held points (v, 3) [m] do not fix a pose; `needed`: the way out."""
    if len(points) >= 3:
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] > IN_LINE * spread[0]:
            return
    lies = f'{len(points)} {"vertex" if len(points) == 1 else "vertices"}'
    raise GripError(
        f'grip {name} holds {lies}{" in one line" if len(points) > 2 else ""}; a pose needs three '
        f'that are not in line: {needed}'
    )


def carried(points: Array, origin: Array, motion: Array) -> Array:
    """Points (p, 3) [m] after `motion` (6,): turned about `origin` (3,) [m], then shifted."""
    turned = Rotation.from_rotvec(motion[3:]).apply(points - origin)
    return np.asarray(turned + origin + motion[:3])


def between(first: Array, last: Array, fraction: float) -> Array:
    """(k, 6) the motions at this fraction of the way from `first` to `last`, both (k, 6).

    Shifts go along straight lines. Turns about one axis go on along it, however far; others the
    shortest way, by the exponential map.
    """
    result = first + fraction * (last - first)
    for k in np.flatnonzero(np.any(first[:, 3:] != 0.0, axis=1)):
        here, there = first[k, 3:], last[k, 3:]
        sizes = np.linalg.norm(here) * np.linalg.norm(there)
        if np.linalg.norm(np.cross(here, there)) <= SAME_AXIS * sizes:
            continue
        start = Rotation.from_rotvec(here)
        way = (Rotation.from_rotvec(there) * start.inv()).as_rotvec()
        result[k, 3:] = (Rotation.from_rotvec(fraction * way) * start).as_rotvec()
    return result


def longest_share(first: Array, last: Array, together: bool) -> float:
    """Share of the way between motions (g, 6) in which no grip turns by more than `LARGEST_TURN`.

    Where a whole turn leads is where it began: what was wound up on the way would be lost. Grips
    that move `together` wind up nothing, unless it is by whole turns that they do.
    """
    if together and len(first):
        wound = _whole_turns(last) - _whole_turns(first)
        if np.abs(wound - wound[0]).max() < np.pi:
            return 1.0
    turns = np.linalg.norm(last[:, 3:] - first[:, 3:], axis=1)
    return min(1.0, LARGEST_TURN / max(float(turns.max(initial=0.0)), LARGEST_TURN))


def _whole_turns(motions: Array) -> Array:
    """(g, 3) what the turns of `motions` (g, 6) have beyond the shortest ones that lead there."""
    shortest = Rotation.from_rotvec(motions[:, 3:]).as_rotvec()
    beyond = np.linalg.norm(motions[:, 3:], axis=1) > np.pi + SAME_AXIS
    return np.where(beyond[:, None], motions[:, 3:] - shortest, 0.0)


def poses_and_wrenches(
    grips: Sequence[Grip], rest: Array, positions: Array, reaction: Array, motions: Array
) -> tuple[Array, Array]:
    """(g, 6) where grips of these `motions` (g, 6) are, with what is free, and what they do.

    `rest`, `positions` (n, 3): control points [m]. `reaction` and the result as in `Grip.wrench`.
    """
    poses, wrenches = np.empty_like(motions), np.empty_like(motions)
    for k, held_by in enumerate(grips):
        poses[k] = held_by.shifted(rest, positions, motions[k])
        wrenches[k] = held_by.wrench(reaction, positions, poses[k])
    return poses, wrenches


def carried_as_one(
    grips: Sequence[Grip], start: Array, end: Array, positions: Array
) -> Array | None:
    """Control points (n, 3) carried along from `start` to `end`, both (g, 6), [m, rad].

    None where the grips do not move as one, or do not move. What is held turns and shifts with
    them then, as it is: an equilibrium stays one.
    """
    if not grips or np.array_equal(start, end):
        return None
    turns = Rotation.from_rotvec(end[:, 3:]) * Rotation.from_rotvec(start[:, 3:]).inv()
    origins = np.array([grip.origin for grip in grips])
    here, there = origins + start[:, :3], origins + end[:, :3]
    turn = turns[0]
    found = turn.apply(here - here[0]) + there[0]
    size = float(np.ptp(positions, axis=0).max())
    if (turns * turn.inv()).magnitude().max() > TOGETHER:
        return None
    if np.abs(found - there).max() > TOGETHER * size:
        return None
    return np.asarray(turn.apply(positions - here[0]) + there[0])


def line_of(grips: Sequence[Grip], moved: int, centre: Array) -> Array:
    """(3,) unit vector towards the grip `moved` from the others, or from `centre` (3,) [m]."""
    others = [grip.origin for k, grip in enumerate(grips) if k != moved]
    start = np.mean(others, axis=0) if others else centre
    line = grips[moved].origin - start
    length = float(np.linalg.norm(line))
    if not length > 0.0:
        raise GripError(
            f'grip {grips[moved].name} lies in the middle of what else is held: say about which '
            'axis it is to move'
        )
    return np.asarray(line / length)


def arc_motion(line: Array, across: Array, length: float, angle: float) -> Array:
    """(6,) motion of the end of a bar of `length` [m] along `line` that bends to a circular arc.

    `angle` [rad] about `across` (3,); the middle line keeps its length.
    """
    share = np.sinc(angle / np.pi)
    sideways = np.cross(across, line)
    half = 0.5 * angle
    rise = np.sin(half) * np.sinc(half / np.pi)
    return np.concatenate([length * ((share - 1.0) * line + rise * sideways), angle * across])


def turned_together(grips: Sequence[Grip], about: Array, turn: Array) -> Array:
    """(g, 6) motions of all grips by the rotation vector `turn` (3,) [rad] about a point (3,)."""
    origins = np.array([grip.origin for grip in grips])
    motion = np.concatenate([np.zeros(3), turn])
    shifts = carried(origins, about, motion) - origins
    return np.concatenate([shifts, np.tile(turn, (len(grips), 1))], axis=1)
