# SPDX-License-Identifier: Apache-2.0
"""The curves of a hold and of a turn: what is kept and what is drawn."""

from __future__ import annotations

import re

import numpy as np
import pytest

from grasp_view.curve_svg import hold_curve_html, turn_curve_html
from grasp_view.curves import WARN_FROM, GripState, HoldCurve, Later, TurnCurve
from grasp_view.scene_model import Contacts
from shell_deform.contact import friction_share


def contacts(stamp: float, push: float, touching: bool = True) -> Contacts:
    row = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    flags = np.full(2, int(touching))
    return Contacts(
        stamp, 'object', row, -row, -push * row, np.full(2, 0.1), np.full(2, 1e-3),
        np.array([1, 2]), flags,
    )  # fmt: skip


def grip(degrees: float, torque: float, friction: float = np.nan, capacity: float = np.nan):
    turn = np.radians([0.0, 0.0, degrees])
    return (GripState(0, turn, np.zeros(3), np.array([0, 0, torque]), friction, capacity),)


def held(seconds: float, rate: float = 100.0) -> HoldCurve:
    curve = HoldCurve()
    for age in np.arange(0.0, seconds, 1.0 / rate):
        curve.add(contacts(5.0 + age, 10.0 - 0.3 * np.log10(max(age, 0.1) / 0.1)))
    return curve


def later(sigma: float = 0.2) -> Later:
    times = np.array([10.0, 600.0])
    return Later(np.repeat([1.0, 2.0], 2), np.tile(times, 2), np.full(4, 9.0), np.full(4, sigma))


def test_a_hold_is_kept_evenly_in_the_logarithm_of_time() -> None:
    curve = held(100.0)
    ages = np.array(curve.rows)[:, 0]
    assert len(ages) < 500 and curve.age == pytest.approx(100.0, abs=0.02)
    assert (np.diff(np.log(ages[ages > 1.0])) < 0.04).all()


def test_fingers_that_were_away_begin_another_hold() -> None:
    curve = held(10.0)
    curve.add(contacts(15.2, 0.0, touching=False))
    assert curve.age == pytest.approx(10.0, abs=0.02)
    curve.add(contacts(17.0, 4.0))
    assert curve.age == 0.0 and not curve.rows
    curve.add(contacts(3.0, 4.0))
    assert curve.began == 3.0


def test_the_band_of_what_comes_stands_beyond_now() -> None:
    curve = held(20.0)
    assert hold_curve_html(curve) == ''
    curve.later = later()
    drawn = hold_curve_html(curve)
    (band, _) = re.findall('class="band" points="([^"]+)"', drawn)
    now = float(re.search('class="now" x1="([0-9.]+)"', drawn)[1])
    assert min(float(point.split(',')[0]) for point in band.split()) > now
    assert 'in 600 s F1 9.0 N, F2 9.0 N' in drawn and '90 %' in drawn
    wide = re.findall('class="band" points="([^"]+)"', _with(curve, later(1.0)))[0]
    heights = [np.ptp([float(p.split(',')[1]) for p in text.split()]) for text in (band, wide)]
    assert heights[1] > 2.0 * heights[0]


def _with(curve: HoldCurve, what: Later) -> str:
    curve.later = what
    return hold_curve_html(curve)


def test_a_turn_is_kept_since_it_last_turned_back() -> None:
    curve = TurnCurve()
    for degrees in np.linspace(0.5, 40.0, 2000):
        curve.add(grip(degrees, 0.01 * degrees))
    assert len(curve.rows) < 500 and curve.rows[-1][0] == pytest.approx(40.0)
    for degrees in np.linspace(40.0, 20.0, 100):
        curve.add(grip(degrees, 0.01 * degrees))
    angles = np.array(curve.rows)[:, 0]
    assert angles[-1] == pytest.approx(20.0) and (np.diff(angles) < 0.0).all()
    assert 'Torque of the turn' in turn_curve_html(curve)


def test_the_warning_comes_before_the_slip_and_marks_the_curve_from_there() -> None:
    curve = TurnCurve()
    for degrees in np.linspace(1.0, 10.0, 19):
        curve.add(grip(degrees, 0.1 * degrees, -0.1 * degrees, 1.0))
        assert curve.slips == (0.1 * degrees > WARN_FROM)
        assert ('about to slip' in turn_curve_html(curve)) == curve.slips
    drawn = turn_curve_html(curve)
    left = float(re.search('class="slip" x="([0-9.]+)"', drawn)[1])
    assert 40 + 272 * 0.8 < left < 40 + 272 * 0.9
    assert 'friction allows 1' in drawn and '100 % of the friction' in drawn


def test_page_and_reports_warn_at_the_same_share() -> None:
    assert WARN_FROM == friction_share.WARN_FROM


def test_nothing_that_turns_draws_nothing() -> None:
    curve = TurnCurve()
    curve.add(())
    curve.add(grip(0.0, 0.0))
    assert turn_curve_html(curve) == '' and hold_curve_html(HoldCurve()) == ''
