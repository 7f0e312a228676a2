# SPDX-License-Identifier: Apache-2.0
"""Grasps beside CalculiX solids: where the normals under the pins turn, and how a map ranks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline
from scipy.stats import spearmanr

import shell_deform.verification
from shell_deform.building import build_model
from shell_deform.grasp.capacity import DIRECTIONS, force_capacities
from shell_deform.grasp.contacts import UNIFORM_ARM, contacts
from shell_deform.grasp.mapping import MapRequest, map_grasp
from shell_deform.grasp.reading import outer_feet
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

SOLIDS = json.loads(
    (Path(shell_deform.verification.__file__).parent / 'solid_grasps.json').read_text()
)
"""Quarters of a ball between pins off its axis, made by `bags/solid_grasps.py`."""
MIDDLE = SOLIDS['outer_radius_m'] - 0.5 * SOLIDS['thickness_m']
PIN = SOLIDS['pin_radius_m']


def _ball():
    ball = load_object('tennis_ball')
    return replace(
        ball,
        contacts=(),
        young_modulus_pa=SOLIDS['young_modulus_pa'],
        solid_young_modulus_pa=SOLIDS['young_modulus_pa'],
        poisson_ratio=SOLIDS['poisson_ratio'],
        gas=replace(ball.gas, kind='none'),
    )


def _leans(theory, lean, depths):
    """Mean angle [degrees] of both normals to the line of the pins at depths (d,) [m]."""
    at = MIDDLE * np.array([[np.cos(lean), np.sin(lean), 0.0], [-np.cos(lean), np.sin(lean), 0.0]])
    model = build_model(_ball(), theory, refine_at=at, refine_radius=PIN)
    axes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    pins = tuple(model.contact(p, PIN, axis=a) for p, a in zip(at, axes, strict=True))
    solver, feet, state, found = EquilibriumSolver(model), outer_feet(model, pins), None, []
    for depth in depths:
        state = solver.solve(displaced(pins, [depth, depth]), state)
        assert state.converged
        normal = feet.at(state.positions)[1]
        found.append(np.degrees(np.arctan2(-normal[:, 1], np.abs(normal[:, 0]))).mean())
    return np.array(found)


@pytest.mark.soak
@pytest.mark.timeout(900)
@pytest.mark.parametrize('degrees', [25, 15])
def test_normals_under_pins_of_a_thick_wall_are_within_a_degree_of_the_solid(degrees):
    solid = next(one for one in SOLIDS['deep'] if one['name'] == f'deep_rigid_{degrees}')
    depths = np.arange(1e-3, min(solid['levels'][-1]['outer_depth_m'], 10.01e-3), 1e-3)
    assert len(depths) >= 8
    truth = CubicSpline(
        [0.0] + [level['outer_depth_m'] for level in solid['levels']],
        [float(degrees)] + [np.degrees(level['leans_rad']) for level in solid['levels']],
    )(depths)
    told = _leans('thick', solid['lean_rad'], depths)
    print(degrees, 'solid', np.round(truth, 2), 'thick', np.round(told, 2))
    assert np.abs(told - truth)[1:].max() < 1.0


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_a_map_ranks_as_the_solids_do(tmp_path):
    file = tmp_path / 'ball.yaml'
    file.write_text(
        yaml.safe_dump(
            {
                'name': 'ball_without_air',
                'surface': {'sphere': {'outer_diameter_m': 2.0 * SOLIDS['outer_radius_m']}},
                'thickness_m': SOLIDS['thickness_m'],
                'young_modulus_pa': SOLIDS['young_modulus_pa'],
                'poisson_ratio': SOLIDS['poisson_ratio'],
                'gas': {'kind': 'none'},
                'control_vertices': 640,
            }
        )
    )
    request = MapRequest(str(file), depth=2e-3)
    told, truth = [], []
    for solid in SOLIDS['mapped']:
        grasp = map_grasp(request, int(solid['name'].split('_')[1]))
        told.append(grasp['worst_capacity_n'])
        truth.append(_worst(solid, np.array(grasp['at_m']), np.array(grasp['axis']), request))
    order = spearmanr(told, truth).statistic
    print(len(told), 'solids', order, np.median(np.array(told) / truth))
    assert len(told) == 50
    assert order >= 0.95


def _worst(solid, at, axis, request):
    """The least of 26 capacities [N] by the push, points and normals of a solid."""
    depth = [level['depth_m'] for level in solid['levels']]

    def there(values):
        return np.polyval(np.polyfit(depth, values, 2), request.depth)

    levels = solid['levels']
    push = there([level['force_n'] for level in levels])
    lean = there([level['leans_rad'] for level in levels])
    x, y = (there([level['contact_m'][i] for level in levels]) for i in (0, 1))
    out = -axis[0]
    middle = at.mean(axis=0)
    side = middle - (middle @ out) * out
    side /= np.linalg.norm(side)
    signs = np.array([1.0, -1.0])[:, None]
    normal = -(signs * np.cos(lean) * out + np.sin(lean) * side)
    force = -signs * push * out
    grasp = contacts(
        signs * x * out + y * side, normal, np.einsum('ki,ki->k', force, normal),
        request.friction, UNIFORM_ARM * request.pin_radius, force,
    )  # fmt: skip
    return force_capacities(grasp, DIRECTIONS, np.zeros(3))[0].min()
