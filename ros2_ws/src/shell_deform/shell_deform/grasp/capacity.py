# SPDX-License-Identifier: Apache-2.0
"""The largest load that the contacts can carry with the pushes they have: limit analysis.

Each contact may press with any share of its present push and carry what friction allows of it; the
capacity is the largest load for which some such forces balance. It is an upper bound: fingers that
stand still share a load out by stiffness, and the first of them slips before (`slip`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from shell_deform.grasp.cone import ConeError, solve_cone
from shell_deform.grasp.contacts import (
    FORCES,
    GraspContacts,
    GraspError,
    contact_wrenches,
    size_of,
)

Array = NDArray[np.float64]

GRAVITY = 9.80665

DIRECTIONS = np.array(
    [np.array(d) / np.linalg.norm(d) for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)]
)
"""(26, 3) unit vectors to the faces, edges and corners of a cube."""

LEAST_CARRIED = 1e-9
"""Of the largest push: a load less than this is round-off."""

LEAST_FRICTION = 1e-6
"""Less friction than this counts as none."""

MOST_PLANES = 60
OUTSIDE = 1e-9
"""Forces that stick out of their cone by less than this share of the largest push are inside."""

SEEDS = 48
DESCENTS = 12


@dataclass(frozen=True)
class Capacity:
    """The largest factor of one load.

    Attributes:
        factor: largest multiple of the load that is carried [-].
        force: (k, 4) push, two tangential forces and spin force then [N].
        bound: (6,) the virtual motion that proves it: no forces do more work on it.
    """

    factor: float
    force: Array
    bound: Array


@dataclass(frozen=True)
class Proofs:
    """Of the capacities for d loads: virtual motions (d, 6) and pushes (d, k) [N] then."""

    bounds: Array
    pushes: Array


def load_capacity(
    grasp: GraspContacts, wrench: Array, origin: Array, basis: Array | None = None
) -> Capacity:
    """How much of `wrench` (6,) on the object, force [N] and moment about `origin` [N m].

    `basis`: `contact_wrenches` about `origin` at 1 m, where it is at hand. Raises GraspError for
    a wrench that is zero or not finite.
    """
    wrench = np.asarray(wrench, float)
    if wrench.shape != (6,) or not np.all(np.isfinite(wrench)) or not np.any(wrench):
        raise GraspError(f'the load {wrench.tolist()} must be six finite numbers, not all zero')
    chosen = grasp.pressing
    force = np.zeros((grasp.count, FORCES))
    if not np.any(chosen):
        return Capacity(0.0, force, np.zeros(6))
    part = grasp.chosen(chosen)
    size, largest = size_of(part), float(part.push.max())
    scaled = np.concatenate([wrench[:3], wrench[3:] / size])
    length = float(np.linalg.norm(scaled))
    if basis is None:
        basis = contact_wrenches(grasp, origin, 1.0)
    basis = basis[:, chosen] / np.array([1.0, 1.0, 1.0, size, size, size])[:, None, None]
    factor, found, bound = _largest(basis, part, scaled / length, part.push / largest)
    factor = factor if factor > LEAST_CARRIED else 0.0
    force[chosen] = found * largest
    bound = np.concatenate([bound[:3], bound[3:] / size]) / length
    return Capacity(factor * largest / length, force, bound)


def force_capacities(
    grasp: GraspContacts, directions: Array, origin: Array
) -> tuple[Array, Proofs]:
    """(d,) largest force [N] through `origin` along each direction (d, 3), and the proofs."""
    basis = contact_wrenches(grasp, origin, 1.0)
    found = [load_capacity(grasp, load, origin, basis) for load in forces(directions)]
    proofs = Proofs(
        np.array([one.bound for one in found]), np.array([one.force[:, 0] for one in found])
    )
    return np.array([one.factor for one in found]), proofs


def forces(directions: Array) -> Array:
    """(d, 6) unit wrenches along directions (d, 3)."""
    return np.concatenate([directions, np.zeros_like(directions)], axis=1)


def liftable_mass(grasp: GraspContacts, down: Array, origin: Array) -> float:
    """Mass [kg] at `origin` that the present squeeze can carry; `down` (3,) unit vector."""
    weight = np.concatenate([np.asarray(down, float), np.zeros(3)])
    return load_capacity(grasp, weight, origin).factor / GRAVITY


def bounds_of(grasp: GraspContacts, bounds: Array, wrenches: Array, basis: Array) -> Array:
    """(d,) capacities for `wrenches` (d, 6) that virtual motions `bounds` (d, 6) allow at most.

    `basis`: `contact_wrenches` at 1 m.

    A motion that was the proof for nearly the same contacts gives nearly the same capacity: the
    difference is of second order. Infinite where a motion says nothing of its load.
    """
    work, along, across = _works(grasp, bounds, wrenches, basis)
    most = np.maximum(along + grasp.friction * across, 0.0) @ np.maximum(grasp.push, 0.0)
    return np.where(work > 0.0, most / np.where(work > 0.0, work, 1.0), np.inf)


def bounds_sigma(
    grasp: GraspContacts,
    found: Proofs,
    wrenches: Array,
    basis: Array,
    push_sigma: Array,
    friction_sigma: float,
) -> Array:
    """(d,) sigma of capacities with their proofs, `wrenches` and `basis` as in `bounds_of`.

    From pushes (k,) [N] and a friction [-] that all contacts have in common: to first order the
    motion stays the proof, and each contact gains what its own push gains by friction. Zero where
    a motion says nothing of its load.
    """
    work, along, across = _works(grasp, found.bounds, wrenches, basis)
    by_push = np.maximum(along + grasp.friction * across, 0.0)
    by_friction = np.einsum('dk,dk->d', across, found.pushes)
    sigma = np.hypot(friction_sigma * by_friction, np.sqrt(by_push**2 @ push_sigma**2))
    return np.where(work > 0.0, sigma / np.where(work > 0.0, work, 1.0), 0.0)


def _works(
    grasp: GraspContacts, bounds: Array, wrenches: Array, basis: Array
) -> tuple[Array, Array, Array]:
    """What motions (d, 6) do: (d,) against the loads, (d, k) along and across unit forces."""
    work = -np.einsum('da,da->d', wrenches, bounds)
    by_contact = (bounds @ basis.reshape(6, -1)).reshape(len(bounds), -1, FORCES)
    across = np.sqrt(np.einsum('dkf,dkf->dk', by_contact[:, :, 1:], by_contact[:, :, 1:]))
    return work, by_contact[:, :, 0], across


def epsilon(
    grasp: GraspContacts, origin: Array, length: float, seed: Array | None = None
) -> tuple[float, Array]:
    """Ferrari and Canny's quality: the largest ball of wrenches carried in every direction [N].

    Moments count as forces at `length` [m]; every contact presses at most with its present push
    (their L-infinity measure, ICRA 1992). Returns it and the unit direction (6,) that is weakest.
    Found by descent from many directions, or from `seed` (6,) alone: each step asks for the
    capacity along a direction, whose proof is the next, weaker one.
    """
    chosen = grasp.pressing
    part = grasp.chosen(chosen)
    nothing = 0.0, np.eye(6)[0]
    if part.count < 2 or not length > 0.0:
        return nothing
    largest = float(part.push.max())
    part = replace(part, push=part.push / largest)
    basis = contact_wrenches(part, origin, length)
    flat = basis.reshape(6, -1) * np.tile(
        np.stack([np.ones(part.count)] + 3 * [part.friction], axis=1).ravel(), (6, 1)
    )
    left, values, _ = np.linalg.svd(flat)
    if values[-1] < 1e-9 * values[0]:
        return 0.0, left[:, -1]
    starts = np.concatenate([left.T, -left.T, _spread(SEEDS)]) if seed is None else seed[None]
    heights = np.array([_support(basis, part, z) for z in starts])
    best, weakest = np.inf, starts[0]
    for start in starts[np.argsort(heights)][: SEEDS // 2]:
        z, value = start, np.inf
        for _ in range(DESCENTS):
            factor, _, bound = _largest(basis, part, -z, part.push)
            norm = float(np.linalg.norm(bound))
            value = min(value, factor)
            if not norm > 0.0 or factor <= 0.0:
                break
            lower = float(_support(basis, part, bound / norm))
            if not lower < value * (1.0 - 1e-10):
                break
            z, value = bound / norm, lower
        if value < best:
            best, weakest = value, z
    return max(best, 0.0) * largest, weakest


def _largest(
    basis: Array, grasp: GraspContacts, wrench: Array, push: Array
) -> tuple[float, Array, Array]:
    """Largest factor of `wrench` (6,), the forces (k, 4) and the motion (6,) that proves it."""
    if grasp.friction.max() < LEAST_FRICTION:
        return _largest_by_pushes(basis, wrench, push)
    count = grasp.count
    friction = np.maximum(grasp.friction, LEAST_FRICTION)
    matrix = np.zeros((6 + count, 5 * count + 1))
    matrix[:6, : FORCES * count] = basis.reshape(6, -1)
    matrix[:6, : FORCES * count : FORCES] /= friction
    rows = np.arange(count)
    matrix[6 + rows, FORCES * rows] = 1.0 / friction
    matrix[6 + rows, FORCES * count + rows] = 1.0
    matrix[:6, -1] = wrench
    cost = np.zeros(5 * count + 1)
    cost[-1] = -1.0
    right = np.concatenate([np.zeros(6), push])
    try:
        x, y = solve_cone(cost, matrix, right, count)
    except ConeError:
        x, y = _by_planes(cost, matrix, right, count)
    force = x[: FORCES * count].reshape(count, FORCES).copy()
    force[:, 0] /= friction
    return max(0.0, float(x[5 * count])), force, y[:6]


def _by_planes(cost: Array, matrix: Array, right: Array, count: int) -> tuple[Array, Array]:
    """The programme where hardly any forces inside the cones balance: by planes that touch them.

    A linear programme whose cones are cut by one more plane at each solution outside: slower, and
    needs no forces strictly inside.
    """
    size = len(cost)
    planes = np.zeros((6 * count, size))
    for i in range(count):
        for j in range(3):
            planes[6 * i + 2 * j, [FORCES * i, FORCES * i + 1 + j]] = -1.0, 1.0
            planes[6 * i + 2 * j + 1, [FORCES * i, FORCES * i + 1 + j]] = -1.0, -1.0
    free = [(None, None)] * (FORCES * count) + [(0.0, None)] * (size - FORCES * count)
    for _ in range(MOST_PLANES):
        found = linprog(
            cost, A_ub=planes, b_ub=np.zeros(len(planes)), A_eq=matrix, b_eq=right, bounds=free
        )
        if not found.success:
            raise ConeError(f'the programme of {count} contacts did not converge: {found.message}')
        vectors = found.x[: FORCES * count].reshape(count, FORCES)
        across = np.linalg.norm(vectors[:, 1:], axis=1)
        outside = np.flatnonzero(across > vectors[:, 0] + OUTSIDE)
        if not len(outside):
            break
        more = np.zeros((len(outside), size))
        for row, i in zip(more, outside.tolist(), strict=True):
            row[FORCES * i] = -1.0
            row[FORCES * i + 1 : FORCES * i + FORCES] = vectors[i, 1:] / across[i]
        planes = np.concatenate([planes, more])
    return found.x, np.asarray(found.eqlin.marginals)


def _largest_by_pushes(basis: Array, wrench: Array, push: Array) -> tuple[float, Array, Array]:
    """`_largest` without friction: a linear programme of the pushes."""
    count = len(push)
    matrix = np.concatenate([basis[:, :, 0], wrench[:, None]], axis=1)
    cost = np.append(np.zeros(count), -1.0)
    limits = [(0.0, float(one)) for one in push] + [(0.0, None)]
    found = linprog(cost, A_eq=matrix, b_eq=np.zeros(6), bounds=limits)
    if not found.success:
        raise ConeError(f'the programme of {count} pushes did not converge: {found.message}')
    force = np.zeros((count, FORCES))
    force[:, 0] = found.x[:-1]
    return max(0.0, float(found.x[-1])), force, np.asarray(found.eqlin.marginals)


def _support(basis: Array, grasp: GraspContacts, motion: Array) -> float:
    """Most work that the contacts' forces can do on a virtual motion (6,)."""
    work = np.einsum('a,akf->kf', motion, basis)
    across = np.linalg.norm(work[:, 1:], axis=1)
    return float(grasp.push @ np.maximum(work[:, 0] + grasp.friction * across, 0.0))


def _spread(count: int) -> Array:
    """(count, 6) unit vectors, always the same, spread over all directions."""
    points = np.random.default_rng(0).normal(size=(count, 6))
    return points / np.linalg.norm(points, axis=1)[:, None]
