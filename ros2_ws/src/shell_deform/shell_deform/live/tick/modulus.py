# SPDX-License-Identifier: Apache-2.0
"""Young's modulus, learned while the object is squeezed.

About the last equilibrium the model knows which push belongs to the measured motion and how that
push grows with the modulus. Without gas the growth is the push itself, with gas the wall's part of
it, so that

    measured push = model push at the measured motion + r growth + zero + stiffness mounting,

with r = E / E_0 - 1, E_0 the object's own modulus. This is linear in r and in what all samples of
a grasp share per finger: the zero of its gauge [N] and the moment of its first touch [m], both
with the widths that the error model states. A recursive least-squares filter keeps all of them.

Samples of a standing grasp repeat the same errors and friction differs on the way back, so a
sample counts only when a push has grown by its own sigma since the last one that counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.fusion_types import Measured, Response
from shell_deform.live.tick.sample import FLAG_NO_GAUGE, FLAG_NOT_TARED, FLAG_SATURATED

Array = NDArray[np.float64]

UNUSABLE = FLAG_SATURATED | FLAG_NOT_TARED | FLAG_NO_GAUGE
# Relative width of the modulus before anything is known.
IGNORANCE = 1.0
# Share of the extrapolated push that the straight line may be wrong by.
CURVED = 0.2
# Samples that contradict all before them by more standard deviations do not count.
GATE = 5.0


@dataclass(frozen=True)
class ModulusEstimate:
    """What the grasps so far say: value and sigma [Pa], and how many samples counted."""

    value: float
    sigma: float
    samples: int


class ModulusFilter:
    """The relative modulus, and per finger a gauge zero and a moment of touch."""

    def __init__(self, young: float, errors: ErrorModel) -> None:
        """`young`: the modulus that the model is solved with [Pa]."""
        self.young = young
        self.errors = errors
        self._mean = np.zeros(1)
        self._covariance = np.array([[IGNORANCE**2]])
        self._fingers: NDArray[np.int64] = np.zeros(0, np.int64)
        self._highest = np.zeros(0)
        self._samples = 0

    @property
    def estimate(self) -> ModulusEstimate:
        """The present estimate; its sigma includes the stiffness bias of shell theory."""
        relative = 1.0 + float(self._mean[0])
        known = float(np.sqrt(self._covariance[0, 0]))
        sigma = self.young * float(np.hypot(known, relative * self.errors.model))
        return ModulusEstimate(self.young * relative, sigma, self._samples)

    def release(self) -> None:
        """The grasp ends: what its fingers shared is forgotten, the modulus is kept."""
        self._grasped(np.zeros(0, np.int64))

    def update(self, response: Response, inputs: Array, measured: Measured) -> bool:
        """Take one sample of k contacts; True when it counted.

        `inputs` (j,): the served answer away from the equilibrium, whose slips and shifts are
        taken as they are.
        """
        if not np.array_equal(self._fingers, measured.finger):
            self._grasped(measured.finger)
        sigma = self.errors.push_sigma(measured.sigma_push)
        usable = measured.present & np.isfinite(measured.travel)
        usable &= (measured.flags & UNUSABLE) == 0
        if not usable.all() or not np.any(measured.push > self._highest + sigma):
            return False
        k = len(measured.finger)
        others = inputs.copy()
        others[:k] = others[-1] = 0.0
        spread = np.where(
            np.isfinite(measured.sigma_travel), measured.sigma_travel, self.errors.default_travel
        )
        stretch = self.errors.tendon * measured.push
        moved = measured.travel + response.travel_offset - stretch - response.displacement
        moved = moved - response.displacement_by @ others
        stiffness = np.linalg.pinv(response.displacement_by[:, :k])
        beyond = stiffness @ moved
        growth = -stiffness @ response.displacement_by[:, -1]
        width = np.hypot(spread, self.errors.tendon_relative * stretch)
        noise = sigma**2 + (stiffness**2) @ width**2 + (CURVED * beyond) ** 2
        design = np.concatenate([growth[:, None], np.eye(k), stiffness], axis=1)
        surprise = measured.push - response.force - beyond - design @ self._mean
        spread_of = design @ self._covariance @ design.T + np.diag(noise)
        if np.any(np.abs(surprise) > GATE * np.sqrt(np.diag(spread_of))):
            return False
        gain = np.linalg.solve(spread_of, design @ self._covariance).T
        self._mean = self._mean + gain @ surprise
        kept = np.eye(len(self._mean)) - gain @ design
        # Joseph's form stays positive whatever the rounding
        self._covariance = kept @ self._covariance @ kept.T + gain @ np.diag(noise) @ gain.T
        self._highest = np.maximum(self._highest, measured.push)
        self._samples += 1
        return True

    def _grasped(self, fingers: NDArray[np.int64]) -> None:
        """New fingers: their shared errors start from the priors."""
        k = len(fingers)
        self._fingers = fingers.copy()
        self._highest = np.zeros(k)
        drift = max(self.errors.drift, self.errors.force_floor)
        widths = np.concatenate([np.full(k, drift), np.full(k, self.errors.mounting)])
        covariance = np.zeros((1 + 2 * k, 1 + 2 * k))
        covariance[0, 0] = self._covariance[0, 0]
        covariance[1:, 1:] = np.diag(widths**2)
        self._mean = np.concatenate([self._mean[:1], np.zeros(2 * k)])
        self._covariance = covariance
