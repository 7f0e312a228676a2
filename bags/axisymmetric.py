# SPDX-License-Identifier: Apache-2.0
"""An axisymmetric rubber ball between two pins, as a solid: mesh, deck and sealed gas.

The upper half of a hollow sphere in CAX8R elements; x is the distance from the axis, y the axis.
Lengths in mm, forces in N, pressures in MPa inside the decks (the usual consistent set).

Two pins, both on the outer face over the rest arc <= the pin radius: `traction`, a uniform dead
traction along the axis, as the shell theory has it; and `rigid`, a flat pin end that moves along
the axis and lets the rubber slide under it. At a radius of 1 mm the traction is more than half
of the modulus and the surface of a real solid folds under it, so the recordings use `rigid`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bags import calculix
from bags.calculix import Array

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)
AMBIENT_MPA = 0.101325


@dataclass(frozen=True)
class Ball:
    """A hollow rubber ball (mm, MPa) and how finely it is meshed.

    `corner`: smallest elements, at the rim of the pin, from where they grow both ways; 0 for even
    ones under the pin. `mooney_share`: of the second invariant's term in the shear modulus.
    """

    outer_radius: float = 32.5
    thickness: float = 2.5
    young_modulus: float = 1.0
    poisson_ratio: float = 0.49
    pin_radius: float = 1.0
    pin: str = 'rigid'
    across: tuple[float, ...] = (0.0, 0.28, 0.5, 0.68, 0.82, 0.92, 1.0)
    pin_elements: int = 6
    growth: float = 1.12
    coarsest: float = 1.2
    corner: float = 0.0
    mooney_share: float = 0.0


def ball_of(told: dict[str, Any]) -> Ball:
    """The ball made of the rubber that a kept solid tells of."""
    return Ball(young_modulus=1e-6 * told['young_modulus_pa'], poisson_ratio=told['poisson_ratio'])


@dataclass(frozen=True)
class Mesh:
    """Quadratic quadrilaterals over (angle from the pole, depth); node numbers start at 1."""

    positions: Array
    elements: np.ndarray
    outer: np.ndarray
    middle: np.ndarray
    inner: np.ndarray
    axis: np.ndarray
    equator: np.ndarray
    pin_edges: int
    grid: np.ndarray = field(repr=False)


def polar_breaks(ball: Ball) -> Array:
    """Element edges in angle from the pole: even under the pin, or graded towards its rim, then
    growing to `coarsest`.
    """
    if ball.corner:
        beyond = ball.outer_radius * np.pi / 2 - ball.pin_radius
        under = graded(ball.pin_radius, ball.corner, ball.growth, ball.coarsest)[::-1]
        outside = graded(beyond, ball.corner, ball.growth, ball.coarsest)
        lengths = np.concatenate([[0.0], under, outside])
        return np.asarray(np.cumsum(lengths)) / ball.outer_radius
    size = ball.pin_radius / ball.pin_elements
    edges = [size * index for index in range(ball.pin_elements + 1)]
    end = ball.outer_radius * np.pi / 2
    rest: list[float] = []
    step = size
    while sum(rest) < end - edges[-1]:
        step = min(step * ball.growth, ball.coarsest)
        rest.append(step)
    scale = (end - edges[-1]) / sum(rest)
    return np.concatenate([edges, edges[-1] + scale * np.cumsum(rest)]) / ball.outer_radius


def graded(total: float, smallest: float, growth: float, coarsest: float) -> Array:
    """Lengths from about `smallest` on, each `growth` times the one before up to `coarsest`."""
    lengths = [smallest]
    while sum(lengths) < total:
        lengths.append(min(lengths[-1] * growth, coarsest))
    return np.array(lengths) * (total / sum(lengths))


def build_mesh(ball: Ball) -> Mesh:
    """Mesh of the upper half; the middle of the wall is a row of nodes."""
    edges = polar_breaks(ball)
    angles = _with_midpoints(edges)
    inner_radius = ball.outer_radius - ball.thickness
    radii = inner_radius + ball.thickness * _with_midpoints(np.array(ball.across))
    columns, rows = len(angles), len(radii)
    grid = np.zeros((columns, rows), dtype=np.int64)
    positions = []
    for column in range(columns):
        for row in range(rows):
            if column % 2 and row % 2:
                continue
            positions.append(
                [radii[row] * np.sin(angles[column]), radii[row] * np.cos(angles[column])]
            )
            grid[column, row] = len(positions)
    elements = []
    for column in range(0, columns - 2, 2):
        for row in range(0, rows - 2, 2):
            block = grid[column : column + 3, row : row + 3]
            # Counter-clockwise in (x, y): outwards along the radius, then back to the pole.
            elements.append(
                [
                    block[2, 0], block[2, 2], block[0, 2], block[0, 0],
                    block[2, 1], block[1, 2], block[0, 1], block[1, 0],
                ]
            )  # fmt: skip
    middle_row = int(np.argmin(abs(radii - (inner_radius + ball.thickness / 2))))
    if abs(radii[middle_row] - inner_radius - ball.thickness / 2) > 1e-9 or middle_row % 2:
        raise ValueError('the middle of the wall must be an element edge')
    return Mesh(
        np.array(positions),
        np.array(elements),
        grid[:, -1],
        grid[:, middle_row],
        grid[:, 0],
        grid[0][grid[0] > 0],
        grid[-1][grid[-1] > 0],
        int(np.searchsorted(edges, (1.0 - 1e-9) * ball.pin_radius / ball.outer_radius)),
        grid,
    )


def _with_midpoints(edges: Array) -> Array:
    values = np.empty(2 * len(edges) - 1)
    values[::2] = edges
    values[1::2] = (edges[1:] + edges[:-1]) / 2
    return values


def _edge_shapes(points: Array) -> tuple[Array, Array]:
    """Values and derivatives of the three quadratic edge functions at local points in [-1, 1]."""
    values = np.stack([points * (points - 1) / 2, 1 - points**2, points * (points + 1) / 2])
    slopes = np.stack([points - 0.5, -2 * points, points + 0.5])
    return values, slopes


def pin_weights(mesh: Mesh) -> dict[int, float]:
    """Share of the pin force carried by each node of the outer face (sum 1)."""
    values, slopes = _edge_shapes(GAUSS_POINTS)
    shares: dict[int, float] = {}
    for edge in range(mesh.pin_edges):
        nodes = mesh.outer[2 * edge : 2 * edge + 3]
        corners = mesh.positions[nodes - 1]
        radius = corners[:, 0] @ values
        arc = np.hypot(*(corners.T @ slopes))
        for node, share in zip(nodes, values @ (GAUSS_WEIGHTS * radius * arc), strict=True):
            shares[int(node)] = shares.get(int(node), 0.0) + float(share)
    total = sum(shares.values())
    return {node: share / total for node, share in shares.items()}


def inside_volume(mesh: Mesh, positions: Array) -> float:
    """Volume inside the inner face of the whole ball (both halves), mm^3."""
    values, slopes = _edge_shapes(GAUSS_POINTS)
    volume = 0.0
    for edge in range((len(mesh.inner) - 1) // 2):
        corners = positions[mesh.inner[2 * edge : 2 * edge + 3] - 1]
        radius = corners[:, 0] @ values
        height_slope = corners[:, 1] @ slopes
        volume -= np.pi * float(GAUSS_WEIGHTS @ (radius**2 * height_slope))
    return 2 * volume


def deck(ball: Ball, mesh: Mesh, forces: Array, pressures: Array) -> str:
    """The CalculiX input: one static nonlinear step per (pin force, gas gauge pressure)."""
    middle_elements = len(ball.across) - 1
    inner_elements = range(1, len(mesh.elements) + 1, middle_elements)
    parts = [
        '*HEADING',
        f'hollow ball, outer radius {ball.outer_radius} mm, wall {ball.thickness} mm, '
        f'pin radius {ball.pin_radius} mm; mm, N, MPa',
        '*NODE,NSET=ALL',
        calculix.node_lines(
            {number: (x, y, 0.0) for number, (x, y) in enumerate(mesh.positions.tolist(), 1)}
        ),
        '*ELEMENT,TYPE=CAX8R,ELSET=WALL',
        calculix.element_lines(mesh.elements),
        calculix.set_lines('INSIDE', 'EL', inner_elements),
        calculix.set_lines('AXIS', 'N', mesh.axis),
        calculix.set_lines('EQUATOR', 'N', mesh.equator),
        '*MATERIAL,NAME=RUBBER',
        calculix.mooney_rivlin(ball.young_modulus, ball.poisson_ratio, ball.mooney_share)
        if ball.mooney_share
        else calculix.neo_hooke(ball.young_modulus, ball.poisson_ratio),
        '*SOLID SECTION,ELSET=WALL,MATERIAL=RUBBER',
        '*BOUNDARY',
        'AXIS,1,1',
        'EQUATOR,2,2',
    ]
    weights = pin_weights(mesh)
    if ball.pin == 'rigid':
        first, *others = weights
        weights = {first: 1.0}
        parts += ['*EQUATION', *(f'2\n{node},2,1.,{first},2,-1.' for node in others)]
    for force, pressure in zip(forces, pressures, strict=True):
        parts += ['*STEP,NLGEOM,INC=400', '*STATIC', '0.5,1.0,1e-4', '*CLOAD']
        parts += [f'{node},2,{-force * share:.12g}' for node, share in weights.items()]
        parts += ['*DLOAD', f'INSIDE,P4,{pressure:.12g}']
        parts += ['*NODE PRINT,NSET=ALL', 'U', '*END STEP']
    return '\n'.join(parts) + '\n'


@dataclass(frozen=True)
class Solution:
    """Deformed node positions per load level, with the gas that goes with them."""

    ball: Ball
    mesh: Mesh
    forces: Array
    pressures: Array
    volumes: Array
    rest_volume: float
    positions: list[Array]
    deck: str

    def middle_displacement(self) -> Array:
        """Inward displacement of the pole at mid-thickness per level, mm."""
        return self._pole(int(self.mesh.middle[0]))

    def outer_displacement(self) -> Array:
        """Inward displacement of the pole of the outer face per level, mm."""
        return self._pole(int(self.mesh.outer[0]))

    def _pole(self, node: int) -> Array:
        rest = self.mesh.positions[node - 1, 1]
        return np.array([rest - moved[node - 1, 1] for moved in self.positions])


def solve(
    ball: Ball, forces: Array, pressures: Array, timeout: float = 900.0, partial: bool = False
) -> Solution:
    """Solve one load history with given gas pressures; `partial` keeps what converged of it."""
    mesh = build_mesh(ball)
    text = deck(ball, mesh, forces, pressures)
    tables = calculix.run(text, 'ball', timeout, partial=partial)
    positions = []
    reached = min(len(forces), int(max(tables) + 1e-6))
    if reached < len(forces) and not partial:
        raise calculix.CalculixError(f'load level {reached + 1} was not reached')
    forces, pressures = np.asarray(forces)[:reached], np.asarray(pressures)[:reached]
    for level in range(reached):
        moved = _last_of_step(tables, level + 1)
        positions.append(
            np.array(
                [
                    mesh.positions[number - 1] + moved[number][:2]
                    for number in range(1, len(mesh.positions) + 1)
                ]
            )
        )
    volumes = np.array([inside_volume(mesh, moved) for moved in positions])
    rest = inside_volume(mesh, mesh.positions)
    return Solution(ball, mesh, forces, pressures, volumes, rest, positions, text)


def _last_of_step(tables: dict[float, dict], step: int) -> dict[int, Array]:
    for time, found in tables.items():
        if abs(time - step) < 1e-6:
            return found['displacements', 'ALL']
    raise calculix.CalculixError(f'load level {step} was not reached')


def solve_sealed(
    ball: Ball, forces: Array, ambient: float = AMBIENT_MPA, tolerance: float = 1e-5
) -> Solution:
    """The same with ambient air sealed in: isothermal, (p + ambient) V = ambient V0.

    The pressures of all levels are iterated together; each round solves the whole history.
    """
    forces = np.asarray(forces, dtype=float)
    solution = solve(ball, forces, np.zeros(len(forces)))
    previous: tuple[Array, Array] | None = None
    for _ in range(12):
        wanted = ambient * (solution.rest_volume / solution.volumes - 1.0)
        residual = wanted - solution.pressures
        if np.all(abs(residual) <= tolerance * ambient):
            return solution
        step = residual
        if previous is not None:
            # Secant per level on residual(pressure): the gas stiffens the ball, so the plain
            # fixed point would overshoot for large dents.
            slope = (residual - previous[1]) / (solution.pressures - previous[0])
            step = -residual / np.where(slope < -0.2, slope, -1.0)
        previous = (solution.pressures, residual)
        solution = solve(ball, forces, solution.pressures + step)
    raise calculix.CalculixError('sealed gas: pressure and volume did not come to agree')
