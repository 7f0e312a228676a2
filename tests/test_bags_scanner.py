# SPDX-License-Identifier: Apache-2.0
"""The simulated scanner: what it sees, what it gets wrong, and that a seed fixes both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bags.scanner import ErrorSources, Obstacle, Scanner, View, scan
from bags.surfaces import BallTruth, Surface

RING = [View(float(azimuth), 10.0) for azimuth in range(0, 360, 60)]
NOTHING = ErrorSources(False, False, False, False, False, False)
COARSE = Scanner(pitch_m=0.0006, most_points=20000)


@pytest.fixture(scope='module')
def ball() -> Surface:
    return BallTruth().surface(16.502902192616453, azimuths=120)


def test_a_scan_without_errors_lies_on_the_truth(ball: Surface) -> None:
    found = scan(ball, RING, [], np.zeros(3), replace(COARSE, errors=NOTHING), 1)
    assert abs(found.points - found.true_points).max() < 1e-8


def test_equal_seeds_give_equal_bytes_and_others_do_not(ball: Surface) -> None:
    first, again, other = (scan(ball, RING, [], np.zeros(3), COARSE, seed) for seed in (3, 3, 4))
    assert first.points.tobytes() == again.points.tobytes()
    assert first.points.tobytes() != other.points[: len(first.points)].tobytes()


def test_the_noise_runs_along_the_ray_and_grows_with_the_incidence() -> None:
    sphere = BallTruth().surface(0.0, azimuths=240)
    scanner = replace(
        COARSE, errors=replace(NOTHING, noise=True, incidence=True), working_distance_m=10.0
    )
    found = scan(sphere, [View(0.0, 0.0)], [], np.zeros(3), scanner, 5)
    error = found.points - found.true_points
    assert abs(error[:, 1:]).max() < 0.01 * abs(error[:, 0]).max()
    cosine = found.true_points[:, 0] / 0.0325
    scaled = error[:, 0] * cosine / scanner.noise_sigma_m
    for low, high in ((0.4, 0.6), (0.6, 0.8), (0.8, 1.0)):
        inside = (cosine > low) & (cosine < high)
        assert scaled[inside].std() == pytest.approx(1.0, abs=0.06)


def test_points_seen_too_flat_are_dropped(ball: Surface) -> None:
    scanner = replace(COARSE, errors=replace(NOTHING, incidence=True), working_distance_m=10.0)
    sphere = BallTruth().surface(0.0, azimuths=240)
    found = scan(sphere, [View(0.0, 0.0)], [], np.zeros(3), scanner, 5)
    steepest = np.cos(np.radians(scanner.steepest_incidence_deg))
    assert (found.true_points[:, 0] / 0.0325).min() > steepest - 0.01


def test_a_pin_hides_what_is_behind_it_and_under_it(ball: Surface) -> None:
    top = BallTruth().surface(16.502902192616453, azimuths=120).vertices[-2]
    pin = Obstacle(top, top + np.array([0.0, 0.0, 0.06]), 0.001)
    link = Obstacle(top + np.array([0.0, 0.0, 0.06]), np.array([0.0, 0.05, 0.09]), 0.011)
    views = [View(float(azimuth), 60.0) for azimuth in range(0, 360, 60)]
    scanner = replace(COARSE, errors=replace(NOTHING, occlusion=True), most_points=10**6)
    seen = scan(ball, views, [], np.zeros(3), scanner, 2).true_points
    hidden = scan(ball, views, [pin, link], np.zeros(3), scanner, 2).true_points

    def in_dent(points: np.ndarray) -> np.ndarray:
        radius = np.hypot(points[:, 0], points[:, 1])
        return radius[(points[:, 2] > 0) & (radius < 0.005)]

    assert len(in_dent(hidden)) < 0.85 * len(in_dent(seen))
    assert in_dent(hidden).min() > 0.0009


def test_the_far_side_is_hidden_by_the_near_side(ball: Surface) -> None:
    scanner = replace(COARSE, errors=replace(NOTHING, occlusion=True))
    found = scan(ball, [View(0.0, 0.0)], [], np.zeros(3), scanner, 2)
    assert found.true_points[:, 0].min() > -0.002


def test_every_error_source_has_its_own_switch(ball: Surface) -> None:
    clean = scan(ball, RING, [], np.zeros(3), replace(COARSE, errors=NOTHING), 6)
    for name in ('noise', 'lateral', 'registration', 'placement'):
        errors = replace(NOTHING, **{name: True})
        found = scan(ball, RING, [], np.zeros(3), replace(COARSE, errors=errors), 6)
        size = np.sqrt(((found.points - found.true_points) ** 2).sum(axis=1).mean())
        assert 2e-5 < size < 3e-3, name
    assert len(clean.points) > 10000


def test_the_placement_is_kept_beside_the_scan(ball: Surface) -> None:
    scanner = replace(COARSE, errors=replace(NOTHING, placement=True))
    found = scan(ball, RING, [], np.array([0.1, 0.0, 0.0]), scanner, 8)
    back = (found.points - found.placement_shift) @ found.placement_rotation
    assert abs(back - found.true_points).max() < 1e-7


def test_a_scan_never_holds_more_points_than_asked(ball: Surface) -> None:
    found = scan(ball, RING, [], np.zeros(3), replace(COARSE, most_points=5000), 9)
    assert 4500 < len(found.points) <= 5000
    assert len(found.view) == len(found.true_points) == len(found.points)


def test_a_scanner_that_sees_nothing_says_so(ball: Surface) -> None:
    box = Obstacle(np.zeros(3), np.array([0.001, 0.0, 0.0]), 0.2)
    with pytest.raises(ValueError, match='sees no point'):
        scan(ball, RING, [box], np.zeros(3), COARSE, 1)
