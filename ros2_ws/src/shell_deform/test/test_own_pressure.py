# SPDX-License-Identifier: Apache-2.0
"""Shells under their own pressure: followed to it where one step is too long, or told why not."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

from shell_deform.building import build_model
from shell_deform.commands import shell_solve
from shell_deform.live.background.solving import LiveSolver
from shell_deform.objects.shell_object import Gas, ShellObject, Sphere
from shell_deform.solve.first_touch import FirstTouchError, alone
from shell_deform.solve.newton import EquilibriumSolver

RADIUS, WALL, YOUNG, NU = 0.03, 6e-4, 2e6, 0.45
BALL = ShellObject('ball', Sphere(2.0 * RADIUS + WALL), WALL, YOUNG, NU, control_vertices=200)
CLASSICAL = -2.0 * YOUNG * (WALL / RADIUS) ** 2 / np.sqrt(3.0 * (1.0 - NU**2))
"""Pressure at which a sphere buckles (R. Zoelly 1915)."""


def under(pressure, vertices=200):
    ball = replace(BALL, pressure_pa=pressure)
    return EquilibriumSolver(build_model(ball, 'koiter', vertices))


def blown(pressure):
    """Stretch under `pressure` [Pa] of a sphere of linear law in Green strain, with bending."""
    wall, bending = WALL * YOUNG / (1.0 - NU), WALL**2 / (6.0 * RADIUS**2)

    def missing(x):
        return wall * (x * (x**2 - 1.0) + bending * (x - 1.0)) - pressure * RADIUS * x**2

    return brentq(missing, 1.0, 3.0)


@pytest.mark.parametrize('stretch', [1.05, 1.3, 1.6])
def test_a_ball_is_blown_far_by_pressure_that_comes_at_once(stretch):
    pressure = WALL * YOUNG / (1.0 - NU) * (stretch - 1.0 / stretch) / RADIUS
    solver = under(pressure)
    state = alone(solver)
    points = [
        solver.model.surface.limit_positions(p) for p in (state.positions, solver.model.rest)
    ]
    found, before = (np.linalg.norm(one, axis=1).mean() for one in points)
    assert found / before == pytest.approx(blown(pressure), rel=1e-4)
    assert state.gas_pressure == pressure and state.filled == 1.0


def test_a_sphere_stands_what_the_classical_formula_says():
    assert alone(under(0.9 * CLASSICAL, 600)).converged
    with pytest.raises(FirstTouchError, match='it buckles; give less pressure') as told:
        alone(under(3.0 * CLASSICAL, 600))
    stood = float(re.search('stands about (\\S+) Pa', str(told.value)).group(1))
    assert stood == pytest.approx(CLASSICAL, rel=0.05)


def test_a_wall_that_no_pressure_of_that_size_leaves_in_balance_says_what_it_stands():
    """A thick wall of rubber is blown up without end beyond its largest pressure."""
    ball = replace(BALL, thickness_m=4e-3, pressure_pa=1e6)
    with pytest.raises(FirstTouchError, match='stands about .* Pa inside'):
        alone(EquilibriumSolver(build_model(ball, 'thick')))


def test_gas_under_pressure_is_filled_in_along_the_same_way():
    gas = Gas('sealed', gauge_pressure_pa=3e4)
    solver = EquilibriumSolver(build_model(replace(BALL, gas=gas), 'koiter'))
    state = alone(solver)
    model = solver.model
    assert 0.0 < state.gas_pressure < 3e4
    assert model.overpressure(model.shell.volume(state.positions)[0]) == state.gas_pressure


def test_the_live_solver_begins_where_pressure_has_brought_the_shell():
    solver = under(3e4)
    live = LiveSolver(solver.model)
    np.testing.assert_allclose(live.unloaded, alone(solver).positions, atol=1e-9)
    with pytest.raises(FirstTouchError, match='it buckles'):
        LiveSolver(under(3.0 * CLASSICAL).model)


@pytest.fixture
def solve(tmp_path, capsys):
    def run(*options, **changes):
        path = tmp_path / 'object.yaml'
        pins = [{'kind': 'pin', 'at_m': [x, 0, 0], 'radius_m': 2e-3} for x in (0.0305, -0.0305)]
        described = {
            'name': 'ball', 'surface': {'sphere': {'outer_diameter_m': 0.061}},
            'thickness_m': 1e-3, 'young_modulus_pa': 2e6, 'poisson_ratio': 0.45,
            'control_vertices': 200, 'contacts': pins,
        }  # fmt: skip
        path.write_text(yaml.safe_dump({**described, **changes}))
        code = shell_solve.main(['--object', str(path), *options])
        return code, capsys.readouterr().err.strip()

    return run


def test_a_command_says_in_one_sentence_what_pressure_its_object_stands(solve):
    for changes in ({'pressure_pa': -1e6}, {'gas': {'kind': 'sealed', 'gauge_pressure_pa': -1e5}}):
        code, told = solve('--displacement-sweep', '0:0.001:1', **changes)
        assert code == 1 and len(told.splitlines()) == 1
        assert told.startswith('shell_solve: ball: the object alone stands about -')
