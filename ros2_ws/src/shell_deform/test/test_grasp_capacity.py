# SPDX-License-Identifier: Apache-2.0
"""What a squeeze carries: closed forms, the ball of wrenches, and the proofs that come along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grasp_sets import leaning_pins, random_grasp, three_pins, two_pads
from scipy.optimize import minimize

from shell_deform.grasp.capacity import (
    DIRECTIONS,
    GRAVITY,
    bounds_of,
    bounds_sigma,
    epsilon,
    force_capacities,
    forces,
    liftable_mass,
    load_capacity,
)
from shell_deform.grasp.closure import closure
from shell_deform.grasp.contacts import GraspError, contact_wrenches, contacts

MIDDLE = np.zeros(3)


@pytest.mark.parametrize('friction', [0.1, 0.5, 1.0, 10.0])
def test_two_flat_pads_lift_twice_the_friction_of_one(friction):
    grasp = two_pads(friction, push=20.0)
    lifted = load_capacity(grasp, np.array([0.0, -1.0, 0, 0, 0, 0]), MIDDLE).factor
    assert lifted == pytest.approx(2.0 * friction * 20.0, rel=1e-9)
    assert liftable_mass(grasp, np.array([0.0, -1.0, 0.0]), MIDDLE) == pytest.approx(
        40.0 * friction / GRAVITY, rel=1e-9
    )


def test_two_flat_pads_turn_by_the_friction_of_their_arms():
    grasp = two_pads(0.4, push=20.0, arm=5e-3)
    spun = load_capacity(grasp, np.array([0, 0, 0, 0, 0, 1.0]), MIDDLE).factor
    assert spun == pytest.approx(2.0 * 0.4 * 20.0 * 5e-3, rel=1e-8)


@pytest.mark.parametrize('friction', [0.2, 0.7])
def test_three_pins_lift_along_and_hold_across_their_axis_by_closed_forms(friction):
    grasp = three_pins(friction, push=20.0)
    along = load_capacity(grasp, np.array([0, 0, -1.0, 0, 0, 0]), MIDDLE).factor
    assert along == pytest.approx(3.0 * friction * 20.0, rel=1e-9)
    spun = load_capacity(grasp, np.array([0, 0, 0, 0, 0, 1.0]), MIDDLE).factor
    assert spun == pytest.approx(3.0 * friction * 20.0 * 0.03, rel=1e-8)
    # Away from pin 1: it presses alone, and the others lean on their friction.
    pushed = load_capacity(grasp, np.array([1.0, 0, 0, 0, 0, 0]), MIDDLE).factor
    others = 2.0 * 20.0 * max(friction * np.sin(np.radians(60.0)) - 0.5, 0.0)
    assert pushed == pytest.approx(20.0 + others, rel=1e-8)


def test_a_capacity_has_the_sigma_of_its_friction_and_of_its_pushes():
    """Beside differences of the programme itself."""
    rng = np.random.default_rng(4)
    for _ in range(5):
        grasp = random_grasp(rng, 4, 0.6)
        here, proofs = force_capacities(grasp, DIRECTIONS[:4], MIDDLE)
        basis, step = contact_wrenches(grasp, MIDDLE, 1.0), 1e-6
        moved = [replace(grasp, friction=grasp.friction + step)]
        moved += [replace(grasp, push=grasp.push + step * row) for row in np.eye(4)]
        slopes = np.array(
            [(force_capacities(one, DIRECTIONS[:4], MIDDLE)[0] - here) / step for one in moved]
        )
        sigmas = np.array([0.1, 0.5, 1.0, 0.2, 0.0])
        told = bounds_sigma(grasp, proofs, forces(DIRECTIONS[:4]), basis, sigmas[1:], 0.1)
        differences = np.linalg.norm(slopes * sigmas[:, None], axis=0)
        assert told == pytest.approx(differences, rel=1e-3, abs=1e-6)


def test_what_a_grasp_cannot_carry_is_nothing_and_no_round_off():
    grasp = leaning_pins(0.3, 0.2)
    found, _ = force_capacities(grasp, DIRECTIONS, MIDDLE)
    assert found.min() == 0.0 and found.max() > 0.1


def test_the_forces_balance_inside_their_cones():
    rng = np.random.default_rng(1)
    for _ in range(10):
        grasp = random_grasp(rng, 4, 0.6)
        wrench = rng.normal(size=6) * [1, 1, 1, 0.03, 0.03, 0.03]
        found = load_capacity(grasp, wrench, MIDDLE)
        basis = contact_wrenches(grasp, MIDDLE, 1.0)
        rest = np.einsum('akf,kf->a', basis, found.force) + found.factor * wrench
        assert np.abs(rest).max() < 1e-6 * grasp.push.max()
        across = np.linalg.norm(found.force[:, 1:], axis=1)
        assert np.all(across < 0.6 * found.force[:, 0] + 1e-6)
        assert np.all(found.force[:, 0] < grasp.push + 1e-6)


def test_the_motion_proves_the_optimum_and_bounds_that_of_neighbours():
    grasp = three_pins(0.5, push=20.0, arm=1e-3)
    wrench = np.array([0.3, 0.2, -1.0, 0, 0, 0])
    found = load_capacity(grasp, wrench, MIDDLE)
    assert bounds_of(grasp, found.bound[None], wrench[None], contact_wrenches(grasp, MIDDLE, 1.0))[
        0
    ] == pytest.approx(found.factor, rel=1e-6)
    turned = grasp.normal + 1e-3 * np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 0.5]])
    near = contacts(grasp.point, turned / np.linalg.norm(turned, axis=1)[:, None], 20.0, 0.5, 1e-3)
    exact = load_capacity(near, wrench, MIDDLE).factor
    bound = bounds_of(near, found.bound[None], wrench[None], contact_wrenches(near, MIDDLE, 1.0))[
        0
    ]
    assert exact * (1.0 - 1e-9) <= bound <= exact * 1.001


def test_capacity_grows_in_proportion_to_the_squeeze_and_with_friction():
    grasp = random_grasp(np.random.default_rng(3), 4, 0.5)
    twice = contacts(grasp.point, grasp.normal, 2.0 * grasp.push, 0.5, grasp.arm)
    rougher = contacts(grasp.point, grasp.normal, grasp.push, 0.7, grasp.arm)
    here, _ = force_capacities(grasp, DIRECTIONS, MIDDLE)
    assert force_capacities(twice, DIRECTIONS, MIDDLE)[0] == pytest.approx(2.0 * here, rel=1e-6)
    assert np.all(force_capacities(rougher, DIRECTIONS, MIDDLE)[0] >= here - 1e-7)


def _support(grasp, motion, length):
    work = np.einsum('a,akf->kf', motion, contact_wrenches(grasp, MIDDLE, length))
    across = np.linalg.norm(work[:, 1:], axis=1)
    return float(grasp.push @ np.maximum(work[:, 0] + grasp.friction * across, 0.0))


def test_the_ball_of_wrenches_is_no_larger_than_any_search_finds():
    rng = np.random.default_rng(8)
    for count in (2, 3, 4):
        grasp = random_grasp(rng, count, 0.9, arm=3e-3, lean=0.1)
        while not closure(grasp).closed:
            grasp = random_grasp(rng, count, 0.9, arm=3e-3, lean=0.1)
        radius, weakest = epsilon(grasp, MIDDLE, 0.03)
        starts = rng.normal(size=(4000, 6))
        starts /= np.linalg.norm(starts, axis=1)[:, None]
        height = np.array([_support(grasp, one, 0.03) for one in starts])
        best = height.min()
        for start in starts[np.argsort(height)[:3]]:
            found = minimize(
                lambda z, g=grasp: _support(g, z / np.linalg.norm(z), 0.03),
                start,
                method='Nelder-Mead',
                options={'maxiter': 4000, 'xatol': 1e-9, 'fatol': 1e-11},
            )
            best = min(best, found.fun)
        assert radius <= best * (1.0 + 1e-6)
        assert radius == pytest.approx(best, rel=1e-2)
        assert _support(grasp, weakest, 0.03) == pytest.approx(radius, rel=1e-6)


def test_an_open_grasp_has_no_ball_and_says_so():
    assert epsilon(leaning_pins(0.3, 0.8, arm=0.0), MIDDLE, 0.03)[0] == pytest.approx(0.0)
    assert epsilon(two_pads(0.5).chosen(np.array([True, False])), MIDDLE, 0.03)[0] == 0.0


@pytest.mark.parametrize('friction', [0.0, 0.3, 10.0])
def test_every_capacity_is_a_number(friction):
    rng = np.random.default_rng(11)
    for count in (1, 2, 3, 5):
        for push in (0.0, 3.0):
            grasp = random_grasp(rng, count, friction)
            grasp = contacts(grasp.point, grasp.normal, push, friction, 0.0)
            found, _ = force_capacities(grasp, DIRECTIONS[:6], MIDDLE)
            assert np.all(np.isfinite(found)) and np.all(found >= 0.0)


def test_a_load_that_is_none_is_refused():
    with pytest.raises(GraspError, match='six finite numbers'):
        load_capacity(two_pads(0.3), np.zeros(6), MIDDLE)
