# SPDX-License-Identifier: Apache-2.0
"""The undeformed surface at quadrature points, in an orthonormal tangent frame of each point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReferencePoints:
    """Undeformed middle surface at p points.

    Attributes:
        tangents: (p, 2, 3) orthonormal tangent vectors t_1, t_2 [-].
        normal: (p, 3) unit normal t_1 x t_2 [-].
        second: (p, 3, 3) second derivatives A_11, A_12, A_22 along the frame [1/m].
        curvature: (p, 3) second fundamental form B_11, B_12, B_22 [1/m].
        area: (p,) area element d(area)/d(parameters) [m^2].
    """

    tangents: Array
    normal: Array
    second: Array
    curvature: Array
    area: Array

    @property
    def mean_and_gauss(self) -> tuple[Array, Array]:
        """Mean (p,) [1/m] and Gaussian (p,) [1/m^2] curvature; the mean of a sphere is -1/R."""
        b_11, b_12, b_22 = self.curvature.T
        return 0.5 * (b_11 + b_22), b_11 * b_22 - b_12**2

    @property
    def derivatives(self) -> Array:
        """(p, 5, 3) derivative vectors (a_1, a_2, a_11, a_12, a_22) of the undeformed surface."""
        return np.concatenate([self.tangents, self.second], axis=1)


def sharpest_curvature(mean: Array, gauss: Array) -> Array:
    """(p,) larger principal curvature by amount [1/m], of mean [1/m] and Gaussian [1/m^2]."""
    return np.abs(mean) + np.sqrt(np.maximum(mean**2 - gauss, 0.0))


def frame_coefficients(first: Array) -> Array:
    """Coefficients L (p, 2, 2) with t_i = sum_a L[a, i] A_a orthonormal; first is (p, 3, 2) [m].

    Gram-Schmidt from the first parameter direction.
    """
    a_u, a_v = first[:, :, 0], first[:, :, 1]
    length = np.linalg.norm(a_u, axis=1)
    along = np.einsum('pi,pi->p', a_u, a_v) / length**2
    height = np.linalg.norm(a_v - along[:, None] * a_u, axis=1)
    coefficients = np.zeros((len(first), 2, 2))
    coefficients[:, 0, 0] = 1.0 / length
    coefficients[:, 0, 1] = -along / height
    coefficients[:, 1, 1] = 1.0 / height
    return coefficients


def frame_rows(first_rows: Array, second_rows: Array, coefficients: Array) -> Array:
    """Basis rows along the frame: (r, 5) for (1, 2, 11, 12, 22).

    `first_rows` (r, 2) and `second_rows` (r, 3: uu, uv, vv) are parameter derivatives of the basis
    functions, `coefficients` (r, 2, 2) the frame of each row's point. Only the pure second
    derivatives are turned: their tangential remainder never enters a strain.
    """
    c = coefficients
    rows = np.empty((len(first_rows), 5))
    for i in range(2):
        rows[:, i] = c[:, 0, i] * first_rows[:, 0] + c[:, 1, i] * first_rows[:, 1]
    for column, (i, j) in enumerate(((0, 0), (0, 1), (1, 1))):
        rows[:, 2 + column] = (
            c[:, 0, i] * c[:, 0, j] * second_rows[:, 0]
            + (c[:, 0, i] * c[:, 1, j] + c[:, 1, i] * c[:, 0, j]) * second_rows[:, 1]
            + c[:, 1, i] * c[:, 1, j] * second_rows[:, 2]
        )
    return rows


def reference_points(derivatives: Array, area: Array) -> ReferencePoints:
    """Reference quantities from derivative vectors (p, 5, 3) along an orthonormal frame."""
    tangents = np.ascontiguousarray(derivatives[:, :2])
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    second = np.ascontiguousarray(derivatives[:, 2:])
    return ReferencePoints(
        tangents=tangents,
        normal=normal,
        second=second,
        curvature=np.einsum('pci,pi->pc', second, normal),
        area=area,
    )
