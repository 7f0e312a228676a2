# SPDX-License-Identifier: Apache-2.0
"""Plain numpy twins of `assemble.kernels`: the oracle in tests, and the way without numba."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.shell_points import ShellPoints
from shell_deform.theory import THEORIES
from shell_deform.theory.koiter import cross_matrix

Array = NDArray[np.float64]


def _matrices(shell: ShellPoints, columns: Array) -> list[sp.csr_matrix]:
    """One (p, n) matrix for every column of basis coefficients (r, c)."""
    size = (len(shell.weights), len(shell.mesh.vertices))
    return [sp.csr_matrix((c, shell.row_nodes, shell.row_offsets), shape=size) for c in columns.T]


def derivatives(shell: ShellPoints, positions: Array) -> Array:
    """Derivative vectors (p, 5, 3) at every quadrature point."""
    return np.stack([m @ positions for m in _matrices(shell, shell.rows)], axis=1)


def wall_stress(shell: ShellPoints, strain: Array) -> Array:
    """Stress resultants (p, 6) of strains (p, 6)."""
    return np.concatenate(
        [
            np.einsum('pij,pj->pi', shell.membrane, strain[:, :3]),
            np.einsum('pij,pj->pi', shell.bending, strain[:, 3:]),
        ],
        axis=1,
    )


def point_energies(shell: ShellPoints, theory: str, positions: Array) -> Array:
    """(p,) strain energy [J] of the area of every quadrature point."""
    strain = THEORIES[theory].strains(derivatives(shell, positions), shell.reference)
    return 0.5 * shell.weights * np.einsum('pk,pk->p', strain, wall_stress(shell, strain))


def shell_gradient(shell: ShellPoints, theory: str, positions: Array) -> tuple[float, Array]:
    """Strain energy [J] and gradient (n, 3) [N]."""
    law = THEORIES[theory]
    matrices = _matrices(shell, shell.rows)
    q = np.stack([m @ positions for m in matrices], axis=1)
    strain = law.strains(q, shell.reference)
    stress = wall_stress(shell, strain)
    energy = 0.5 * float(shell.weights @ np.einsum('pk,pk->p', strain, stress))
    force = np.einsum('p,pk,pkai->pai', shell.weights, stress, law.jacobian(q, shell.reference))
    gradient = sum(m.T @ force[:, d] for d, m in enumerate(matrices))
    return energy, np.asarray(gradient)


def shell_tangent(
    shell: ShellPoints, theory: str, positions: Array, pressure: float = 0.0
) -> tuple[float, Array, Array]:
    """Strain energy [J], gradient (n, 3) [N] and stiffness values in `shell.pattern`."""
    law = THEORIES[theory]
    energy, gradient = shell_gradient(shell, theory, positions)
    matrices = _matrices(shell, shell.rows)
    q = np.stack([m @ positions for m in matrices], axis=1)
    jac = law.jacobian(q, shell.reference)
    stress = wall_stress(shell, law.strains(q, shell.reference))
    stiff = np.zeros((len(q), 6, 6))
    stiff[:, :3, :3], stiff[:, 3:, 3:] = shell.membrane, shell.bending
    h = np.einsum('pkai,pkl,plbj->paibj', jac, stiff, jac, optimize=True)
    h += law.hessian(q, shell.reference, stress)
    total = _assembled(shell, matrices, h) - pressure * _volume_stiffness(shell, positions)
    return energy, gradient, _into_pattern(shell, total)


def _assembled(shell: ShellPoints, matrices: list[sp.csr_matrix], h: Array) -> sp.csr_matrix:
    """Stiffness (3 n, 3 n) of second derivatives h (p, 5, 3, 5, 3) by the derivative vectors."""
    h = shell.weights[:, None, None, None, None] * h
    total = sp.csr_matrix((3 * len(shell.mesh.vertices),) * 2)
    for a, left in enumerate(matrices):
        for b, right in enumerate(matrices):
            for i in range(3):
                for j in range(3):
                    block = left.T @ sp.diags(h[:, a, i, b, j]) @ right
                    total = total + _spread(block, i, j)
    return total


def held_tangent(
    shell: ShellPoints, theory: str, held: Array, positions: Array, stiff: bool
) -> tuple[float, Array, Array]:
    """Work [J] of the stresses `held` (p, 6), its gradient, and if `stiff` its stiffness."""
    law = THEORIES[theory]
    matrices = _matrices(shell, shell.rows)
    q = np.stack([m @ positions for m in matrices], axis=1)
    energy = float(shell.weights @ np.einsum('pk,pk->p', held, law.strains(q, shell.reference)))
    force = np.einsum('p,pk,pkai->pai', shell.weights, held, law.jacobian(q, shell.reference))
    gradient = sum(m.T @ force[:, d] for d, m in enumerate(matrices))
    data = np.zeros(0)
    if stiff:
        h = law.hessian(q, shell.reference, held)
        data = _into_pattern(shell, _assembled(shell, matrices, h))
    return energy, np.asarray(gradient), data


def _spread(block: sp.spmatrix, i: int, j: int) -> sp.csr_matrix:
    """Place a (n, n) matrix at component (i, j) of the 3 x 3 blocks."""
    coo = block.tocoo()
    size = 3 * block.shape[0]
    return sp.csr_matrix((coo.data, (3 * coo.row + i, 3 * coo.col + j)), shape=(size, size))


def _into_pattern(shell: ShellPoints, matrix: sp.spmatrix) -> Array:
    full = shell.pattern.matrix(np.zeros(len(shell.pattern.indices)))
    rows = np.repeat(np.arange(full.shape[0]), np.diff(full.indptr))
    return np.asarray(matrix.tocsr()[rows, full.indices]).ravel()


def _volume_matrices(shell: ShellPoints) -> list[sp.csr_matrix]:
    columns = np.column_stack([shell.values, shell.rows[:, 0], shell.rows[:, 1]])
    return _matrices(shell, columns)


def volume_gradient(shell: ShellPoints, positions: Array) -> tuple[float, Array]:
    """Enclosed volume [m^3] and gradient (n, 3) [m^2]."""
    matrices = _volume_matrices(shell)
    x, a, b = (m @ positions for m in matrices)
    w = shell.weights[:, None] / 3.0
    parts = (np.cross(a, b), np.cross(b, x), np.cross(x, a))
    gradient = sum(m.T @ (w * part) for m, part in zip(matrices, parts, strict=True))
    return float(np.sum(w * x * parts[0])), np.asarray(gradient)


def pressure_load(shell: ShellPoints, positions: Array) -> Array:
    """Nodal forces (n, 3) [m^2] of a unit pressure on the wall alone, whatever closes it."""
    value, first, second = _volume_matrices(shell)
    force = shell.weights[:, None] * np.cross(first @ positions, second @ positions)
    return np.asarray(value.T @ force)


def _volume_stiffness(shell: ShellPoints, positions: Array) -> sp.csr_matrix:
    """Second derivative (3 n, 3 n) of the enclosed volume [m]."""
    matrices = _volume_matrices(shell)
    vectors = [m @ positions for m in matrices]
    total = sp.csr_matrix((3 * len(positions),) * 2)
    for third, (first, second) in enumerate(((1, 2), (2, 0), (0, 1))):
        # x . (a x b) by two of its arguments is minus the cross matrix of the third.
        c = (shell.weights / -3.0)[:, None, None] * cross_matrix(vectors[third])
        for i in range(3):
            for j in range(3):
                block = matrices[first].T @ sp.diags(c[:, i, j]) @ matrices[second]
                spread = _spread(block, i, j)
                total = total + spread + spread.T
    return total
