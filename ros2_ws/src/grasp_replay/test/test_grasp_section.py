# SPDX-License-Identifier: Apache-2.0
"""The grasp in the report: from the rows' documents to a curve, bars and a table."""

from __future__ import annotations

import pytest

from grasp_replay.grasp_section import grasp_sections, needed_friction, windows


def row(force: float, needed: float, **changes: object) -> dict[str, object]:
    grasp = {
        'closed': needed < 0.5,
        'why': '' if needed < 0.5 else 'a balanced squeeze needs more friction than there is',
        'needed_friction': needed,
        'needed_friction_sigma': 0.02,
        'closure_probability': 0.9,
        'liftable_mass_kg': 1.2,
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


def test_the_section_tells_what_is_closed_and_why_another_is_not() -> None:
    (section,) = grasp_sections(ROWS)
    text = str(section.body)
    assert section.key == 'grasp'
    assert text.count('<td>yes</td>') == 2
    assert 'no: a balanced squeeze needs more friction than there is' in text
    assert '0.350 ± 0.020' in text
    assert text.count('<svg') == 2
    assert str(grasp_sections(ROWS)[0].body) == text


def test_rows_without_a_grasp_have_no_section_and_no_friction_is_no_point() -> None:
    assert grasp_sections([{'force_n': 1.0, 'grasp': {'failed': 'no equilibrium'}}]) == []
    assert grasp_sections([{'force_n': 1.0}]) == []
    hopeless = row(3.0, 20.0, least_push_n=1e9, most_push_n=0.0, fingers=[])
    assert 'none would do' in str(grasp_sections([hopeless])[0].body)
    assert not windows([hopeless]).axes[0].patches


def test_names_in_a_reason_stay_text() -> None:
    (section,) = grasp_sections([row(3.0, 0.9, why='<b>why</b>')])
    assert '<b>why' not in str(section.body)
