# SPDX-License-Identifier: Apache-2.0
"""Whether the grasp holds: its message, its words, its bar and its cones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from view_grasp import cloud

from grasp_common.point_cloud import MessageError
from grasp_view.grasp_measures import GraspMeasures, colour_of, hold_html, window_svg
from grasp_view.messages import read_grasp
from grasp_view.palette import LIGHT, rgb
from grasp_view.scene_model import Snapshot, friction_cones

FIELDS = (
    'finger', 'x', 'y', 'z', 'nx', 'ny', 'nz', 'push', 'closed', 'closure_probability',
    'needed_friction', 'needed_friction_sigma', 'friction_given', 'friction_sigma_given',
    'least_push', 'most_push', 'liftable_mass', 'mass_given', 'on_deformed_normals',
)  # fmt: skip
ROWS = np.array(
    [
        [1, 0.03, 0, 0, -1, 0, 0, 10.0, *[0.0] * 11],
        [2, -0.03, 0, 0, 1, 0, 0, 14.0, *[0.0] * 11],
        [-1, *[0.0] * 7, 1, 0.97, 0.35, 0.02, 0.5, 0.1, 3.0, 18.0, 0.9, 0.058, 1],
    ]
)


@pytest.fixture
def grasp() -> GraspMeasures:
    return read_grasp(cloud(ROWS, FIELDS, Time()))


def test_the_message_is_read_by_names(grasp: GraspMeasures) -> None:
    assert grasp.closed and grasp.deformed
    assert grasp.points.shape == grasp.normals.shape == (2, 3)
    assert grasp.push == pytest.approx(12.0)
    assert (grasp.probability, grasp.needed, grasp.mass) == pytest.approx((0.97, 0.35, 0.058))


def test_a_message_without_the_row_of_the_whole_is_refused() -> None:
    with pytest.raises(MessageError, match='finger -1'):
        read_grasp(cloud(ROWS[:2], FIELDS, Time()))


def test_closure_is_told_with_what_it_needs_and_what_was_given(grasp: GraspMeasures) -> None:
    told = hold_html(grasp)
    assert '>closed<' in told and '97 % sure' in told
    assert 'friction 0.50 ± 0.10 given, needs 0.35 ± 0.02' in told
    assert 'window for 58 g: from 3.0 N, at most 18.0 N' in told
    open_one = hold_html(replace(grasp, closed=False, probability=0.02, needed=20.0))
    assert '>not closed<' in open_one and 'no friction would do' in open_one


def test_a_grasp_that_is_not_closed_says_why(grasp: GraspMeasures) -> None:
    why = 'not closed: all contacts are in one place'
    assert 'all contacts are in one place' in hold_html(replace(grasp, closed=False), why)
    # Words come once a second: those of a grasp that has closed meanwhile are not shown.
    assert 'one place' not in hold_html(grasp, why)
    assert hold_html(replace(grasp, closed=False), 'closed') == hold_html(
        replace(grasp, closed=False)
    )


def test_first_slip_and_dent_are_told_where_the_message_has_them(grasp: GraspMeasures) -> None:
    assert 'slips first' not in hold_html(grasp) and 'dent begins' not in hold_html(grasp)
    more = ('gravity_slip', 'slip_finger', 'dent_push', 'stress_resolved')
    rows = np.concatenate([ROWS, [[0.0] * 4, [0.0] * 4, [4.25, 2.0, 31.0, 0.0]]], axis=1)
    told = hold_html(read_grasp(cloud(rows, FIELDS + more, Time())))
    assert 'F2 slips first, under a weight of 4.2 N' in told
    assert 'a dent begins at 31.0 N (stress not resolved)' in told


def test_a_finger_that_is_no_number_slips_nowhere() -> None:
    rows = np.concatenate([ROWS, [[0.0], [0.0], [np.inf]]], axis=1)
    read_grasp(cloud(rows, (*FIELDS, 'slip_finger'), Time()))


def test_the_bar_spans_the_window_and_the_mark_is_the_squeeze(grasp: GraspMeasures) -> None:
    told = window_svg(grasp)
    # 18 N are 1 / 1.25 of the scale of 288 pixels that begins at 6.
    begin, width = 6.0 + 288.0 * 3.0 / 22.5, 288.0 * 15.0 / 22.5
    assert f'class="window" x="{begin:.1f}" y="8" width="{width:.1f}"' in told
    assert f'M{6.0 + 288.0 * 12.0 / 22.5:.1f} 4V22' in told
    assert 'class="window open"' in window_svg(replace(grasp, closed=False))


@pytest.mark.parametrize(
    ('changes', 'words', 'drawn'),
    [
        ({'most': 1e9}, 'no known limit above', True),
        ({'least': 1e9}, 'no squeeze lifts 58 g', False),
        ({'least': 20.0}, 'from 20.0 N, at most 18.0 N', False),
        ({'mass': -1.0, 'least': 1e9, 'most': 0.0}, 'a mass below zero', False),
        ({'push': 0.0}, 'squeeze 0.0 N', True),
        ({'mass': 0.0, 'least': 0.0}, 'lifts 900 g; at most 18.0 N', True),
    ],
)
def test_a_window_that_is_none_draws_no_bar(
    grasp: GraspMeasures, changes: dict[str, float], words: str, drawn: bool
) -> None:
    told = hold_html(replace(grasp, **changes))
    assert words in told
    assert ('class="window"' in told) == drawn
    assert 'nan' not in told and 'inf' not in told


def test_no_grasp_is_no_text(grasp: GraspMeasures) -> None:
    assert hold_html(None) == ''
    assert hold_html(replace(grasp, points=grasp.points[:0], normals=grasp.normals[:0])) == ''


def test_cones_stand_on_the_deformed_normals_and_take_the_colour_of_their_chance(
    grasp: GraspMeasures,
) -> None:
    segments = friction_cones(Snapshot(grasp=grasp), 0.9, 0.02)
    assert len(segments) == 2 * 32
    rim = segments[0, 1] - segments[0, 0]
    assert segments[0, 0] == pytest.approx([0.03, 0.0, 0.0])
    assert rim[0] == pytest.approx(0.02)
    assert np.hypot(*rim[1:]) == pytest.approx(0.5 * 0.02)
    assert colour_of(1.0) == rgb(LIGHT.good)
    assert colour_of(0.0) == rgb(LIGHT.bad)
