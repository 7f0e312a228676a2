from __future__ import annotations

import numpy as np
import pytest
from scan_shells import ball, two_dents

from scan_compare.error_budget import (
    BudgetError,
    error_budget,
    model_surfaces,
    virtual_scans,
)
from scan_compare.virtual_scanner import Capsule, VirtualScanner, scan_surface, turntable

TRUTH = ball(two_dents(0.006, bulge=0.0003))
PIN = Capsule(np.array([0.0, 0.0, 0.027]), np.array([0.0, 0.0, 0.09]), 2e-3)
FINGER = Capsule(np.array([0.0, 0.0, 0.045]), np.array([0.05, 0.0, 0.07]), 9e-3)
SCANNER = VirtualScanner(turntable(8), fingers=(PIN, FINGER))


def test_a_perfect_scanner_returns_the_surface_itself() -> None:
    perfect = SCANNER.without('noise').without('occlusion').without('merging')
    scan = scan_surface(TRUTH.samples.position, TRUTH.samples.normal, perfect, 1)
    assert np.allclose(scan.points, TRUTH.samples.position, atol=1e-15)
    assert 'synthetic' in scan.source


def test_fingers_hide_the_dent() -> None:
    scan = scan_surface(TRUTH.samples.position, TRUTH.samples.normal, SCANNER, 1)
    near_pin = np.linalg.norm(scan.points - TRUTH.samples.position[0], axis=1)
    assert len(near_pin) < len(TRUTH.samples.position)
    top = scan.points[scan.points[:, 2] > 0.0]
    assert np.hypot(top[:, 0], top[:, 1]).min() > 1.0e-3


def test_noise_lies_along_the_ray_and_has_its_sigma() -> None:
    one_view = VirtualScanner(np.array([[0.0, 0.0, 1.0]]))
    points = np.random.default_rng(0).random((20_000, 3))
    scan = scan_surface(points, np.tile([0.0, 0.0, 1.0], (20_000, 1)), one_view, 3)
    error = scan.points - points
    assert np.abs(error[:, :2]).max() == 0.0
    assert error[:, 2].std() == pytest.approx(0.127e-3, rel=0.03)


def test_each_cause_switched_off_lowers_the_error_by_its_share() -> None:
    samples = TRUTH.samples
    budget = error_budget(
        virtual_scans(samples.position, samples.normal, SCANNER, 1),
        model_surfaces(
            ball(two_dents(0.0074, bulge=0.0003)),
            ball(two_dents(0.0066, bulge=0.0003)),
            ball(two_dents(0.0068, bulge=0.0003)),
            TRUTH,
        ),
    )
    shares = {row.cause: row.share_m for row in budget.rows}
    means = {row.cause: row.mean_error_m for row in budget.rows}
    assert list(shares)[0] == 'all causes'
    assert shares['all causes'] == 0.0
    assert shares['without noise'] > 0.03e-3
    assert shares['without force'] > 0.0
    assert shares['without air'] > 0.0
    assert means['no cause'] < 0.01e-3
    assert len(budget.to_json()) == 7
    assert 'without merging' in budget.text()


def test_a_budget_without_causes_is_refused() -> None:
    with pytest.raises(BudgetError):
        error_budget(lambda on: None, lambda on: TRUTH, ())
