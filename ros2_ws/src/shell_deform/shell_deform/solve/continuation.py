# SPDX-License-Identifier: Apache-2.0
"""Arc length: equilibrium paths through limit points in load and in displacement.

Every step prescribes the motion along the path's own last direction and leaves the load factor
unknown, so neither a maximum of the load (snap-through) nor one of the contact displacement
(snap-back) stops it. E. Riks, Int. J. Solids Struct. 15:529 (1979).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.solve.borders import Borders, borders
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, forced
from shell_deform.solve.newton_step import StepSolver
from shell_deform.solve.prediction import StepLoads

Array = NDArray[np.float64]

FIRST_SHARE = 0.02
"""The first step where load steps ended: this share of what the tangent there asks for."""

SHORTEST, LONGEST_FIRST, LONGEST = 2e-4, 0.2, 1.0
"""Steps there, root-mean-square in wall thicknesses."""

MOST_POINTS = 120
"""After so many the path of a shell that has snapped is given up."""


@dataclass(frozen=True)
class PathPoint:
    """A state on an equilibrium path: `factor` times the reference loads are carried."""

    factor: float
    state: Equilibrium


@dataclass(frozen=True)
class Path:
    """The points found, and why the search ended before its goal (empty if it did not)."""

    points: tuple[PathPoint, ...]
    message: str


@dataclass(frozen=True)
class ArcLengthOptions:
    """Steps [m] of root-mean-square control displacement, and when to stop."""

    first_step: float
    largest_step: float
    smallest_step: float
    points: int = 200
    wanted_iterations: int = 5


@dataclass(frozen=True)
class Ray:
    """Loads [N] on a line: `dead` + factor `load` (N,), pushes `force` + factor `more` (k,)."""

    dead: Array
    load: Array
    force: Array
    more: Array


def follow_path(
    solver: StepSolver,
    case: LoadCase,
    options: ArcLengthOptions,
    until: float = 1.0,
    start: Equilibrium | None = None,
) -> Path:
    """Follow the path of `case`, whose loads are all scaled by one factor, up to `until`.

    Every contact of `case` must be forced; its forces and dead load belong to factor 1. The search
    ends when the factor passes `until` for good, after `options.points` points, or when a step
    below `options.smallest_step` does not converge.
    """
    case.refuse_pads('arc length')
    solver.take(solver.model.on_contacts(case.contacts))
    bordering = borders(solver.model, forced(case.contacts, case.force))
    if case.dead_load is not None:
        dead = bordering.dead.copy()
        dead[: case.dead_load.size] += case.dead_load.reshape(-1)
        bordering = replace(bordering, dead=dead)
    load = bordering.push @ case.force + bordering.dead
    ray = Ray(np.zeros_like(load), load, np.zeros_like(case.force), case.force)
    state = solver.met(start or solver.rest())
    return _follow(solver, bordering, ray, options, state, until)


def carried_on(
    solver: StepSolver, bordering: Borders, present: Equilibrium, goal: StepLoads
) -> tuple[Equilibrium, float, bool]:
    """Where load steps from `present` towards `goal` end, by arc length: every contact is forced.

    Returns the state, the share of the way it carries (1 under `goal`), and whether the load had
    to fall on the way: then the shell snaps. Where nothing carries `goal`, the state is the last
    one before the fall. One behind a snap is the next on the path; a jump under dead load may
    land on another.
    """
    dead = np.zeros_like(goal.dead)
    dead[: len(present.dead_load)] = present.dead_load
    base = bordering.push @ present.force + dead
    ray = Ray(
        base,
        bordering.push @ goal.force + goal.dead - base,
        present.force,
        goal.force - present.force,
    )
    wall = float(solver.model.shell.thickness.max())
    tangent = solver.respond(present, bordering, ray.load[:, None])[:, 0]
    whole = float(np.linalg.norm(tangent)) / np.sqrt(len(solver.model.start))
    first = float(np.clip(FIRST_SHARE * whole, SHORTEST * wall, LONGEST_FIRST * wall))
    options = ArcLengthOptions(first, LONGEST * wall, SHORTEST * wall, MOST_POINTS)
    path = _follow(solver, bordering, ray, options, present, 1.0)
    states = [present, *(point.state for point in path.points)]
    factors = np.array([0.0, *(point.factor for point in path.points)])
    falls = np.flatnonzero(np.diff(factors) < 0.0)
    snaps = len(falls) > 0
    if factors[-1] >= 1.0:
        found = solver.step(bordering, goal, states[-1])
        if found.converged:
            return found, 1.0, snaps
    last = int(falls[0] if snaps else np.argmax(factors * (factors < 1.0)))
    return states[last], float(factors[last]), snaps


def _follow(
    solver: StepSolver,
    bordering: Borders,
    ray: Ray,
    options: ArcLengthOptions,
    state: Equilibrium,
    until: float,
) -> Path:
    """Points on the path of `ray` from `state`, where its factor is 0."""
    model, load = solver.model, ray.load
    count = len(model.start)
    step = options.first_step
    direction = _unit(solver.respond(state, bordering, load[:, None])[:, 0], count)
    points: list[PathPoint] = []
    message = ''
    while len(points) < options.points:
        driven = _along(bordering, load, direction / count)
        position = float(driven.measure[:, 0] @ (state.unknowns - model.start).reshape(-1))
        guess = state.unknowns + step * direction.reshape(-1, 3)
        found = solver.step(
            driven,
            StepLoads(
                np.zeros(1),
                np.array([position + step]),
                ray.dead,
                np.zeros((1, 6)),
                state.grip_motion,
            ),
            replace(state, multipliers=np.zeros(driven.held.shape[1])),
            guess,
        )
        if not found.converged:
            step *= 0.5
            if step < options.smallest_step:
                factor = points[-1].factor if points else 0.0
                message = f'{found.message} at load factor {factor:.4g}'
                break
            continue
        direction = _unit((found.unknowns - state.unknowns).reshape(-1), count)
        factor = float(found.force[0])
        state = replace(
            found,
            force=ray.force + factor * ray.more,
            displacement=bordering.measure.T @ (found.unknowns - model.start).reshape(-1),
        )
        points.append(PathPoint(factor, state))
        if factor >= until:
            break
        growth = np.sqrt(options.wanted_iterations / max(1, found.iterations))
        step = float(np.clip(step * np.clip(growth, 0.5, 1.5), 0.0, options.largest_step))
    return Path(tuple(points), message)


def _along(bordering: Borders, load: Array, measure: Array) -> Borders:
    """Borders with the load factor as the one unknown push, measured along the path."""
    return Borders(
        push=load[:, None],
        measure=measure[:, None],
        held=bordering.held,
        dead=np.zeros_like(load),
        driven=np.array([True]),
        loose=bordering.loose,
    )


def _unit(direction: Array, count: int) -> Array:
    """Scaled to a root-mean-square displacement of one per row of unknowns."""
    return direction * np.sqrt(count) / float(np.linalg.norm(direction))
