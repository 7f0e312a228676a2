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
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.prediction import StepLoads

Array = NDArray[np.float64]


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


def follow_path(
    solver: EquilibriumSolver,
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
    model = solver.model
    edge = borders(model, forced(case.contacts, case.force))
    if case.dead_load is not None:
        edge = replace(edge, dead=edge.dead + case.dead_load.reshape(-1))
    load = edge.push @ case.force + edge.dead
    count = len(model.rest)
    state = start or solver.rest()
    factor, step = 0.0, options.first_step
    direction = _unit(solver.respond(state, edge, load[:, None])[:, 0], count)
    points: list[PathPoint] = []
    message = ''
    while len(points) < options.points:
        driven = _along(edge, load, direction / count)
        position = float(driven.measure[:, 0] @ (state.positions - model.rest).reshape(-1))
        guess = state.positions + step * direction.reshape(-1, 3)
        found = solver.step(
            driven,
            StepLoads(np.zeros(1), np.array([position + step]), np.zeros_like(load)),
            replace(state, multipliers=np.zeros(driven.held.shape[1])),
            guess,
        )
        if not found.converged:
            step *= 0.5
            if step < options.smallest_step:
                message = f'{found.message} at load factor {factor:.4g}'
                break
            continue
        moved = (found.positions - state.positions).reshape(-1)
        direction = _unit(moved, count)
        factor = float(found.force[0])
        state = replace(
            found,
            force=factor * case.force,
            displacement=edge.measure.T @ (found.positions - model.rest).reshape(-1),
        )
        points.append(PathPoint(factor, state))
        if factor >= until:
            break
        growth = np.sqrt(options.wanted_iterations / max(1, found.iterations))
        step = float(np.clip(step * np.clip(growth, 0.5, 1.5), 0.0, options.largest_step))
    return Path(tuple(points), message)


def _along(edge: Borders, load: Array, measure: Array) -> Borders:
    """Borders with the load factor as the one unknown push, measured along the path."""
    return Borders(
        push=load[:, None],
        measure=measure[:, None],
        held=edge.held,
        dead=np.zeros_like(load),
        driven=np.array([True]),
        loose=edge.loose,
    )


def _unit(direction: Array, count: int) -> Array:
    """Scaled to a root-mean-square displacement of one per control point."""
    return direction * np.sqrt(count) / float(np.linalg.norm(direction))
