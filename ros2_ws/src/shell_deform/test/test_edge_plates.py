# SPDX-License-Identifier: Apache-2.0
"""Plates on open edges: a can or cup crushed along its axis."""

import json

import numpy as np
import pytest
import yaml

from shell_deform.building import build_model, object_contacts
from shell_deform.commands import shell_solve
from shell_deform.objects import Contact, GripPlace, ObjectError, ShellObject, load_object
from shell_deform.objects.shell_object import Cylinder
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.first_touch import first_touch
from shell_deform.solve.newton import EquilibriumSolver

RADIUS, LENGTH, WALL, YOUNG = 0.02, 0.06, 1e-3, 2e9
LOWER = GripPlace('lower')
STIFFNESS = YOUNG * 2.0 * np.pi * RADIUS * WALL / LENGTH


def can(*contacts, grips=(LOWER,), vertices=300):
    described = ShellObject(
        'can', Cylinder(2 * RADIUS + WALL, LENGTH, 'open'), WALL, YOUNG, 0.3,
        contacts=contacts, grips=grips,
    )  # fmt: skip
    model = build_model(described, control_vertices=vertices)
    return EquilibriumSolver(model), object_contacts(described, model)


def plate(height=0.5 * LENGTH, towards=(0.0, 0.0, -1.0), radius=0.05, friction=0.0):
    return Contact((0.0, 0.0, height), radius, 'plate', friction=friction, towards=towards)


def test_a_plate_on_the_edge_feels_the_wall_along_its_axis():
    solver, contacts = can(plate())
    state = solver.solve(displaced(contacts, [5e-5]))
    assert state.converged, state.message
    assert state.force[0] == pytest.approx(STIFFNESS * 5e-5, rel=0.01)
    np.testing.assert_allclose(state.grip_wrench[0, 2], state.force[0], rtol=1e-4)


def test_two_plates_crush_it_from_both_ends():
    solver, contacts = can(
        plate(friction=0.3), plate(-0.5 * LENGTH, (0.0, 0.0, 1.0), friction=0.3), grips=()
    )
    state = solver.solve(displaced(contacts, [5e-5, 5e-5]))
    assert state.converged, state.message
    np.testing.assert_allclose(state.force, STIFFNESS * 1e-4, rtol=0.015)


def test_a_force_on_the_plate_is_carried():
    solver, contacts = can(plate())
    state = solver.solve(forced(contacts, [100.0]))
    assert state.converged, state.message
    assert state.displacement[0] == pytest.approx(100.0 / STIFFNESS, rel=0.01)


def test_a_plate_starts_where_it_first_touches_the_edge():
    solver, contacts = can(plate(height=0.1))
    assert contacts[0].body.origin[2] == pytest.approx(0.5 * LENGTH, abs=1e-5)
    assert first_touch(solver, contacts)[1][0] == pytest.approx(0.0, abs=1e-9)


def test_a_tilted_plate_presses_one_side_and_never_pulls():
    tilt = np.radians(2.0)
    way = (np.sin(tilt), 0.0, -np.cos(tilt))
    solver, contacts = can(plate(height=0.1, towards=way))
    state = solver.solve(displaced(contacts, [2e-5]))
    assert state.converged, state.message
    (touch,) = state.touches
    assert (touch.pressure >= 0.0).all()
    # What looks up the slope is the side at -x.
    assert (touch.face.position[touch.pressure > 0.0, 0] < 0.0).all()


@pytest.mark.parametrize(
    ('contact', 'said'),
    [
        (plate(height=0.0), 'starts 0.03 m inside'),
        (plate(radius=0.01), 'misses the object'),
    ],
)
def test_a_plate_that_cannot_be_there_is_refused(contact, said):
    with pytest.raises(ObjectError, match=f'contact 1: the plate {said}'):
        can(contact)


CUP = {
    'name': 'cup', 'surface': {'cone': {'outer_diameters_m': [0.05, 0.07], 'length_m': 0.08}},
    'thickness_m': 5e-4, 'young_modulus_pa': 2e9, 'poisson_ratio': 0.35, 'control_vertices': 300,
    'supports': [{'kind': 'hinged', 'where': 'lower'}],
}  # fmt: skip
RIM = {'kind': 'plate', 'at_m': [0, 0, 0.05], 'towards': [0, 0, -1], 'radius_m': 0.05}


def test_a_cup_is_crushed_from_its_object_file(tmp_path, capsys):
    path = tmp_path / 'cup.yaml'
    path.write_text(yaml.safe_dump({**CUP, 'contacts': [RIM]}))
    assert shell_solve.main(
        ['--object', str(path), '--displacement-sweep', '0:4e-5:2', '--json']
    ) == 0  # fmt: skip
    forces = [point['force_n'] for point in json.loads(capsys.readouterr().out)['points']]
    assert forces[0] == pytest.approx(0.0, abs=1e-6)
    # A cone's membrane: d = F ln(r2 / r1) / (2 pi E h sin a cos^2 a), its edges free to give way.
    slope = np.arctan2(0.01, 0.08)
    exact = 2 * np.pi * 2e9 * 5e-4 * np.sin(slope) * np.cos(slope) ** 2 / np.log(0.07 / 0.05)
    assert forces[2] == pytest.approx(exact * 4e-5, rel=0.15)


@pytest.mark.parametrize('missing', ['towards', 'radius_m'])
def test_a_plate_says_what_it_lacks(tmp_path, missing):
    entry = {key: value for key, value in RIM.items() if key != missing}
    path = tmp_path / 'cup.yaml'
    path.write_text(yaml.safe_dump({**CUP, 'contacts': [entry]}))
    with pytest.raises(ObjectError, match=f'a plate needs {missing}'):
        load_object(path)
