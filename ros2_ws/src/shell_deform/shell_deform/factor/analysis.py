# SPDX-License-Identifier: Apache-2.0
"""Sparse symmetric factorisation K = L D L^T behind one small interface, inertia reported.

    symbolic = analyse(pattern, coordinates)         # once per mesh
    factor = factorise(symbolic, stiffness)          # once per Newton step
    displacement = factor.solve(load)
    factor.inertia.negative                          # > 0: the equilibrium is unstable

`method='multifrontal'` is the house's own factorisation (`fronts.py`), `'superlu'` SciPy's:
slower, always present, and taken without asking when numba is not installed. Singular and nearly
singular matrices keep their accuracy, see `base.py`; `bordered.py` solves bordered and low-rank
updated systems.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.factor.base import (
    Factor,
    FactorError,
    Inertia,
    SingularMatrixError,
    SymbolicFactor,
)
from shell_deform.factor.superlu import SuperLUFactor

__all__ = [
    'Factor',
    'FactorError',
    'Inertia',
    'SingularMatrixError',
    'SymbolicFactor',
    'analyse',
    'factorise',
    'superlu_factorise',
]


def analyse(
    pattern: Any,
    coordinates: ArrayLike | None = None,
    block: int = 3,
    of_vertices: bool | None = None,
) -> SymbolicFactor:
    """Analyse a symmetric pattern for many factorisations.

    `pattern`: SciPy sparse matrix, (n, n) of vertices or (block n, block n) of unknowns; its
    values are ignored. `of_vertices` says which; left out, it is read off `coordinates` (n, d)
    [m], and without these the pattern is one of unknowns. Coordinates give better orders.
    Raises FactorError for patterns that are not square, symmetric or made of full blocks.
    """
    graph = scipy.sparse.csr_array(pattern)
    rows = graph.shape[0]
    if graph.shape != (rows, rows) or rows == 0:
        raise FactorError(f'pattern of shape {graph.shape}: a square, non-empty one is needed')
    points = None if coordinates is None else np.asarray(coordinates, dtype=float)
    if of_vertices is None:
        of_vertices = points is not None and len(points) == rows
    if not of_vertices and block > 1:
        graph = _vertex_graph(graph, block)
    vertices = graph.shape[0]
    if points is not None and (points.ndim != 2 or len(points) != vertices):
        raise FactorError(
            f'coordinates of shape {points.shape} for {vertices} vertices: one row each is needed'
        )
    graph = scipy.sparse.csr_array(
        (np.ones(len(graph.indices), np.int8), graph.indices, graph.indptr), shape=graph.shape
    )
    graph.sum_duplicates()
    mirrored = scipy.sparse.csr_array(graph.T)
    mirrored.sort_indices()
    if not (
        np.array_equal(mirrored.indptr, graph.indptr)
        and np.array_equal(mirrored.indices, graph.indices)
    ):
        raise FactorError('the pattern is not symmetric: store both triangles')
    indptr = graph.indptr.astype(np.int32)
    indices = graph.indices.astype(np.int32)
    if not HAVE_NUMBA:
        return SymbolicFactor(block, indptr, indices, np.arange(vertices, dtype=np.int32), None)
    from shell_deform.factor.nested_dissection import nested_dissection
    from shell_deform.factor.symbolic import find_fronts

    fronts = find_fronts(indptr, indices, nested_dissection(indptr, indices, points), block)
    return SymbolicFactor(block, indptr, indices, fronts.order, fronts)


def _vertex_graph(graph: Any, block: int) -> Any:
    """Vertex pattern of a pattern of unknowns made of full (block, block) blocks."""
    rows = graph.shape[0]
    if rows % block:
        raise FactorError(f'{rows} unknowns are no multiple of the block size {block}')
    blocks = scipy.sparse.csr_array(
        (np.ones(len(graph.indices), np.int8), graph.indices // block, graph.indptr.copy()),
        shape=(rows, rows // block),
    )
    blocks.sum_duplicates()
    first = blocks.indptr[:-1:block]
    if len(graph.indices) != block * len(blocks.indices) or np.any(
        np.diff(blocks.indptr) != np.repeat(np.diff(blocks.indptr)[::block], block)
    ):
        raise FactorError(
            f'the pattern is not made of full {block} x {block} blocks; analyse it with block=1'
        )
    degrees = np.diff(blocks.indptr)[::block]
    starts = np.concatenate([[0], np.cumsum(degrees)])
    take = np.repeat(first - starts[:-1], degrees) + np.arange(starts[-1])
    return scipy.sparse.csr_array(
        (np.ones(starts[-1], np.int8), blocks.indices[take], starts),
        shape=(rows // block, rows // block),
    )


def factorise(
    symbolic: SymbolicFactor,
    matrix: Any,
    fixed: NDArray[np.bool_] | None = None,
    method: str = 'multifrontal',
) -> Factor:
    """Factorise a symmetric matrix with the analysed pattern.

    `matrix` (N, N): SciPy CSR or CSC with sorted indices, or BSR with the analysed block size;
    both triangles stored. Its values are copied: the matrix may change afterwards. `fixed` (N,):
    unknowns held at zero (rows and columns left out, not counted in the inertia). `method`:
    'multifrontal' or 'superlu'.
    Raises FactorError for another pattern than the analysed one and for values that are not
    finite.
    """
    interleaved = _check_pattern(symbolic, matrix)
    count = symbolic.unknowns
    free = np.ones(count, bool) if fixed is None else ~np.asarray(fixed, dtype=bool)
    if free.shape != (count,):
        raise FactorError(f'fixed has shape {free.shape}, needed is ({count},)')
    if method == 'multifrontal' and symbolic.fronts is not None:
        from shell_deform.factor.multifrontal import MultifrontalFactor

        return MultifrontalFactor(symbolic, matrix, free, interleaved)
    if method in ('multifrontal', 'superlu'):
        return SuperLUFactor(symbolic, matrix, free)
    raise FactorError(f"method {method!r}: allowed are 'multifrontal' and 'superlu'")


def superlu_factorise(
    symbolic: SymbolicFactor, matrix: Any, fixed: NDArray[np.bool_] | None = None
) -> Factor:
    """`factorise` by SciPy's SuperLU."""
    return factorise(symbolic, matrix, fixed, method='superlu')


def _check_pattern(symbolic: SymbolicFactor, matrix: Any) -> bool:
    """Whether rows of scalars (CSR, CSC) rather than blocks (BSR) are stored; refuse others."""
    count, block = symbolic.unknowns, symbolic.block
    if matrix.shape != (count, count):
        raise FactorError(f'matrix of shape {matrix.shape}, analysed were {count} unknowns')
    if any(
        kept is matrix.indices and pointers is matrix.indptr for kept, pointers in symbolic.checked
    ):
        return str(matrix.format) != 'bsr'
    if matrix.format == 'bsr' and matrix.blocksize == (block, block):
        same = np.array_equal(matrix.indptr, symbolic.indptr) and np.array_equal(
            matrix.indices, symbolic.indices
        )
    elif matrix.format in ('csr', 'csc'):
        degrees = np.diff(symbolic.indptr).astype(np.int64)
        same = np.array_equal(np.diff(matrix.indptr), np.repeat(block * degrees, block))
        # Row a of a vertex lists block consecutive unknowns of each neighbour.
        per_row = (symbolic.indices[:, None] * block + np.arange(block)).ravel()
        if same and block == 1:
            same = np.array_equal(matrix.indices, per_row)
        elif same:
            start = np.repeat(block * symbolic.indptr[:-1].astype(np.int64), block)
            shift = np.repeat(start - matrix.indptr[:-1], np.repeat(block * degrees, block))
            same = np.array_equal(matrix.indices, per_row[shift + np.arange(len(shift))])
    else:
        raise FactorError(
            f'matrix of format {matrix.format!r}: CSR, CSC or BSR with {block} x {block} blocks'
        )
    if not same:
        raise FactorError(
            'the matrix has another pattern than the analysed one (indices must be sorted)'
        )
    symbolic.checked[:] = [*symbolic.checked[-3:], (matrix.indices, matrix.indptr)]
    return str(matrix.format) != 'bsr'
