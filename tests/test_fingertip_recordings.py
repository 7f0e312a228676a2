# SPDX-License-Identifier: Apache-2.0
"""Recorded fingertips: what the node reads of them, and the shell beside the solid."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from grasp_replay.bag_reader import open_bag
from grasp_replay.pipeline import PipelineOptions, run
from grasp_replay.results import document
from shell_deform.building import build_model, object_contacts
from shell_deform.contact.body_file import load_body
from shell_deform.contact.taxels import cell_forces
from shell_deform.live.tick.contact_cloud import ContactReader
from shell_deform.live.tick.touch_check import TouchCells, check_cells
from shell_deform.objects import load_object
from shell_deform.objects.finger_files import find_body
from shell_deform.objects.shell_object import Contact
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver

ROOT = Path(__file__).resolve().parents[1] / 'bags'
BAG = ROOT / 'ball_fingertips'


def body(name: str):
    path = find_body(name, Path.cwd())
    assert path is not None
    return load_body(path)


@pytest.mark.parametrize(
    ('recording', 'count', 'travel', 'turned'),
    [(BAG, 450, 1.2e-3, 0.12), (ROOT / 'bottle_fingertips', 300, 2e-3, 0.0)],
)
def test_contacts_and_cells_of_a_recording_are_what_the_node_takes(
    recording: Path, count: int, travel: float, turned: float
) -> None:
    facts = yaml.safe_load((recording / 'experiment.yaml').read_text())
    tip, reader = body(facts['finger_body']), ContactReader()
    samples, pushes = [], []
    with open_bag(recording) as bag:
        assert not bag.notes
        for message in bag.messages(['/hand/contacts', '/hand/tactile']):
            cloud = bag.decode(message)
            if message.topic == '/hand/contacts':
                samples.append(reader.read(cloud, message.log_time))
                continue
            rows = np.frombuffer(bytes(cloud.data), '<f4').reshape(-1, 3)
            whose = rows[:, :2].astype(int)
            check_cells(TouchCells(message.log_time, *whose.T, rows[:, 2]), {0: tip})
            pushes.append(rows[whose[:, 0] == 1, 2].sum())
    assert len(samples) == len(pushes) == count
    last = samples[-1]
    assert last.travel == pytest.approx(travel)
    assert np.abs(last.along[0, 1]) == pytest.approx(np.sin(turned), rel=1e-6)
    # The cells of a finger together feel what its gauge does, both with their noise.
    push = np.array([np.linalg.norm(sample.force[0]) for sample in samples])
    assert np.abs(push - pushes).max() < 6 * np.hypot(0.1, 0.02 * np.sqrt(24))


def test_a_shell_between_the_fingers_feels_what_the_solid_does() -> None:
    truth = yaml.safe_load((BAG / 'truth.yaml').read_text())
    tip = body('barrett_fingertip')
    ball = load_object(str(BAG / 'object.yaml'))
    model = build_model(ball, control_vertices=300)
    contacts = object_contacts(ball, model)
    solver, state, found = EquilibriumSolver(model), None, []
    states = truth['states'][1::2]
    for kept in states:
        motion = np.zeros((2, 6))
        motion[:, 3] = kept['turn_rad'] * np.array([1.0, -1.0])
        case = replace(displaced(contacts, [kept['depth_m']] * 2), motion=motion)
        state = solver.solve(case, state)
        touch = state.touches[0]
        found.append((state.force[0], touch.moment(touch.pose.origin)[0]))
        cells = -cell_forces(touch, tip.cells)[:, 2]
        assert cells.sum() == pytest.approx(state.force[0], rel=0.02)
        # The loaded cells are the solid's.
        assert np.argmax(cells) == np.argmax(kept['cells_n'])
    push = [-kept['force_n'][0] for kept in states]
    np.testing.assert_allclose([row[0] for row in found], push, rtol=0.03)
    slipped, torque = found[-1][1], truth['states'][-1]['torque_nm'][0]
    assert slipped == pytest.approx(torque, rel=0.15)


def squeezed(depth: float, turn: float, theory: str = 'koiter', **mesh: float):
    """The recorded ball between its fingers, and what the first one touches."""
    ball = load_object(str(BAG / 'object.yaml'))
    model = build_model(ball, theory, **mesh)
    contacts = object_contacts(ball, model)
    solver = EquilibriumSolver(model)
    state = solver.solve(displaced(contacts, [depth] * 2))
    if turn:
        motion = np.zeros((2, 6))
        motion[:, 3] = turn * np.array([1.0, -1.0])
        state = solver.solve(replace(displaced(contacts, [depth] * 2), motion=motion), state)
    assert state.converged
    return state, state.touches[0]


def test_each_cell_feels_the_same_on_a_mesh_of_twice_the_vertices_half_as_large() -> None:
    cells = body('barrett_fingertip').cells
    felt = []
    for mesh in ({'control_vertices': 300}, {'control_vertices': 600, 'refine_radius': 1.1e-3}):
        _, touch = squeezed(1.2e-3, 0.0, **mesh)
        felt.append(-cell_forces(touch, cells)[:, 2])
        np.testing.assert_allclose(felt[-1].sum(), np.linalg.norm(touch.force), rtol=1e-9)
    pressed = felt[1] > 0.02 * felt[1].sum()
    assert pressed.sum() == 3
    np.testing.assert_allclose(felt[0][pressed], felt[1][pressed], rtol=0.03)
    assert np.abs(felt[0] - felt[1]).max() < 0.03 * felt[1].sum()


def missed(contacts: tuple[Contact, ...], push: float, solid: np.ndarray, rest: np.ndarray):
    """Root mean square by which the dent of a pushed ball misses the solid's outer face [m]."""
    ball = replace(load_object(str(BAG / 'object.yaml')), contacts=contacts)
    model = build_model(ball, control_vertices=300)
    state = EquilibriumSolver(model).solve(forced(object_contacts(ball, model), [push] * 2))
    feet = model.surface.closest_point(model.rest, rest)

    def outer(control: np.ndarray) -> np.ndarray:
        at = model.surface.evaluate(control, feet.triangle, feet.parameters)
        return at.position + 0.5 * ball.thickness_m * at.normal

    moved = outer(state.positions) - outer(model.rest)
    return float(np.sqrt(np.mean(np.sum((moved - solid) ** 2, axis=1))))


def test_a_push_where_the_cells_felt_it_dents_as_the_solid_does_and_an_even_one_does_not() -> None:
    kept = yaml.safe_load((BAG / 'truth.yaml').read_text())['states'][3]
    solid = np.load(ROOT / 'solid/ball_fingertips.npz')
    dent = np.linalg.norm(solid['rest_m'] - [0.0325, 0.0, 0.0], axis=1) < 0.012
    rest, moved = (solid[name].astype(float) for name in ('rest_m', 'moved_m'))
    places = load_object(str(BAG / 'object.yaml')).contacts
    felt = tuple(
        replace(one, friction=0.0, finger=replace(one.finger, cells_n=tuple(kept['cells_n'])))
        for one in places
    )
    even = tuple(Contact(one.at_m, 7.55e-3, 'pin') for one in places)
    by_cells, by_pin = (
        missed(contacts, -kept['force_n'][0], moved[3, dent], rest[dent])
        for contacts in (felt, even)
    )
    assert by_cells < 4e-5
    assert by_pin > 8e-5


def test_a_wall_that_shears_carries_the_tip_as_the_solid_does() -> None:
    kept = yaml.safe_load((BAG / 'truth.yaml').read_text())['states'][-1]
    state, touch = squeezed(kept['depth_m'], kept['turn_rad'], 'thick', control_vertices=300)
    assert state.force[0] == pytest.approx(-kept['force_n'][0], rel=0.02)
    torque = touch.moment(touch.pose.origin)[0]
    assert torque == pytest.approx(kept['torque_nm'][0], rel=0.06)


def test_the_solid_bottle_is_pushed_on_by_its_cells_within_friction() -> None:
    kept = json.loads((ROOT / 'solid/bottle_fingertips.json').read_text())
    inward = -np.array(kept['normal'])
    before = 0.0
    for state in kept['states']:
        force, cells = np.array(state['force_n']), np.array(state['cells_n'])
        push = force @ inward
        assert push > before
        before = push
        along = np.linalg.norm(force - push * inward)
        assert along < kept['friction'] * push
        assert cells.sum() == pytest.approx(push, rel=0.02)
        # Both halves of the finger feel the same.
        np.testing.assert_allclose(cells.reshape(-1, 3), cells.reshape(-1, 3)[:, ::-1])


@pytest.mark.soak
def test_a_shell_of_the_bottle_feels_what_its_solid_does() -> None:
    kept = json.loads((ROOT / 'solid/bottle_fingertips.json').read_text())
    bottle = load_object(str(ROOT / 'bottle_fingertips/object.yaml'))
    model = build_model(bottle)
    contacts = object_contacts(bottle, model)
    solver, state = EquilibriumSolver(model), None
    for solid in kept['states']:
        state = solver.solve(displaced(contacts, [solid['depth_m']] * 3), state)
        assert state.converged
        push = -np.array(solid['force_n']) @ kept['normal']
        assert state.force.mean() == pytest.approx(push, rel=0.05)


@pytest.mark.soak
def test_the_report_of_a_squeeze_presses_where_its_cells_felt_it() -> None:
    (row,) = document(run(BAG, PipelineOptions()), [])['rows']
    touch, theories = row['grasp']['touch'], row['theories']
    assert touch['suspect'] == ''
    assert [one['finger'] for one in touch['fingers']] == [1, 2]
    for one in touch['fingers']:
        assert sum(one['expected_cells_n']) == pytest.approx(row['force_n'], rel=0.02)
    assert theories['koiter']['mean_error_m'] < 1.05 * row['noise_floor_m']
    assert 'touch cells' in theories['thick']['message']
    assert 'lies where its touch cells felt it' in row['notes'][0]


def test_the_solid_holds_what_turns_until_friction_is_used_up() -> None:
    states = json.loads((ROOT / 'solid/ball_fingertips.json').read_text())['states']
    torque = np.array([state['torque_nm'][0] for state in states])
    turning = torque[4:]
    assert turning[0] < 0.75 * turning[-1]
    assert np.ptp(turning[-3:]) < 0.005 * turning[-1]
