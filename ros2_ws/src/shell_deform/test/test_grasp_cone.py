# SPDX-License-Identifier: Apache-2.0
"""The interior-point method against its plain twin and against another maker's programme."""

from __future__ import annotations

import numpy as np
import pytest
from grasp_sets import by_planes, random_grasp

from shell_deform.grasp import cone
from shell_deform.grasp.cone import ConeError, solve_cone
from shell_deform.grasp.cone_plain import solve_plain
from shell_deform.grasp.contacts import contact_wrenches, size_of


def _load_programme(seed):
    rng = np.random.default_rng(seed)
    grasp = random_grasp(rng, int(rng.integers(2, 6)), float(rng.choice([0.05, 0.3, 0.8, 10.0])))
    count = grasp.count
    basis = contact_wrenches(grasp, np.zeros(3), size_of(grasp))
    wrench = rng.normal(size=6)
    matrix = np.zeros((6 + count, 5 * count + 1))
    for i in range(count):
        matrix[:6, 4 * i] = basis[:, i, 0] / grasp.friction[i]
        matrix[:6, 4 * i + 1 : 4 * i + 4] = basis[:, i, 1:]
        matrix[6 + i, 4 * i], matrix[6 + i, 4 * count + i] = 1.0 / grasp.friction[i], 1.0
    matrix[:6, -1] = wrench / np.linalg.norm(wrench)
    cost = np.zeros(5 * count + 1)
    cost[-1] = -1.0
    return cost, matrix, np.append(np.zeros(6), grasp.push / grasp.push.max()), count


@pytest.mark.parametrize('seed', range(60))
def test_the_optimum_is_that_of_an_independent_solver(seed):
    cost, matrix, right, count = _load_programme(seed)
    x, _ = solve_cone(cost, matrix, right, count)
    assert cost @ x == pytest.approx(by_planes(cost, matrix, right, count), rel=1e-6, abs=1e-7)
    assert np.abs(matrix @ x - right).max() < 1e-7


@pytest.mark.parametrize('seed', range(20))
def test_the_kernel_and_its_plain_twin_agree(seed):
    cost, matrix, right, count = _load_programme(seed)
    x, y = solve_cone(cost, matrix, right, count)
    plain_x, plain_y, done = solve_plain(cost, matrix, right, count, cone.TOLERANCE)
    assert done
    assert cost @ x == pytest.approx(cost @ plain_x, rel=1e-8, abs=1e-9)
    assert right @ y == pytest.approx(right @ plain_y, rel=1e-6, abs=1e-8)


def test_a_programme_without_a_solution_is_refused():
    matrix = np.array([[1.0, 0.0, 0.0, 0.0]])
    with pytest.raises(ConeError, match='1 friction cones'):
        solve_cone(np.array([1.0, 0.0, 0.0, 0.0]), matrix, np.array([-1.0]), 1)
