# SPDX-License-Identifier: Apache-2.0
"""A thick wall that cannot be: typed results with the place and the last good state, never NaN."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import shell_deform
from shell_deform.assemble.stamps import WallError
from shell_deform.assemble.thick import thick_shell
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.objects import ShellObject, load_object
from shell_deform.objects.shell_object import Contact, Ellipsoid, Revolution
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.material import Material

THICKNESS = 2.5e-3


@pytest.fixture(scope='module')
def mesh():
    return build_model(load_object('tennis_ball'), control_vertices=100).shell.mesh


@pytest.fixture(scope='module')
def shell(mesh):
    return thick_shell(mesh, Material(1e6, 0.49), THICKNESS, everywhere=True)


@pytest.mark.parametrize('share', [2.05, 3.0])
def test_a_wall_thicker_than_twice_the_radius_is_refused_with_its_place(mesh, share):
    radius = float(np.linalg.norm(mesh.vertices, axis=1).mean())
    with pytest.raises(WallError, match=r'centre of curvature.* at \[.*thinner wall'):
        thick_shell(mesh, Material(1e6, 0.49), share * radius)


@pytest.mark.parametrize(
    'surface',
    [
        Ellipsoid((0.06, 0.06, 0.008)),
        Ellipsoid((0.1, 0.014, 0.014)),
        Revolution(((0.02, -0.03), (0.003, 0.0), (0.02, 0.03))),
    ],
    ids=['lens', 'needle', 'waist'],
)
def test_a_wall_that_is_thicker_than_a_part_of_it_is_round_is_refused(surface):
    """Its inner face would pass through itself, and no load leads anywhere from there."""
    described = ShellObject('sharp', surface, 4e-3, 1e6, 0.45)
    with pytest.raises(WallError, match=r'the wall of 4 mm .*centre of curvature.*thinner wall'):
        build_model(described, 'thick', control_vertices=120)


def test_a_wall_turned_inside_out_says_where(shell):
    """One control point pulled far through the ball: there the wall has no equilibrium."""
    state = shell.start.copy()
    state[0] = -1.5 * state[0]
    energy, gradient = shell.gradient('thick', state)
    if np.isfinite(energy):
        assert np.all(np.isfinite(gradient))
        return
    place = shell.lost_place(state)
    assert place is not None
    assert np.linalg.norm(place - shell.mesh.vertices[0]) < 0.03


@pytest.mark.parametrize(
    ('wall', 'told'),
    [(4.5e-3, 'beside solids its force is up to'), (0.02, 'no solid was compared with a wall')],
)
def test_a_wall_that_is_thick_for_theory_thick_too_is_told(wall, told):
    ball = shell_deform.load('tennis_ball', thickness=wall, gas='none', control_vertices=100)
    assert ball.model.theory == 'thick'
    squeezed = ball.squeeze(displacement=1e-4)
    assert any(told in sentence for sentence in squeezed.warnings)


def test_a_lens_with_a_rim_sharper_than_its_wall_is_thin_and_says_why():
    lens = ShellObject(
        'lens', Ellipsoid((0.065, 0.065, 0.012)), 4e-3, 1e6, 0.49,
        contacts=tuple(Contact((0.0, 0.0, z), 1e-3, 'pin') for z in (0.006, -0.006)),
    )  # fmt: skip
    model = build_model(lens, 'auto', control_vertices=120)
    assert model.theory == 'koiter'
    assert 'it reaches its centre of curvature' in model.reason


def test_states_of_a_sweep_can_be_read_out_after_it_has_gone_on():
    """Beyond four walls the shear reaches further: another discretisation, not of these states."""
    ball = shell_deform.load('tennis_ball', theory='thick', control_vertices=100)
    first, last = ball.sweep(displacement=[1e-3, 11e-3])
    assert len(first.state.unknowns) < len(last.state.unknowns)
    for state in (first, last):
        assert np.isfinite(state.outer_points).all()
        assert np.isfinite(state.stresses.von_mises).all()


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-6, 2.0), shear=st.floats(0.0, 20.0))
def test_any_state_has_an_energy_or_a_place_where_it_has_none(shell, seed, size, shear):
    rng = np.random.default_rng(seed)
    n = len(shell.mesh.vertices)
    state = shell.start.copy()
    state[:n] *= 1.0 + size * rng.normal(size=(n, 3))
    state[n:, :2] = shear * THICKNESS * rng.normal(size=(len(state) - n, 2))
    energy, gradient = shell.gradient('thick', state)
    if np.isfinite(energy):
        assert np.all(np.isfinite(gradient))
        assert shell.lost_place(state) is None
    else:
        assert np.all(np.isnan(gradient))
        assert np.linalg.norm(shell.lost_place(state)) == pytest.approx(0.03125, rel=0.02)


def test_a_travel_that_no_wall_can_take_ends_with_the_last_good_state():
    """Two pins driven towards each other, beyond the middle of the ball."""
    ball = with_material(load_object('tennis_ball'), young_modulus=1e6, poisson_ratio=0.49,
                         gas_kind='none')  # fmt: skip
    model = build_model(ball, 'thick', control_vertices=200)
    pins = object_contacts(ball, model, 2e-3)
    solver = EquilibriumSolver(model)
    good = solver.solve(displaced(pins, [1e-3, 1e-3]))
    lost = solver.solve(displaced(pins, [80e-3, 80e-3]), good)
    assert good.converged
    for state in (good, lost):
        assert np.all(np.isfinite(state.positions)) and np.all(np.isfinite(state.force))
        assert np.isfinite(state.energy)
    assert not lost.converged
    assert lost.message and 0.0 <= lost.load_fraction < 1.0
    assert np.all(lost.displacement >= 1e-3 - 1e-9)
