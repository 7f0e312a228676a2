# SPDX-License-Identifier: Apache-2.0
"""Tubes twisted and bent by grips beside a solid; a bottle turned until it slips."""

from types import SimpleNamespace

import numpy as np
import pytest

from shell_deform.contact.friction_share import friction_share
from shell_deform.verification import tubes
from shell_deform.verification.tube_section import TubeSection


@pytest.fixture(scope='module')
def twisted():
    return {row.quantity: row for row in tubes.twisted_tube()}


def test_the_torque_of_a_small_twist_is_that_of_a_hollow_circle(twisted):
    assert abs(twisted['torque [N m] per radian at rest'].error) < 5e-3


def test_torque_and_shortening_follow_the_solid_to_60_degrees(twisted):
    rows = [row for quantity, row in twisted.items() if 'degrees' in quantity and row.goal == 1e-2]
    assert len(rows) == 24
    assert max(abs(row.error) for row in rows) < 1e-2


def test_turning_the_twisted_tube_by_180_degrees_keeps_its_energy(twisted):
    assert abs(twisted['energy [J] of the whole turned by 180 degrees'].error) < 1e-10


def test_a_thin_tube_turns_unstable_at_the_eigenvalue_of_the_solid():
    solid, formula = tubes.limit_twist()
    assert abs(solid.error) < 0.03
    assert abs(formula.error) < 0.05


def test_the_moment_of_a_bent_tube_follows_the_solid_to_its_largest():
    rows = [row for row in tubes.bent_tube() if row.goal is not None]
    assert len(rows) > 8
    assert max(abs(row.error) for row in rows) < 1e-2


def test_pressure_inside_puts_off_the_wrinkles_of_a_bent_tube():
    (row,) = tubes.wrinkled_tube(20e3, 24, 48)
    assert abs(row.error) < 0.05
    assert row.value > 1.4 * TubeSection(0.01, 0.001, tubes.SOFT, 0.3).largest_moment()


def test_a_section_bent_little_is_as_stiff_as_a_beam():
    section = TubeSection(0.01, 0.0005, 1e9, 0.3)
    curvature = 1e-3 * section.curvature_unit
    beam = 1e9 * np.pi * 0.01**3 * 0.0005 * (1.0 + 0.25 * 0.05**2)
    moment = section.moment(section.bent(curvature, section.round()), curvature)
    assert moment == pytest.approx(beam * curvature, rel=5e-4)


def test_a_bottle_turned_between_three_fingers_slips_at_the_exact_sum_of_friction():
    (row,) = tubes.held_bottle()
    assert abs(row.error) < 0.02


def ring_of_points(share):
    """Points on a circle of 2 m, pressed with 3 Pa, that give `share` of their friction."""
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    out = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    around = np.cross([0.0, 0.0, 1.0], out)
    return SimpleNamespace(
        body=0,
        face=SimpleNamespace(position=2.0 * out),
        weights=np.full(12, 0.5),
        pressure=np.full(12, 3.0),
        friction=share * 0.4 * 3.0 * around,
    )


@pytest.mark.parametrize(('share', 'warned'), [(0.5, False), (0.75, False), (0.85, True)])
def test_the_slip_warning_comes_before_the_last_tenth_of_the_torque(share, warned):
    found = friction_share([ring_of_points(share)], [0.4], np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert found.capacity == pytest.approx(12 * 0.5 * 0.4 * 3.0 * 2.0)
    assert found.share == pytest.approx(share)
    assert found.slips is warned


def test_nothing_slips_where_nothing_touches():
    assert not friction_share([], [], np.zeros(3), np.array([0.0, 0.0, 1.0])).slips
