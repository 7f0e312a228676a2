# SPDX-License-Identifier: Apache-2.0
"""Theory `thick` beside a solid: forces and outer faces of balls under two rigid pins.

The solid's own modulus and Poisson's ratio are given to the shell and nothing is fitted. Both are
driven to the same travel of the pins; faces are compared along the normal, beyond the pins. One
solid is of a Mooney-Rivlin rubber of the same E: it tells what the law costs, and is not scored.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from shell_deform.building import build_model, object_contacts
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.theory import THICK
from shell_deform.verification.problem import Verified, stopwatch
from shell_deform.verification.spheres import pinched_sphere

Array = NDArray[np.float64]

FACE_GOALS = {25.0: 0.01e-3, 12.5: 0.031e-3, 8.0: 0.09e-3, 6.0: 0.12e-3}
"""95th percentile of the distance of the outer faces over their area [m], by R/h."""

SMALL_TRAVEL = 0.5e-3
"""Below it a stamp's edge field, which no shell has, is a larger share of the force [m]."""

DEEPEST = 6.0
"""Dents of more walls than this only inform: their ridge lies beyond the shear near the pin, and
on the coarse part of the mesh."""

FORCE_GOALS = {
    25.0: (0.011, 0.011), 12.5: (0.036, 0.021), 8.0: (0.036, 0.036), 6.0: (0.077, 0.077),
}  # fmt: skip
"""Relative error of the force at small travel and above, by R/h: limits of the theory itself."""


@cache
def kept_solids() -> dict[str, Any]:
    """The kept solid solutions: `source`, and `balls` with travel, force and outer face, SI."""
    text = resources.files(__package__).joinpath('solid_faces.json').read_text()
    found: dict[str, Any] = json.loads(text)
    return found


def problems(control_vertices: int = 650) -> Iterator[Verified]:
    """Force and face at every kept travel of every ball."""
    for ball in kept_solids()['balls']:
        yield from _ball(ball, control_vertices)


def name_of(ball: dict[str, Any]) -> str:
    """The name of a kept ball's rows."""
    name = f'thick_ball_rh_{ball["radius_over_thickness"]:g}_pin_{1e3 * ball["pin_radius_m"]:g}mm'
    return name + ('_mooney_rivlin' if ball['mooney_share'] else '')


def goals(ball: dict[str, Any], travel: float) -> tuple[float | None, float | None]:
    """Largest error of force [-] and face [m] at a travel [m]; None where a row only informs."""
    if ball['mooney_share'] or travel >= DEEPEST * ball['thickness_m']:
        return None, None
    ratio = ball['radius_over_thickness']
    small, large = FORCE_GOALS[ratio]
    return small if travel < SMALL_TRAVEL else large, FACE_GOALS[ratio]


def _ball(ball: dict[str, Any], control_vertices: int) -> Iterator[Verified]:
    name, source = name_of(ball), kept_solids()['source']
    sphere = pinched_sphere(
        ball['middle_radius_m'], ball['thickness_m'], ball['young_modulus_pa'],
        ball['poisson_ratio'], ball['pin_radius_m'], control_vertices,
    )  # fmt: skip
    model = build_model(sphere, THICK)
    pins = object_contacts(sphere, model)
    solver = EquilibriumSolver(model)
    state = solver.rest()
    for level in ball['levels']:
        travel = level['travel_m']
        with stopwatch() as watch:
            state = solver.solve(displaced(pins, [travel] * len(pins)), state)
        force_goal, face_goal = goals(ball, travel)
        at = f'at {1e3 * travel:.2f} mm'
        force = float(state.force.mean()) if state.converged else np.nan
        yield Verified(
            name, f'force {at} [N]', level['force_n'], source, force, len(model.rest),
            watch.seconds, force_goal,
        )  # fmt: skip
        distance, area = face_distance(solver.model, state.unknowns, ball, level)
        yield Verified(
            name, f'outer face {at}, 95th percentile [m]', 0.0, source,
            area_quantile(distance, area, 0.95), len(model.rest), watch.seconds,
            face_goal,
        )  # fmt: skip


def face_distance(
    model: ShellModel, unknowns: Array, ball: dict[str, Any], level: dict[str, Any]
) -> tuple[Array, Array]:
    """(v,) distance [m] of the shell's outer face from the solid's, beyond the pins; (v,) areas.

    The meridian of the solid is a spline through its kept nodes; pins lie on the ball's axis.
    """
    axis = model.shell.stamps[0].axis  # type: ignore[attr-defined]  # a thick shell has them
    rest, now = model.shell.outer_face(model.start), model.shell.outer_face(unknowns)
    height, radius = np.abs(now @ axis), np.linalg.norm(now - np.outer(now @ axis, axis), axis=1)
    arc = np.array(ball['arc_m'])
    fine = np.linspace(0.0, arc[-1], 6000)
    meridian = CubicSpline(arc, np.array(level['face_m']))(fine)
    off_axis = np.linalg.norm(rest - np.outer(rest @ axis, axis), axis=1)
    beyond = off_axis > 1.02 * ball['pin_radius_m']
    distance, _ = cKDTree(meridian).query(np.column_stack([radius, height])[beyond])
    return np.asarray(distance), vertex_areas(model.shell.mesh)[beyond]


def vertex_areas(mesh: ControlMesh) -> Array:
    """(n,) a third of the triangles around each control vertex [m^2]."""
    corners = mesh.vertices[mesh.triangles[mesh.active]]
    sides = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 6.0
    shares = np.repeat(area, 3)
    corner = mesh.triangles[mesh.active].ravel()
    return np.bincount(corner, weights=shares, minlength=len(mesh.vertices)).astype(float)


def area_quantile(values: Array, area: Array, share: float) -> float:
    """The value below which lies `share` of the area."""
    order = np.argsort(values)
    below = np.cumsum(area[order]) / area.sum()
    return float(values[order][np.searchsorted(below, share)])
