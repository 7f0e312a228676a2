# SPDX-License-Identifier: Apache-2.0
"""Problems with closed-form answers: clamped plates, a slit tube under torque, tubes turned far.

SI units. Every length is in metres, every modulus in pascals.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import discretise
from shell_deform.building import boundary_vertices, build_model
from shell_deform.contact.loads import surface_load
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject
from shell_deform.objects.shell_object import Cylinder
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, forced, gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.supports import clamp, hold_position, joined
from shell_deform.supports.grips import arc_motion, grip
from shell_deform.surface.control_mesh import ControlMesh, control_mesh, moved
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import grid_surface
from shell_deform.verification.linear_course import first_order, unheld
from shell_deform.verification.problem import Verified, point_load, stopwatch, used_vertices

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)
EXACT_PLATE = 'thin plate, exact (Timoshenko)'
GOAL = 1e-2

TWIST = 0.5 * np.pi
BEND = np.pi / 3.0


def disc_mesh(radius: float, rings: int) -> tuple[ControlMesh, NDArray[np.int64]]:
    """A flat disc in rings of 6, 12, 18 … vertices, all of valence 6, and the rim's vertices.

    One more ring of control points lies beyond the rim.
    """
    points, number = [np.zeros(3)], {(0, 0): 0}
    for ring in range(1, rings + 2):
        for k in range(6 * ring):
            angle = 2.0 * np.pi * k / (6 * ring)
            number[ring, k] = len(points)
            points.append(radius * ring / rings * np.array([np.cos(angle), np.sin(angle), 0.0]))
    triangles, inside = [], []
    for ring in range(1, rings + 2):
        for sector in range(6):
            for k in range(ring):
                outer = [number[ring, (sector * ring + k + i) % (6 * ring)] for i in range(2)]
                inner = [
                    number[ring - 1, (sector * (ring - 1) + k + i) % max(1, 6 * (ring - 1))]
                    for i in range(2)
                ]
                triangles.append([inner[0], *outer])
                inside.append(ring <= rings)
                if k < ring - 1:
                    triangles.append([inner[0], outer[1], inner[1]])
                    inside.append(ring <= rings)
    target = np.array(points)
    mesh = control_mesh(target, triangles, corners=[], active=np.array(inside))
    surface, control = LimitSurface(mesh), target
    free = np.linalg.norm(target, axis=1) < radius * (1.0 + 0.5 / rings)
    for _ in range(30):
        control = control + free[:, None] * (target - surface.limit_positions(control))
    rim = np.array([number[rings, k] for k in range(6 * rings)])
    return moved(mesh, control), rim


def clamped_plate(rings: int = 20) -> Iterator[Verified]:
    """Circular plate with a clamped rim under a force on its centre, and under a uniform load."""
    radius, thickness, material = 0.1, 1e-3, Material(70e9, 0.3)
    with stopwatch() as watch:
        mesh, rim = disc_mesh(radius, rings)
        shell = discretise(mesh, material, thickness)
        outward = mesh.vertices[rim] / np.linalg.norm(mesh.vertices[rim], axis=1)[:, None]
        model = ShellModel(shell, supports=joined(clamp(shell, rim, -outward)))
        centre = point_load(model, 0, Z)
        by_force = first_order(model, unheld(forced((centre,), [1.0])))
        spread = LoadCase((), np.zeros(0), np.zeros(0), dead_load=surface_load(shell, Z))
        by_pressure = first_order(model, spread)
    stiffness = material.bending_stiffness(thickness)
    for quantity, exact, motion in (
        ('deflection [m] per N on the centre', radius**2 / (16.0 * np.pi * stiffness), by_force),
        ('deflection [m] per Pa', radius**4 / (64.0 * stiffness), by_pressure),
    ):
        yield Verified(
            'clamped_circular_plate', quantity, exact, EXACT_PLATE,
            float(centre.centre @ motion @ Z), used_vertices(model), watch.seconds, GOAL,
        )  # fmt: skip


def slit_tube(cells: tuple[int, int] = (48, 24)) -> Verified:
    """Thin tube slit along its length: torque per twist, the ends free to warp."""
    radius, length, thickness, material = 0.05, 0.4, 1e-3, Material(1e9, 0.3)

    def tube(s: Array, t: Array) -> Array:
        angle = 2.0 * np.pi * s
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), length * t], axis=1)

    with stopwatch() as watch:
        grid = grid_surface(tube, cells)
        shell = discretise(grid.mesh, material, thickness)
        ends = [grid.edge('t0'), grid.edge('t1')]
        lower, upper = (hold_position(shell, end, np.stack([X, Y])) for end in ends)
        axial = hold_position(shell, ends[0][cells[0] // 2 :][:1], Z[None])
        turned = grip('upper', shell, [upper], np.zeros(3))
        model = ShellModel(shell, supports=joined([lower, axial]), grips=(turned,))
        angle = 1e-5
        state = _turned_to(model, np.concatenate([np.zeros(3), angle * Z])[None])
        torque = float(state.grip_wrench[0, 5])
    shear_modulus = 1e9 / 2.6
    exact = 2.0 * np.pi * radius * shear_modulus * thickness**3 / 3.0 * angle / length
    return Verified(
        'slit_tube', 'torque [N m] for a small twist', exact, 'thin open tube, (2 pi R) G h^3 / 3',
        torque, used_vertices(model), watch.seconds, GOAL,
    )  # fmt: skip


def turned_tube(theory: str, turn: str) -> Verified:
    """Diameter in the middle of a tube whose end section is turned far as a rigid body.

    `turn`: 'twist' by 90 degrees about the axis, or 'bend' by 60 degrees along a circular arc.
    A wall keeps its section, but for the flattening that Brazier (1927) gives for bending. Linear
    theory does not: its tube swells, which its rows show and are not scored for.
    """
    radius, length, thickness, poisson = 0.01, 0.4, 2e-3, 0.3
    angle = TWIST if turn == 'twist' else BEND
    with stopwatch() as watch:
        tube = ShellObject(
            'tube', Cylinder(2.0 * radius + thickness, length, 'open'), thickness, 1e6, poisson,
            control_vertices=800,
        )  # fmt: skip
        shell = build_model(tube).shell
        rim, _ = boundary_vertices(shell.mesh)
        points = LimitSurface(shell.mesh).limit_positions(shell.mesh.vertices)[rim]
        ends = np.sign(points[:, 2])
        held = [hold_position(shell, rim[ends == side], np.eye(3)) for side in (-1, 1)]
        upper = grip('upper', shell, [held[1]], 0.5 * length * Z)
        model = ShellModel(shell, theory, supports=held[0], grips=(upper,))
        steps = 1 if theory == 'linear' else 12
        angles = angle / steps * np.arange(1, steps + 1)
        state = _turned_to(model, np.stack([_end_motion(length, a, turn) for a in angles]))
        width = _section_width(model, state)
    flattening = 0.0
    if turn == 'bend':
        flattening = (angle / length * radius**2 / thickness) ** 2 * (1.0 - poisson**2)
    return Verified(
        f'tube_{turn}_{theory}', 'diameter in the middle over that at rest', 1.0 - flattening,
        'rigid sections; Brazier 1927', width, used_vertices(model), watch.seconds,
        None if theory == 'linear' else GOAL,
    )  # fmt: skip


def _end_motion(length: float, angle: float, turn: str) -> Array:
    """(6,) shift and turn of the upper end: about the axis, or along a circular arc."""
    if turn == 'twist':
        return np.concatenate([np.zeros(3), angle * Z])
    return arc_motion(Z, Y, length, angle)


def _section_width(model: ShellModel, state: Equilibrium) -> float:
    """Deformed over undeformed diameter of the middle section, in the plane of bending."""
    surface = model.surface
    sides = np.abs(model.rest[:, 0]).max() * np.stack([X, -X])
    place = surface.closest_point(model.rest, sides)
    now = surface.evaluate(state.positions, place.triangle, place.parameters).position
    before = np.linalg.norm(place.position[0] - place.position[1])
    return float(np.linalg.norm(now[0] - now[1]) / before)


def _turned_to(model: ShellModel, motions: Array) -> Equilibrium:
    """Equilibrium with the one grip taken through `motions` (s, 6)."""
    solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0))
    state = solver.rest()
    for motion in motions:
        state = solver.solve(gripped(motion[None]), state)
    return state


def problems() -> Iterator[Verified]:
    """All closed forms; the strip rolled to a circle is among the problems of Sze, Liu & Lo."""
    yield from clamped_plate()
    yield slit_tube()
    for turn in ('twist', 'bend'):
        for theory in ('koiter', 'linear'):
            yield turned_tube(theory, turn)
