# SPDX-License-Identifier: Apache-2.0
"""Force of a squeezed object over displacement, for any modulus and gas pressure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject
from shell_deform.readout import wall_ratio
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, displaced, forced
from shell_deform.solve.first_touch import FirstTouchError, alone
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory import THICK
from shell_deform.theory.thin_wall import excess_stiffness, thick_wall_error

Array = NDArray[np.float64]

MODULUS_STEPS, MODULUS_TOLERANCE, LEAST_SLOPE = 20, 1e-6, 0.1


class IdentificationError(ValueError):
    """Data from which nothing can be identified."""


def modulus_where(
    error: Callable[[float], float | None],
    young: float,
    tolerance: float = MODULUS_TOLERANCE,
) -> float | None:
    """Young's modulus [Pa] at which `error` vanishes, by secants in ln E from `young`, or None.

    `error` is the logarithm of model over measurement of something that a stiffer wall raises:
    the force at a displacement, or one over the displacement under a force. It is None where the
    wall is too soft to answer.
    """
    last: tuple[float, float] | None = None
    for _ in range(MODULUS_STEPS):
        found = error(young)
        if found is None:
            young *= 2.0
            continue
        if abs(found) < tolerance:
            return young
        slope = 1.0
        if last is not None and last[0] != young:
            slope = (found - last[1]) / np.log(young / last[0])
        last = (young, found)
        # the gas lowers the slope, softening walls raise it: steps stay within a factor e
        young *= float(np.exp(np.clip(-found / max(slope, LEAST_SLOPE), -1.0, 1.0)))
    return None


class ForceCurve:
    """What every contact of an object answers when all are pushed alike.

    The mesh is built once; the wall is proportional to the modulus, so only its stiffness changes.
    Displacements count from the state that the gas pressure alone gives.
    """

    def __init__(
        self,
        shell_object: ShellObject,
        pin_radius: float | None = None,
        theory: str = 'koiter',
        control_vertices: int | None = None,
    ) -> None:
        """`pin_radius` [m] replaces that of the object's contacts."""
        self._given_radius, self._vertices = pin_radius, control_vertices
        self._model = build_model(
            shell_object,
            theory,
            control_vertices,
            refine_radius=pin_radius,
            sheared_everywhere=True,
        )
        self._described, self.shell_object = shell_object, shell_object.for_theory(self.theory)
        self._contacts = object_contacts(shell_object, self._model, pin_radius)
        self._known: dict[bytes, Array] = {}

    def with_theory(self, theory: str) -> ForceCurve:
        """The same object and contacts under another theory, thin walls on the same mesh."""
        if THICK in (theory, self.theory):
            return ForceCurve(self._described, self._given_radius, theory, self._vertices)
        other = copy(self)
        other._model = self._model.with_theory(theory)
        other._known = {}
        return other

    def with_thickness(self, thickness: float) -> ForceCurve:
        """The same object and contacts with another wall [m], even everywhere."""
        wall = with_material(self._described, thickness=thickness)
        return ForceCurve(wall, self._given_radius, self.theory, self._vertices)

    @property
    def theory(self) -> str:
        """Name of the strain measure."""
        return self._model.theory

    @property
    def theory_reason(self) -> str:
        """Why `auto` took it; empty where it was asked for."""
        return self._model.reason

    @property
    def contacts(self) -> tuple[ContactPatch, ...]:
        """What pushes, on the middle surface."""
        return self._contacts

    @property
    def surface(self) -> LimitSurface:
        """The middle surface as a function of its control points."""
        return self._model.surface

    @property
    def pin_radius(self) -> float:
        """Radius of the contacts [m]."""
        return self._contacts[0].radius

    @property
    def thickness_over_radius(self) -> float:
        """How far the wall is from thin; see `theory.thin_wall`."""
        return wall_ratio(self._model)

    @property
    def excess_stiffness(self) -> float:
        """Largest share by which a solid is softer than this theory; 0 for a thick wall's."""
        if self.theory == THICK:
            return 0.0
        return excess_stiffness(self.thickness_over_radius)

    @property
    def force_sigma(self) -> float:
        """Relative standard deviation of a thick wall's forces; 0 for a thin one's.

        What a thin wall is off by is known better: `excess_stiffness`.
        """
        if self.theory != THICK:
            return 0.0
        return thick_wall_error(self.thickness_over_radius) / np.sqrt(3.0)

    def model(self, young: float, gauge: float) -> ShellModel:
        """The shell with this modulus [Pa] and gauge pressure [Pa]."""
        factor = young / self.shell_object.young_modulus_pa
        wall = self._model.shell.stiffened(factor)
        gas = self._model.gas
        if gas.is_sealed:
            gas = replace(gas, gauge_pressure=gauge)
        return replace(self._model, shell=wall, gas=gas)

    def force(self, displacement: Array, young: float, gauge: float = 0.0) -> Array:
        """(n,) mean force of the contacts [N] at displacements (n,) [m], in any order.

        Raises IdentificationError where the shell has no equilibrium.
        """
        if not (self._model.gas.is_sealed or self._model.pressure):
            # without pressure every force is proportional to the modulus
            own = self.shell_object.young_modulus_pa
            key = np.ascontiguousarray(displacement).tobytes()
            if key not in self._known:
                self._known[key] = self._forces(displacement, own, 0.0)
            return young / own * self._known[key]
        return self._forces(displacement, young, gauge)

    def displacement(self, force: Array, young: float, gauge: float = 0.0) -> Array:
        """(n,) mean displacement of the contacts [m] under forces (n,) [N], in any order.

        Raises IdentificationError where the shell has no equilibrium.
        """

        def case(value: float, start: Array) -> LoadCase:
            return forced(self._contacts, np.full(len(start), value))

        states, start = self._walk(np.asarray(force, float), young, gauge, case, 'N')
        return np.array([float(np.mean(state.displacement - start)) for state in states])

    def modulus(self, force: float, displacement: float, gauge: float = 0.0) -> float:
        """Young's modulus [Pa] with which `force` [N] gives `displacement` [m].

        Raises IdentificationError when the gas alone is stiffer than that.
        """
        depth = np.array([displacement])

        def error(young: float) -> float | None:
            found = float(self.force(depth, young, gauge)[0])
            return float(np.log(found / force)) if found > 0.0 else None

        own = self.shell_object.young_modulus_pa
        young = modulus_where(error, own) if force > 0.0 else None
        if young is not None:
            return young
        raise IdentificationError(
            f'{self.shell_object.name}: no modulus gives {force:.4g} N at {displacement:.4g} m '
            f'with gauge pressure {gauge:.4g} Pa'
        )

    def equilibria(
        self, displacement: Array, young: float, gauge: float = 0.0
    ) -> list[Equilibrium]:
        """The squeezed shell at displacements (n,) [m], in any order.

        Raises IdentificationError where the shell has no equilibrium.
        """

        def case(value: float, start: Array) -> LoadCase:
            return displaced(self._contacts, start + value)

        return self._walk(np.asarray(displacement, float), young, gauge, case, 'm')[0]

    def outer_faces(
        self, states: Sequence[Equilibrium], young: float, gauge: float, thickness: float
    ) -> tuple[list[Array], float]:
        """Control points (n, 3) [m] of squeezed surfaces, and the outer face's distance from them.

        Of a thin wall that is half the `thickness` [m] along the normal of the middle surface; of
        a thick one the surface itself is the outer face, and the distance what `thickness` is more
        than its own.
        """
        if self.theory != THICK:
            return [state.positions for state in states], 0.5 * thickness
        shell = self.model(young, gauge).on_contacts(self._contacts).shell
        faces = [self.surface.control_points(shell.outer_face(s.unknowns)) for s in states]
        return faces, 0.5 * (thickness - self.shell_object.thickness_m)

    def _forces(self, displacement: Array, young: float, gauge: float) -> Array:
        states = self.equilibria(displacement, young, gauge)
        return np.array([float(np.mean(state.force)) for state in states])

    def _walk(
        self,
        values: Array,
        young: float,
        gauge: float,
        case: Callable[[float, Array], LoadCase],
        unit: str,
    ) -> tuple[list[Equilibrium], Array]:
        """Equilibria at rising values, in the given order; displacements where all is at zero."""
        solver = EquilibriumSolver(self.model(young, gauge))
        try:
            state = alone(solver)
        except FirstTouchError as error:
            raise IdentificationError(
                f'{self.shell_object.name}: with E {young:.4g} Pa {error}'
            ) from error
        start = np.zeros(len(self._contacts))
        if solver.model.own_pressure:
            state = solver.solve(forced(self._contacts, [0.0] * len(start)), state)
            start = state.displacement
        found: dict[int, Equilibrium] = {}
        for i in np.argsort(values, kind='stable').tolist():
            state = solver.solve(case(float(values[i]), start), state)
            if not state.converged:
                raise IdentificationError(
                    f'{self.shell_object.name}: no equilibrium at {values[i]:g} {unit} with '
                    f'E {young:.4g} Pa, gauge pressure {gauge:.4g} Pa: {state.message}'
                )
            found[i] = state
        return [found[i] for i in range(len(values))], start
