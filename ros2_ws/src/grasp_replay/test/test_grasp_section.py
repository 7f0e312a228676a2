# SPDX-License-Identifier: Apache-2.0
"""The grasp in the report: from the rows' documents to a curve, bars and a table."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from grasp_replay.experiment import Experiment
from grasp_replay.grasp_rows import grasp_document
from grasp_replay.grasp_section import (
    grasp_sections,
    needed_friction,
    windows,
    with_nearest_limits,
)
from grasp_replay.holds import HeldContacts
from grasp_replay.theories import theory_set


def row(force: float, needed: float, **changes: object) -> dict[str, object]:
    grasp = {
        'closed': needed < 0.5,
        'why': '' if needed < 0.5 else 'a balanced squeeze needs more friction than there is',
        'needed_friction': needed,
        'needed_friction_sigma': 0.02,
        'closure_probability': 0.9,
        'liftable_mass_kg': 1.2,
        'liftable_mass_sigma_kg': 0.24,
        'least_push_n': 0.5,
        'most_push_n': 1e9,
        'limit': '',
        'friction_given': 0.5,
        'note': 'friction is an input',
        'fingers': [{'push_n': force}, {'push_n': force + 1.0}],
        **changes,
    }
    return {'force_n': force, 'grasp': grasp}


ROWS = [row(20.0, 0.35), row(5.0, 0.46), row(1.0, 0.62, limit='yield', most_push_n=30.0)]


def test_needed_friction_is_drawn_over_the_mean_push_beside_the_one_given() -> None:
    curve, given = needed_friction(sorted(ROWS, key=lambda one: one['force_n'])).axes[0].lines
    assert curve.get_xdata().tolist() == [1.5, 5.5, 20.5]
    assert curve.get_ydata().tolist() == [0.62, 0.46, 0.35]
    assert list(given.get_ydata()) == [0.5, 0.5]


def test_a_bar_ends_at_its_limit_or_at_the_end_of_the_scale() -> None:
    axes = windows(ROWS).axes[0]
    top = axes.get_xlim()[1]
    assert top == pytest.approx(1.25 * 30.0)
    ends = [bar.get_x() + bar.get_width() for bar in axes.patches]
    assert ends == pytest.approx([top, top, 30.0])


def test_a_row_beyond_a_limit_takes_it_from_the_last_row_that_keeps_it() -> None:
    soft, deep = (
        row(f, 0.3, limit='strain', most_push_n=m) for f, m in ((10.0, 11.5), (20.0, 5.0))
    )
    told = with_nearest_limits([soft, deep, row(30.0, 0.3, limit='yield', most_push_n=4.0)])
    assert [one['grasp']['most_push_n'] for one in told] == [11.5, 11.5, 11.5]
    assert told[2]['grasp']['limit'] == 'strain'
    # Nobody saw it coming, or nobody keeps it.
    far = row(10.0, 0.3, limit='strain', most_push_n=50.0)
    assert with_nearest_limits([far, deep])[1]['grasp']['most_push_n'] == 10.5
    assert with_nearest_limits([deep])[0] is deep


def test_the_section_tells_what_is_closed_and_why_another_is_not() -> None:
    (section,) = grasp_sections(ROWS)
    text = str(section.body)
    assert section.key == 'grasp'
    assert text.count('<td>yes</td>') == 2
    assert 'no: a balanced squeeze needs more friction than there is' in text
    assert '0.350 ± 0.020' in text and '1.2 ± 0.24' in text
    assert text.count('<svg') == 2
    assert str(grasp_sections(ROWS)[0].body) == text


def test_the_curve_says_whose_normals_it_is_of() -> None:
    (section,) = grasp_sections([row(5.0, 0.3, theory='thick', mass_given_kg=0.058)])
    assert 'on the deformed normals of theory thick' in str(section.body)
    assert 'lifts the object of 0.058 kg to' in str(section.body)


def test_rows_without_a_grasp_have_no_section_and_no_friction_is_no_point() -> None:
    assert grasp_sections([{'force_n': 1.0, 'grasp': {'failed': 'no equilibrium'}}]) == []
    assert grasp_sections([{'force_n': 1.0}]) == []
    hopeless = row(3.0, 20.0, least_push_n=1e9, most_push_n=0.0, fingers=[])
    assert 'none would do' in str(grasp_sections([hopeless])[0].body)
    assert not windows([hopeless]).axes[0].patches


def test_names_in_a_reason_stay_text() -> None:
    (section,) = grasp_sections([row(3.0, 0.9, why='<b>why</b>')])
    assert '<b>why' not in str(section.body)


@pytest.fixture(scope='module')
def ball():
    return theory_set('tennis_ball', changes={'control_vertices': 300}, thick=False)


def by_bodies(ball, body):
    """What a row between two fingers of 8 N says that carried `body`: mu 0.4, 0.2 kg to lift."""
    normal = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    held = HeldContacts(
        np.array([1, 2]), -0.031 * normal, normal, np.full(2, 8.0), np.full(2, 0.1),
        np.full(2, 7.5e-3), np.full(2, 1.5e-3), 5, False,
    )  # fmt: skip
    experiment = Experiment('tips', None, Path('.'), finger_body=body, friction=0.4, mass=0.2)
    told = grasp_document(ball, SimpleNamespace(contacts=held, force=8.0), experiment)
    json.dumps(told, allow_nan=False)
    return told


def test_fingers_that_carried_bodies_hold_by_the_pressure_of_these(ball):
    told = by_bodies(ball, 'barrett_fingertip')
    assert told['closed']
    assert told['friction_given'] == 0.4
    assert [finger['push_n'] for finger in told['fingers']] == pytest.approx([8.0, 8.0], rel=1e-3)
    assert told['gravity_capacity_n'] == pytest.approx(2.0 * 0.4 * 8.0, rel=0.02)
    least = 8.0 * 0.2 * 9.80665 / told['gravity_capacity_n']
    assert told['least_push_n'] == pytest.approx(least, rel=1e-3)
    assert 0.0 < told['gravity_slip_n'] < 1.05 * told['gravity_capacity_n']
    assert 'no shell theory resolves' in told['stress_unresolved']


@pytest.mark.parametrize(
    ('body', 'text'),
    [('nosuch', "no body 'nosuch'"), ('1: barrett_fingertip', 'finger 2 carries')],
)
def test_bodies_that_are_none_are_named(ball, body, text):
    assert text in by_bodies(ball, body)['failed']
