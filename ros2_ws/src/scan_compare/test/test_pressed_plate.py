# SPDX-License-Identifier: Apache-2.0
"""The pressed elastic layer against its limits: half-space, thin plate, shallow shell."""

from __future__ import annotations

import numpy as np
import pytest

from scan_compare import dent
from scan_compare.dent import Wall, under_pin
from scan_compare.pressed_plate import bed_of, face_compliance, pressed_pin, shallow_shell

RADII = np.array([0.1, 0.5, 1.0, 2.0])


def test_long_waves_bend_and_shear_the_layer() -> None:
    k = np.array([0.02, 0.05, 0.1])
    assert face_compliance(k) == pytest.approx(1.0 / k**4 + 0.2 / k**2, rel=1e-5)


def test_short_waves_see_a_half_space() -> None:
    k = np.array([20.0, 50.0, 500.0])
    assert face_compliance(k) == pytest.approx(1.0 / (6.0 * k), rel=1e-5)


def test_the_series_of_long_waves_joins_the_closed_form() -> None:
    below, above = face_compliance(np.array([0.5 - 1e-9, 0.5 + 1e-9]))
    assert below == pytest.approx(above, rel=1e-7)


def test_a_needle_sinks_as_a_stamp_into_a_half_space() -> None:
    # P (1 - nu^2) / (2 a E) is pi / (3 a) in these units; what else the layer gives is finite
    a = 0.01
    assert a * pressed_pin(a).depth[2] == pytest.approx(np.pi / 3.0, rel=0.02)


def test_under_a_needle_the_pressure_is_that_of_a_stamp() -> None:
    a = 0.02
    assert pressed_pin(a).moment == pytest.approx([0.0, 2.0 * a**2 / 3.0], rel=1e-4, abs=1e-6)


def test_around_a_disc_far_wider_than_the_wall_the_thin_plate_is_clamped() -> None:
    # w = r^2 ln r - a^2 (1 + 2 ln a) ln r has no slope at the rim; r^2 - 2 a^2 ln r neither
    a = 10.0
    pin = pressed_pin(a)
    assert pin.moment == pytest.approx([-2.0 * a**2, -(a**2) * (1.0 + 2.0 * np.log(a))], rel=0.1)
    assert pin.depth[1] == pytest.approx(-(a**2) * (1.0 + 2.0 * np.log(a)), rel=0.1)


@pytest.mark.parametrize('pin_radius', [0.1, 0.4, 0.8, 2.5])
def test_what_a_curvature_does_to_the_force_the_force_does_to_the_curvature(
    pin_radius: float,
) -> None:
    # Betti: the moment that a force adds is the depth that a curvature adds
    pin = pressed_pin(pin_radius)
    assert pin.moment[1] == pytest.approx(pin.depth[1], rel=1e-9)


@pytest.mark.parametrize('pin_radius', [0.4, 0.8, 2.5])
def test_the_face_leaves_the_rim_of_the_pin_without_a_step(pin_radius: float) -> None:
    pin = pressed_pin(pin_radius)
    rim = pin.fields(np.array([pin_radius]), 0.0)[0]
    assert rim == pytest.approx(pin.depth, rel=0.08)


def test_the_depth_falls_with_the_pin_radius_and_lies_beyond_the_ring_around_it() -> None:
    depths = [pressed_pin(a).depth[2] for a in (0.1, 0.2, 0.4, 0.8)]
    assert np.all(np.diff(depths) < 0.0)
    assert depths[2] > pressed_pin(0.4).fields(np.array([0.8]), 0.0)[0, 2]


def test_without_a_bed_the_fields_are_those_of_the_plate() -> None:
    found = np.array(shallow_shell(RADII, 0.0))
    plate = [RADII**0, RADII**2, np.log(RADII), RADII**2 * np.log(RADII)]
    assert found == pytest.approx(np.array(plate), abs=1e-8)


@pytest.mark.parametrize('field', range(4))
def test_on_a_bed_every_field_solves_the_shallow_shell(field: int) -> None:
    # the biharmonic operator of w is - bed w, by differences
    bed, r, d = 0.3, 1.5, 2e-2

    def laplace(of, at):  # type: ignore[no-untyped-def]
        second = (of(at + d) - 2.0 * of(at) + of(at - d)) / d**2
        return second + (of(at + d) - of(at - d)) / (2.0 * d * at)

    def w(at: float) -> float:
        return float(shallow_shell(np.array([at]), bed)[field][0])

    assert laplace(lambda at: laplace(w, at), r) == pytest.approx(-bed * w(r), rel=5e-3, abs=2e-4)


def test_a_sphere_lies_on_a_bed_and_a_wall_with_straight_lines_on_none() -> None:
    assert bed_of(np.eye(2) / 12.5) == pytest.approx(12.0 * (1.0 - 0.4**2) / 12.5**2)
    assert bed_of(np.diag([1.0, 0.0]) / 12.5) == 0.0
    assert bed_of(np.diag([1.0, -0.5]) / 12.5) == 0.0


def test_the_bed_does_not_depend_on_how_the_axes_lie() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    curved = np.diag([0.08, 0.02])
    assert bed_of(turn @ curved @ turn.T) == pytest.approx(bed_of(curved), rel=1e-12)


@pytest.mark.parametrize('beside', [0.0, 0.6e-3])
def test_a_pin_beside_its_contact_is_found_and_its_dent_is_not_told_too_shallow(
    beside: float,
) -> None:
    h, pin, curved = 2.5e-3, 1e-3, np.eye(2) / 32.5e-3
    radius = np.sqrt(np.linspace((2e-3) ** 2, (7e-3) ** 2, 2_000))
    turn = 2.4 * np.arange(2_000)
    around = radius[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
    plate = pressed_pin(pin / h)
    planted = np.array([4e-3, -0.55e-3, 0.3e-3])
    depth = plate.fields(radius / h, bed_of(h * curved)) @ planted
    across = around + [beside, 0.5 * beside]
    near = np.hypot(*across.T) < 6e-3
    apex, variance, rise = under_pin(
        across[near], depth[near], 2e-3, Wall(h, pin, 0.0, curved), pin
    )
    assert apex == pytest.approx(plate.depth @ planted, abs=5e-6)
    assert variance < (5e-6) ** 2
    assert rise > 0.2e-3


@pytest.mark.parametrize('how', ['a pressed plate', 'a bent plate'])
def test_noise_across_a_steep_dent_does_not_make_its_apex_shallower(how: str) -> None:
    h, pin, curved = 2.5e-3, 1e-3, np.eye(2) / 32.5e-3
    generator = np.random.default_rng(418)
    reach = np.sqrt(np.linspace((2e-3) ** 2, (8e-3) ** 2, 30_000))
    turn = 2.4 * np.arange(30_000)
    outward = np.column_stack((np.cos(turn), np.sin(turn)))
    if how == 'a pressed plate':
        plate, planted = pressed_pin(pin / h), np.array([12e-3, -1.65e-3, 0.9e-3])
        truth = float(plate.depth @ planted)

        def face(radius: np.ndarray) -> np.ndarray:
            return plate.fields(radius / h, bed_of(h * curved)) @ planted
    else:
        truth = 10e-3

        def face(radius: np.ndarray) -> np.ndarray:
            scaled = radius / 6e-3
            return truth + 1e-3 * scaled**2 + 5e-3 * scaled**2 * np.log(scaled) - 4e-3 * scaled**2

    slope = (face(reach + 1e-6) - face(reach - 1e-6)) / 2e-6
    noise = 0.127e-3 * generator.standard_normal(len(reach)) / np.hypot(1.0, slope)
    across = (reach - noise * slope)[:, None] * outward
    depth = face(reach) + noise
    near = np.hypot(*across.T) < 7e-3
    if how == 'a pressed plate':
        apex = under_pin(across[near], depth[near], 2e-3, Wall(h, pin, 0.0, curved), pin)[0]
    else:
        apex = dent._bent_apex(across[near], depth[near], 2e-3).depth
    # By where points are seen it would be 0.05 mm and more.
    assert apex == pytest.approx(truth, abs=0.02e-3)
