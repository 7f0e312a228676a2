# SPDX-License-Identifier: Apache-2.0
"""The stress that begins a dent, beside an elastic solid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.building import build_model
from shell_deform.grasp.reading import read_wall
from shell_deform.objects import load_object
from shell_deform.readout import read_out, von_mises
from shell_deform.solve.equilibrium import forced
from shell_deform.solve.newton import EquilibriumSolver

RADIUS, WALL, PIN, FORCE = 31.25e-3, 0.625e-3, 2e-3, 20.0
SOLID_OUTER, SOLID_INNER = 35.72e6, 20.30e6
"""Largest von Mises stress at both faces of an aluminium ball of R/h 50 under 20 N spread evenly
over two opposite pins: CalculiX 2.20, CAX8R, by the deck of `bags/axisymmetric.py` with
E 70 GPa, nu 0.33, `pin='traction'`, nine elements under the pin, six through the wall, stress
carried from the Gauss points to the faces."""


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_a_wall_yields_where_the_solid_does_once_the_mesh_resolves_the_pin():
    ball = load_object('tennis_ball')
    ball = replace(
        ball,
        contacts=(),
        thickness_m=WALL,
        young_modulus_pa=70e9,
        poisson_ratio=0.33,
        gas=replace(ball.gas, kind='none'),
    )
    at = RADIUS * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    stress = {}
    for vertices in (650, 4000):
        model = build_model(ball, control_vertices=vertices, refine_at=at)
        pins = tuple(model.contact(point, PIN, axis=-point / RADIUS) for point in at)
        state = EquilibriumSolver(model).solve(forced(pins, np.full(2, FORCE)))
        assert state.converged
        faces = read_out(model, state.positions)
        stress[vertices] = [
            float(von_mises(face).max()) for face in (faces.outer_stress, faces.inner_stress)
        ]
        assert read_wall(model, state.positions).stress == max(stress[vertices])
    assert stress[4000] == pytest.approx([SOLID_OUTER, SOLID_INNER], rel=0.05)
    # The documentation warns of it: a mesh coarser than the pin misses most of the stress.
    assert stress[650][0] < 0.5 * SOLID_OUTER
