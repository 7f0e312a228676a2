# SPDX-License-Identifier: Apache-2.0
"""A wall that remembers.

Within a step of time it answers by a share of its modulus, and carries what is held of its past.
The past is kept in the material frame, as stresses at the quadrature points (membrane forces and
moments of a thin wall, those of the metric numbers of a thick one), so that it turns with the
wall. Under the pins of a thick wall the pressures remember, too: its unknown pressures are those
that squeeze the elastic wall, and what a pin is pushed with besides is a dead load.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble import plain
from shell_deform.assemble.discretisation import Discretisation, Sums
from shell_deform.assemble.thick import ThickShell
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.theory import THEORIES

if HAVE_NUMBA:
    from shell_deform.assemble import held_kernels, thick_held_kernels

Array = NDArray[np.float64]

THICK_STRESSES = 12


@dataclass(frozen=True)
class HeldWall:
    """A shell in a step of time: its elastic answer times `now`, and `past` on top.

    Attributes:
        past: (.,) what is held, in the order of `elastic_stress`.
    """

    shell: Discretisation
    theory: str
    now: float
    past: Array

    def gradient(self, positions: Array) -> tuple[float, Array]:
        """Potential [J] of the step and its gradient [N] at all unknowns."""
        energy, gradient = self.shell.gradient(self.theory, positions)
        more, pull, _ = self._held(positions, stiff=False)
        return self.now * energy + more, self.now * gradient + pull

    def tangent(self, positions: Array, pressure: float) -> tuple[float, Array, Array]:
        """`gradient`, and stiffness values with the gas under `pressure` [Pa]."""
        energy, gradient, data = self.shell.tangent(self.theory, positions, pressure / self.now)
        more, pull, stiffness = self._held(positions, stiff=True)
        return self.now * energy + more, self.now * gradient + pull, self.now * data + stiffness

    @cached_property
    def _stress(self) -> Array:
        """(p, .) held at every point."""
        count = len(self.shell.weights)
        width = THICK_STRESSES if isinstance(self.shell, ThickShell) else 6
        return np.ascontiguousarray(self.past[: count * width].reshape(count, width))

    def _held(self, positions: Array, stiff: bool) -> tuple[float, Array, Array]:
        shell, pattern = self.shell, self.shell.pattern
        if not HAVE_NUMBA:
            return plain.held_tangent(shell, self.theory, self._stress, positions, stiff)
        positions = np.ascontiguousarray(positions)

        def part(first: int, last: int) -> Sums:
            gradient = np.zeros_like(positions)
            data = np.zeros(len(pattern.indices) if stiff else 0)
            places: Any = (
                pattern.block_offsets[first:], pattern.block_start,
                np.ascontiguousarray(pattern.indptr[:-1:3]), pattern.row_length, pattern.indices,
                data,
            )  # fmt: skip
            if isinstance(shell, ThickShell):
                _, points, stamps, _ = shell.kernel_arguments
                energy = thick_held_kernels.thick_held_tangent(
                    stiff, shell.thick_elements(first, last), points, stamps, self._stress,
                    positions, gradient, *places,
                )  # fmt: skip
                return energy, gradient, data
            reference = shell.reference
            energy = held_kernels.held_tangent(
                THEORIES[self.theory].code, stiff, *shell.surface_elements(first, last),
                shell.rows, shell.values, reference.tangents, reference.second,
                reference.curvature, shell.weights, self._stress, positions, gradient, *places,
            )  # fmt: skip
            return energy, gradient, data

        energy, gradient, data = shell.summed(part)
        if isinstance(shell, ThickShell):
            dead = self._on_pins
            return energy + float(np.sum(dead * positions)), gradient + dead, data
        return energy, gradient, data

    @cached_property
    def _on_pins(self) -> Array:
        """Gradient of what the held pressures of the cells do to pins and the wall under them."""
        shell = self.shell
        assert isinstance(shell, ThickShell)
        dead, pressed = np.zeros_like(shell.start), shell.pressed
        past = self.past[len(shell.weights) * THICK_STRESSES :]
        push = shell.weights[pressed.point] * past[pressed.cell]
        n = len(shell.mesh.vertices)
        force = np.zeros((len(shell.weights), 3))
        force[pressed.point] = push[:, None] * pressed.axis
        dead[:n] = shell.value_matrix().T @ force
        pins = shell.first_pin + pressed.stamp
        np.add.at(dead[:, 0], pins, push)
        np.add.at(dead[:, 1], pins, push * pressed.arm[:, 0])
        np.add.at(dead[:, 2], pins, push * pressed.arm[:, 1])
        return dead


def elastic_stress(shell: Discretisation, theory: str, positions: Array) -> Array:
    """All that relaxes, as one vector: stresses point by point, then pressures under pins [Pa].

    Raises ValueError where a thick wall has no equilibrium at a point.
    """
    if not isinstance(shell, ThickShell):
        strain = THEORIES[theory].strains(shell.derivatives(positions), shell.reference)
        return plain.wall_stress(shell, strain).ravel()
    out = np.zeros((len(shell.weights), THICK_STRESSES))
    arguments: Any = (*shell.kernel_arguments, np.ascontiguousarray(positions), out)
    if not thick_held_kernels.thick_stresses(*arguments):
        raise ValueError('a point of the wall has no equilibrium')
    first = 3 * (shell.first_pin + len(shell.stamps))
    cells = positions.reshape(-1)[first : first + shell.pressed.cells]
    return np.concatenate([out.ravel(), shell.pressure_unit * cells])
