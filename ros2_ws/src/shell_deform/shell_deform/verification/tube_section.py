# SPDX-License-Identifier: Apache-2.0
"""Uniform bending of a long tube by its cross-section alone: largest moment and wrinkling.

Bent to a torus, every section of a long tube looks the same. Its energy, that of Koiter's shell
with finite stretch and finite turns, depends on the plane curve of the section and on one axial
stretch; Fourier series of the curve and Newton's method find its equilibrium at every curvature.
Nothing is assumed small, which Brazier's formula does of the flattening. Not one line is shared
with the shell of this package.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Field = NDArray[Any]
"""Real, or complex where a derivative is taken by a complex step."""

HARMONICS = 10
POINTS = 64
COMPLEX_STEP = 1e-30
CONVERGED = 1e-9


class SectionError(RuntimeError):
    """No equilibrium of the section was found."""


@dataclass(frozen=True)
class TubeSection:
    """A long circular tube: middle radius [m], wall [m], Young's modulus [Pa], Poisson's ratio.

    `pressure` inside [Pa] acts on closed ends, too.
    """

    radius: float
    wall: float
    young: float
    poisson: float
    pressure: float = 0.0

    @cached_property
    def _series(self) -> tuple[Array, Array, Array]:
        angle = 2.0 * np.pi * (np.arange(POINTS) + 0.5) / POINTS
        numbers = np.arange(HARMONICS + 1.0)
        return np.cos(np.outer(angle, numbers)), np.sin(np.outer(angle, numbers)), numbers

    @property
    def curvature_unit(self) -> float:
        """h / (R^2 sqrt(1 - nu^2)) [1/m]: Brazier's largest moment is at 0.471 of it."""
        return self.wall / self.radius**2 / float(np.sqrt(1.0 - self.poisson**2))

    @property
    def brazier(self) -> float:
        """Brazier's largest moment [N m], of first order in the flattening, without pressure."""
        stiffness = np.pi * self.young * self.radius * self.wall**2
        return float(2.0 * np.sqrt(2.0) / 9.0 * stiffness / np.sqrt(1.0 - self.poisson**2))

    def round(self) -> Array:
        """(u,) unknowns of the undeformed section: cosines of x, sines of y, axial stretch."""
        found = np.zeros(2 * HARMONICS + 1)
        found[0] = found[HARMONICS] = self.radius
        found[-1] = 1.0
        return found

    def _curve(self, unknowns: Field) -> tuple[Field, ...]:
        """x, y, their first and second derivatives, (n, b) for unknowns (u, b)."""
        cosines, sines, k = self._series
        k = k[1:]
        x, y = unknowns[:HARMONICS], unknowns[HARMONICS : 2 * HARMONICS]
        c, s = cosines[:, 1:], sines[:, 1:]
        return c @ x, s @ y, -(s * k) @ x, (c * k) @ y, -(c * k**2) @ x, -(s * k**2) @ y

    def strains(self, unknowns: Field, curvature: Any) -> tuple[Field, ...]:
        """Hoop and axial strain of the middle, change of both curvatures, local hoop curvature."""
        x, y, x1, y1, x2, y2 = self._curve(unknowns)
        stretch = unknowns[-1] + curvature * x
        square = x1 * x1 + y1 * y1
        length = np.sqrt(square)
        normal, bent = y1 / length, (y1 * x2 - x1 * y2) / length
        hoop = 0.5 * (square / self.radius**2 - 1.0)
        axial = 0.5 * (stretch * stretch - 1.0)
        hoop_bend = bent / self.radius**2 + 1.0 / self.radius
        axial_bend = -curvature * stretch * normal
        return hoop, axial, hoop_bend, axial_bend, -bent / square

    def energy(self, unknowns: Field, curvature: Any) -> Field:
        """(b,) energy per length [N] for unknowns (u, b), pressure included."""
        hoop, axial, hoop_bend, axial_bend, _ = self.strains(unknowns, curvature)
        modulus = self.young * self.wall / (1.0 - self.poisson**2)
        density = hoop**2 + axial**2 + 2.0 * self.poisson * hoop * axial
        bending = hoop_bend**2 + axial_bend**2 + 2.0 * self.poisson * hoop_bend * axial_bend
        share = 2.0 * np.pi / POINTS
        total = 0.5 * modulus * (density + self.wall**2 / 12.0 * bending).sum(axis=0)
        if self.pressure:
            x, _, _, y1, _, _ = self._curve(unknowns)
            volume = (unknowns[-1] * x + 0.5 * curvature * x * x) * y1
            return (self.radius * total - self.pressure * volume.sum(axis=0)) * share
        return total * self.radius * share

    def _gradients(self, unknowns: Array, curvature: float) -> Array:
        """(u, b) for unknowns (u, b)."""
        count, columns = unknowns.shape
        apart = np.repeat(unknowns.astype(complex), count, axis=1)
        apart[np.tile(np.arange(count), columns), np.arange(count * columns)] += 1j * COMPLEX_STEP
        values = self.energy(apart, curvature).imag / COMPLEX_STEP
        return np.asarray(values.reshape(columns, count).T, float)

    def bent(self, curvature: float, start: Array) -> Array:
        """(u,) equilibrium at `curvature` [1/m], from `start`. Raises SectionError."""
        found = start.copy()
        sizes = np.full(len(found), self.radius)
        sizes[-1] = 1.0
        for _ in range(40):
            steps = 1e-6 * np.diag(sizes)
            both = found[:, None] + np.concatenate([steps, -steps], axis=1)
            ahead, behind = np.split(self._gradients(both, curvature), 2, axis=1)
            stiffness = (ahead - behind) / (2e-6 * sizes)
            gradient = self._gradients(found[:, None], curvature)[:, 0]
            step = -np.linalg.solve(0.5 * (stiffness + stiffness.T), gradient)
            found = found + step
            if np.abs(step / sizes).max() < CONVERGED:
                return found
        raise SectionError(f'no section in equilibrium at a curvature of {curvature:g} 1/m')

    def moment(self, unknowns: Array, curvature: float) -> float:
        """Bending moment [N m] of an equilibrium."""
        value = self.energy(unknowns[:, None], curvature + 1j * COMPLEX_STEP)
        return float(value.imag[0] / COMPLEX_STEP)

    def path(self, furthest: float = 0.7, steps: int = 28) -> tuple[Array, Array, Array]:
        """Curvatures (s,) [1/m] up to `furthest` units, moments (s,) [N m], unknowns (s, u)."""
        curvatures = self.curvature_unit * np.linspace(0.0, furthest, steps + 1)
        states, moments = [self.round()], [0.0]
        for curvature in curvatures:
            states.append(self.bent(curvature, states[-1]))
            moments.append(self.moment(states[-1], curvature))
        return curvatures, np.array(moments[1:]), np.array(states[1:])

    def largest_moment(self) -> float:
        """Largest moment of the path [N m], by a parabola through its three highest points."""
        curvatures, moments, _ = self.path()
        top = min(max(int(np.argmax(moments)), 1), len(moments) - 2)
        a, b, c = np.polyfit(curvatures[top - 1 : top + 2], moments[top - 1 : top + 2], 2)
        return float(c - b * b / (4.0 * a))

    def wrinkling(self, furthest: float = 1.6, steps: int = 160) -> tuple[float, float]:
        """Moment [N m] and curvature [1/m] at which the section wrinkles.

        There the axial force per length at its most compressed point reaches what a cylinder of
        the local radius bears, E h^2 / (r sqrt(3 (1 - nu^2))). Raises SectionError where it does
        not.
        """
        classical = self.young * self.wall**2 / np.sqrt(3.0 * (1.0 - self.poisson**2))
        modulus = self.young * self.wall / (1.0 - self.poisson**2)
        state, before = self.round(), (0.0, 0.0, 0.0)
        for curvature in self.curvature_unit * np.linspace(0.0, furthest, steps + 1)[1:]:
            state = self.bent(curvature, state)
            hoop, axial, _, _, bent = self.strains(state[:, None], curvature)
            inner = int(np.argmin(axial[:, 0]))
            force = -modulus * (axial + self.poisson * hoop) * (1.0 + axial)
            share = float(force[inner, 0] / (classical * bent[inner, 0]))
            now = (share, self.moment(state, curvature), float(curvature))
            if share >= 1.0:
                part = (1.0 - before[0]) / (share - before[0])
                moment, found = np.array(before[1:]) + part * np.subtract(now[1:], before[1:])
                return float(moment), float(found)
            before = now
        raise SectionError(f'no wrinkling up to a curvature of {before[2]:g} 1/m')
