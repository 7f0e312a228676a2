# SPDX-License-Identifier: Apache-2.0
"""The linear obstacle course: Scordelis-Lo roof, pinched cylinder, pinched hemisphere.

Kirchhoff-Love limits; the linear theory solved is Koiter's first-order part (tangent at rest).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import discretise
from shell_deform.contact.loads import surface_load
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import LoadCase, forced
from shell_deform.solve.newton import EquilibriumSolver, borders
from shell_deform.supports import hold_position, joined
from shell_deform.surface.control_mesh import control_mesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import closed_tube, grid_surface
from shell_deform.verification.problem import (
    Verified,
    point_load,
    references,
    stopwatch,
    used_vertices,
)

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)


def first_order(model: ShellModel, case: LoadCase) -> Array:
    """Displacements (n, 3) of the shell's tangent at rest under forced contacts and dead load."""
    solver = EquilibriumSolver(model)
    bordering = borders(model, case)
    load = bordering.push @ case.force + bordering.dead
    return solver.respond(solver.rest(), bordering, load[:, None])[:, 0].reshape(-1, 3)


def scordelis_lo(cells: int = 32) -> Verified:
    """Roof under its weight: vertical sag of the middle of the free edge."""
    data = references()['linear_obstacle_course']['scordelis_lo']
    radius, length, half = data['R'], data['L'], np.deg2rad(data['half_angle_deg'])

    def roof(s: Array, t: Array) -> Array:
        angle = half * (2.0 * s - 1.0)
        return np.stack([radius * np.sin(angle), length * t, radius * np.cos(angle)], axis=1)

    with stopwatch() as watch:
        grid = grid_surface(roof, (cells, cells))
        shell = discretise(grid.mesh, Material(data['E'], data['nu']), data['h'])
        ends = np.concatenate([grid.edge('t0'), grid.edge('t1')])
        model = ShellModel(shell, supports=hold_position(shell, ends, np.stack([X, Z])))
        case = LoadCase((), np.zeros(0), np.zeros(0), dead_load=surface_load(shell, -90.0 * Z))
        moved_by = first_order(model, case)
        probe = point_load(model, int(grid.edge('s0')[cells // 2]), -Z)
        sag = float(probe.centre @ moved_by @ probe.axis)
    return Verified(
        'scordelis_lo', 'sag of the free edge [ft]', data['value'],
        'own: Kirchhoff-Love limit, mixed Koiter element of order 3', sag,
        used_vertices(model), watch.seconds, 1e-3,
    )  # fmt: skip


def pinched_cylinder(cells: int = 36) -> Verified:
    """Cylinder with rigid diaphragms between two point forces, whole; `cells` to a quarter turn.

    An octant would need three symmetric edges, which are a little soft (`supports`): it converges
    from above at first order. The whole one does from below, faster than third order.
    """
    data = references()['linear_obstacle_course']['pinched_cylinder']
    with stopwatch() as watch:
        grid = closed_tube(data['R'], data['L'], (4 * cells, 2 * cells))
        shell = discretise(grid.mesh, Material(data['E'], data['nu']), data['h'])
        ends = np.unique(np.concatenate([grid.edge('t0'), grid.edge('t1')]))
        middle = grid.number[1:-1, 1 + cells]
        model = ShellModel(
            shell,
            supports=joined(
                [
                    hold_position(shell, ends, np.stack([X, Z])),
                    hold_position(shell, middle[:1], Y[None]),
                ]
            ),
        )
        loads = (
            point_load(model, int(middle[0]), -Z),
            point_load(model, int(middle[2 * cells]), Z),
        )
        moved_by = first_order(model, unheld(forced(loads, [data['P']] * 2)))
        dent = float(np.mean([load.centre @ moved_by @ load.axis for load in loads]))
    return Verified(
        'pinched_cylinder', 'displacement under the force [in]', data['value_published'],
        'published series solution 164.24 P / (E h)', dent,
        used_vertices(model), watch.seconds, 5e-3,
    )  # fmt: skip


def pinched_hemisphere(subdivisions: int = 5) -> Verified:
    """Closed hemisphere between four alternating point forces on its free equator."""
    data = references()['linear_obstacle_course']['pinched_hemisphere_full']
    radius = data['R']
    with stopwatch() as watch:
        mesh = upper_half_sphere(radius, subdivisions)
        shell = discretise(mesh, Material(data['E'], data['nu']), data['h'])
        model = ShellModel(shell)
        points = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]

        def at(direction: Array) -> int:
            return int(np.argmax(points @ direction))

        loads = tuple(
            point_load(model, at(direction), push)
            for direction, push in ((X, X), (-X, -X), (Y, -Y), (-Y, Y))
        )
        moved_by = first_order(model, unheld(forced(loads, [2.0] * 4)))
        value = float(np.mean([p.centre @ moved_by @ p.axis for p in loads]))
    return Verified(
        'pinched_hemisphere', 'displacement under the forces', data['value'],
        'MacNeal-Harder, full hemisphere', value, used_vertices(model), watch.seconds, 5e-3,
    )  # fmt: skip


def upper_half_sphere(radius: float, subdivisions: int):  # type: ignore[no-untyped-def]
    """Octahedral sphere whose lower half only carries the basis of the upper one."""
    octahedron = trimesh.Trimesh(
        vertices=np.concatenate([np.eye(3), -np.eye(3)]),
        faces=[
            [0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2],
            [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5],
        ],
        process=False,
    )  # fmt: skip
    vertices, faces = octahedron.vertices, octahedron.faces
    for _ in range(subdivisions):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
        vertices = vertices / np.linalg.norm(vertices, axis=1)[:, None]
    surface = LimitSurface(control_mesh(radius * vertices, faces))
    points = surface.mesh.vertices
    for _ in range(40):
        limit = surface.limit_positions(points)
        points = points + radius * limit / np.linalg.norm(limit, axis=1)[:, None] - limit
    upper = vertices[faces].mean(axis=1)[:, 2] > 0
    return control_mesh(points, faces, active=upper)


def unheld(case: LoadCase) -> LoadCase:
    """The same loads without the held contacts of a grasp."""
    return LoadCase(
        case.contacts, case.force, case.displacement, held=False, dead_load=case.dead_load
    )


def problems() -> Iterator[Verified]:
    """All problems of the course, one after the other."""
    yield scordelis_lo()
    published = pinched_cylinder()
    yield published
    yield replace(
        published,
        quantity='displacement against our own extrapolated limit [in]',
        reference=references()['linear_obstacle_course']['pinched_cylinder']['value_KL'],
        source='own: Kirchhoff-Love limit, mixed Koiter element of order 3',
        goal=None,
    )
    yield pinched_hemisphere()
