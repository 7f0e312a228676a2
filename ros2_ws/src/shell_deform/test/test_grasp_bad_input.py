# SPDX-License-Identifier: Apache-2.0
"""Contacts that hold nothing, or cannot be: a stated answer, and numbers in it."""

from __future__ import annotations

import json
from types import SimpleNamespace

import live_hand
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.commands.grasp_map import main
from shell_deform.grasp.closure import closure
from shell_deform.grasp.contacts import GraspError, contacts
from shell_deform.grasp.mapping import MapRequest, map_grasp
from shell_deform.grasp.measures import Doubt, Held, Task, measure
from shell_deform.grasp.probability import Sigmas, closure_probability
from shell_deform.live.tick.grasp import GRASP_FIELDS, GraspTick

OUTWARD = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0]])
POINT, INWARD = 0.03 * OUTWARD, -OUTWARD
SIX = 0.03 * OUTWARD[[4] * 6] + 1e-3 * np.eye(6, 3)
LINE = np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]])


def measured(
    point, normal, push=5.0, friction=0.5, arm=1.3e-3, mass=0.05, friction_sigma=0.1, sigmas=()
):
    grasp = contacts(point, normal, push, friction, arm)
    known = {'push': 0.0, 'tangential': 0.0, 'point': 2e-4, 'normal': 0.02, **dict(sigmas)}
    doubt = Doubt(**{name: np.full(grasp.count, value) for name, value in known.items()})
    task = Task(mass=mass, friction_sigma=friction_sigma)
    told = measure(grasp, Held(np.zeros(3)), task, doubt)
    json.dumps(told.to_json(), allow_nan=False)
    return told


def test_a_weight_pulls_down_unless_it_is_told_where():
    assert Task().down == (0.0, 0.0, -1.0)


@pytest.mark.parametrize(
    ('values', 'why'),
    [
        ({'point': POINT[:0], 'normal': INWARD[:0]}, 'no contact'),
        ({'point': POINT[:1], 'normal': INWARD[:1]}, 'one contact holds nothing'),
        ({'point': POINT[[0, 0]], 'normal': INWARD[:2]}, 'in one place'),
        ({'point': POINT[[2, 2, 2]], 'normal': INWARD[:3]}, 'in one place'),
        ({'point': LINE, 'normal': INWARD[:3], 'arm': 0.0}, 'turn about the line'),
        ({'point': POINT[:3], 'normal': INWARD[[0, 0, 0]]}, 'cannot balance'),
        ({'point': POINT[:3], 'normal': INWARD[:3], 'push': 0.0}, 'no contact presses'),
        ({'point': POINT[:3], 'normal': INWARD[:3], 'push': -5.0}, 'no contact presses'),
        ({'point': POINT[:2], 'normal': INWARD[:2], 'push': [5.0, 0.0]}, 'only one contact'),
        ({'point': POINT[:3], 'normal': INWARD[:3], 'friction': 0.0}, 'without friction'),
        ({'point': POINT[:3], 'normal': INWARD[:3], 'friction': [0.5, 0.5, 0.0]}, 'beside others'),
        ({'point': POINT[:2], 'normal': INWARD[[0, 0]]}, 'cannot balance'),
        ({'point': POINT[[0, 0]] + LINE[:2], 'normal': INWARD[[0, 0]]}, 'cannot balance'),
        ({'point': SIX, 'normal': INWARD[[4] * 6]}, 'cannot balance'),
    ],
)
def test_what_holds_nothing_says_why(values, why):
    told = measured(**values)
    assert not told.closed
    assert why in told.why
    assert told.closure_probability == 0.0
    assert told.epsilon == 0.0


def test_six_contacts_from_all_sides_close():
    told = measured(0.03 * np.vstack([OUTWARD, -OUTWARD[4:]]), np.vstack([INWARD, OUTWARD[4:]]))
    assert told.closed
    assert told.closure_probability > 0.99


def test_a_contact_that_does_not_press_is_none():
    grasp = contacts(POINT[:3], INWARD[:3], [5.0, 5.0, 0.0], 0.5, 1e-3)
    alone = contacts(POINT[:2], INWARD[:2], 5.0, 0.5, 1e-3)
    sigmas = Sigmas(np.full(3, 1e-3), np.full(3, 0.2), 0.1)
    two = Sigmas(sigmas.point[:2], sigmas.normal[:2], 0.1)
    found, expected = closure(grasp), closure(alone)
    assert found.closed
    assert found.squeeze[2].tolist() == [0.0, 0.0, 0.0, 0.0]
    assert closure_probability(grasp, found, sigmas) == closure_probability(alone, expected, two)


def test_ten_is_a_friction_and_a_billion_is_none():
    told = measured(POINT[:3], INWARD[:3], friction=10.0)
    assert told.closed
    assert told.gravity_capacity == pytest.approx(100.0, rel=1e-3)
    with pytest.raises(GraspError, match='friction of a contact .* look at the units'):
        measured(POINT[:3], INWARD[:3], friction=1e9)


@pytest.mark.parametrize('mass', [-1.0, np.nan])
def test_a_mass_that_is_none_opens_no_window_and_says_so(mass):
    window = measured(POINT[:3], INWARD[:3], mass=mass).window
    assert not window.open
    assert 'mass' in window.limit


@pytest.mark.parametrize(
    ('name', 'value', 'text'),
    [
        ('friction', -0.1, 'cannot be negative'),
        ('friction', np.nan, 'must be finite'),
        ('push', np.inf, 'must be finite'),
        ('push', 1e300, 'look at the units'),
        ('normal', 0.0 * INWARD[:2], 'contact 1 .* of length 0; it must be a unit vector'),
        ('normal', 3.0 * INWARD[:2], 'contact 1 .* of length 3; it must be a unit vector'),
        ('point', np.nan * POINT[:2], 'must be finite'),
        ('arm', -1e-3, 'cannot be negative'),
        ('friction', 'abc', "is 'abc'; it must be a number"),
        ('friction', '0.5', "is '0.5'; it must be a number"),
        ('friction', None, 'is None; it must be a number'),
        ('friction', True, 'is True; it must be a number'),
        ('friction', [0.5] * 3, 'has shape .3,.; 2 contacts need .2,.'),
        ('push', ['a', 'b'], 'it must be a number'),
        ('point', [[0.0, 0.0, 0.0], [1.0, 0.0]], 'it must be a number'),
        ('point', POINT[:2, :2], 'has shape .2, 2.; k contacts need'),
        ('point', POINT[:3], '3 contacts need'),
        ('mass', 'abc', "is 'abc'; it must be a finite number"),
        ('friction_sigma', '0.1', "is '0.1'; it must be a finite number"),
    ],
)
def test_what_cannot_be_is_named(name, value, text):
    values = {'point': POINT[:2], 'normal': INWARD[:2], name: value}
    with pytest.raises(GraspError, match=f'{name}.*{text}|{text}'):
        measured(**values)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('push', np.nan), ('push', -1.0), ('tangential', np.inf), ('point', -1e-3),
        ('normal', np.nan), ('normal', np.inf),
    ],
)  # fmt: skip
def test_a_sigma_that_is_none_is_named(name, value):
    with pytest.raises(GraspError, match=f'sigma of a {name} is .* must be zero or more'):
        measured(POINT[:2], INWARD[:2], sigmas={name: value})


@pytest.mark.parametrize('value', [np.nan, -0.1, np.inf])
def test_a_sigma_of_the_friction_that_is_none_is_named(value):
    with pytest.raises(GraspError, match='sigma of the friction is .* must be zero or more'):
        measured(POINT[:2], INWARD[:2], friction_sigma=value)


@pytest.mark.parametrize('sigmas', [{'push': np.inf}, {'normal': 1e6}, {'point': 1e3}])
def test_what_is_hardly_known_has_numbers(sigmas):
    told = measured(POINT[:3], INWARD[:3], friction_sigma=1e3, sigmas=sigmas)
    assert 0.0 <= told.closure_probability <= 1.0
    assert np.all(told.per_finger.slip_sigma > 1e3)


def test_fingers_inside_a_ring_close_by_pushing_apart():
    told = measured(POINT[:2], OUTWARD[:2])
    assert told.closed
    assert told.closure_probability > 0.99


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 5), st.sampled_from([0.0, 0.3, 10.0]))
def test_no_contacts_give_a_number_that_is_none(seed, count, friction):
    """Places from a few, so that many coincide; pushes of every sign."""
    rng = np.random.default_rng(seed)
    place = rng.integers(0, 5, count)
    told = measured(
        POINT[place] * rng.integers(0, 2, (count, 1)),
        INWARD[rng.integers(0, 5, count)],
        rng.choice([-5.0, 0.0, 1e-12, 5.0], count),
        friction,
        rng.choice([0.0, 1e-3], count),
    )
    assert told.closed or told.why


def untouched(points, normals, forces):
    """What a tick knows of a hand before any equilibrium."""
    return SimpleNamespace(
        sample=live_hand.sample(points, normals, forces),
        adopted=None,
        posterior=None,
        rest=POINT,
        pose_in_use=SimpleNamespace(rotation=np.eye(3), translation=np.zeros(3)),
    )


@pytest.mark.parametrize(
    ('sample', 'why'),
    [
        ((POINT[:0], INWARD[:0], np.zeros(0)), 'no contact'),
        ((POINT[:1], INWARD[:1], [5.0]), 'one contact holds nothing'),
        ((POINT[[0, 0]], INWARD[:2], [5.0, 5.0]), 'in one place'),
        ((POINT[:3], INWARD[[0, 0, 0]], [5.0, 5.0, 5.0]), 'cannot balance'),
        ((POINT[:2], INWARD[:2], [0.0, 0.0]), 'no contact presses'),
        ((POINT[:2], 0.0 * INWARD[:2], [5.0, 5.0]), 'of length 0'),
        ((np.nan * POINT[:2], INWARD[:2], [5.0, 5.0]), 'must be finite'),
    ],
)
@pytest.mark.filterwarnings('error')
def test_the_tick_tells_of_every_sample_and_never_nan(sample, why):
    tick = GraspTick()
    rows = tick.rows(untouched(*sample))
    assert np.all(np.isfinite(rows))
    assert rows[-1, GRASP_FIELDS.index('closed')] == 0.0
    assert rows[-1, GRASP_FIELDS.index('closure_probability')] == 0.0
    assert why in tick.why


def test_a_grasp_that_closes_again_has_no_reason_left():
    tick = GraspTick()
    tick.rows(untouched(POINT[:1], INWARD[:1], [5.0]))
    tick.rows(untouched(POINT[:3], INWARD[:3], [5.0, 5.0, 5.0]))
    assert tick.why == ''


@pytest.mark.parametrize('mu', [-0.5, float('nan'), 1e9])
def test_a_map_of_an_impossible_friction_fails_grasp_by_grasp(mu):
    told = map_grasp(MapRequest('tennis_ball', friction=mu, vertices=162), 0)
    assert 'friction' in told['failed']
    json.dumps(told, allow_nan=False)


@pytest.mark.parametrize('mu', [0.0, 10.0])
def test_a_map_of_an_extreme_friction_has_numbers(mu):
    told = map_grasp(MapRequest('tennis_ball', friction=mu, vertices=162), 0)
    json.dumps(told, allow_nan=False)
    assert told['closed'] == (mu > 0.0)
    assert told['closed'] or 'without friction' in told['why']


@pytest.mark.parametrize(
    ('options', 'text'),
    [
        (['--mu', '-1'], '--mu: -1'),
        (['--mu', 'nan'], '--mu: nan'),
        (['--mu', 'abc'], "--mu: 'abc' is no number"),
        (['--seed', '-1'], '--seed: -1 is not between 0'),
        (['--number', '1.5'], "--number: '1.5' is no whole number"),
        (['--mass', '-0.1'], '--mass: -0.1'),
        (['--number', '99999999999'], 'between 1 and'),
        (['--down', '0,0,0'], "'0,0,0' is no direction"),
        (['--down', 'nan,0,1'], "'nan,0,1' is no direction"),
    ],
)
def test_the_command_refuses_in_one_sentence(options, text, tmp_path, capsys):
    try:
        code = main(['tennis_ball', '--out', str(tmp_path), *options])
    except SystemExit as ended:
        code = ended.code
    assert code != 0
    assert text in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
