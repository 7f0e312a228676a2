# SPDX-License-Identifier: Apache-2.0
"""The geometrically nonlinear shell problems of Sze, Liu & Lo (2004), point by point.

Finite Elements in Analysis and Design 40:1551-1569. A displacement is scored against the larger of
1 % of it, 0.5 % of its final value and half a printed digit, and against 0.5 % at the last load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import discretise
from shell_deform.contact.loads import ContactPatch, line_load
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, forced, gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.supports import clamp, hold_slope, joined, symmetry
from shell_deform.supports.grips import grip
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import (
    GridSurface,
    fine_at_both,
    fine_at_end,
    fine_at_start,
    grid_surface,
)
from shell_deform.verification.linear_course import unheld
from shell_deform.verification.problem import (
    Verified,
    point_load,
    references,
    stopwatch,
    used_vertices,
)

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)
HALF_DIGIT = 5e-4


@dataclass(frozen=True)
class Curve:
    """Displacements (loads, columns) of one problem beside the published ones."""

    name: str
    columns: tuple[str, ...]
    fraction: Array
    ours: Array
    published: Array
    vertices: int
    cpu_seconds: float
    message: str

    def rows(
        self, skip: tuple[float, float] = (2.0, 2.0), unscored_column: str = ''
    ) -> Iterator[Verified]:
        """One row per column and load, except for load fractions inside `skip`.

        The column `unscored_column` has no goal where the path is past `skip`.
        """
        for k, column in enumerate(self.columns):
            final = abs(self.published[:, k]).max()
            for i, fraction in enumerate(self.fraction):
                if skip[0] <= fraction <= skip[1]:
                    continue
                reference = float(self.published[i, k])
                allowed = allowed_error(reference, final, i == len(self.fraction) - 1)
                unscored = column == unscored_column and fraction > skip[1]
                yield Verified(
                    self.name,
                    f'{column} at {fraction:g} of the largest load',
                    reference,
                    'Sze, Liu & Lo 2004',
                    float(self.ours[i, k]),
                    self.vertices,
                    self.cpu_seconds,
                    None if unscored else allowed / abs(reference) if reference else allowed,
                )


def allowed_error(reference: float, final: float, last: bool) -> float:
    """Largest error of a tabulated displacement, in its unit; `final`: largest of its column.

    1 % on the way, 0.5 % of the largest at the end, half a digit of the print in any case.
    """
    on_the_way = 0.0 if last else 0.01 * abs(reference)
    return max(on_the_way, 0.005 * final, HALF_DIGIT)


def cantilever_shear(cells: tuple[int, int] = (40, 4)) -> Curve:
    """Cantilever under an end shear force that keeps its direction."""
    data = references()['sze_cantilever_shear']
    with stopwatch() as watch:
        model, grid = _strip(data, cells)
        load = line_load(model.shell.mesh, grid.edge('s1'), Z * data['Pmax'])
        tip = point_load(model, int(grid.edge('s1')[cells[1] // 2]), Z)
        states, message = _ramp(model, (), load, np.array(data['data'])[:, 0])
        ours = np.array([_motion(model, s, tip) for s in states])
    return _curve(data, 'sze_cantilever_shear', ('-U_tip', 'W_tip'),
                  ours[:, [0, 2]] * [-1, 1], model, watch.seconds, message)  # fmt: skip


def cantilever_moment(cells: tuple[int, int] = (80, 4)) -> Curve:
    """Cantilever rolled to a full circle: the end turns by the angle that the moment demands.

    For this pure bending the moment is proportional to the end rotation (R = E I / M), so the
    rotation is prescribed and the tip motion scored at the moment it stands for.
    """
    data = references()['sze_cantilever_moment']
    with stopwatch() as watch:
        model, grid = _strip(data, cells)
        shell = model.shell
        end = grid.edge('s1')
        turn = hold_slope(shell, end, np.tile(X, (len(end), 1)), np.stack([X, Z]))
        root = clamp(shell, grid.edge('s0'), X)
        model = ShellModel(
            shell, supports=joined(root), grips=(grip('end', shell, [turn], np.zeros(3)),)
        )
        solver = EquilibriumSolver(model)
        tip = point_load(model, int(end[cells[1] // 2]), Z)
        state, ours, message = solver.rest(), [], ''
        steps = np.linspace(0.0, 1.0, 81)[1:]
        for fraction in steps:
            motion = np.concatenate([np.zeros(3), -2.0 * np.pi * fraction * Y])
            state = solver.solve(gripped(motion[None]), state)
            message = state.message
            if not state.converged:
                break
            if abs(fraction * 20 - round(fraction * 20)) < 1e-9:
                ours.append(_motion(model, state, tip))
    moved = np.array(ours)
    return _curve(data, 'sze_cantilever_moment', ('-U_tip', 'W_tip'),
                  moved[:, [0, 2]] * [-1, 1], model, watch.seconds, message)  # fmt: skip


def slit_annulus(cells: tuple[int, int] = (8, 64)) -> Curve:
    """Annular plate slit along a radius, one lip clamped, the other lifted."""
    data = references()['sze_slit_annulus']
    inner, outer = data['Ri'], data['Ro']

    def plate(s: Array, t: Array) -> Array:
        radius, angle = inner + (outer - inner) * s, 2.0 * np.pi * t
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * s], axis=1)

    with stopwatch() as watch:
        grid = grid_surface(plate, cells)
        shell = discretise(grid.mesh, Material(data['E'], data['nu']), data['h'])
        model = ShellModel(shell, supports=joined(clamp(shell, grid.edge('t0'), Y)))
        load = line_load(shell.mesh, grid.edge('t1'), Z * 0.8 * (outer - inner))
        probes = [point_load(model, grid.corner(s, 1), Z) for s in (0, 1)]
        fractions = np.array(data['data'])[:, 0]
        states, message = _ramp(model, (), load, fractions)
        ours = np.array([[_motion(model, s, p)[2] for p in probes] for s in states])
    return _curve(data, 'sze_slit_annulus', ('W_A', 'W_B'), ours, model, watch.seconds, message)


def hemisphere(cells: tuple[int, int] = (27, 19), loads: int | None = None) -> Curve:
    """Hemisphere with an 18 degree hole between alternating forces, by a quarter.

    `loads`: only so many of the tabulated loads, the smallest first.
    """
    data = references()['sze_hemisphere_18deg']
    radius, hole = data['R'], np.deg2rad(data['hole_deg'])

    def quarter(s: Array, t: Array) -> Array:
        around, down = 0.5 * np.pi * s, hole + (0.5 * np.pi - hole) * t
        flat = radius * np.sin(down)
        return np.stack(
            [flat * np.cos(around), flat * np.sin(around), radius * np.cos(down)], axis=1
        )

    with stopwatch() as watch:
        grid = grid_surface(quarter, cells, fine_at_both, fine_at_end)
        shell = discretise(grid.mesh, Material(data['E'], data['nu']), data['h'])
        supports = joined(
            [*symmetry(shell, grid.edge('s0'), Y), *symmetry(shell, grid.edge('s1'), X)]
        )
        model = ShellModel(shell, supports=supports)
        forces = (
            point_load(model, grid.corner(0, 1), X),
            point_load(model, grid.corner(1, 1), -Y),
        )
        largest = np.array([200.0, 200.0])
        states, message = _ramp(model, forces, largest, _fractions(data)[:loads])
        ours = np.array([s.displacement for s in states])
    return _curve(data, 'sze_hemisphere_18deg', ('U outward', '-V inward'), ours, model,
                  watch.seconds, message)  # fmt: skip


def pullout(cells: tuple[int, int] = (32, 24)) -> Curve:
    """Open cylinder pulled apart by two forces, by an octant, driven by the motion of A.

    B and C, away from the force, are scored. A lies under a point force: the published element is
    shear-flexible, so its A moves on by the shear dent of a point force, P / (2 pi k G h) times
    the logarithm of dent over element size. A Kirchhoff-Love wall has no such dent. On the
    stiffened branch A is therefore not scored. That the difference is a shear dent is
    tested: it is proportional to the load, `shear_dent` gives its size, B and C stay within 0.1
    and 0.3 %, and refinement leaves it: -1.50, -1.33, -1.21, -1.16 % at the largest load on
    24 x 18, 32 x 24, 48 x 36, 64 x 48 cells. Kratos' thin corotational quadrilaterals, a Kirchhoff
    element too, deviate to the same side: 1.058 and 1.085 of the largest load at the published A
    on 16 x 24 and 24 x 36.
    """
    data = references()['sze_pullout_cylinder']
    radius, length = data['R'], data['L']

    def octant(s: Array, t: Array) -> Array:
        angle = 0.5 * np.pi * s
        x, z = radius * np.sin(angle), radius * np.cos(angle)
        return np.stack([x, 0.5 * length * t, z], axis=1)

    with stopwatch() as watch:
        grid = grid_surface(octant, cells, fine_at_start, fine_at_start)
        shell = discretise(grid.mesh, Material(data['E'], data['nu']), data['h'])
        supports = joined(
            [
                *symmetry(shell, grid.edge('s0'), X),
                *symmetry(shell, grid.edge('s1'), Z),
                *symmetry(shell, grid.edge('t0'), Y),
            ]
        )
        model = ShellModel(shell, supports=supports)
        load = point_load(model, grid.corner(0, 0), Z)
        probes = [point_load(model, grid.corner(1, t), -X) for t in (0, 1)]
        solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0))
        state, path, message = solver.rest(), [], ''
        for depth in np.concatenate([np.linspace(0.05, 2.4, 36), np.linspace(2.42, 2.85, 44)]):
            state = solver.solve(_driven(load, depth), state)
            message = state.message
            if not state.converged:
                break
            moved = state.positions - model.rest
            path.append([state.force[0], depth, *(p.centre @ moved @ p.axis for p in probes)])
    ours = _at_loads(np.array(path), _fractions(data) * data['Pmax'] / 4.0)
    return _curve(data, 'sze_pullout_cylinder', ('W_A', '-U_B', '-U_C'), ours, model,
                  watch.seconds, message)  # fmt: skip


def shear_dent(load: Any, modulus: float, poisson: float, thickness: float) -> Any:
    """Shear deflection under a point force per e-fold of distance: P / (2 pi (5/6) G h)."""
    shear_modulus = 0.5 * modulus / (1.0 + poisson)
    return load / (2.0 * np.pi * 5.0 / 6.0 * shear_modulus * thickness)


def _strip(data: dict, cells: tuple[int, int]) -> tuple[ShellModel, GridSurface]:
    length, width = data['L'], data['b']

    def flat(s: Array, t: Array) -> Array:
        return np.stack([length * s, width * (t - 0.5), 0.0 * s], axis=1)

    grid = grid_surface(flat, cells)
    shell = discretise(grid.mesh, Material(data['E'], data['nu']), data['h'])
    return ShellModel(shell, supports=joined(clamp(shell, grid.edge('s0'), X))), grid


def _driven(load: ContactPatch, depth: float) -> LoadCase:
    return LoadCase((load,), np.array([np.nan]), np.array([depth]), held=False)


def _fractions(data: dict) -> Array:
    return np.array(data['data'])[:, 0]


def _ramp(
    model: ShellModel, contacts: tuple[ContactPatch, ...], load: Array, fractions: Array
) -> tuple[list[Equilibrium], str]:
    """States at fractions of a load: contact forces (k,), or nodal forces (n, 3) by themselves."""
    solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0, factorisations=14))
    state = solver.rest()
    found: list[Equilibrium] = []
    for fraction in fractions:
        if contacts:
            case = unheld(forced(contacts, fraction * load))
        else:
            case = LoadCase((), np.zeros(0), np.zeros(0), dead_load=fraction * load)
        state = solver.solve(case, state)
        if not state.converged:
            return found, state.message
        found.append(state)
    return found, ''


def _motion(model: ShellModel, state: Equilibrium, probe: ContactPatch) -> Array:
    return probe.centre @ (state.positions - model.rest)


def _at_loads(path: Array, loads: Array) -> Array:
    """Displacements at the wanted loads, on the last rising branch that reaches each."""
    result = np.full((len(loads), path.shape[1] - 1), np.nan)
    for i, load in enumerate(loads):
        above = np.flatnonzero((path[:-1, 0] < load) & (path[1:, 0] >= load))
        if len(above):
            k = above[-1]
            part = (load - path[k, 0]) / (path[k + 1, 0] - path[k, 0])
            result[i] = path[k, 1:] + part * (path[k + 1, 1:] - path[k, 1:])
    return result


def _curve(
    data: dict,
    name: str,
    columns: tuple[str, ...],
    ours: Array,
    model: ShellModel,
    seconds: float,
    message: str,
) -> Curve:
    published = np.array(data['data'])
    full = np.full((len(published), len(columns)), np.nan)
    if len(ours):
        full[: len(ours)] = ours
    return Curve(
        name, columns, published[:, 0], full, published[:, 1:], used_vertices(model), seconds,
        message,
    )  # fmt: skip


SMOOTH: tuple[Callable[[], Curve], ...] = (
    cantilever_shear,
    cantilever_moment,
    slit_annulus,
    hemisphere,
)
SNAP = (0.45, 0.55)


def problems() -> Iterator[Verified]:
    """Every tabulated load of every problem."""
    for solve in SMOOTH:
        yield from solve().rows()
    yield from pullout().rows(SNAP, unscored_column='W_A')
