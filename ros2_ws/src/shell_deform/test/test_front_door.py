# SPDX-License-Identifier: Apache-2.0
"""`import shell_deform`: what a notebook finds there."""

import subprocess
import sys

import numpy as np
import pytest

import shell_deform
from shell_deform.building import build_model, object_contacts
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver


@pytest.fixture(scope='module')
def ball():
    return shell_deform.load('tennis_ball', theory='koiter', control_vertices=200)


@pytest.fixture(scope='module')
def squeezed(ball):
    return ball.squeeze(displacement=3e-3)


def test_the_import_loads_neither_numpy_nor_numba():
    code = 'import shell_deform, sys; print({"numpy", "numba", "scipy"} & set(sys.modules))'
    said = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert said.stdout == 'set()\n'


def test_everything_promised_is_there_and_documented_and_nothing_else():
    assert dir(shell_deform) == sorted(shell_deform.__all__)
    assert all(getattr(shell_deform, name).__doc__ for name in shell_deform.__all__)
    with pytest.raises(AttributeError, match='no attribute .squash'):
        shell_deform.squash  # noqa: B018


@pytest.mark.parametrize(
    ('name', 'theory'), [('tennis_ball', 'thick'), ('half_soda_can', 'koiter')]
)
def test_where_nobody_chooses_the_wall_takes_the_theory_it_needs_and_tells_why(name, theory):
    shell = shell_deform.load(name, control_vertices=150)
    assert shell.model.theory == theory
    assert str(shell).startswith(f'{name}: {theory} theory (the wall is ')
    assert 'too stiff (limit 2 %)' in shell.model.reason


def test_a_squeeze_is_what_the_parts_behind_it_give(squeezed):
    description = load_object('tennis_ball')
    model = build_model(description, control_vertices=200)
    contacts = object_contacts(description, model)
    state = EquilibriumSolver(model).solve(displaced(contacts, [3e-3, 3e-3]))
    np.testing.assert_allclose(squeezed.contact_force, state.force, rtol=1e-9)
    np.testing.assert_allclose(
        squeezed.points, model.surface.limit_positions(state.positions), atol=1e-12
    )


def test_points_faces_and_displacement_fit_together(ball, squeezed):
    assert squeezed.points.shape == ball.points.shape == squeezed.displacement.shape
    assert squeezed.faces.max() == len(ball.points) - 1
    np.testing.assert_allclose(squeezed.contact_displacement, 3e-3, rtol=1e-9)
    assert squeezed.max_displacement == pytest.approx(3e-3, rel=0.02)
    assert squeezed.stable and squeezed.energy > 0.0


def test_force_and_displacement_meet(ball, squeezed):
    again = ball.squeeze(force=squeezed.contact_force)
    np.testing.assert_allclose(again.contact_displacement, 3e-3, rtol=1e-6)


def test_stresses_are_largest_under_the_pins(squeezed):
    stresses = squeezed.stresses
    worst = stresses.points[np.argmax(stresses.von_mises)]
    apexes = squeezed.points[np.argsort(np.linalg.norm(squeezed.displacement, axis=1))[-6:]]
    assert np.linalg.norm(apexes - worst, axis=1).min() < 8e-3


def test_a_sweep_ends_where_a_single_squeeze_does(ball, squeezed):
    sweep = ball.sweep(displacement=[0.0, 1.5e-3, 3e-3])
    assert len(sweep) == 3 and sweep.contact_force.shape == (3, 2)
    np.testing.assert_allclose(sweep[-1].contact_force, squeezed.contact_force, rtol=1e-6)
    assert [state.max_displacement for state in sweep] == sorted(
        state.max_displacement for state in sweep
    )


@pytest.mark.parametrize('asked', [{}, {'force': 1.0, 'displacement': 1e-3}])
def test_one_of_force_and_displacement_is_asked_for(ball, asked):
    with pytest.raises(shell_deform.SqueezeError, match='exactly one'):
        ball.squeeze(**asked)


def test_as_many_numbers_as_contacts(ball):
    with pytest.raises(shell_deform.SqueezeError, match='2 contacts: give one number or 2'):
        ball.squeeze(force=[1.0, 2.0, 3.0])


def test_a_sweep_that_fails_keeps_what_it_reached(ball):
    with pytest.raises(shell_deform.SqueezeError, match='tennis_ball: no equilibrium') as failed:
        ball.sweep(displacement=[1e-3, 0.2])
    assert len(failed.value.reached) == 1


def test_the_material_can_be_another(ball):
    soft = shell_deform.load(
        'tennis_ball', theory='koiter', control_vertices=200, young_modulus=1e6, gas='none'
    )
    assert soft.squeeze(displacement=1e-3).contact_force[0] < 1.0


def test_a_notebook_shows_the_picture_and_the_warnings(squeezed):
    html = squeezed._repr_html_()
    assert html.startswith('<img alt="tennis_ball: ') and 'data:image/png;base64,' in html
    assert all(f'<p>{warning}</p>' in html for warning in squeezed.warnings)
    assert squeezed.warnings


def test_an_unknown_object_is_refused_in_one_sentence():
    with pytest.raises(shell_deform.ObjectError, match='tenis_ball'):
        shell_deform.load('tenis_ball')


def test_what_a_notebook_echoes_is_a_line_and_no_arrays(ball, squeezed):
    assert repr(ball).startswith('<Shell tennis_ball: koiter theory')
    assert repr(squeezed).startswith('<Squeezed tennis_ball: ')
    assert repr(squeezed.state).startswith('<Equilibrium carried: force [')
    assert max(len(repr(one)) for one in (ball, squeezed, squeezed.state)) < 300
