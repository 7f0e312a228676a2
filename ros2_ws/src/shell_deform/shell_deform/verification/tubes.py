# SPDX-License-Identifier: Apache-2.0
"""Tubes turned far by rigid grips: twisted, twisted to their limit, bent to their largest moment.

Beside closed forms, a solid (`bags/solid_tube.py`) and the section of a long tube by itself
(`tube_section.py`). The bent tube has no more rows along its length than its curvature needs:
short wrinkles are then not among its motions, and the largest moment can be reached. The one that
is to wrinkle has enough.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shell_deform.assemble.discretisation import discretise
from shell_deform.building import build_model, object_contacts
from shell_deform.contact.friction_share import friction_share
from shell_deform.model import ShellModel
from shell_deform.objects import Contact, GripPlace, ShellObject
from shell_deform.objects.shell_object import Cylinder
from shell_deform.solve.equilibrium import Equilibrium, displaced, gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.supports import hold_position, joined, symmetry
from shell_deform.supports.grips import arc_motion, grip, turned_together
from shell_deform.surface.control_mesh import ControlMesh, control_mesh, moved
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory.material import Material
from shell_deform.verification.problem import Verified, stopwatch, used_vertices
from shell_deform.verification.tube_section import TubeSection

Array = NDArray[np.float64]
Index = NDArray[np.int64]
X, Y, Z = np.eye(3)

SLOPE_GOAL, CURVE_GOAL, LIMIT_GOAL, FORMULA_GOAL = 5e-3, 1e-2, 3e-2, 5e-2
ENERGY_GOAL, BOTTLE_GOAL = 1e-10, 2e-2

# Beyond the last angle of the solid [rad], where the moment is largest.
PAST_THE_SOLID = (0.645, 0.66)
# Of a tube that 20 kPa inside stiffen [Pa].
SOFT = 3e7
# Turns of the bottle's neck [degrees]: all fingers slip from some 0.1 on.
BOTTLE_TURNS = (0.03, 0.06, 0.1, 0.15, 0.25, 0.4)


@dataclass(frozen=True)
class TubeMesh:
    """A tube about z from 0 to its length, regular all over, and the vertices of its ends."""

    mesh: ControlMesh
    lower: Index
    upper: Index


def tube_mesh(radius: float, length: float, around: int, along: int) -> TubeMesh:
    """`around` vertices in each of `along` + 1 rows, every other one turned by half a cell.

    One more row of control points lies beyond each end.
    """
    ring = np.arange(around)
    rows = np.arange(-1, along + 2)
    angle = 2.0 * np.pi * (ring + 0.5 * (rows[:, None] % 2)) / around
    height = np.broadcast_to(length * rows[:, None] / along, angle.shape)
    target = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=2)
    target = target.reshape(-1, 3)
    triangles, inside = [], []
    for k, row in enumerate(rows[:-1]):
        here, there = k * around + ring, (k + 1) * around + ring
        after, beyond = k * around + (ring + 1) % around, (k + 1) * around + (ring + 1) % around
        pairs = [(here, after, there), (after, beyond, there)]
        if row % 2:
            pairs = [(here, after, beyond), (here, beyond, there)]
        for triple in pairs:
            triangles.append(np.stack(triple, axis=1))
            inside.append(np.full(around, 0 <= row < along))
    mesh = control_mesh(
        target, np.concatenate(triangles), corners=[], active=np.concatenate(inside)
    )
    surface, control = LimitSurface(mesh), target
    free = np.repeat((rows >= 0) & (rows <= along), around)
    for _ in range(30):
        control = control + free[:, None] * (target - surface.limit_positions(control))
    return TubeMesh(moved(mesh, control), around + ring, (along + 1) * around + ring)


def kept_solution() -> dict[str, Any]:
    """The solid's solutions."""
    return dict(json.loads((Path(__file__).parent / 'solid_tubes.json').read_text()))


def _twisted_tube(kept: dict[str, Any], around: int, along: int) -> ShellModel:
    """The tube between two hinged grips, the upper one free along the axis."""
    radius, length = kept['middle_radius_m'], kept['length_m']
    tube = tube_mesh(radius, length, around, along)
    material = Material(kept['young_modulus_pa'], kept['poisson_ratio'])
    shell = discretise(tube.mesh, material, kept['thickness_m'])
    ends = [hold_position(shell, end, np.eye(3)) for end in (tube.lower, tube.upper)]
    grips = (
        grip('lower', shell, ends[:1], np.zeros(3)),
        grip('upper', shell, ends[1:], length * Z, Z[None]),
    )
    return ShellModel(shell, grips=grips)


def _twisted(
    solver: EquilibriumSolver, angle: float, start: Equilibrium | None = None
) -> Equilibrium:
    motion = np.zeros((2, 6))
    motion[1, 3:] = angle * Z
    return solver.solve(gripped(motion), start)


def twisted_tube(around: int = 24, along: int = 60) -> Iterator[Verified]:
    """A long tube twisted by 60 degrees, then turned as a whole by 180."""
    solutions = kept_solution()
    kept = solutions['twist']
    radius, wall, length = kept['middle_radius_m'], kept['thickness_m'], kept['length_m']
    shear = kept['young_modulus_pa'] / (2.0 + 2.0 * kept['poisson_ratio'])
    polar = 2.0 * np.pi * radius**3 * wall * (1.0 + 0.25 * (wall / radius) ** 2)
    with stopwatch() as watch:
        model = _twisted_tube(kept, around, along)
        solver = EquilibriumSolver(model)
        state = _twisted(solver, small := 1e-3)
        slope = float(state.grip_wrench[1, 5]) / small
        states = []
        for angle in kept['turn_rad']:
            states.append(state := _twisted(solver, angle, state))
        motion = turned_together(model.grips, np.zeros(3), np.pi * X)
        twist = Rotation.from_rotvec(state.grip_motion[1, 3:])
        motion[1, 3:] = (Rotation.from_rotvec(motion[1, 3:]) * twist).as_rotvec()
        turned = solver.solve(gripped(motion), state)
    common = (used_vertices(model), watch.seconds)
    yield Verified(
        'tube_twisted', 'torque [N m] per radian at rest', shear * polar / length,
        'closed form, G J / L of a hollow circle', slope, *common, SLOPE_GOAL,
    )  # fmt: skip
    for k, angle in enumerate(kept['turn_rad']):
        at = f'at {np.degrees(angle):.0f} degrees'
        yield Verified(
            'tube_twisted', f'torque [N m] {at}', kept['torque_nm'][k], solutions['source'],
            float(states[k].grip_wrench[1, 5]), *common, CURVE_GOAL,
        )  # fmt: skip
        yield Verified(
            'tube_twisted', f'shortening [m] {at}', kept['shortening_m'][k], solutions['source'],
            -float(states[k].grip_pose[1, 2]), *common, CURVE_GOAL,
        )  # fmt: skip
    yield Verified(
        'tube_twisted', 'energy [J] of the whole turned by 180 degrees', state.energy,
        'the same before', turned.energy, *common, ENERGY_GOAL,
    )  # fmt: skip


def limit_twist(around: int = 96, along: int = 26) -> Iterator[Verified]:
    """Torque at which a direction of negative stiffness appears, of a short thin tube."""
    solutions = kept_solution()
    kept = solutions['limit']
    radius, wall, length = kept['middle_radius_m'], kept['thickness_m'], kept['length_m']
    young = kept['young_modulus_pa']
    formula = 0.747 * young * (wall / radius) ** 1.25 * np.sqrt(radius / length)
    formula *= 2.0 * np.pi * radius**2 * wall
    with stopwatch() as watch:
        model = _twisted_tube(kept, around, along)
        solver = EquilibriumSolver(model, NewtonOptions(stability=True))
        shear = young / (2.0 + 2.0 * kept['poisson_ratio'])
        guess = formula * length / (shear * 2.0 * np.pi * radius**3 * wall)
        low, high = 0.8 * guess, 1.3 * guess
        below = _twisted(solver, low)
        above = _twisted(solver, high, below)
        if not (below.stable and above.negative_modes):
            raise RuntimeError('the limit of the twisted tube is not between its bounds')
        while high - low > 1e-3 * guess:
            middle = 0.5 * (low + high)
            found = _twisted(solver, middle, below)
            low, high, below = (middle, high, found) if found.stable else (low, middle, below)
        torque = float(below.grip_wrench[1, 5])
    for reference, source, goal in (
        (kept['torque_nm'], f'{solutions["source"]}, lowest eigenvalue', LIMIT_GOAL),
        (formula, 'NASA SP-8007, 0.747 E (h/R)^5/4 (R/L)^1/2, Donnell', FORMULA_GOAL),
    ):
        yield Verified(
            'tube_limit_twist', 'torque [N m] where it turns unstable', reference, source,
            torque, used_vertices(model), watch.seconds, goal,
        )  # fmt: skip


def _bent_model(section: TubeSection, length: float, around: int, along: int) -> ShellModel:
    """Half a tube from its plane of symmetry to a grip on its upper end, which may shift."""
    tube = tube_mesh(section.radius, length, around, along)
    shell = discretise(tube.mesh, Material(section.young, section.poisson), section.wall)
    upper = hold_position(shell, tube.upper, np.eye(3))
    end = grip('upper', shell, [upper], length * Z, np.stack([X, Z]))
    return ShellModel(
        shell, supports=joined(symmetry(shell, tube.lower, Z)), grips=(end,),
        pressure=section.pressure,
    )  # fmt: skip


def _bent(
    solver: EquilibriumSolver,
    section: TubeSection,
    length: float,
    angle: float,
    start: Equilibrium,
) -> Equilibrium:
    """Bent by `angle` [rad] at its end, which the pressure inside pushes on as on a lid."""
    lid = section.pressure * np.pi * section.radius**2
    force = lid * np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    return solver.solve(gripped(arc_motion(Z, Y, length, angle)[None], force), start)


def bent_tube(around: int = 32, along: int = 20) -> Iterator[Verified]:
    """Half a tube bent from its plane of symmetry by its upper end, which may shift."""
    solutions = kept_solution()
    kept = solutions['bend']
    length = kept['length_m']
    section = TubeSection(
        kept['middle_radius_m'], kept['thickness_m'], kept['young_modulus_pa'],
        kept['poisson_ratio'],
    )  # fmt: skip
    with stopwatch() as watch:
        model = _bent_model(section, length, around, along)
        solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0))
        state, moments = solver.rest(), []
        for angle in (*kept['turn_rad'], *PAST_THE_SOLID):
            state = _bent(solver, section, length, angle, state)
            moments.append(float(state.grip_wrench[0, 4]) if state.converged else np.nan)
    common = (used_vertices(model), watch.seconds)
    for angle, theirs, ours in zip(kept['turn_rad'], kept['moment_nm'], moments, strict=False):
        yield Verified(
            'tube_bent', f'moment [N m] at {np.degrees(angle):.0f} degrees', theirs,
            solutions['source'], ours, *common, CURVE_GOAL,
        )  # fmt: skip
    largest = float(np.nanmax(moments))
    yield Verified(
        'tube_bent', 'largest moment [N m]', section.largest_moment(),
        'uniform bending of a section that stretches and turns far (tube_section.py)', largest,
        *common, CURVE_GOAL,
    )  # fmt: skip
    yield Verified(
        'tube_bent', 'largest moment [N m] beside the formula', section.brazier,
        'Brazier 1927, first order in the flattening: that section carries 96.6 % of it', largest,
        *common,
    )  # fmt: skip


def wrinkled_tube(pressure: float, around: int = 32, along: int = 80) -> Iterator[Verified]:
    """Moment at which a soft tube with `pressure` [Pa] inside, finely meshed, first wrinkles.

    Beside the moment at which the axial stress of its section reaches the classical critical
    stress of a cylinder of the local radius.
    """
    kept = kept_solution()['bend']
    length = kept['length_m']
    section = TubeSection(
        kept['middle_radius_m'], kept['thickness_m'], SOFT, kept['poisson_ratio'], pressure
    )
    with stopwatch() as watch:
        expected, curvature = section.wrinkling()
        model = _bent_model(section, length, around, along)
        solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0, stability=True))
        state, moment = solver.rest(), np.nan
        for share in (0.3, 0.6, 0.8, *np.arange(0.9, 1.12, 0.02)):
            found = _bent(solver, section, length, share * curvature * length, state)
            if not (found.converged and found.stable):
                moment = float(state.grip_wrench[0, 4])
                break
            state = found
    yield Verified(
        'tube_wrinkled', f'moment [N m] at {1e-3 * pressure:.0f} kPa', expected,
        'critical stress E h / (r sqrt(3 (1 - nu^2))) at the local radius of the bent section',
        moment, used_vertices(model), watch.seconds, FORMULA_GOAL,
    )  # fmt: skip


def held_bottle(control_vertices: int = 400) -> Iterator[Verified]:
    """A bottle between three fingers whose neck is turned until all of them slip."""
    radius, wall, friction = 0.0325, 0.5e-3, 0.5
    angles = np.radians([90.0, 210.0, 330.0])
    places = [(radius * np.cos(a), radius * np.sin(a), -0.02) for a in angles]
    bottle = ShellObject(
        'bottle', Cylinder(2.0 * radius, 0.16, 'open'), wall, 2.7e9, 0.38,
        contacts=tuple(Contact(at, 0.012, 'pad', 0.03, friction) for at in places),
        grips=(GripPlace('upper'),),
    )  # fmt: skip
    with stopwatch() as watch:
        model = build_model(bottle, control_vertices=control_vertices)
        fingers = object_contacts(bottle, model)
        solver = EquilibriumSolver(model)
        state = solver.rest()
        for depth, turn in [(1e-4, 0.0), (3e-4, 0.0), *((3e-4, t) for t in BOTTLE_TURNS)]:
            motion = np.zeros((1, 6))
            motion[0, 5] = np.radians(turn)
            case = replace(displaced(fingers, [depth] * len(fingers)), grip_motion=motion)
            state = solver.solve(case, state)
            if not state.converged:
                raise RuntimeError(f'the held bottle has no equilibrium: {state.message}')
        share = friction_share(state.touches, [friction] * len(fingers), np.zeros(3), Z)
    yield Verified(
        'bottle_turned', 'torque [N m] of the neck while all fingers slip', share.capacity,
        'exact sum, mu times pressure times arm', float(state.grip_wrench[0, 5]),
        used_vertices(model), watch.seconds, BOTTLE_GOAL,
    )  # fmt: skip


def problems() -> Iterator[Verified]:
    """All tubes."""
    yield from twisted_tube()
    yield from limit_twist()
    yield from bent_tube()
    for pressure in (0.0, 10e3, 20e3):
        yield from wrinkled_tube(pressure)
    yield from held_bottle()
