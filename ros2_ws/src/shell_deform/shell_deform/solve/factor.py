"""Sparse symmetric factorisation K = L D L^T behind one small interface, inertia reported.

    symbolic = analyse(pattern, coordinates)         # once per mesh
    factor = factorise(symbolic, stiffness)          # once per Newton step
    displacement = factor.solve(load)
    factor.inertia.negative                          # > 0: the equilibrium is unstable

`method='multifrontal'` is the house's own factorisation (`multifrontal.py`); `'superlu'` is SciPy's,
slower, always present, taken by itself when numba is not installed.

Nearly singular matrices keep their accuracy: pivots that are tiny against the (equilibrated) matrix
stay outside the factor. With the strong part's generalised inverse K+, the weak modes Z and the
small weak matrix R of a factor, K x = f means x = K+ f + Z a with R a = Z^T f, exactly, however
small R is. `factor_bordered.py` builds bordered and low-rank updated systems on this.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import ArrayLike, NDArray

from shell_deform.compiled import HAVE_NUMBA

# Pivots below this, relative to the equilibrated matrix, are set aside as weak.
WEAK_PIVOT = 1e-10
# Eigenvalues below this, relative to the equilibrated matrix, are rounding: zero.
ZERO_EIGENVALUE = 1e-13
# Smallest admissible pivot relative to its column in fronts that are not definite.
PIVOT_THRESHOLD = 0.01
# Refinement stops at this residual relative to |K| |x| + |f|.
REFINED = 4.0 * np.finfo(float).eps
# A load may have this part along zero modes before it counts as inconsistent.
CONSISTENT = 1e-9
DENSE_INERTIA_LIMIT = 1000


class FactorError(RuntimeError):
    """A matrix that cannot be factorised or solved as asked."""


class SingularMatrixError(FactorError):
    """The matrix is singular and the right-hand side is not in its range.

    `unknowns`: the unknowns whose pivots vanish (one per zero mode).
    """

    def __init__(self, message: str, unknowns: NDArray[np.int64]) -> None:
        super().__init__(message)
        self.unknowns = unknowns


@dataclass(frozen=True)
class Inertia:
    """Numbers of positive, negative and zero eigenvalues."""

    positive: int
    negative: int
    zero: int

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.positive + other.positive,
            self.negative + other.negative,
            self.zero + other.zero,
        )

    def __sub__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.positive - other.positive,
            self.negative - other.negative,
            self.zero - other.zero,
        )


@dataclass(frozen=True)
class SymbolicFactor:
    """A pattern analysed once: vertex graph (`indptr`, `indices`) with `block` unknowns each.

    Unknown a of vertex v is number block * v + a. `order` (n,): elimination order of the vertices;
    `fronts`: the multifrontal structure, None without numba.
    """

    block: int
    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    order: NDArray[np.int32]
    fronts: Any
    checked: list[Any] = field(default_factory=list, repr=False, compare=False)
    spare: list[Any] = field(default_factory=list, repr=False, compare=False)
    permuted: list[Any] = field(default_factory=list, repr=False, compare=False)

    @property
    def unknowns(self) -> int:
        """Rows of the matrices that fit."""
        return self.block * (len(self.indptr) - 1)

    @property
    def stored_entries(self) -> int:
        """Doubles in a multifrontal factor."""
        return 0 if self.fronts is None else int(self.fronts.stored_entries(self.block))


def analyse(
    pattern: Any,
    coordinates: ArrayLike | None = None,
    block: int = 3,
    of_vertices: bool | None = None,
) -> SymbolicFactor:
    """Analyse a symmetric pattern for many factorisations.

    `pattern`: SciPy sparse matrix, (n, n) of vertices or (block n, block n) of unknowns; values are
    ignored. `of_vertices` says which; left out, it is read off `coordinates` (n, d) [m], and
    without these the pattern is taken as one of unknowns. Coordinates give better orders.
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
    from shell_deform.solve.multifrontal_symbolic import find_fronts
    from shell_deform.solve.nested_dissection import nested_dissection

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

    `matrix` (N, N): SciPy CSR or CSC with sorted indices, or BSR with the analysed block size; both
    triangles stored, the lower one in elimination order is read. `fixed` (N,): unknowns held at
    zero (rows and columns left out, not counted in the inertia). Its values are copied: the
    matrix may change afterwards. `method`: 'multifrontal' or 'superlu'.
    Raises FactorError for a pattern other than the analysed one and for values that are not finite.
    """
    interleaved = _check_pattern(symbolic, matrix)
    count = symbolic.unknowns
    free = np.ones(count, bool) if fixed is None else ~np.asarray(fixed, dtype=bool)
    if free.shape != (count,):
        raise FactorError(f'fixed has shape {free.shape}, needed is ({count},)')
    if method == 'multifrontal' and symbolic.fronts is not None:
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


class Factor:
    """A factorised symmetric matrix K, some unknowns held at zero.

    Attributes: `size` N; `inertia` of K over the free unknowns; `strong` inertia of the part behind
    K+; `weak_matrix` R (r, r), `weak_modes` Z (N, r), `weak_unknowns` (r,), see the module;
    `definite`: no pivoting was needed and nothing is weak.
    """

    def __init__(self, matrix: Any, free: NDArray[np.bool_]) -> None:
        self.size = len(free)
        self.free = free
        copied = type(matrix)((matrix.data.copy(), matrix.indices, matrix.indptr), matrix.shape)
        self.matrix = copied
        self.definite = False
        self.strong = Inertia(0, 0, 0)
        self.weak_unknowns: NDArray[np.int64] = np.zeros(0, np.int64)
        self.weak_matrix: NDArray[np.float64] = np.zeros((0, 0))
        self.weak_modes: NDArray[np.float64] = np.zeros((self.size, 0))
        self._weak_values: NDArray[np.float64] = np.zeros(0)
        self._weak_vectors: NDArray[np.float64] = np.zeros((0, 0))
        self._norm: float | None = None

    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K+ f (N, k) and Z^T f (r, k) of f (N, k), unrefined."""
        raise NotImplementedError

    @property
    def norm(self) -> float:
        """Largest magnitude in K."""
        if self._norm is None:
            self._norm = float(np.max(np.abs(self.matrix.data), initial=0.0))
        return self._norm

    @property
    def inertia(self) -> Inertia:
        """Positive, negative and zero eigenvalues of K over the free unknowns."""
        values = self._weak_values
        return self.strong + Inertia(
            int(np.sum(values > ZERO_EIGENVALUE)),
            int(np.sum(values < -ZERO_EIGENVALUE)),
            int(np.sum(np.abs(values) <= ZERO_EIGENVALUE)),
        )

    def solve(self, rhs: ArrayLike, refinements: int | None = None) -> NDArray[np.float64]:
        """x with K x = f for f (N,) or (N, k), in the same shape; held unknowns are 0.

        `refinements`: steps of iterative refinement; left out, none for a definite factor and as
        many (at most 4) as still reduce the residual otherwise. A singular K answers consistent
        loads with one of the solutions.
        Raises SingularMatrixError for other loads, FactorError for a wrong shape.
        """
        load = np.asarray(rhs, dtype=np.float64)
        if load.shape[:1] != (self.size,) or load.ndim > 2:
            raise FactorError(
                f'right-hand side of shape {load.shape}, needed are {self.size} rows'
            )
        columns = load.reshape(self.size, -1)
        x = self._solve_once(columns, check=True)
        steps = (0 if self.definite else 4) if refinements is None else refinements
        if steps:
            x = self._refined(columns, x, steps, until_exact=refinements is None)
        return x.reshape(load.shape)

    def refine(self, rhs: ArrayLike, x: ArrayLike, steps: int = 1) -> NDArray[np.float64]:
        """`x` improved by `steps` of iterative refinement against f (N,) or (N, k)."""
        load = np.asarray(rhs, dtype=np.float64)
        start = np.array(x, dtype=np.float64).reshape(self.size, -1)
        columns = load.reshape(self.size, -1)
        return self._refined(columns, start, steps, until_exact=False).reshape(load.shape)

    def residual(self, rhs: ArrayLike, x: ArrayLike) -> float:
        """max |f - K x| / (|K| max |x| + max |f|) over the free unknowns, |K| in the max norm."""
        load = np.asarray(rhs, dtype=np.float64).reshape(self.size, -1)
        solution = np.asarray(x, dtype=np.float64).reshape(self.size, -1)
        rest = np.where(self.free[:, None], load - self.matrix @ solution, 0.0)
        return float(np.max(self._relative(rest, load, solution), initial=0.0))

    def zero_modes(self) -> NDArray[np.float64]:
        """Basis (N, inertia.zero) of the null space of K."""
        vectors = self._weak_vectors[:, np.abs(self._weak_values) <= ZERO_EIGENVALUE]
        return self.weak_modes @ vectors

    def _relative(
        self,
        rest: NDArray[np.float64],
        load: NDArray[np.float64],
        x: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Residual of each column relative to |K| |x| + |f|."""
        size = self.norm * np.max(np.abs(x), axis=0) + np.max(np.abs(load), axis=0)
        return np.max(np.abs(rest), axis=0) / np.where(size > 0.0, size, 1.0)

    def _refined(
        self,
        load: NDArray[np.float64],
        x: NDArray[np.float64],
        steps: int,
        until_exact: bool,
    ) -> NDArray[np.float64]:
        """Iterative refinement; with `until_exact` it stops when nothing is gained."""
        best, smallest = x, np.inf
        for step in range(steps + 1):
            rest = np.where(self.free[:, None], load - self.matrix @ x, 0.0)
            error = float(np.max(self._relative(rest, load, x), initial=0.0))
            if until_exact and not error < 0.5 * smallest:
                return x if error < smallest else best
            best, smallest = x, error
            if step == steps or (until_exact and error <= REFINED):
                return x
            x = x + self._solve_once(rest, check=False)
        return best

    def _solve_once(self, load: NDArray[np.float64], check: bool) -> NDArray[np.float64]:
        """One solve through the strong and the weak part."""
        x, along = self.partial_solve(load)
        if len(self._weak_values) == 0:
            return x
        zero = np.abs(self._weak_values) <= ZERO_EIGENVALUE
        components = self._weak_vectors.T @ along
        if check and np.any(zero):
            modes = self.weak_modes @ self._weak_vectors[:, zero]
            reach = np.abs(modes).T @ np.abs(load)
            if np.any(np.abs(components[zero]) > CONSISTENT * reach):
                raise SingularMatrixError(self._singular_message(), self.weak_unknowns)
        amounts = np.zeros_like(components)
        amounts[~zero] = components[~zero] / self._weak_values[~zero, None]
        solution: NDArray[np.float64] = x + self.weak_modes @ (self._weak_vectors @ amounts)
        return solution

    def _singular_message(self) -> str:
        """What is singular, where, and the way out."""
        named = ', '.join(str(i) for i in self.weak_unknowns[:12])
        return (
            f'the matrix has {self.inertia.zero} zero eigenvalues (pivots vanish at unknowns '
            f'{named}) and the load works on these modes: add supports, balance the load, or '
            'border the system'
        )

    def _set_weak(
        self,
        unknowns: NDArray[np.int64],
        matrix: NDArray[np.float64],
        modes: NDArray[np.float64],
        gram: NDArray[np.float64],
    ) -> None:
        """Keep the weak part and its Rayleigh-Ritz values, with `gram` = Z^T Z of scaled modes.

        Divided by the modes' length the weak values are eigenvalues of the equilibrated matrix (up
        to second order), which can be told from rounding; those of R alone cannot.
        """
        self.weak_unknowns, self.weak_matrix, self.weak_modes = unknowns, matrix, modes
        self._weak_values, self._weak_vectors = scipy.linalg.eigh(matrix, gram)


class MultifrontalFactor(Factor):
    """The house's own factor; its storage returns to the symbolic factor when it is dropped."""

    def __init__(
        self,
        symbolic: SymbolicFactor,
        matrix: Any,
        free: NDArray[np.bool_],
        interleaved: bool,
    ) -> None:
        from shell_deform.solve import multifrontal

        super().__init__(matrix, free)
        self._kernels = multifrontal
        self._spare = symbolic.spare
        fronts, block = symbolic.fronts, symbolic.block
        data = np.ascontiguousarray(self.matrix.data, dtype=np.float64).reshape(-1)
        pattern = (symbolic.indptr, symbolic.indices)
        scale = np.empty(self.size)
        bad = multifrontal.equilibrate(data, *pattern, interleaved, block, free, scale)
        if bad >= 0:
            raise FactorError(f'row {bad} of the matrix holds a value that is not finite')
        storage = self._take_storage(symbolic)
        result = multifrontal.factorise_fronts(
            data,
            *pattern,
            interleaved,
            scale,
            block,
            fronts.order,
            fronts.owned,
            fronts.row_offsets,
            fronts.rows,
            fronts.parent,
            fronts.parity,
            fronts.targets,
            fronts.run_offsets,
            fronts.runs,
            *storage,
            PIVOT_THRESHOLD,
            WEAK_PIVOT,
        )
        self._lower = result[:5]
        self._pivots = result[5:8]
        weak_ids, weak_values, weak_sizes, self._stack = result[8:]
        self._unknown = (fronts.order[:, None].astype(np.int64) * block + np.arange(block)).ravel()
        self._scale = scale[self._unknown]
        definite, diagonal, beside = self._pivots
        positive, negative = multifrontal.count_signs(result[4], definite, diagonal, beside)
        held = self.size - int(np.count_nonzero(free))
        self.strong = Inertia(positive - held, negative, 0)
        self.definite = bool(np.all(definite))
        if len(weak_ids):
            blocks, at = [], 0
            for size in weak_sizes:
                blocks.append(weak_values[at : at + size * size].reshape(size, size))
                at += size * size
            modes = np.zeros((self.size, len(weak_ids)))
            modes[weak_ids, np.arange(len(weak_ids))] = 1.0
            multifrontal.backward(*self._lower, modes)
            gram = modes.T @ modes
            natural = np.empty_like(modes)
            natural[self._unknown] = modes * self._scale[:, None]
            self._set_weak(
                self._unknown[weak_ids], scipy.linalg.block_diag(*blocks), natural, gram
            )

    @staticmethod
    def _take_storage(symbolic: SymbolicFactor) -> Any:
        """Arrays for values, row numbers and the stack, recycled when a factor was dropped."""
        if symbolic.spare:
            return symbolic.spare.pop()
        fronts, block = symbolic.fronts, symbolic.block
        return (
            np.empty(fronts.stored_entries(block)),
            np.empty(len(fronts.rows) * block, np.int32),
            np.empty(fronts.stack_entries(block)),
        )

    def __del__(self) -> None:
        if hasattr(self, '_stack') and len(self._spare) < 2:
            self._spare.append((self._lower[0], self._lower[2], self._stack))

    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K+ f (N, k) and Z^T f (r, k) of f (N, k), unrefined."""
        y = np.ascontiguousarray(rhs[self._unknown] * self._scale[:, None])
        self._kernels.forward(*self._lower, *self._pivots, y)
        along = np.zeros((0, y.shape[1]))
        if len(self.weak_unknowns):
            rows = self._weak_rows()
            along = y[rows].copy()
            y[rows] = 0.0
        self._kernels.backward(*self._lower, y)
        x = np.empty_like(y)
        x[self._unknown] = y * self._scale[:, None]
        return x, along

    def _weak_rows(self) -> NDArray[np.int64]:
        """Elimination numbers of the weak unknowns."""
        place = np.empty(self.size, np.int64)
        place[self._unknown] = np.arange(self.size)
        return place[self.weak_unknowns]


class SuperLUFactor(Factor):
    """SciPy's SuperLU behind the same interface.

    Pivots are taken on the diagonal while that is accurate: then the signs of U's diagonal are the
    inertia. Otherwise rows are exchanged and the inertia is known for small matrices only.
    """

    def __init__(self, symbolic: SymbolicFactor, matrix: Any, free: NDArray[np.bool_]) -> None:
        super().__init__(matrix, free)
        values = scipy.sparse.csc_array(self.matrix)
        if not np.all(np.isfinite(values.data)):
            raise FactorError('the matrix holds a value that is not finite')
        block = symbolic.block
        unknown = (symbolic.order[:, None].astype(np.int64) * block + np.arange(block)).ravel()
        self._unknown = unknown[free[unknown]]
        reduced = scipy.sparse.csc_array(values[self._unknown][:, self._unknown])
        largest = np.maximum(abs(reduced).max(axis=0).toarray().ravel(), np.finfo(float).tiny)
        self._scale = 1.0 / np.sqrt(largest)
        diagonal = scipy.sparse.dia_array(
            (self._scale[None], [0]), shape=(len(self._scale), len(self._scale))
        )
        scaled = scipy.sparse.csc_array(diagonal @ reduced @ diagonal)
        specification = 'MMD_AT_PLUS_A' if symbolic.fronts is None else 'NATURAL'
        self._factor: Any = None
        self._known: Inertia | None = None
        for threshold in (0.0, 0.1):
            try:
                self._factor = scipy.sparse.linalg.splu(
                    scaled,
                    permc_spec=specification,
                    diag_pivot_thresh=threshold,
                    options={'SymmetricMode': True},
                )
            except RuntimeError as error:
                if threshold > 0.0:
                    raise SingularMatrixError(
                        f'SuperLU: {error}; use the multifrontal factor or add supports',
                        np.zeros(0, np.int64),
                    ) from error
                continue
            if self._set_inertia(scaled):
                break

    def _set_inertia(self, scaled: Any) -> bool:
        """Read the inertia off the pivots; False when they are not trustworthy."""
        probe = np.cos(np.arange(1.0, scaled.shape[0] + 1.0))
        error = np.max(np.abs(scaled @ self._factor.solve(probe) - probe))
        on_diagonal = np.array_equal(self._factor.perm_r, self._factor.perm_c)
        pivots = self._factor.U.diagonal()
        if not on_diagonal or not error < 1e-6:
            if scaled.shape[0] <= DENSE_INERTIA_LIMIT:
                pivots = np.linalg.eigvalsh(scaled.toarray())
            else:
                return False
        self._known = Inertia(
            int(np.sum(pivots > ZERO_EIGENVALUE)),
            int(np.sum(pivots < -ZERO_EIGENVALUE)),
            int(np.sum(np.abs(pivots) <= ZERO_EIGENVALUE)),
        )
        self.strong = self._known
        self.definite = self._known.negative == 0 and self._known.zero == 0
        return bool(on_diagonal and error < 1e-6)

    @property
    def inertia(self) -> Inertia:
        """Positive, negative and zero eigenvalues; FactorError when rows had to be exchanged."""
        if self._known is None:
            raise FactorError(
                'SuperLU exchanged rows of this matrix and so does not know its inertia; '
                "use method='multifrontal'"
            )
        return self._known

    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K^-1 f (N, k), and no weak components."""
        x = np.zeros_like(rhs)
        scale = self._scale[:, None]
        x[self._unknown] = scale * self._factor.solve(scale * rhs[self._unknown])
        return x, np.zeros((0, rhs.shape[1]))
