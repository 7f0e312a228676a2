# SPDX-License-Identifier: Apache-2.0
"""Force and motion together: the small weighted least-squares problem of every tick.

Unknown are the inputs of the condensed response (pushes, lateral slips, free rigid motion,
relative modulus) away from the last equilibrium. Gauges measure the pushes, encoders the
displacement of the contacts less what the tendons stretch under the push, and everything else has
a prior width: pin mounting and slip, an object that may shift between the fingers, a modulus that
is known to a few percent, outside forces that nearly balance. What the drive does not use is left
out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.live.tick.fusion_types import SOURCES, Measured, Response, Widths

if HAVE_NUMBA:
    from shell_deform.live.tick.fusion_kernel import least_squares
else:
    from shell_deform.live.tick.fusion_plain import least_squares

Array = NDArray[np.float64]

DRIVES = ('force', 'motion', 'fused')


@dataclass(frozen=True)
class ErrorModel:
    """Standard deviations that no message carries.

    Attributes:
        drive: 'force', 'motion' or 'fused'.
        force_floor: smallest sigma of a push [N]. drift: zero drift of a gauge [N].
        quantum: one count of the gauge [N], uniform inside.
        tendon: stretch of the tendons at the contact [m/N]. tendon_relative: its relative sigma.
        mounting: along the normal, pin mounting and moment of first touch [m].
        slip: lateral motion of a held patch [m].
        rigid: shift of the object between the fingers [m]. outside: forces beside the fingers [N].
        modulus: relative sigma of Young's modulus. model: relative stiffness bias of the theory.
        default_travel: sigma of a travel that comes without one [m].
        mesh: how much of the estimated stiffness error of the mesh counts [-].
    """

    drive: str = 'fused'
    force_floor: float = 0.01
    drift: float = 0.1
    quantum: float = 0.2
    tendon: float = 0.0
    tendon_relative: float = 0.3
    mounting: float = 5e-5
    slip: float = 1e-4
    rigid: float = 5e-3
    outside: float = 0.3
    modulus: float = 0.05
    model: float = 0.03
    default_travel: float = 2e-5
    mesh: float = 1.0

    @cached_property
    def widths(self) -> Widths:
        """All numbers, by their names."""
        return Widths(*(float(getattr(self, name)) for name in Widths._fields))

    def on_mesh(self, coarseness: Array) -> ErrorModel:
        """The same with the stiffness error of a mesh under its contacts (k,) added."""
        return _coarser(self, self.mesh * float(coarseness.max(initial=0.0)))

    def push_sigma(self, reported: Array) -> Array:
        """Sigma of the gauges' pushes [N] from what the hand reports."""
        reported = np.where(np.isfinite(reported), reported, 1e6)
        return np.sqrt(
            np.maximum(reported, self.force_floor) ** 2 + self.drift**2 + self.quantum**2 / 12.0
        )


@lru_cache(maxsize=16)
def _coarser(errors: ErrorModel, share: float) -> ErrorModel:
    return replace(errors, model=float(np.hypot(errors.model, share)))


@dataclass(frozen=True)
class Posterior:
    """The answer.

    Attributes:
        inputs: (j,) away from the equilibrium. root: (j, j) upper root of their covariance.
        contradiction: root mean square of the normalised residuals over the degrees of freedom.
        suspect: the observation that strains most: '', 'gauge of finger 1', 'modulus', ...
    """

    inputs: Array
    root: Array
    contradiction: float
    suspect: str


def fuse(model: ErrorModel, response: Response, measured: Measured) -> Posterior:
    """Most probable inputs under all observations and priors."""
    found = least_squares(
        model.drive != 'motion', model.drive != 'force', model.widths, response, measured
    )
    contradiction = float(np.sqrt(found.chi_squared / max(1, found.freedom)))
    suspect = ''
    if contradiction > 1.0:
        suspect = SOURCES[found.kind]
        if found.contact >= 0:
            suspect += f' {measured.finger[found.contact]}'
    return Posterior(found.inputs, found.root, contradiction, suspect)
