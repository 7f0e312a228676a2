# SPDX-License-Identifier: Apache-2.0
"""What merged views do to neighbourhoods shows where nothing was deformed."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scan_shells import BALL_RADIUS, SCANNER_SIGMA, ball, scan_points

from scan_compare.comparison import Setup, compare
from scan_compare.dent import Contacts
from scan_compare.scan import Scan
from scan_compare.uncertainty import mean_error_sigma, merging_sigma

SIZE = 12e-3
VIEWS = np.random.default_rng(3).normal(size=(40, 3))
VIEWS /= np.linalg.norm(VIEWS, axis=1, keepdims=True)


def feet(seed: int) -> np.ndarray:
    away = np.random.default_rng(seed).normal(size=(40_000, 3))
    return BALL_RADIUS * away / np.linalg.norm(away, axis=1, keepdims=True)


def merged(at: np.ndarray, sigma: float, seed: int) -> np.ndarray:
    """Distances whose every view, the points nearest to a direction, is off by its own amount."""
    random = np.random.default_rng(seed)
    view = np.argmax(at @ VIEWS.T, axis=1)
    return random.normal(0.0, sigma, len(VIEWS))[view] + random.normal(0.0, SCANNER_SIGMA, len(at))


def wrong_model(at: np.ndarray) -> np.ndarray:
    return 0.4e-3 * np.sin(at[:, 0] / 0.01)


def test_views_that_are_off_show_as_a_spread_of_means() -> None:
    at = feet(1)
    found = [merging_sigma(at, merged(at, 0.06e-3, seed), None, SIZE) for seed in range(8)]
    assert np.mean(found) == pytest.approx(0.06e-3, rel=0.25)


def test_against_the_scan_at_rest_both_merges_count_and_the_model_does_not() -> None:
    loaded, rest = feet(1), feet(2)
    found = [
        merging_sigma(
            loaded,
            merged(loaded, 0.06e-3, seed) + wrong_model(loaded),
            (rest, merged(rest, 0.06e-3, 100 + seed) + wrong_model(rest)),
            SIZE,
        )
        for seed in range(8)
    ]
    assert np.mean(found) == pytest.approx(np.sqrt(2.0) * 0.06e-3, rel=0.25)


def test_noise_of_single_points_counts_for_nothing_much() -> None:
    at = feet(1)
    assert merging_sigma(at, merged(at, 0.0, 1), None, SIZE) < 0.1 * SCANNER_SIGMA


def test_too_few_neighbourhoods_tell_nothing() -> None:
    at = 5e-3 + 0.1 * feet(1)
    assert merging_sigma(at, merged(at, 0.06e-3, 1), None, SIZE) is None


def test_a_comparison_says_that_what_merging_does_to_a_depth_is_unknown() -> None:
    model = ball()
    thin = Scan(scan_points(model, 1_500), None, 'm', False, 'thin')
    compared = compare(thin, model)
    assert compared.merging_sigma_m is None
    assert any('lower bound' in note for note in compared.notes)


def test_a_depth_is_no_better_known_than_the_views_that_show_it() -> None:
    model = ball()
    points = scan_points(model, 60_000)
    outward = points / np.linalg.norm(points, axis=1, keepdims=True)
    view = np.argmax(points @ VIEWS.T, axis=1)
    off = np.random.default_rng(5).normal(0.0, 0.15e-3, len(VIEWS))[view]
    pole = np.array([[0.0, 0.0, np.linalg.norm(model.samples.position[0])]])
    contact = Contacts(pole, np.array([[0.0, 0.0, -1.0]]))
    plain, merged_views = (
        compare(Scan(seen, None, 'm', False, 'views'), model, setup=Setup(contacts=contact))
        for seen in (points, points + off[:, None] * outward)
    )
    assert plain.profiles[0].apex_sigma_m < 0.03e-3
    assert merged_views.merging_sigma_m == pytest.approx(0.15e-3, rel=0.35)
    assert merged_views.profiles[0].apex_sigma_m > merged_views.merging_sigma_m


@pytest.mark.parametrize('numbered', [True, False])
def test_views_that_are_off_widen_the_sigma_of_the_mean_error(numbered: bool) -> None:
    """Ten views, each off by as much as a point scatters, move the mean of the distances."""
    at = feet(4)[:4_000]
    view = np.argmax(at @ VIEWS[:10].T, axis=1)
    everywhere = np.ones(len(at), bool)
    known = SimpleNamespace(centre=np.zeros(3), covariance=np.zeros((6, 6)), radius_m=BALL_RADIUS)
    means, sigmas = [], []
    for seed in range(150):
        random = np.random.default_rng([seed, 7])
        distance = SCANNER_SIGMA * (random.normal(size=10)[view] + random.normal(size=len(at)))
        off = SimpleNamespace(foot=at, normal=at / BALL_RADIUS, distance=distance)
        means.append(np.mean(np.abs(distance)))
        sigmas.append(mean_error_sigma(off, everywhere, known, view if numbered else None))
    ratio = np.std(means) / np.sqrt(np.mean(np.square(sigmas)))
    assert 0.8 < ratio < (1.2 if numbered else 2.0)
