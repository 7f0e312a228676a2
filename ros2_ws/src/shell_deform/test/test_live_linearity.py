# SPDX-License-Identifier: Apache-2.0
"""The gauge of the transition, against converged solutions."""

import numpy as np
import pytest

from shell_deform.live.background.condensed import contact_rows
from shell_deform.live.background.small_loads import pair_products, small_loads
from shell_deform.live.background.tracked_state import Target
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.live.tick.linearity import linear_error

R, H = 31.25e-3, 2.5e-3


@pytest.fixture(scope='module')
def squeezed(sphere):
    """Make (true error, prediction with depth, prediction without) at a depth in walls."""
    model = sphere(R, H, subdivisions=2)
    tracker = EquilibriumTracker(model)
    rows = contact_rows(model, tuple(model.contact(np.array([x, 0, 0]), 4e-3) for x in (R, -R)))
    small = small_loads(model, model.rest, tracker.rest_system(model.rest, rows), rows)
    tracker.set_contacts(rows, np.zeros(2))

    def at(walls):
        here = tracker.present(np.ones(2, bool))
        target = Target(here.force, np.full(2, walls * H), here.driven, here.rigid, here.held)
        assert tracker.advance(target) == 1.0
        force, depth = tracker.state.force, np.full(2, walls * H)
        truth = 1.0 - float((small.compliance @ force)[0]) / depth[0]
        with_depth = linear_error(small.compliance, small.second_order, force, depth)
        return truth, with_depth, linear_error(small.compliance, small.second_order, force)

    return at


@pytest.mark.parametrize('walls', [0.05, 0.12, 0.28, 0.5, 1.0, 2.0])
def test_the_prediction_is_within_a_tenth_of_the_truth_up_to_two_walls(squeezed, walls):
    truth, predicted, _ = squeezed(walls)
    assert predicted == pytest.approx(truth, rel=0.1)


def test_the_linear_quantities_alone_underrate_a_deep_dent(squeezed):
    truth, predicted, alone = squeezed(2.0)
    assert alone < predicted
    assert alone == pytest.approx(truth, rel=0.5)


def test_linear_theory_is_exact_for_no_load():
    assert linear_error(np.eye(2), np.ones((2, 3)), np.zeros(2)) == 0.0


def test_a_stiffening_shell_makes_linear_theory_too_soft():
    assert linear_error(np.eye(1), np.array([[-0.1]]), np.ones(1)) == pytest.approx(0.1)


def test_pairs_come_in_the_order_of_the_upper_triangle():
    assert pair_products(np.array([1.0, 2.0, 3.0])).tolist() == [1, 2, 3, 4, 6, 9]
