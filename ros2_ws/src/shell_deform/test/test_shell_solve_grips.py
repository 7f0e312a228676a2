# SPDX-License-Identifier: Apache-2.0
"""shell_solve with grips, a filling and a pressure, as its user meets it."""

import json

import numpy as np
import pytest
import yaml

from shell_deform.building import build_model
from shell_deform.commands import shell_solve
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import gripped
from shell_deform.solve.newton import EquilibriumSolver

RADIUS, LENGTH, WALL, YOUNG = 0.02, 0.12, 1e-3, 2e9
TUBE = {
    'name': 'tube',
    'surface': {
        'cylinder': {'outer_diameter_m': 2 * RADIUS + WALL, 'length_m': LENGTH, 'ends': 'open'}
    },
    'thickness_m': WALL,
    'young_modulus_pa': YOUNG,
    'poisson_ratio': 0.3,
    'control_vertices': 400,
}
LOWER = {'kind': 'grip', 'where': 'lower'}
UPPER = {'kind': 'grip', 'where': 'upper', 'free': ['z']}


@pytest.fixture
def solve(tmp_path, capsys):
    def run(*options, contacts=(LOWER, UPPER), **changes):
        path = tmp_path / 'object.yaml'
        path.write_text(yaml.safe_dump({**TUBE, 'contacts': list(contacts), **changes}))
        code = shell_solve.main(['--object', str(path), '--json', *options])
        told = capsys.readouterr()
        return code, json.loads(told.out) if told.out else None, told.err.strip()

    return run


def test_a_twist_tells_turn_torque_and_shortening_of_every_grip(solve):
    code, result, _ = solve('--twist', '0:2:2')
    assert code == 0
    last = result['points'][-1]
    lower, upper = last['grips']
    assert last['twist_rad'] == pytest.approx(np.radians(2.0))
    torque = YOUNG / 2.6 * 2 * np.pi * RADIUS**3 * WALL * np.radians(2.0) / LENGTH
    assert upper['torque_nm'][2] == pytest.approx(torque, rel=0.01)
    assert lower['torque_nm'][2] == pytest.approx(-torque, rel=0.01)
    assert upper['force_n'] == pytest.approx([0, 0, 0], abs=1e-4)
    assert upper['shift_m'][2] < 0.0 and last['stable'] is True


def test_a_bend_tells_its_moment(solve):
    free = {**UPPER, 'free': ['x', 'z']}
    code, result, _ = solve('--bend', '0:0.5:1', '--about', '0,1,0', contacts=(LOWER, free))
    assert code == 0
    moment = result['points'][-1]['grips'][1]['torque_nm']
    # The clamps keep the ends round, which stiffens a short tube a little.
    beam = YOUNG * np.pi * RADIUS**3 * WALL * np.radians(0.5) / LENGTH
    assert moment[1] == pytest.approx(beam, rel=0.03)


def test_an_axial_force_on_a_free_grip_stretches_the_tube(solve):
    code, result, _ = solve('--twist', '0:0:1', '--axial', '-50')
    assert code == 0
    upper = result['points'][-1]['grips'][1]
    shortened = -50 * LENGTH / (YOUNG * 2 * np.pi * RADIUS * WALL)
    assert upper['force_n'][2] == pytest.approx(-50.0, rel=1e-6)
    assert upper['shift_m'][2] == pytest.approx(shortened, rel=0.02)


def test_all_grips_turned_together_cost_no_energy(solve):
    code, result, _ = solve('--turn', '0:180:2', '--about', '1,0,0')
    assert code == 0
    assert max(point['energy_j'] for point in result['points']) < 1e-12


def test_contacts_press_while_a_grip_turns(solve):
    pin = {'at_m': [RADIUS + WALL / 2, 0.0, 0.0], 'radius_m': 4e-3}
    code, result, _ = solve('--twist', '0:1:1', '--force', '5', contacts=(LOWER, UPPER, pin))
    assert code == 0
    lower, upper = result['points'][-1]['grips']
    # The pin pushes along -x and stays where it is across its axis.
    assert lower['force_n'][0] + upper['force_n'][0] == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize(
    ('options', 'contacts', 'said'),
    [
        (['--pull', '0:0.001:1'], (LOWER, UPPER), 'free along the line'),
        (['--twist', '0:1:1', '--grip', 'neck'], (LOWER, UPPER), 'its grips are lower, upper'),
        (['--bend', '0:1:1', '--about', '0,0,1'], (LOWER, UPPER), 'one across it'),
        (['--force', '1'], (LOWER, UPPER), 'no other contacts'),
        ([], (LOWER, UPPER), 'say what is to happen'),
        (['--axial', '3'], (LOWER, UPPER), 'go with --twist'),
        (['--twist', '0:1:1'], (LOWER, LOWER), 'hold the same part'),
        (['--twist', '0:1:1'], (LOWER, {'kind': 'grip', 'where': 'z=0.01'}), '0 vertices'),
        (['--twist', '0:1:1'], (LOWER, {**UPPER, 'hold': 'hinged', 'free': ['z', 'z']}), 'twice'),
        (
            ['--twist', '0:1:1'],
            (LOWER, {'kind': 'grip', 'at_m': [0.1, 0, 0], 'radius_m': 1e-2}),
            'away from the object',
        ),
        (
            ['--twist', '0:1:1'],
            (LOWER, {'kind': 'grip', 'radius_m': 0.01}),
            'where: …, or a patch',
        ),
        (['--twist', '0:1:1'], ({'at_m': [RADIUS, 0, 0]},), 'nothing holds it'),
    ],
)
def test_what_no_grip_can_do_is_refused_in_one_sentence(solve, options, contacts, said):
    code, _, error = solve(*options, contacts=contacts)
    assert code == 1
    assert said in error.splitlines()[-1]


def test_grips_that_tear_the_tube_apart_leave_the_rows_before(solve):
    code, result, error = solve('--pull', '0:0.24:4', contacts=(LOWER, {**UPPER, 'free': []}))
    assert code == 1
    assert 1 <= len(result['points']) < 5
    last = error.splitlines()[-1]
    assert 'tear the object apart' in last or 'no equilibrium at a pull' in last


@pytest.mark.parametrize('value', ['nan:1:2', '0:inf:2', '0:1', '0:1:0'])
def test_a_pose_that_is_no_number_is_a_usage_error(solve, value):
    with pytest.raises(SystemExit) as stop:
        solve('--twist', value)
    assert stop.value.code == 2


BOTTLE = {
    'cylinder': {'outer_diameter_m': 2 * RADIUS + WALL, 'length_m': LENGTH, 'ends': 'closed'}
}
PINS = tuple({'at_m': [side * (RADIUS + WALL / 2), 0, 0], 'radius_m': 4e-3} for side in (1, -1))


def test_a_liquid_keeps_its_volume_and_pushes_back(solve):
    forces = {}
    for filling in ('none', 'sealed', 'liquid'):
        changes = {'surface': BOTTLE, 'gas': {'kind': filling}, 'contacts': PINS}
        code, result, error = solve('--displacement-sweep', '0:0.002:2', **changes)
        assert code == 0, error
        forces[filling] = result['points'][-1]['force_n']
    assert forces['none'] < forces['sealed'] < forces['liquid']


def test_a_liquid_in_an_open_tube_is_refused(solve):
    code, _, error = solve('--twist', '0:1:1', gas={'kind': 'liquid'})
    assert code == 1 and 'cannot hold a liquid' in error


@pytest.mark.parametrize('pressure', [2e3, -2e3])
def test_a_constant_pressure_on_an_open_tube_is_that_of_a_ring(solve, pressure):
    contacts = (LOWER, {**UPPER, 'hold': 'hinged'})
    code, result, error = solve('--twist', '0:0:1', pressure_pa=pressure, contacts=contacts)
    assert code == 0, error
    # Hoop stress alone: the tube, free along its axis, shortens by nu p R L / (E h).
    shift = result['points'][-1]['grips'][1]['shift_m'][2]
    exact = -0.3 * pressure * RADIUS * LENGTH / (YOUNG * WALL)
    assert shift == pytest.approx(exact, rel=0.15)
    assert result['points'][-1]['gas_pressure_pa'] == pytest.approx(pressure)


RELAXES = {'kind': 'prony', 'shares': [0.2, 0.1], 'times_s': [1, 100]}


def test_a_twist_that_is_held_loses_torque_as_the_wall_relaxes(solve):
    """0.2 exp(-t) + 0.1 exp(-t / 100) + 0.7, the shape and the shortening stay."""
    code, result, told = solve('--twist', '0:2:2', '--hold', '600', relaxation=RELAXES)
    assert code == 0 and '600 s is longer than the 100 s' in told
    (_, _, last), hold = result['points'], result['hold']
    for row in (hold[0], hold[len(hold) // 2], hold[-1]):
        left = 0.7 + 0.2 * np.exp(-row['time_s']) + 0.1 * np.exp(-row['time_s'] / 100.0)
        upper = row['grips'][1]
        share = upper['torque_nm'][2] / last['grips'][1]['torque_nm'][2]
        assert share == pytest.approx(left, rel=1e-5)
        assert upper['shift_m'][2] == pytest.approx(last['grips'][1]['shift_m'][2], rel=1e-4)
    assert hold[-1]['relative_sigma'] > hold[0]['relative_sigma']


def test_a_pull_that_is_held_creeps_where_it_is_free(solve):
    """Under a dead load on a free grip the tube goes on stretching, to 1 / 0.7 of it."""
    arguments = ('--twist', '0:0:1', '--axial', '20', '--hold', '3000')
    code, result, _ = solve(*arguments, relaxation=RELAXES)
    assert code == 0
    stretch = [row['grips'][1]['shift_m'][2] for row in result['hold']]
    assert stretch[-1] / stretch[0] == pytest.approx(1.0 / 0.7, rel=2e-3)


def test_grips_of_a_wall_without_a_law_are_not_held(solve):
    code, _, told = solve('--twist', '0:1:1', '--hold', '60')
    assert code == 1 and 'needs relaxation:' in told.splitlines()[-1]


@pytest.mark.parametrize('hold', ['hinged', 'clamped'])
def test_a_tube_under_pressure_leaves_a_held_edge_as_the_edge_is_held(tmp_path, hold):
    """Exact edge solution of a cylinder: 1 - exp(-b) cos b, clamped with + sin b in it."""
    pressure = 1000.0
    held = [{'kind': 'grip', 'where': where, 'hold': hold} for where in ('lower', 'upper')]
    path = tmp_path / 'object.yaml'
    short = {'cylinder': {**TUBE['surface']['cylinder'], 'length_m': 0.06}}
    path.write_text(
        yaml.safe_dump(
            {**TUBE, 'surface': short, 'contacts': held, 'pressure_pa': pressure,
             'control_vertices': 1500}
        )
    )  # fmt: skip
    model = build_model(load_object(str(path)))
    state = EquilibriumSolver(model).solve(gripped(np.zeros((2, 6))))
    rest, now = map(model.surface.limit_positions, (model.rest, state.positions))
    grown = np.linalg.norm(now[:, :2], axis=1) - np.linalg.norm(rest[:, :2], axis=1)
    far = pressure * RADIUS**2 * (1.0 - 0.3**2) / (YOUNG * WALL)
    b = (0.03 - np.abs(rest[:, 2])) * (3.0 * (1.0 - 0.3**2)) ** 0.25 / np.sqrt(RADIUS * WALL)
    exact = 1.0 - np.exp(-b) * (np.cos(b) + (hold == 'clamped') * np.sin(b))
    np.testing.assert_allclose(grown / far, exact, atol=0.02)
