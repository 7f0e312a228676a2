"""What holds a shell: dofs that are eliminated, and rigid motions that nothing else prevents."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rigid_modes(positions: Array) -> Array:
    """Six orthonormal infinitesimal rigid motions (3 n, 6) of control points (n, 3)."""
    centred = positions - positions.mean(axis=0)
    scale = np.sqrt(np.mean(np.einsum('ni,ni->n', centred, centred)))
    modes = np.zeros((len(positions), 3, 6))
    for i in range(3):
        modes[:, i, i] = 1.0
        modes[:, :, 3 + i] = np.cross(np.eye(3)[i], centred / scale)
    orthonormal, _ = np.linalg.qr(modes.reshape(-1, 6))
    return orthonormal


def free_rigid_modes(modes: Array, rows: Array, tolerance: float = 1e-6) -> Array:
    """Rigid motions (N, k) that the constraint `rows` (N, c) do not prevent."""
    if rows.shape[1] == 0:
        return modes
    scaled = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    _, singular, right = np.linalg.svd(scaled.T @ modes)
    rank = int(np.sum(singular > tolerance * max(1.0, float(singular[0]))))
    return modes @ right[rank:].T


def isostatic_dofs(modes: Array) -> NDArray[np.int64]:
    """As many dofs as rigid modes (N, k) whose fixing prevents exactly those motions.

    Pivoted elimination: each time the dof in which the remaining modes move most.
    """
    work = modes.copy()
    chosen = []
    for _ in range(modes.shape[1]):
        size = np.einsum('nk,nk->n', work, work)
        dof = int(np.argmax(size))
        chosen.append(dof)
        direction = work[dof] / np.sqrt(size[dof])
        work = work - np.outer(work @ direction, direction)
    return np.array(chosen, dtype=np.int64)


def fixed_components(size: int, fixed: NDArray[np.bool_]) -> sp.csr_matrix:
    """Selection (3 n, r) of the dofs that stay; `fixed` (n, 3) marks those held at zero."""
    keep = np.flatnonzero(~np.asarray(fixed, bool).reshape(3 * size))
    columns = np.arange(len(keep))
    return sp.csr_matrix((np.ones(len(keep)), (keep, columns)), shape=(3 * size, len(keep)))
