# SPDX-License-Identifier: Apache-2.0
"""Planted errors come back, noise alone gives no verdict, and the same scan the same bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scan_shells import (
    BALL_RADIUS,
    BALL_THICKNESS,
    SCANNER_SIGMA,
    Displacement,
    ball,
    half_can,
    occlude,
    odd_body,
    scan_points,
    two_dents,
)

from scan_compare.comparison import Comparison, ComparisonError, Setup, compare
from scan_compare.deformed_surface import DeformedSurface
from scan_compare.dent import Contacts, body_motion, profiles
from scan_compare.pressed_plate import bed_of, pressed_pin
from scan_compare.ranking import rank
from scan_compare.registration import Registration, register
from scan_compare.report.files import dump_json
from scan_compare.rigid import Pose, rotation_from_vector
from scan_compare.scan import Scan
from scan_compare.statistics import local_means, mean_unsigned_noise, summarise

SCANNER = Pose(rotation_from_vector(np.array([0.05, -0.06, 0.0])), np.array([3e-3, -2e-3, 3e-3]))
SIDE = np.array([1.0, 0.3, 0.2])
GRASP = two_dents(0.006, bulge=0.0003)
KEYS = {
    'mean_error_m', 'rms_error_m', 'p95_error_m', 'max_error_m', 'dent_mean_error_m',
    'max_displacement_m', 'noise_floor_m', 'registration',
}  # fmt: skip


def cloud(points: np.ndarray, source: str = 'planted') -> Scan:
    return Scan(SCANNER.inverse().apply(points), None, 'm', False, source)


def noisy(surface: DeformedSurface, seed: int = 1, sigma: float = SCANNER_SIGMA) -> np.ndarray:
    return occlude(scan_points(surface, 110_000, sigma, seed), 0.4, SIDE)


def plus(field: Displacement, extra: Displacement) -> Displacement:
    return lambda points: field(points) + extra(points)


def bump(height: float, width: float = 0.006) -> Displacement:
    place = BALL_RADIUS * np.array([-0.8, 0.0, 0.6])

    def displacement(points: np.ndarray) -> np.ndarray:
        near = np.exp(-np.sum((points - place) ** 2, axis=1) / width**2)
        return height * near[:, None] * points / BALL_RADIUS

    return displacement


def inflated(amount: float) -> Displacement:
    return lambda points: amount * points / BALL_RADIUS


@pytest.fixture(scope='module')
def truth() -> DeformedSurface:
    return ball(GRASP)


@pytest.fixture(scope='module')
def scan(truth: DeformedSurface) -> Scan:
    return cloud(noisy(truth))


@pytest.fixture(scope='module')
def null(scan: Scan, truth: DeformedSurface) -> Comparison:
    return compare(scan, truth)


@pytest.fixture(scope='module')
def perfect(truth: DeformedSurface) -> tuple[Scan, Registration]:
    """A scan without noise, and its true pose."""
    scan = Scan(noisy(truth, sigma=0.0), None, 'm', False, 'perfect')
    return scan, register(scan.points, truth)


def test_the_null_test_shows_the_noise_floor_and_no_verdict(null: Comparison) -> None:
    assert null.noise_floor_m == pytest.approx(0.1013e-3, rel=1e-3)
    assert null.vertex.mean_m == pytest.approx(null.noise_floor_m, rel=0.1)
    assert null.dent.mean_m == pytest.approx(null.noise_floor_m, rel=0.1)
    assert null.mean_error_noise_free_m < 0.02e-3
    assert null.max_error_m < 0.1e-3
    assert not null.beyond_noise


@pytest.mark.parametrize(
    'field',
    [
        plus(GRASP, bump(0.8e-3)),
        plus(GRASP, bump(-1.5e-3, 0.009)),
        two_dents(0.0068, bulge=0.0003),
        two_dents(0.005, bulge=0.0003),
        plus(GRASP, inflated(0.3e-3)),
    ],
    ids=['bump', 'wide hollow', 'deeper dent', 'shallower dent', 'offset'],
)
def test_planted_errors_are_recovered_within_a_twentieth_of_a_millimetre(
    field: Displacement, scan: Scan, perfect: tuple[Scan, Registration]
) -> None:
    model = ball(field)
    found = compare(scan, model)
    planted = compare(perfect[0], model, setup=Setup(registration=perfect[1]))
    assert found.mean_error_noise_free_m == pytest.approx(planted.vertex.mean_m, abs=0.05e-3)
    assert found.max_error_m == pytest.approx(planted.max_error_m, abs=0.05e-3)
    signed = found.dent.signed_mean_m - planted.dent.signed_mean_m
    assert abs(signed) < 0.05e-3
    noise = SCANNER_SIGMA * np.random.default_rng(0).standard_normal(planted.used.sum())
    with_noise = np.abs(planted.distances.distance[planted.used] + noise).mean()
    assert found.vertex.mean_m == pytest.approx(with_noise, abs=0.05e-3)


def test_a_uniform_offset_is_beyond_the_noise_and_said(scan: Scan) -> None:
    found = compare(scan, ball(plus(GRASP, inflated(0.5e-3))))
    assert found.vertex.signed_mean_m == pytest.approx(-0.5e-3, abs=0.02e-3)
    assert found.beyond_noise
    assert any('mm inside the model' in note for note in found.notes)


def test_equal_models_get_no_verdict(null: Comparison, scan: Scan) -> None:
    verdict = rank(null, compare(scan, ball(two_dents(0.00605, bulge=0.0003))))
    assert verdict.better is None
    assert 'no verdict' in verdict.text


def test_a_model_that_is_better_beyond_the_floor_wins(null: Comparison, scan: Scan) -> None:
    worse = compare(scan, ball(two_dents(0.003, 0.013, bulge=0.0003)))
    verdict = rank(worse, null, ('linear', 'koiter'))
    assert verdict.better == 'B'
    assert verdict.p_value < 0.01
    assert verdict.text.startswith('koiter is better than linear')


def test_models_of_different_scans_are_not_ranked(
    null: Comparison, truth: DeformedSurface
) -> None:
    other = compare(cloud(scan_points(truth, 5_000)), truth)
    with pytest.raises(ValueError, match='same scan'):
        rank(null, other)


def test_the_json_carries_the_keys_of_the_contract(null: Comparison) -> None:
    result = null.to_json()
    assert set(result) >= KEYS
    assert result['max_displacement_m'] == pytest.approx(0.006, rel=1e-3)
    assert result['registration']['text'].startswith('rigid, no scale')


def test_the_same_scan_gives_the_same_bytes(
    null: Comparison, scan: Scan, truth: DeformedSurface
) -> None:
    assert dump_json(compare(scan, truth)) == dump_json(null)


def test_coverage_sees_the_occluded_part(null: Comparison) -> None:
    assert null.coverage.patch == pytest.approx(0.6, abs=0.02)
    assert 0.5 < null.coverage.dent < 0.95


def test_the_measured_displacement_is_that_of_the_truth(scan: Scan) -> None:
    undeformed = cloud(scan_points(ball(), 100_000, seed=3), 'undeformed')
    model = ball(two_dents(0.0068, bulge=0.0003))
    found = compare(scan, model, undeformed)
    assert len(found.profiles) == 2
    assert all(profile.reference == 'undeformed scan' for profile in found.profiles)
    assert found.measured_max_displacement_m == pytest.approx(0.006, abs=0.1e-3)


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
def test_the_depth_under_a_hidden_pin_is_extrapolated_and_said_so(seed: int) -> None:
    pin, force = 0.4, 0.3e-3
    generator = np.random.default_rng(seed)
    radius = np.sqrt(generator.uniform(2e-3**2, 6e-3**2, 3_000))
    angle = generator.uniform(0.0, 2.0 * np.pi, radius.size)
    outer = BALL_RADIUS + 0.5 * BALL_THICKNESS
    scaled = radius / BALL_THICKNESS
    plate = pressed_pin(pin)
    bed = bed_of(np.eye(2) * BALL_THICKNESS / outer)
    planted = np.array([4e-3, -0.55e-3, force])
    depth = plate.fields(scaled, bed) @ planted
    height = np.sqrt(outer**2 - radius**2) - depth + SCANNER_SIGMA * generator.normal(size=3_000)
    points = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), height))
    contact = Contacts(np.array([[0.0, 0.0, outer]]), np.array([[0.0, 0.0, -1.0]]), None)
    truth = float(plate.depth @ planted)
    known = replace(contact, radius=np.array([pin * BALL_THICKNESS]))
    (profile,) = profiles(points, ball(), known, None)
    assert profile.extrapolated
    assert 'pin radius 1.00 mm' in profile.method
    assert profile.deepest_seen_m < profile.apex_m
    assert profile.apex_m == pytest.approx(truth, abs=2.5 * profile.apex_sigma_m)
    assert profile.apex_sigma_m < 0.2e-3
    assert 0.0 < profile.extrapolation_sigma_m < profile.apex_sigma_m
    (guessed,) = profiles(points, ball(), contact, None)
    assert 'taken as' in guessed.method
    assert guessed.apex_sigma_m > profile.apex_sigma_m


def test_a_wall_thinner_than_its_pin_bends_as_under_a_point() -> None:
    thin = replace(ball(), thickness=0.5e-3)
    outer = BALL_RADIUS + 0.25e-3
    radius = np.sqrt(np.linspace(2e-3**2, 6e-3**2, 3_000))
    angle = 2.4 * np.arange(3_000)
    x = radius / 6e-3
    depth = 2e-3 - 0.5e-3 * x**2 + 0.4e-3 * x**2 * np.log(x)
    points = np.column_stack(
        (radius * np.cos(angle), radius * np.sin(angle), np.sqrt(outer**2 - radius**2) - depth)
    )
    contact = Contacts(
        np.array([[0.0, 0.0, outer]]), np.array([[0.0, 0.0, -1.0]]), np.array([1e-3])
    )
    (profile,) = profiles(points, thin, contact, None)
    assert 'bent plate' in profile.method
    assert profile.apex_m == pytest.approx(2e-3, abs=0.02e-3)


def test_a_dent_is_deep_against_its_own_body_even_if_that_drifts(scan: Scan) -> None:
    drift = np.array([0.0, 0.0, 0.5e-3])
    still = compare(scan, ball(GRASP)).profiles
    field = lambda points: GRASP(points) + drift  # noqa: E731
    moved = Scan(scan.points, None, 'm', False, 'drifted')
    start = SCANNER.after(Pose(np.eye(3), drift))
    drifted = compare(moved, ball(field), setup=Setup(start=start)).profiles
    for one, other in zip(still, drifted, strict=True):
        assert other.apex_m == pytest.approx(one.apex_m, abs=0.03e-3)


def test_a_dent_that_fills_the_object_is_not_taken_for_its_drift() -> None:
    def pressed(points: np.ndarray) -> np.ndarray:
        height = np.clip(points[:, 1] / 0.033, 0.0, 1.0)
        down = -0.8e-3 * height * np.exp(-((points[:, 2] / 0.1) ** 2))
        return down[:, None] * [0.0, 1.0, 0.0]

    can = half_can(pressed)
    undeformed = can.samples.displacement <= can.dent_threshold
    assert can.samples.area[undeformed].sum() < 0.1 * can.samples.area.sum()
    crown = np.array([[0.0, 0.033, 0.0]])
    assert np.linalg.norm(body_motion(can).apply(crown) - crown) < 0.05e-3


def test_a_mesh_brings_its_own_areas() -> None:
    body = odd_body(two_dents(0.004))
    points = body.limit.limit_positions(body.deformed)
    normals = body.limit.vertex_normals(body.deformed)
    outer = points + body.offset * normals
    mesh = Scan(outer, np.asarray(body.mesh.triangles), 'm', False, 'mesh')
    found = compare(mesh, body)
    assert found.area.count == len(points)
    assert found.vertex.max_m < 1e-8


def test_points_far_from_the_object_are_outliers(truth: DeformedSurface) -> None:
    points = np.concatenate((scan_points(truth, 20_000), np.full((100, 3), 0.2)))
    found = compare(cloud(points), truth)
    assert found.outliers == 100
    assert found.vertex.mean_m < 0.11e-3


def test_a_scan_of_nothing_is_refused_by_name(truth: DeformedSurface) -> None:
    with pytest.raises(ComparisonError, match='empty: the scan has no points'):
        compare(cloud(np.empty((0, 3)), 'empty'), truth)


def test_mean_unsigned_noise_is_the_folded_normal() -> None:
    noise = np.random.default_rng(0).standard_normal(200_000)
    assert np.abs(noise).mean() == pytest.approx(mean_unsigned_noise(1.0), rel=5e-3)


def test_the_summary_matches_its_definitions() -> None:
    distance = np.array([-4.0, 1.0, 2.0, -3.0])
    summary = summarise(distance)
    assert (summary.mean_m, summary.max_m, summary.signed_mean_m) == (2.5, 4.0, -1.0)
    assert summary.rms_m == pytest.approx(np.sqrt(7.5))
    weighted = summarise(distance, np.array([0.0, 1.0, 1.0, 0.0]))
    assert weighted.mean_m == 1.5
    assert summarise(np.empty(0)) is None


def test_a_thin_scan_widens_the_disc_until_enough_points_lie_in_it() -> None:
    generator = np.random.default_rng(0)
    points = np.column_stack((generator.random((2_000, 2)) * 0.05, np.zeros(2_000)))
    means = local_means(points, np.full(2_000, 1e-3))
    assert means.radius_m > 2e-3
    assert means.quotable.mean() >= 0.5
    assert np.allclose(means.mean, 1e-3)
