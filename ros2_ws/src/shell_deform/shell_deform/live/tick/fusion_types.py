# SPDX-License-Identifier: Apache-2.0
"""What the fusion of a tick reads, as named tuples: its kernels take them by their names, too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Widths(NamedTuple):
    """The numbers of an `ErrorModel`, under the same names."""

    force_floor: float
    drift: float
    quantum: float
    tendon: float
    tendon_relative: float
    mounting: float
    slip: float
    rigid: float
    outside: float
    modulus: float
    model: float
    default_travel: float


class Response(NamedTuple):
    """Condensed outputs about the last equilibrium for k contacts and r rigid motions.

    Attributes:
        force, displacement: (k,) there [N], [m]. travel_offset: (k,) displacement minus travel.
        rigid: (r,) amplitudes; rigid_scale: amplitude of a shift by one metre.
        reaction: (2 k,) lateral [N]; lateral: (2 k, 3) their directions.
        rigid_reaction: (r,). displacement_by, reaction_by, rigid_by: their change per input.
    """

    force: Array
    displacement: Array
    travel_offset: Array
    rigid: Array
    rigid_scale: float
    reaction: Array
    lateral: Array
    rigid_reaction: Array
    displacement_by: Array
    reaction_by: Array
    rigid_by: Array


class Measured(NamedTuple):
    """What the hand says about the same k contacts.

    Attributes:
        finger, flags: (k,). present: (k,) whether the finger touches in this sample.
        push, sigma_push: (k,) [N]. travel, sigma_travel: (k,) [m], NaN where unknown.
        tangential: (2 k,) forces along the lateral directions [N], sigma (2 k,) infinite if none.
    """

    finger: NDArray[np.int64]
    flags: NDArray[np.int64]
    present: NDArray[np.bool_]
    push: Array
    sigma_push: Array
    travel: Array
    sigma_travel: Array
    tangential: Array
    sigma_tangential: Array


class Design(NamedTuple):
    """The weighted least-squares problem: m observations of j inputs.

    Attributes:
        rows: (m, j), values: (m,): each over its sigma. kinds: (m,) what was observed, a place in
            `SOURCES`. contacts: (m,) which contact it belongs to, -1 for none.
    """

    rows: Array
    values: Array
    kinds: NDArray[np.int64]
    contacts: NDArray[np.int64]


class LeastSquares(NamedTuple):
    """The solution of a `Design`.

    Attributes:
        inputs: (j,). root: (j, j) upper root of their covariance. chi_squared: sum of the squared
            normalised residuals. freedom: observations less inputs. kind, contact: of the
            observation with the largest residual.
    """

    inputs: Array
    root: Array
    chi_squared: float
    freedom: int
    kind: int
    contact: int


GAUGE, MOTION, SLIP, TANGENTIAL, BALANCE, SHIFT, MODULUS = range(7)
SOURCES = (
    'gauge of finger',
    'motion of finger',
    'slip of finger',
    'tangential force of finger',
    'balance of the forces',
    'shift of the object',
    'modulus',
)
"""What an observation is, by its code."""
