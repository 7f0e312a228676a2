# SPDX-License-Identifier: Apache-2.0
"""The heavy part of the tick, compiled: displacement field, its sigma, and the packed message.

One pass over the vertices writes x y z ux uy uz displacement sigma as float32 in the frame of the
contacts; `serve_outer` adds the outer face where that is a field of its own. `serve_numpy` is the
same in plain numpy: the oracle, and the fallback without numba.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.compiled.cache import HAVE_NUMBA

Array = NDArray[np.float64]

FIELDS = ('x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma')
NONLINEAR_FIELDS = (*FIELDS, 'energy_density')
"""What the background process knows besides: strain energy per undeformed area [J/m^2]."""
OUTER_FIELDS = ('ox', 'oy', 'oz')
"""Behind these: the outer face of a wall whose outer face is not half a wall off the middle."""


def serve_numpy(
    rest: Array,
    surface: Array,
    normals: Array,
    columns: Array,
    inputs: Array,
    root: Array,
    bend: Array,
    bend_input: float,
    bend_error: float,
    third: Array,
    third_input: float,
    doubt: float,
    unmodelled: Array,
    rotation: Array,
    translation: Array,
    pose_root: Array,
    packed: NDArray[np.float32],
) -> float:
    """Fill the first eight columns of `packed`; returns the largest displacement [m].

    Args:
        rest, surface, normals: (n, 3) undeformed and last equilibrium [m], unit normals.
        columns: (n, 3, j) motion per unit input. inputs: (j,) away from the equilibrium.
        root: (j, i) upper triangular root of their covariance. bend: (n, 3) [1/m] second-order
            motion per bend_input [m^2], of which bend_error [m^2] is uncertain.
        third: (n,) [1/m^2] unknown motion per third_input [m^3]. doubt: unknown anywhere [m].
        unmodelled: (n,) sigma beside all this [m].
        rotation, translation: from the object to the contacts.
        pose_root: (6, i) root of the covariance of the pose (translation, rotation vector).
    """
    position = surface + columns @ inputs + bend_input * bend
    moved = position - rest
    along = np.einsum('ni,nij->nj', normals, columns) @ root
    along_bend = np.einsum('ni,ni->n', normals, bend)
    lever = np.concatenate([normals, np.cross(position, normals)], axis=1) @ pose_root
    variance = (
        np.einsum('nj,nj->n', along, along)
        + (np.abs(along_bend) * bend_error + third * third_input + doubt) ** 2
        + np.einsum('nj,nj->n', lever, lever)
        + unmodelled**2
    )
    packed[:, 0:3] = position @ rotation.T + translation
    packed[:, 3:6] = moved @ rotation.T
    size = np.linalg.norm(moved, axis=1)
    packed[:, 6] = size
    packed[:, 7] = np.sqrt(variance)
    return float(size.max())


def serve_outer(offset: Array, rotation: Array, packed: NDArray[np.float32]) -> None:
    """Fill the last three columns of `packed` with the outer face.

    `offset` (n, 3): of the outer face over the middle surface in the object's frame [m].
    """
    packed[:, -3:] = packed[:, :3] + offset @ rotation.T


if HAVE_NUMBA:
    from numba import types

    from shell_deform.compiled.kernel_arrays import floats
    from shell_deform.compiled.kernel_types import Float, FloatBlocks, FloatRows, Floats, kernel

    @kernel(
        Float, FloatRows, FloatRows, FloatRows, FloatBlocks, Floats, FloatRows, FloatRows, Float,
        Float, Floats, Float, Float, Floats, FloatRows, Floats, FloatRows, types.float32[:, ::1],
        called_from_python=True,
    )  # fmt: skip
    def _serve(
        rest: Any,
        surface: Any,
        normals: Any,
        columns: Any,
        inputs: Any,
        root: Any,
        bend: Any,
        bend_input: Any,
        bend_error: Any,
        third: Any,
        third_input: Any,
        doubt: Any,
        unmodelled: Any,
        rotation: Any,
        translation: Any,
        pose_root: Any,
        packed: Any,
    ) -> float:
        largest = 0.0
        count = inputs.shape[0]
        roots = root.shape[1]
        pose_roots = pose_root.shape[1]
        along = floats(count, 0.0)
        for v in range(rest.shape[0]):
            bx, by, bz = bend[v, 0], bend[v, 1], bend[v, 2]
            px = surface[v, 0] + bend_input * bx
            py = surface[v, 1] + bend_input * by
            pz = surface[v, 2] + bend_input * bz
            nx, ny, nz = normals[v, 0], normals[v, 1], normals[v, 2]
            for j in range(count):
                cx, cy, cz = columns[v, 0, j], columns[v, 1, j], columns[v, 2, j]
                px += cx * inputs[j]
                py += cy * inputs[j]
                pz += cz * inputs[j]
                along[j] = nx * cx + ny * cy + nz * cz
            error = abs(nx * bx + ny * by + nz * bz) * bend_error + third[v] * third_input + doubt
            variance = error * error + unmodelled[v] * unmodelled[v]
            for i in range(roots):
                # The root is upper triangular.
                part = 0.0
                for j in range(min(i + 1, count)):
                    part += along[j] * root[j, i]
                variance += part * part
            if pose_roots > 0:
                tx, ty, tz = py * nz - pz * ny, pz * nx - px * nz, px * ny - py * nx
                for i in range(pose_roots):
                    part = (
                        nx * pose_root[0, i]
                        + ny * pose_root[1, i]
                        + nz * pose_root[2, i]
                        + tx * pose_root[3, i]
                        + ty * pose_root[4, i]
                        + tz * pose_root[5, i]
                    )
                    variance += part * part
            ux, uy, uz = px - rest[v, 0], py - rest[v, 1], pz - rest[v, 2]
            size = np.sqrt(ux * ux + uy * uy + uz * uz)
            if size > largest:
                largest = size
            for a in range(3):
                r0, r1, r2 = rotation[a, 0], rotation[a, 1], rotation[a, 2]
                packed[v, a] = r0 * px + r1 * py + r2 * pz + translation[a]
                packed[v, 3 + a] = r0 * ux + r1 * uy + r2 * uz
            packed[v, 6] = size
            packed[v, 7] = np.sqrt(variance)
        return float(largest)

    def serve(*arguments: Any) -> float:
        """`serve_numpy`, compiled; `root` must be upper triangular."""
        return float(_serve(*arguments))

else:  # pragma: no cover - numba is there in every locked environment
    serve = serve_numpy
