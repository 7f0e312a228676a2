# SPDX-License-Identifier: Apache-2.0
"""Theory `thick` beside exact solutions: thick plates, a block bent to an arc, a thick sphere.

Each is derived here again. Plates: Reissner and Mindlin with the shear stiffness 5/6 G h, which a
parabolic shear profile has exactly; loads act on the middle surface. The block and the sphere are
solids: incompressible for R. S. Rivlin's flexure (Phil. Trans. R. Soc. A 242:173, 1949), nearly so
for the sphere, whose shell is given 0.4999.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse.linalg as sla
from numpy.typing import NDArray

from shell_deform.assemble.thick import MOST_INCOMPRESSIBLE, ThickShell, thick_shell
from shell_deform.building import build_model
from shell_deform.contact.loads import surface_load
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject
from shell_deform.objects.shell_object import Sphere
from shell_deform.solve.equilibrium import LoadCase
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import clamp, hold_position, hold_shear, hold_slope, joined
from shell_deform.theory import THICK
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import GridSurface, grid_surface
from shell_deform.verification.linear_course import first_order
from shell_deform.verification.problem import Verified, point_load, stopwatch, used_vertices

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)

PLATE_GOAL, SOLID_GOAL = 1e-3, 5e-3
SHEAR_FACTOR = 5.0 / 6.0
STEEL = Material(210e9, 0.3)
RUBBER = 1e6
MOST_STEPS = 20
"""Newton steps from an arc of the undeformed length to the bent block."""


def shear_stiffness(material: Material, thickness: float) -> float:
    """5/6 G h [N/m] of a wall."""
    modulus = 0.5 * material.young_modulus / (1.0 + material.poisson_ratio)
    return SHEAR_FACTOR * modulus * thickness


def navier_deflection(side: float, thickness: float, material: Material) -> float:
    """Sag [m/Pa] of the middle of a square plate on hard simple supports.

    Each double sine is Kirchhoff's times 1 + D pi^2 (m^2 + n^2) / L^2 / (5/6 G h): there the
    director turns by -w,a times the inverse of the same factor, so bending carries what it does.
    """
    m = np.arange(1, 3000, 2)
    a, b = np.meshgrid(m, m, indexing='ij')
    waves = (np.pi / side) ** 2 * (a**2 + b**2)
    bending = material.bending_stiffness(thickness)
    load = 16.0 / (np.pi**2 * a * b)
    sign = (-1.0) ** ((a + b - 2) // 2)
    sag = load * sign / (bending * waves**2)
    return float((sag * (1.0 + bending * waves / shear_stiffness(material, thickness))).sum())


def supported_plate(slenderness: float, cells: int = 32) -> Verified:
    """Square plate of h / L `slenderness`, hard simple supports, uniform load."""
    side = 0.1
    thickness = slenderness * side

    def flat(s: Array, t: Array) -> Array:
        return side * np.stack([s, t, np.zeros_like(s)], axis=1)

    with stopwatch() as watch:
        grid = grid_surface(flat, (cells, cells))
        shell = thick_shell(grid.mesh, STEEL, thickness, everywhere=True)
        parts = []
        for name, along in (('s0', Y), ('s1', Y), ('t0', X), ('t1', X)):
            edge = grid.edge(name)
            parts += [
                hold_position(shell, edge, np.stack([Z, along])),
                hold_shear(shell, edge, np.tile(along, (len(edge), 1))),
            ]
        model = ShellModel(shell, THICK, supports=joined(parts))
        centre = point_load(model, int(grid.number[1 + cells // 2, 1 + cells // 2]), Z)
        motion = first_order(model, _spread(shell))[: len(model.rest)]
    return Verified(
        'thick_square_plate', f'sag [m/Pa] at h/L {slenderness:g}',
        navier_deflection(side, thickness, STEEL), 'exact: Navier series, Reissner-Mindlin',
        float(centre.centre @ motion @ Z), used_vertices(model), watch.seconds, PLATE_GOAL,
    )  # fmt: skip


def disc(radius: float, cells: int) -> GridSurface:
    """A flat disc as a square whose sides are bent to the rim: flat angles at four corners."""

    def bent(s: Array, t: Array) -> Array:
        u, v = 2.0 * s - 1.0, 2.0 * t - 1.0
        x, y = u * np.sqrt(1.0 - 0.5 * v**2), v * np.sqrt(1.0 - 0.5 * u**2)
        return radius * np.stack([x, y, np.zeros_like(s)], axis=1)

    return grid_surface(bent, (cells, cells))


def clamped_plate(slenderness: float, cells: int = 48) -> Verified:
    """Circular plate of h / a `slenderness`, clamped rim, uniform load.

    Its sag p (a^2 - r^2)^2 / 64 D + p (a^2 - r^2) / 4 (5/6 G h): the shear force is p r / 2, and
    the director of Kirchhoff's solution bends the plate to the moments that balance it.
    """
    radius = 0.1
    thickness = slenderness * radius
    with stopwatch() as watch:
        grid = disc(radius, cells)
        shell = thick_shell(grid.mesh, STEEL, thickness, everywhere=True)
        rim = np.unique(np.concatenate([grid.edge(side) for side in ('s0', 's1', 't0', 't1')]))
        limit = shell.surface.limit_positions(grid.mesh.vertices)[rim]
        inward = -limit / np.linalg.norm(limit, axis=1)[:, None]
        model = ShellModel(shell, THICK, supports=joined(clamp(shell, rim, inward)))
        centre = point_load(model, int(grid.number[1 + cells // 2, 1 + cells // 2]), Z)
        motion = first_order(model, _spread(shell))[: len(model.rest)]
    bent = radius**4 / (64.0 * STEEL.bending_stiffness(thickness))
    sheared = radius**2 / (4.0 * shear_stiffness(STEEL, thickness))
    return Verified(
        'thick_clamped_plate', f'sag [m/Pa] at h/a {slenderness:g}', bent + sheared,
        'exact: p a^4 / 64 D + p a^2 / 4 (5/6 G h)', float(centre.centre @ motion @ Z),
        used_vertices(model), watch.seconds, PLATE_GOAL,
    )  # fmt: skip


def _spread(shell: ThickShell) -> LoadCase:
    return LoadCase((), np.zeros(0), np.zeros(0), dead_load=surface_load(shell, Z))


def arc_moment(bend: float, shear_modulus: float) -> float:
    """Moment per width and h^2 [Pa] that bends an incompressible block by `bend` = h / c.

    Rivlin: the block 0 < Y < L, |X| < h / 2 goes to r^2 = 2 c X + b, theta = Y / c, with
    principal stretches c / r and r / c. Balance of forces leaves the radial stress
    G/2 (r^2/c^2 + c^2/r^2) + constant, which vanishes on both faces if r_1 r_2 = c^2. Their hoop
    stress, that plus G (r^2/c^2 - c^2/r^2), has no resultant.
    """
    middle = np.sqrt(1.0 + bend**2)
    inner, outer = np.sqrt(middle - bend), np.sqrt(middle + bend)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r = 0.5 * (inner + outer) + 0.5 * (outer - inner) * nodes
    radial = 0.5 * (r**2 + r**-2) - 0.5 * (inner**2 + inner**-2)
    hoop = radial + r**2 - r**-2
    moment = 0.5 * (outer - inner) * float(weights @ (hoop * r))
    return shear_modulus * moment / bend**2


def bent_block(bend: float) -> Verified:
    """A flat strip in plane strain, its ends turned towards each other until it is an arc.

    The moment is the change of the strain energy with the angle between the ends.
    """
    thickness, material = 0.01, Material(RUBBER, MOST_INCOMPRESSIBLE)
    length, width = 3.0 * thickness, thickness

    def flat(s: Array, t: Array) -> Array:
        return np.stack([length * s, width * t, np.zeros_like(s)], axis=1)

    with stopwatch() as watch:
        grid = grid_surface(flat, (8, 8))
        shell = thick_shell(grid.mesh, material, thickness, everywhere=True)
        small = 1e-3 * bend
        energies = [_arc_energy(shell, grid, length, length * b / thickness)
                    for b in (bend - small, bend + small)]  # fmt: skip
        angle = 2.0 * small * length / thickness
        moment = (energies[1] - energies[0]) / angle / width
    modulus = 0.5 * RUBBER / (1.0 + MOST_INCOMPRESSIBLE)
    return Verified(
        'thick_block_bent', f'moment over width and h^2 [Pa] at h/c {bend:g}',
        arc_moment(bend, modulus), 'exact: Rivlin 1949, flexure of an incompressible block',
        moment / thickness**2, len(shell.mesh.vertices), watch.seconds, SOLID_GOAL,
    )  # fmt: skip


def _arc_energy(shell: ThickShell, grid: GridSurface, length: float, angle: float) -> float:
    """Strain energy [J] of the strip between two planes through one axis, `angle` apart.

    Its start lies on the plane x = 0, its end on the turned one, both free to slide in them.
    """
    start, end = grid.edge('s0'), grid.edge('s1')
    sides = np.concatenate([grid.edge('t0'), grid.edge('t1')])
    normal = np.cos(angle) * X - np.sin(angle) * Z
    outward = np.sin(angle) * X + np.cos(angle) * Z
    along = np.tile(X, (len(start), 1))
    turned = hold_slope(shell, end, along, outward[None])
    placed = hold_position(shell, end, normal[None])
    still = [
        hold_position(shell, start, X[None]),
        hold_slope(shell, start, along, Z[None]),
        hold_position(shell, sides, Y[None]),
        hold_slope(shell, sides, np.tile(Y, (len(sides), 1)), np.stack([X, Z])),
        hold_shear(shell, sides, np.tile(Y, (len(sides), 1))),
        *(hold_shear(shell, edge, along) for edge in (start, end)),
    ]
    model = ShellModel(shell, THICK, supports=joined([turned, placed, *still]))
    axis = -length / angle * Z
    rest = shell.surface.limit_positions(shell.mesh.vertices)[end]
    # The tangent along the strip, X at rest, is to have no part along the radius at the end.
    slope = -np.sin(angle) * turned.stretch(_stretched(shell, X, outward))
    target = np.concatenate(
        [slope, (axis - rest) @ normal, np.zeros(sum(len(part.stiffness) for part in still))]
    )
    place = np.array(shell.mesh.vertices)
    turn = place[:, 0] * angle / length
    place[:, 0], place[:, 2] = -axis[2] * np.sin(turn), axis[2] - axis[2] * np.cos(turn)
    moved = np.zeros_like(shell.start)
    moved[: len(place)] = place - shell.mesh.vertices
    for _ in range(MOST_STEPS):
        tangent = model.tangent(shell.start + moved, target, moved)
        step = sla.spsolve(tangent.stiffness.tocsc(), -tangent.gradient)
        moved += step.reshape(-1, 3)
        if np.abs(step).max() < 1e-10 * length:
            return float(shell.gradient(THICK, shell.start + moved)[0])
    return np.nan


def _stretched(shell: ThickShell, along: Array, motion: Array) -> Array:
    """All displacements (N, 3) of a flat shell whose derivative along `along` is `motion` (3,)."""
    result = np.zeros_like(shell.start)
    result[: len(shell.mesh.vertices)] = (shell.mesh.vertices @ along)[:, None] * motion
    return result


def sphere_pressure(inner: float, outer: float, stretch: float) -> float:
    """Pressure over G inside an incompressible neo-Hookean sphere at hoop `stretch` inside.

    Integral of 2 (hoop - radial stress) / r over the wall: each hoop stretch s contributes
    2 / s + 1 / (2 s^4), outside less inside; `inner`, `outer` are the undeformed radii.
    """
    grown = inner**3 * (stretch**3 - 1.0)
    beyond = np.cbrt(outer**3 + grown) / outer
    return float(2.0 / beyond + 0.5 * beyond**-4 - 2.0 / stretch - 0.5 * stretch**-4)


def blown_sphere(ratio: float, control_vertices: int = 300) -> Iterator[Verified]:
    """A sphere of R / h `ratio` under inner pressure: the exact pressure at the radius found."""
    radius = 0.03
    thickness = radius / ratio
    inner, outer = radius - 0.5 * thickness, radius + 0.5 * thickness
    modulus = 0.5 * RUBBER / (1.0 + MOST_INCOMPRESSIBLE)
    ball = ShellObject('sphere', Sphere(2.0 * outer), thickness, RUBBER, MOST_INCOMPRESSIBLE)
    with stopwatch() as watch:
        model = build_model(ball, THICK, control_vertices=control_vertices)
        solver = EquilibriumSolver(model)
        state = solver.rest()
    for stretch in (1.02, 1.1, 1.2):
        applied = modulus * sphere_pressure(inner, outer, stretch)
        with stopwatch() as watch:
            solver.take(replace(solver.model, pressure=applied))
            state = solver.solve(LoadCase((), np.zeros(0), np.zeros(0), held=False), state)
        volume = solver.model.shell.volume(state.unknowns)[0]
        found = np.cbrt(volume / solver.model.rest_volume)
        yield Verified(
            'thick_sphere_blown', f'pressure [Pa] at R/h {ratio:g}, {stretch:g} inside',
            modulus * sphere_pressure(inner, outer, float(found)),
            'exact: incompressible neo-Hookean sphere, at the inner volume found',
            applied if state.converged else np.nan, len(model.rest), watch.seconds, SOLID_GOAL,
        )  # fmt: skip


def problems() -> Iterator[Verified]:
    """Plates, blocks and spheres, thin to thick."""
    for slenderness in (0.1, 0.2):
        yield supported_plate(slenderness)
    for slenderness in (0.01, 0.1, 0.2, 0.4):
        yield clamped_plate(slenderness)
    for bend in (0.1, 0.2, 0.3):
        yield bent_block(bend)
    for ratio in (4.0, 12.5):
        yield from blown_sphere(ratio)
