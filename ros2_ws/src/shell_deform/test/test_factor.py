# SPDX-License-Identifier: Apache-2.0
"""The sparse factorisation: right on definite, indefinite and singular matrices."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.factor.analysis import (
    FactorError,
    Inertia,
    SingularMatrixError,
    analyse,
    factorise,
    superlu_factorise,
)

sys.path.insert(0, str(Path(__file__).parent))
from factor_matrices import (  # noqa: E402
    geodesic_sphere,
    loop_pattern,
    rigid_modes,
    shifted,
    springs,
)

METHODS = ['multifrontal', 'superlu']


class Sphere:
    def __init__(self, frequency):
        self.vertices, triangles = geodesic_sphere(frequency)
        self.graph = loop_pattern(self.vertices, triangles)
        self.free = springs(self.vertices, self.graph)
        self.symbolic = analyse(self.graph, self.vertices)
        self.load = np.random.default_rng(1).normal(size=self.free.shape[0])


@pytest.fixture(scope='module')
def sphere():
    return Sphere(4)


@pytest.fixture(scope='module')
def larger_sphere():
    return Sphere(8)


def dense_inertia(matrix, zero=1e-12):
    values = np.linalg.eigvalsh(matrix.toarray())
    size = np.max(np.abs(values))
    return Inertia(
        int(np.sum(values > zero * size)),
        int(np.sum(values < -zero * size)),
        int(np.sum(np.abs(values) <= zero * size)),
    )


def backward_error(matrix, x, load):
    scale = abs(matrix).max() * np.max(np.abs(x)) + np.max(np.abs(load))
    return np.max(np.abs(matrix @ x - load)) / scale


def test_the_pattern_of_a_closed_loop_sphere_has_37_blocks_per_row(larger_sphere):
    assert np.max(np.diff(larger_sphere.graph.indptr)) == 37


@pytest.mark.parametrize('method', METHODS)
def test_a_definite_matrix_is_solved_to_rounding_without_refinement(sphere, method):
    matrix = shifted(sphere.free, 0.1)
    factor = factorise(sphere.symbolic, matrix, method=method)
    x = factor.solve(sphere.load, refinements=0)
    assert backward_error(matrix, x, sphere.load) < 1e-14
    assert factor.definite
    assert factor.inertia == Inertia(len(sphere.load), 0, 0)


@pytest.mark.parametrize('method', METHODS)
def test_the_solution_agrees_with_splu(sphere, method):
    matrix = shifted(sphere.free, 0.1)
    expected = scipy.sparse.linalg.splu(matrix.tocsc()).solve(sphere.load)
    x = factorise(sphere.symbolic, matrix, method=method).solve(sphere.load)
    assert np.linalg.norm(x - expected) < 1e-11 * np.linalg.norm(expected)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('shift', [-0.05, -0.3, -2.0, -9.0])
def test_the_inertia_of_162_vertices_equals_that_of_the_eigenvalues(sphere, shift, method):
    matrix = shifted(sphere.free, shift)
    factor = factorise(sphere.symbolic, matrix, method=method)
    assert factor.inertia == dense_inertia(matrix)
    assert backward_error(matrix, factor.solve(sphere.load), sphere.load) < 1e-12


def test_the_inertia_of_642_vertices_equals_that_of_the_eigenvalues(larger_sphere):
    matrix = shifted(larger_sphere.free, -0.6)
    factor = factorise(larger_sphere.symbolic, matrix)
    assert factor.inertia == dense_inertia(matrix)
    x = factor.solve(larger_sphere.load)
    assert backward_error(matrix, x, larger_sphere.load) < 1e-14


def test_many_right_hand_sides_give_the_same_answers_as_one_at_a_time(sphere):
    for shift in (0.1, -0.3):
        factor = factorise(sphere.symbolic, shifted(sphere.free, shift))
        loads = np.random.default_rng(2).normal(size=(len(sphere.load), 5))
        together = factor.solve(loads)
        one_by_one = np.column_stack([factor.solve(loads[:, k]) for k in range(5)])
        assert np.allclose(together, one_by_one, rtol=1e-10, atol=1e-10)
        assert factor.solve(loads[:, :1]).shape == (len(sphere.load), 1)


def test_the_three_storage_formats_give_the_same_factor(sphere):
    matrix = shifted(sphere.free, 0.1)
    expected = factorise(sphere.symbolic, matrix).solve(sphere.load)
    for other in (matrix.tocsc(), matrix.tobsr((3, 3))):
        other.sort_indices()
        assert np.array_equal(factorise(sphere.symbolic, other).solve(sphere.load), expected)


def test_a_pattern_of_unknowns_is_analysed_like_that_of_its_vertices(sphere):
    symbolic = analyse(sphere.free, sphere.vertices)
    assert np.array_equal(symbolic.indices, sphere.symbolic.indices)
    assert np.array_equal(symbolic.order, sphere.symbolic.order)


def test_without_coordinates_the_order_comes_from_the_graph(sphere):
    symbolic = analyse(sphere.free)
    assert sorted(symbolic.order) == list(range(len(sphere.vertices)))
    assert symbolic.stored_entries < 1.5 * sphere.symbolic.stored_entries
    matrix = shifted(sphere.free, 0.1)
    x = factorise(symbolic, matrix).solve(sphere.load)
    assert backward_error(matrix, x, sphere.load) < 1e-14


@pytest.mark.parametrize('method', METHODS)
def test_held_unknowns_stay_zero_and_do_not_count(sphere, method):
    fixed = np.zeros(len(sphere.load), bool)
    fixed[:30] = True
    factor = factorise(sphere.symbolic, sphere.free, fixed, method=method)
    x = factor.solve(sphere.load)
    reduced = sphere.free.toarray()[30:, 30:]
    assert np.all(x[:30] == 0.0)
    assert np.allclose(x[30:], np.linalg.solve(reduced, sphere.load[30:]), rtol=1e-9)
    assert factor.inertia == Inertia(len(x) - 30, 0, 0)


def test_the_six_rigid_modes_of_a_free_body_are_counted_as_zero(larger_sphere):
    factor = factorise(larger_sphere.symbolic, larger_sphere.free)
    assert factor.inertia == Inertia(len(larger_sphere.load) - 6, 0, 6)
    modes = factor.zero_modes()
    exact = rigid_modes(larger_sphere.vertices)
    fit = exact @ np.linalg.lstsq(exact, modes, rcond=None)[0]
    assert np.allclose(fit, modes, atol=1e-9 * np.max(np.abs(modes)))


def test_a_free_body_under_balanced_loads_is_solved(larger_sphere):
    factor = factorise(larger_sphere.symbolic, larger_sphere.free)
    load = larger_sphere.free @ larger_sphere.load
    assert backward_error(larger_sphere.free, factor.solve(load), load) < 1e-14


def test_an_unbalanced_load_on_a_free_body_is_refused_by_name(sphere):
    factor = factorise(sphere.symbolic, sphere.free)
    with pytest.raises(SingularMatrixError, match='6 zero eigenvalues') as caught:
        factor.solve(sphere.load)
    assert len(caught.value.unknowns) == 6


def test_an_empty_row_is_named_as_singular(sphere):
    matrix = shifted(sphere.free, 0.1)
    emptied = matrix.copy()
    emptied.data[emptied.indptr[77] : emptied.indptr[78]] = 0.0
    emptied.data[emptied.indices == 77] = 0.0
    factor = factorise(sphere.symbolic, emptied)
    assert factor.inertia == Inertia(len(sphere.load) - 1, 0, 1)
    assert list(factor.weak_unknowns) == [77]


@pytest.mark.parametrize('modulus', [1e-9, 1e3, 2.1e11])
def test_the_unit_of_the_stiffness_does_not_matter(sphere, modulus):
    for shift, negatives in ((0.0, 0), (-0.3, factorise(
        sphere.symbolic, shifted(sphere.free, -0.3)).inertia.negative)):  # fmt: skip
        factor = factorise(sphere.symbolic, modulus * shifted(sphere.free, shift))
        assert factor.inertia.negative == negatives
        assert factor.inertia.zero == (6 if shift == 0.0 else 0)


def test_a_nearly_singular_matrix_keeps_its_small_eigenvalue(sphere):
    for tiny in (1e-9, -1e-9):
        factor = factorise(sphere.symbolic, shifted(sphere.free, tiny))
        assert factor.inertia.zero == 0
        assert factor.inertia.negative == (6 if tiny < 0.0 else 0)


def test_the_factor_keeps_its_values_when_the_matrix_changes(sphere):
    matrix = shifted(sphere.free, -0.3)
    factor = factorise(sphere.symbolic, matrix)
    before = factor.solve(sphere.load)
    matrix.data *= 5.0
    assert np.array_equal(factor.solve(sphere.load), before)


def test_storage_of_a_dropped_factor_is_used_again(sphere):
    matrix = shifted(sphere.free, 0.1)
    first = factorise(sphere.symbolic, matrix)
    expected = first.solve(sphere.load)
    kept = factorise(sphere.symbolic, 2.0 * matrix)
    del first
    again = factorise(sphere.symbolic, matrix)
    assert np.array_equal(again.solve(sphere.load), expected)
    assert np.allclose(kept.solve(sphere.load), 0.5 * expected, rtol=1e-12)


def test_refinement_lowers_the_residual_of_a_disturbed_solution(sphere):
    matrix = shifted(sphere.free, 0.1)
    factor = factorise(sphere.symbolic, matrix)
    x = factor.solve(sphere.load) * (1.0 + 1e-6)
    refined = factor.refine(sphere.load, x)
    assert factor.residual(sphere.load, refined) < 1e-14 < factor.residual(sphere.load, x)


def test_a_value_that_is_not_finite_is_refused_with_its_row(sphere):
    matrix = shifted(sphere.free, 0.1)
    matrix.data[matrix.indptr[40]] = np.nan
    with pytest.raises(FactorError, match='row 40'):
        factorise(sphere.symbolic, matrix)


def test_another_pattern_is_refused(sphere):
    other = scipy.sparse.csr_array(scipy.sparse.identity(len(sphere.load)))
    with pytest.raises(FactorError, match='another pattern'):
        factorise(sphere.symbolic, other)
    with pytest.raises(FactorError, match='not symmetric'):
        analyse(scipy.sparse.csr_array(np.triu(np.ones((6, 6)))), block=1)
    with pytest.raises(FactorError, match='not made of full 3 x 3 blocks'):
        analyse(other)
    with pytest.raises(FactorError, match='method'):
        factorise(sphere.symbolic, sphere.free, method='magic')


def random_saddle(seed, primal, dual, density, zero_block):
    """[[H, G^T], [G, 0 or negative]] with an indefinite sparse H and its full diagonal."""
    random = np.random.default_rng(seed)
    upper = scipy.sparse.random(
        primal,
        primal,
        density,
        random_state=random,
        data_rvs=lambda count: random.normal(size=count),
    )
    hessian = upper + upper.T + scipy.sparse.diags(random.normal(size=primal))
    border = np.zeros((dual, primal))
    for k in range(dual):
        border[k, random.choice(primal, size=min(3, primal), replace=False)] = random.normal(
            size=min(3, primal)
        )
    corner = np.zeros((dual, dual)) if zero_block else np.diag(-random.uniform(0.1, 1.0, dual))
    matrix = np.block([[hessian.toarray(), border.T], [border, corner]])
    rows = np.arange(primal + dual)
    pattern = scipy.sparse.csr_array((matrix != 0.0) | (rows[:, None] == rows))
    values = matrix[np.repeat(rows, np.diff(pattern.indptr)), pattern.indices]
    return scipy.sparse.csr_array((values, pattern.indices, pattern.indptr), shape=matrix.shape)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    primal=st.integers(1, 120),
    part=st.floats(0.0, 0.6),
    density=st.floats(0.01, 0.2),
    zero_block=st.booleans(),
)
def test_random_saddle_matrices_have_the_inertia_of_their_eigenvalues(
    seed, primal, part, density, zero_block
):
    matrix = random_saddle(seed, primal, int(part * primal), density, zero_block)
    factor = factorise(analyse(matrix, block=1), matrix)
    values = np.linalg.eigvalsh(matrix.toarray())
    clear = np.abs(values) > 1e-9 * np.max(np.abs(values))
    inertia = factor.inertia
    assert inertia.positive + inertia.negative + inertia.zero == len(values)
    assert inertia.positive >= np.sum(clear & (values > 0.0))
    assert inertia.negative >= np.sum(clear & (values < 0.0))
    if np.all(clear):
        load = np.random.default_rng(seed).normal(size=len(values))
        assert backward_error(matrix, factor.solve(load), load) < 1e-13


def test_superlu_refuses_to_guess_an_inertia_it_does_not_know():
    matrix = random_saddle(3, 900, 300, 0.005, zero_block=True)
    factor = superlu_factorise(analyse(matrix, block=1), matrix)
    with pytest.raises(FactorError, match='does not know its inertia'):
        _ = factor.inertia


def test_superlu_counts_an_eigenvalue_of_rounding_as_zero_and_not_as_negative():
    matrix = scipy.sparse.csr_array(np.array([[1.0, 1.0], [1.0, 1.0 + 1e-15]]))
    factor = superlu_factorise(analyse(matrix, block=1), matrix)
    assert factor.inertia == Inertia(1, 0, 1)
    assert not factor.definite


def test_without_numba_superlu_takes_over(sphere, monkeypatch):
    monkeypatch.setattr('shell_deform.factor.analysis.HAVE_NUMBA', False)
    matrix = shifted(sphere.free, 0.1)
    factor = factorise(analyse(sphere.graph, sphere.vertices), matrix)
    assert backward_error(matrix, factor.solve(sphere.load), sphere.load) < 1e-14
    assert factor.inertia == Inertia(len(sphere.load), 0, 0)


def test_threads_share_an_analysis(larger_sphere):
    matrices = [shifted(larger_sphere.free, 0.1 * k - 0.35) for k in range(8)]

    def solution(matrix):
        return factorise(larger_sphere.symbolic, matrix).solve(larger_sphere.load)

    alone = [solution(matrix) for matrix in matrices]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(solution, matrices))
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


@pytest.mark.parametrize('shift', [0.1, -0.3, -3.0])
def test_two_subtrees_at_a_time_give_the_factor_of_one_after_the_other(larger_sphere, shift):
    matrix, load = shifted(larger_sphere.free, shift), larger_sphere.load
    two, one = (analyse(larger_sphere.graph, larger_sphere.vertices) for _ in range(2))
    assert len(two.fronts.spans) == 3
    one.fronts.__dict__['spans'] = ((0, one.fronts.count),)
    together, alone = factorise(two, matrix), factorise(one, matrix)
    assert together.inertia == alone.inertia
    np.testing.assert_array_equal(together.weak_matrix, alone.weak_matrix)
    np.testing.assert_allclose(together.solve(load), alone.solve(load), rtol=1e-12)
    again = [factorise(two, matrix).solve(load) for _ in range(3)]
    assert all(np.array_equal(found, together.solve(load)) for found in again)


def test_blas_threads_are_given_back_after_a_factorisation(sphere):
    from shell_deform.factor.threads import _thread_counts, one_blas_thread

    def numbers():
        return [read() for read, _ in _thread_counts()]

    before = numbers()
    with one_blas_thread():
        assert numbers() == [1] * len(before)
        factorise(sphere.symbolic, sphere.free)
        assert numbers() == [1] * len(before)
    assert numbers() == before


def test_unconnected_parts_are_factorised_together():
    part = scipy.sparse.csr_array([[2.0, 1.0], [1.0, -3.0]])
    matrix = scipy.sparse.csr_array(scipy.sparse.block_diag([part] * 40))
    factor = factorise(analyse(matrix, block=1), matrix)
    assert factor.inertia == Inertia(40, 40, 0)
    load = np.arange(80.0)
    assert np.allclose(matrix @ factor.solve(load), load)
