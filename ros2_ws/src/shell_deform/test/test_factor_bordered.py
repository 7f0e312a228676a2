# SPDX-License-Identifier: Apache-2.0
"""Bordered systems and low-rank updates through the factor of the plain matrix."""

import sys
from pathlib import Path

import numpy as np
import pytest

from shell_deform.factor.analysis import (
    FactorError,
    Inertia,
    SingularMatrixError,
    analyse,
    factorise,
)
from shell_deform.factor.bordered import BorderedFactor

sys.path.insert(0, str(Path(__file__).parent))
from factor_matrices import (  # noqa: E402
    geodesic_sphere,
    loop_pattern,
    rigid_modes,
    shifted,
    springs,
)

METHODS = ['multifrontal', 'superlu']


@pytest.fixture(scope='module')
def sphere():
    vertices, triangles = geodesic_sphere(4)
    graph = loop_pattern(vertices, triangles)
    return vertices, springs(vertices, graph), analyse(graph, vertices)


def signs(matrix):
    values = np.linalg.eigvalsh(matrix)
    zero = np.abs(values) <= 1e-12 * np.max(np.abs(values))
    return Inertia(
        int(np.sum((values > 0) & ~zero)), int(np.sum((values < 0) & ~zero)), int(np.sum(zero))
    )


def updated_factor(factor, vectors, coefficients):
    return BorderedFactor(factor, update_vectors=vectors, update_coefficients=coefficients)


def random(*shape):
    return np.random.default_rng(sum(shape)).normal(size=shape)


def test_a_solution_is_refined_only_while_that_gains(sphere, monkeypatch):
    _, free, symbolic = sphere
    bordered = BorderedFactor(factorise(symbolic, shifted(free, 0.1)), random(free.shape[0], 2))
    monkeypatch.setattr(sys.modules[BorderedFactor.__module__], 'REFINED', 0.0)
    solved = []
    once = BorderedFactor._solve_once
    monkeypatch.setattr(
        BorderedFactor, '_solve_once', lambda own, *rhs: solved.append(1) or once(own, *rhs)
    )
    bordered.solve(random(free.shape[0]), refinements=50)
    assert len(solved) < 10


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('shift', [0.1, -0.3])
def test_a_bordered_system_equals_the_dense_one(sphere, shift, method):
    _, free, symbolic = sphere
    matrix = shifted(free, shift)
    size = matrix.shape[0]
    borders, corner = random(size, 3), np.diag([0.0, 1.0, -2.0])
    dense = np.block([[matrix.toarray(), borders], [borders.T, corner]])
    bordered = BorderedFactor(factorise(symbolic, matrix, method=method), borders, corner)
    f, g = random(size), random(3)
    x, m = bordered.solve(f, g)
    expected = np.linalg.solve(dense, np.concatenate([f, g]))
    assert np.allclose(np.concatenate([x, m]), expected, rtol=1e-9, atol=1e-9)
    assert bordered.inertia == signs(dense)


def test_borders_hold_the_rigid_modes_of_a_free_body(sphere):
    vertices, free, symbolic = sphere
    modes = rigid_modes(vertices)
    bordered = BorderedFactor(factorise(symbolic, free), modes)
    load = random(len(modes))
    x, m = bordered.solve(load)
    assert np.max(np.abs(modes.T @ x)) < 1e-11 * np.max(np.abs(x))
    # The multipliers are the unbalanced part of the load.
    assert np.allclose(modes @ m, modes @ np.linalg.lstsq(modes, load, rcond=None)[0])
    assert np.max(np.abs(free @ x + modes @ m - load)) < 1e-12 * np.max(np.abs(load))
    assert bordered.inertia == Inertia(len(modes), 6, 0)


def test_borders_that_repeat_each_other_share_their_multipliers(sphere):
    vertices, free, symbolic = sphere
    modes = rigid_modes(vertices)
    alone = BorderedFactor(factorise(symbolic, free), modes)
    twice = BorderedFactor(factorise(symbolic, free), np.hstack([modes, modes[:, :2]]))
    load, values = random(len(modes)), 1e-3 * random(6)
    (x, m), (y, shared) = (
        system.solve(load, given)
        for system, given in ((alone, values), (twice, np.append(values, values[:2])))
    )
    assert np.allclose(y, x, rtol=1e-9, atol=1e-9 * np.abs(x).max())
    expected = np.concatenate([0.5 * m[:2], m[2:], 0.5 * m[:2]])
    assert np.allclose(shared, expected, rtol=1e-9, atol=1e-9 * np.abs(m).max())
    # Every border takes one direction away, told twice or not.
    assert twice.inertia.negative - 8 == alone.inertia.negative - 6
    # Given different values they meet in the middle.
    apart = np.append(values, 3.0 * values[:2])
    middle = alone.solve(load, np.append(2.0 * values[:2], values[2:]))[0]
    assert np.allclose(twice.solve(load, apart)[0], middle, atol=1e-9 * np.abs(middle).max())


def test_borders_that_leave_a_mode_free_are_refused(sphere):
    vertices, free, symbolic = sphere
    bordered = BorderedFactor(factorise(symbolic, free), rigid_modes(vertices)[:, :5])
    assert bordered.inertia.zero == 1
    with pytest.raises(SingularMatrixError, match='1 zero eigenvalues'):
        bordered.solve(random(free.shape[0]))


@pytest.mark.parametrize('distance', [0.0, 1e-14, 1e-11, 1e-8, 1e-5])
def test_a_limit_point_costs_no_accuracy_in_displacement_control(sphere, distance):
    _, free, symbolic = sphere
    fixed = np.zeros(free.shape[0], bool)
    fixed[:12] = True
    kept = np.flatnonzero(~fixed)
    values, vectors = np.linalg.eigh(free.toarray()[np.ix_(kept, kept)])
    matrix = shifted(free, -values[0] + distance)
    border = np.zeros(free.shape[0])
    border[kept[np.argmax(np.abs(vectors[:, 0]))]] = 1.0
    bordered = BorderedFactor(factorise(symbolic, matrix, fixed), border)
    load = np.where(fixed, 0.0, random(free.shape[0]))
    x, m = bordered.solve(load, [0.25])
    rest = np.where(fixed, 0.0, matrix @ x + border * m - load)
    assert np.max(np.abs(rest)) < 1e-13 * (np.max(np.abs(load)) + 40.0 * np.max(np.abs(x)))
    assert np.isclose(border @ x, 0.25, rtol=1e-12)
    assert np.all(x[fixed] == 0.0)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('strength', [1e-8, 3.0, -3.0, 1e8])
def test_a_rank_one_update_equals_the_dense_sum(sphere, strength, method):
    _, free, symbolic = sphere
    matrix = shifted(free, -0.3)
    vector = random(matrix.shape[0])
    dense = matrix.toarray() + strength * np.outer(vector, vector)
    updated = updated_factor(factorise(symbolic, matrix, method=method), vector, strength)
    load = random(len(vector))
    x = updated.solve(load)[0]
    error = np.max(np.abs(dense @ x - load))
    assert error < 1e-12 * (np.max(np.abs(dense)) * np.max(np.abs(x)) + np.max(np.abs(load)))
    assert updated.inertia == signs(dense)


def test_a_negative_update_can_make_the_matrix_unstable(sphere):
    _, free, symbolic = sphere
    matrix = shifted(free, 0.1)
    vector = random(matrix.shape[0])
    factor = factorise(symbolic, matrix)
    critical = -1.0 / (vector @ factor.solve(vector))
    assert updated_factor(factor, vector, 0.99 * critical).inertia.negative == 0
    assert updated_factor(factor, vector, 1.01 * critical).inertia.negative == 1
    assert updated_factor(factor, vector, 0.0).inertia == factor.inertia


def test_springs_on_the_rigid_modes_make_a_free_body_regular(sphere):
    vertices, free, symbolic = sphere
    modes = rigid_modes(vertices)
    updated = updated_factor(factorise(symbolic, free), modes, np.full(6, 0.5))
    load = random(len(modes))
    dense = free.toarray() + 0.5 * modes @ modes.T
    assert np.allclose(updated.solve(load)[0], np.linalg.solve(dense, load), rtol=1e-9)
    assert updated.inertia == Inertia(len(modes), 0, 0)


def test_borders_and_updates_work_together_for_many_loads(sphere):
    _, free, symbolic = sphere
    matrix = shifted(free, -0.3)
    size = matrix.shape[0]
    border, vector = random(size, 1), random(size, 2)
    whole = matrix.toarray() + vector @ np.diag([2.0, -1.0]) @ vector.T
    dense = np.block([[whole, border], [border.T, np.zeros((1, 1))]])
    bordered = BorderedFactor(
        factorise(symbolic, matrix), border, None, vector, np.array([2.0, -1.0])
    )
    f, g = random(size, 4), random(1, 4)
    x, m = bordered.solve(f, g)
    expected = np.linalg.solve(dense, np.vstack([f, g]))
    assert np.allclose(np.vstack([x, m]), expected, rtol=1e-8, atol=1e-8)
    assert bordered.inertia == signs(dense)


def test_shapes_that_do_not_fit_are_refused(sphere):
    _, free, symbolic = sphere
    factor = factorise(symbolic, shifted(free, 0.1))
    with pytest.raises(FactorError, match='borders of shape'):
        BorderedFactor(factor, np.ones(5))
    with pytest.raises(FactorError, match='corner'):
        BorderedFactor(factor, np.ones(factor.size), np.eye(2))
    with pytest.raises(FactorError, match='update coefficients'):
        updated_factor(factor, np.ones(factor.size), [1.0, 2.0])
    with pytest.raises(FactorError, match='border right-hand side'):
        BorderedFactor(factor, np.ones(factor.size)).solve(np.ones(factor.size), [1.0, 2.0])


@pytest.mark.parametrize('method', METHODS)
def test_what_is_measured_need_not_be_what_is_pushed(sphere, method):
    _, free, symbolic = sphere
    matrix = shifted(free, -0.3)
    size = matrix.shape[0]
    pushes, measures = random(size, 3), random(size, 3) + 1.0
    dense = np.block([[matrix.toarray(), pushes], [measures.T, np.zeros((3, 3))]])
    factor = factorise(symbolic, matrix, method=method)
    bordered = BorderedFactor(factor, pushes, measures=measures)
    f, g = random(size), random(3)
    x, m = bordered.solve(f, g)
    expected = np.linalg.solve(dense, np.concatenate([f, g]))
    np.testing.assert_allclose(np.concatenate([x, m]), expected, rtol=1e-7, atol=1e-9)
    with pytest.raises(FactorError, match='not symmetric'):
        _ = bordered.inertia
    with pytest.raises(FactorError, match='2 measures for 3 borders'):
        BorderedFactor(factor, pushes, measures=measures[:, :2])
