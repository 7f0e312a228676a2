# SPDX-License-Identifier: Apache-2.0
"""Matrices of the shell's shape for the factorisation tests: springs in the Loop pattern."""

from __future__ import annotations

import numpy as np
import scipy.sparse


def geodesic_sphere(frequency):
    """Vertices (10 f^2 + 2, 3) on the unit sphere and triangles (20 f^2, 3)."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = np.array(
        [
            [-1, golden, 0], [1, golden, 0], [-1, -golden, 0], [1, -golden, 0],
            [0, -1, golden], [0, 1, golden], [0, -1, -golden], [0, 1, -golden],
            [golden, 0, -1], [golden, 0, 1], [-golden, 0, -1], [-golden, 0, 1],
        ]
    )  # fmt: skip
    faces = [
        (a, b, c)
        for a in range(12)
        for b in range(a)
        for c in range(b)
        if all(
            np.isclose(np.linalg.norm(corners[p] - corners[q]), 2.0)
            for p, q in ((a, b), (b, c), (a, c))
        )
    ]
    numbers: dict[tuple[float, ...], int] = {}
    triangles = []

    def number(i, j, face):
        a, b, c = (corners[k] for k in face)
        point = a * (frequency - i - j) + b * i + c * j
        key = tuple(np.round(point / np.linalg.norm(point), 9) + 0.0)
        return numbers.setdefault(key, len(numbers))

    for face in faces:
        for i in range(frequency):
            for j in range(frequency - i):
                triangles.append([number(i, j, face), number(i + 1, j, face),
                                  number(i, j + 1, face)])  # fmt: skip
                if i + j < frequency - 1:
                    triangles.append([number(i + 1, j, face), number(i + 1, j + 1, face),
                                      number(i, j + 1, face)])  # fmt: skip
    return np.array(list(numbers)), np.array(triangles)


def loop_pattern(vertices, triangles):
    """Vertex graph in which each triangle couples the union of its corners' one-rings."""
    count, faces = len(vertices), len(triangles)
    rows = np.repeat(triangles, 3, axis=1).ravel()
    adjacent = scipy.sparse.csr_array(
        (np.ones(9 * faces), (rows, np.tile(triangles, 3).ravel())), shape=(count, count)
    )
    incident = scipy.sparse.csr_array(
        (np.ones(3 * faces), (np.repeat(np.arange(faces), 3), triangles.ravel())),
        shape=(faces, count),
    )
    patches = incident @ adjacent
    patches.data[:] = 1.0
    graph = scipy.sparse.csr_array(patches.T @ patches)
    graph.sort_indices()
    return graph


def springs(vertices, graph):
    """Stiffness of unit springs along all graph edges (CSR): six exact rigid modes."""
    rows = np.repeat(np.arange(len(vertices)), np.diff(graph.indptr))
    across = vertices[graph.indices] - vertices[rows]
    lengths = np.linalg.norm(across, axis=1)
    apart = lengths > 0.0
    across[apart] /= lengths[apart, None]
    blocks = -across[:, :, None] * across[:, None, :]
    sums = np.zeros((len(vertices), 3, 3))
    np.add.at(sums, rows, -blocks)
    blocks[~apart] = sums
    size = 3 * len(vertices)
    matrix = scipy.sparse.bsr_array((blocks, graph.indices, graph.indptr), shape=(size, size))
    return scipy.sparse.csr_array(matrix)


def shifted(matrix, amount):
    """matrix + amount I with the very same index arrays."""
    data = matrix.data.copy()
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    data[rows == matrix.indices] += amount
    return scipy.sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def rigid_modes(vertices):
    """Translations and linearised rotations (3 n, 6)."""
    modes = np.zeros((len(vertices), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for k in range(3):
        modes[:, :, 3 + k] = np.cross(np.eye(3)[k], vertices)
    return modes.reshape(-1, 6)
