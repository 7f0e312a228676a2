# SPDX-License-Identifier: Apache-2.0
"""The pressed elastic layer against its limits and against the solid of the recordings."""

from __future__ import annotations

import numpy as np
import pytest

from scan_compare.pressed_plate import bending, depth_under_pin, face_compliance, squeeze


def test_long_waves_bend_and_shear_the_layer() -> None:
    k = np.array([0.02, 0.05, 0.1])
    assert face_compliance(k) == pytest.approx(1.0 / k**4 + 0.2 / k**2, rel=1e-5)


def test_short_waves_see_a_half_space() -> None:
    k = np.array([20.0, 50.0, 500.0])
    assert face_compliance(k) == pytest.approx(1.0 / (6.0 * k), rel=1e-5)


def test_the_series_of_long_waves_joins_the_closed_form() -> None:
    below, above = face_compliance(np.array([0.5 - 1e-9, 0.5 + 1e-9]))
    assert below == pytest.approx(above, rel=1e-7)


@pytest.mark.parametrize('pin_radius', [0.01, 0.02])
def test_a_needle_sinks_as_into_a_half_space(pin_radius: float) -> None:
    # less what the plate's own logarithm already holds
    expected = 1.0 / (24.0 * pin_radius)
    assert squeeze(pin_radius) == pytest.approx(expected, rel=0.1)


def test_a_wide_pin_squeezes_nothing_more() -> None:
    assert 0.0 < squeeze(0.8) < squeeze(0.4) < squeeze(0.2)
    assert squeeze(0.8) < 0.01


def test_the_depth_falls_with_the_pin_radius_and_lies_beyond_the_ring_around_it() -> None:
    depths = [depth_under_pin(a) for a in (0.1, 0.2, 0.4, 0.8)]
    assert np.all(np.diff(depths) < 0.0)
    assert depth_under_pin(0.4) > float(bending(np.array([0.8]))[0])
