# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from scan_shells import SCANNER_SIGMA, ball, occlude, scan_points, two_dents

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.error_budget import BudgetError, error_budget, model_surfaces
from scan_compare.scan import Scan

TRUTH = ball(two_dents(0.006, bulge=0.0003))


def make_scan(on: frozenset[str]) -> Scan:
    points = scan_points(TRUTH, 20_000, SCANNER_SIGMA if 'noise' in on else 0.0)
    if 'occlusion' in on:
        points = occlude(points, 0.4, np.array([1.0, 0.2, 0.3]))
    if 'merging' in on:
        points[points[:, 1] > 0.0] += [0.0, 0.2e-3, 0.0]
    return Scan(points, None, 'm', False, 'planted')


def models() -> tuple[DeformedSurface, ...]:
    depths = (0.0074, 0.0066, 0.0068)
    return (*(ball(two_dents(depth, bulge=0.0003)) for depth in depths), TRUTH)


def test_each_cause_switched_off_lowers_the_error_by_its_share() -> None:
    budget = error_budget(make_scan, model_surfaces(*models()))
    shares = {row.cause: row.share_m for row in budget.rows}
    means = {row.cause: row.mean_error_m for row in budget.rows}
    assert list(shares)[0] == 'all causes'
    assert shares['all causes'] == 0.0
    assert shares['without noise'] > 0.03e-3
    assert shares['without force'] > 0.0
    assert shares['without air'] > 0.0
    assert shares['without merging'] > 0.0
    assert means['no cause'] < 0.002e-3
    assert len(budget.to_json()) == 7
    assert 'without merging' in budget.text()


def test_a_budget_without_causes_is_refused() -> None:
    with pytest.raises(BudgetError):
        error_budget(make_scan, lambda on: TRUTH, ())
