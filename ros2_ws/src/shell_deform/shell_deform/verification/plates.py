# SPDX-License-Identifier: Apache-2.0
"""A hollow sphere between two rigid plates: the pads against a solid with contact."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from shell_deform.building import build_model, object_contacts
from shell_deform.objects import ShellObject
from shell_deform.objects.shell_object import Contact, Sphere
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.verification.problem import Verified, stopwatch

# The plates' rim, in middle radii: never reached.
RIM = 0.8
# The first touch, shallower than this share of the wall, crushes a solid and not a shell.
FIRST_TOUCH = 0.2
GOAL = 0.015


def kept_solution(name: str = 'solid_plates') -> dict[str, Any]:
    """The solid's solution, see `bags/solid_plates.py`."""
    return dict(json.loads((Path(__file__).parent / f'{name}.json').read_text()))


def squeezed_sphere(kept: dict[str, Any]) -> ShellObject:
    """The sphere of the kept solution between two flat pads."""
    radius, wall = kept['middle_radius_m'], kept['thickness_m']
    outer = radius + 0.5 * wall
    return ShellObject(
        'sphere between plates', Sphere(2.0 * outer), wall, kept['young_modulus_pa'],
        kept['poisson_ratio'],
        contacts=tuple(Contact((0.0, 0.0, z), RIM * radius, 'pad') for z in (outer, -outer)),
    )  # fmt: skip


def problems(control_vertices: int = 1000) -> Iterator[Verified]:
    """Force at each depth of the kept solution."""
    kept = kept_solution()
    ball = squeezed_sphere(kept)
    with stopwatch() as watch:
        model = build_model(ball, control_vertices=control_vertices)
        contacts = object_contacts(ball, model)
        cases = [displaced(contacts, [depth, depth]) for depth in kept['depth_m']]
        states = EquilibriumSolver(model).sweep(cases)
    for depth, force, state in zip(kept['depth_m'], kept['force_n'], states, strict=True):
        touching = depth < FIRST_TOUCH * kept['thickness_m']
        yield Verified(
            'sphere_between_plates', f'force at {1e3 * depth:g} mm', force, kept['source'],
            float(state.force[0]), len(model.rest), watch.seconds / len(states),
            None if touching else GOAL,
        )  # fmt: skip
