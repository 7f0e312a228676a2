# SPDX-License-Identifier: Apache-2.0
"""Elimination orders and fronts."""

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.factor.nested_dissection import nested_dissection
from shell_deform.factor.symbolic import find_fronts

sys.path.insert(0, str(Path(__file__).parent))
from factor_matrices import geodesic_sphere, loop_pattern  # noqa: E402


def graph_arrays(graph):
    return graph.indptr.astype(np.int32), graph.indices.astype(np.int32)


def grid_graph(columns, rows):
    """Points (n, 2) of a lattice and its graph of neighbours, diagonals included."""
    points = np.array([(i, j) for i in range(columns) for j in range(rows)], dtype=float)
    apart = np.max(np.abs(points[:, None] - points), axis=2)
    return points, scipy.sparse.csr_array(apart <= 1.0)


def exact_factor_entries(graph, order):
    """Entries of the Cholesky factor by elimination of the graph, vertex by vertex."""
    filled = graph.toarray()[np.ix_(order, order)] != 0
    total = 0
    for k in range(len(order)):
        below = np.flatnonzero(filled[k + 1 :, k]) + k + 1
        filled[np.ix_(below, below)] = True
        total += len(below) + 1
    return total


def random_graph(seed, count, edges):
    random = np.random.default_rng(seed)
    ends = random.integers(0, count, size=(edges, 2))
    dense = np.eye(count, dtype=bool)
    dense[ends[:, 0], ends[:, 1]] = dense[ends[:, 1], ends[:, 0]] = True
    return scipy.sparse.csr_array(dense)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 80), edges=st.integers(0, 300))
def test_fronts_hold_every_entry_of_the_factor(seed, count, edges):
    graph = random_graph(seed, count, edges)
    indptr, indices = graph_arrays(graph)
    order = nested_dissection(indptr, indices, leaf_vertices=4)
    assert sorted(order) == list(range(count))
    fronts = find_fronts(indptr, indices, order, 1)
    assert sorted(fronts.order) == list(range(count))
    assert fronts.stored_entries(1) >= exact_factor_entries(graph, fronts.order)
    for f, parent in enumerate(fronts.parent):
        rows = fronts.rows[fronts.row_offsets[f] : fronts.row_offsets[f + 1]]
        own = fronts.owned[f + 1] - fronts.owned[f]
        assert np.all(np.diff(rows) > 0) and rows[0] == fronts.owned[f]
        if parent < 0:
            assert len(rows) == own
        else:
            above = fronts.rows[fronts.row_offsets[parent] : fronts.row_offsets[parent + 1]]
            assert set(rows[own:]) <= set(above)


def test_a_lattice_with_ties_is_cut_along_its_short_side():
    points, graph = grid_graph(41, 9)
    order = nested_dissection(*graph_arrays(graph), points)
    first_cut = points[order[-9:]]
    assert len(np.unique(first_cut[:, 1])) == 9
    assert np.ptp(first_cut[:, 0]) <= 2.0


def test_distances_in_the_graph_stand_in_for_coordinates():
    vertices, triangles = geodesic_sphere(8)
    indptr, indices = graph_arrays(loop_pattern(vertices, triangles))
    placed, unplaced = (
        find_fronts(indptr, indices, nested_dissection(indptr, indices, where), 3)
        for where in (vertices, None)
    )
    assert unplaced.stored_entries(3) < 1.2 * placed.stored_entries(3)


def test_an_empty_graph_has_an_empty_order():
    assert len(nested_dissection(np.zeros(1, np.int32), np.zeros(0, np.int32))) == 0


def test_vertices_on_one_point_are_left_as_they_are():
    _, graph = grid_graph(8, 8)
    order = nested_dissection(*graph_arrays(graph), np.zeros((64, 3)))
    assert sorted(order) == list(range(64))


@pytest.mark.parametrize(('frequency', 'most'), [(4, 0.14e6), (8, 0.85e6), (16, 5.1e6)])
def test_the_factor_of_a_sphere_stays_small(frequency, most):
    vertices, triangles = geodesic_sphere(frequency)
    indptr, indices = graph_arrays(loop_pattern(vertices, triangles))
    fronts = find_fronts(indptr, indices, nested_dissection(indptr, indices, vertices), 3)
    assert fronts.stored_entries(3) < most
