"""Young's modulus, and internal pressure where the data allow it, from forces and displacements.

Nonlinear least squares on the nonlinear model: at each measured displacement the model's force is
compared with the measured one, weighed by the gauge's and the encoder's uncertainty. What cannot
be told apart is said: a force-displacement curve of a thin sphere fixes about E h^2.5, not E.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

# Two-sided 90 % of a normal distribution.
NINETY_PERCENT = 1.6448536269514722
# A parameter is told apart when its relative sigma is below this.
SEPARABLE_SIGMA = 0.25
# Thin-shell theory is stiffer than a solid by up to this at h/R 0.08: E comes out low.
SOLID_BIAS = 0.10


class IdentificationError(ValueError):
    """Data from which nothing can be identified."""


@dataclass(frozen=True)
class SqueezeData:
    """n measured pairs per contact.

    Attributes:
        force: (n,) push of each contact [N]. displacement: (n,) of its centre along its axis [m].
        sigma_force: (n,) [N]. sigma_displacement: (n,) [m].
    """

    force: Array
    displacement: Array
    sigma_force: Array
    sigma_displacement: Array

    def __post_init__(self) -> None:
        columns = (self.force, self.displacement, self.sigma_force, self.sigma_displacement)
        if len({len(column) for column in columns}) != 1 or len(self.force) == 0:
            raise IdentificationError('every column of the data needs the same, non-zero length')
        for name, column in zip(('force', 'displacement'), columns, strict=False):
            if not np.all(np.isfinite(column)):
                row = int(np.flatnonzero(~np.isfinite(column))[0])
                raise IdentificationError(f'{name} of row {row + 1} is {column[row]}')
        if not np.all(self.displacement > 0):
            row = int(np.flatnonzero(~(self.displacement > 0))[0])
            raise IdentificationError(
                f'displacement of row {row + 1} is {self.displacement[row]} m; only squeezed '
                'states (above 0) say something'
            )

    def rows(self, chosen: NDArray[np.int64]) -> SqueezeData:
        """Some of the rows."""
        return SqueezeData(
            self.force[chosen],
            self.displacement[chosen],
            self.sigma_force[chosen],
            self.sigma_displacement[chosen],
        )


@dataclass(frozen=True)
class Identified:
    """What the data say.

    Attributes:
        names: identified parameters, 'young_modulus_pa' and perhaps 'gauge_pressure_pa'.
        values, sigma: (k,) best values and one standard deviation.
        correlation: (k, k). fitted_force: (n,) of the model at the measured displacements [N].
        reduced_chi_square: near 1 when model and noise explain the data.
        stiffness_product: E h^2.5 [Pa m^2.5], what a thin sphere's curve really fixes.
        statement: sentences on what is and is not separable.
    """

    names: tuple[str, ...]
    values: Array
    sigma: Array
    correlation: Array
    fitted_force: Array
    reduced_chi_square: float
    stiffness_product: float
    statement: tuple[str, ...]

    def interval(self, name: str) -> tuple[float, float]:
        """90 % interval of a parameter."""
        k = self.names.index(name)
        half = NINETY_PERCENT * self.sigma[k]
        return float(self.values[k] - half), float(self.values[k] + half)


class ForceCurve:
    """Force of each contact at given displacements, for any modulus and gauge pressure.

    The mesh is built once; the wall is proportional to the modulus, so only its stiffness changes.
    """

    def __init__(
        self,
        shell_object: ShellObject,
        pin_radius: float | None = None,
        theory: str = 'koiter',
        control_vertices: int | None = None,
    ) -> None:
        self.shell_object = shell_object
        self._model = build_model(shell_object, theory, control_vertices, refine_radius=pin_radius)
        self._contacts = object_contacts(shell_object, self._model, pin_radius)
        self._known: dict[bytes, Array] = {}

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

        Displacements count from the state that the gas pressure alone gives. Raises
        IdentificationError where the shell has no equilibrium.
        """
        if not self._model.gas.is_sealed:
            # without gas every force is proportional to the modulus
            own = self.shell_object.young_modulus_pa
            key = np.ascontiguousarray(displacement).tobytes()
            if key not in self._known:
                self._known[key] = self._solved(displacement, own, 0.0)
            return young / own * self._known[key]
        return self._solved(displacement, young, gauge)

    def _solved(self, displacement: Array, young: float, gauge: float) -> Array:
        model = self.model(young, gauge)
        solver = EquilibriumSolver(model)
        state = solver.rest()
        start = np.zeros(len(self._contacts))
        if gauge:
            state = solver.solve(displaced(self._contacts, start), state)
            start = self._blown(solver)
        result = np.empty(len(displacement))
        for i in np.argsort(displacement):
            case = displaced(self._contacts, start + displacement[i])
            state = solver.solve(case, state)
            if not state.converged:
                raise IdentificationError(
                    f'{self.shell_object.name}: no equilibrium at {displacement[i]:g} m with '
                    f'E {young:.4g} Pa, gauge pressure {gauge:.4g} Pa: {state.message}'
                )
            result[i] = float(np.mean(state.force))
        return result

    def _blown(self, solver: EquilibriumSolver) -> Array:
        """Displacement of the contact centres [m] when only the gas presses."""
        return solver.solve(forced(self._contacts, [0.0] * len(self._contacts))).displacement


def identify(
    curve: ForceCurve,
    data: SqueezeData,
    pressure: bool = False,
    start: tuple[float, float] | None = None,
) -> Identified:
    """Fit the modulus, and with `pressure` the gauge pressure of a sealed object, to data.

    `start`: first values of both [Pa] (default: the object's own). Raises IdentificationError when
    pressure is asked of an object that is not sealed, or of fewer than two rows.
    """
    shell_object = curve.shell_object
    if pressure and shell_object.gas.kind != 'sealed':
        raise IdentificationError(
            f'{shell_object.name}: pressure can be identified only with gas: {{kind: sealed}}'
        )
    if pressure and len(data.force) < 2:
        raise IdentificationError('one row fixes one parameter; give two rows for the pressure')
    young, gauge = start or (shell_object.young_modulus_pa, shell_object.gas.gauge_pressure_pa)
    slope = _slope(curve, data, young, gauge)
    sigma = np.hypot(data.sigma_force, slope * data.sigma_displacement)
    scale = max(shell_object.gas.ambient_pa, 1.0)

    def residual(parameters: Array) -> Array:
        e = float(np.exp(parameters[0]))
        p = float(parameters[1]) * scale if pressure else gauge
        return (curve.force(data.displacement, e, p) - data.force) / sigma

    first = [np.log(young)] + ([gauge / scale] if pressure else [])
    bounds = ([-np.inf] + [-0.5] * pressure, [np.inf] + [10.0] * pressure)
    fit = least_squares(
        residual, first, diff_step=1e-4, xtol=1e-8, ftol=1e-10, x_scale='jac', bounds=bounds
    )
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)
    free = max(1, len(data.force) - len(first))
    chi = float(2.0 * fit.cost / free)
    deviation = np.sqrt(np.diag(covariance))
    values = [float(np.exp(fit.x[0]))] + ([float(fit.x[1]) * scale] if pressure else [])
    sigmas = np.array([values[0] * deviation[0]] + ([deviation[1] * scale] if pressure else []))
    names = ('young_modulus_pa', 'gauge_pressure_pa')[: len(values)]
    correlation = covariance / np.outer(deviation, deviation)
    return Identified(
        names=names,
        values=np.array(values),
        sigma=sigmas,
        correlation=correlation,
        fitted_force=data.force + fit.fun * sigma,
        reduced_chi_square=chi,
        stiffness_product=values[0] * shell_object.thickness_m**2.5,
        statement=_statement(shell_object, values, sigmas, correlation),
    )


def cross_validate(
    curve: ForceCurve, data: SqueezeData, fitted_rows: int
) -> tuple[Identified, Array]:
    """Fit the modulus on the `fitted_rows` smallest loads; forces (m,) [N] predicted for the rest.

    Raises IdentificationError when nothing is left to predict.
    """
    order = np.argsort(data.displacement)
    if not 0 < fitted_rows < len(order):
        raise IdentificationError(
            f'{fitted_rows} of {len(order)} rows cannot be fitted and leave others to predict'
        )
    small, large = data.rows(order[:fitted_rows]), data.rows(order[fitted_rows:])
    found = identify(curve, small)
    return found, curve.force(large.displacement, float(found.values[0]))


def thickness_sensitivity(shell_object: ShellObject, data: SqueezeData) -> float:
    """Exponent m in F ~ E h^m over the data's range: how modulus and thickness trade off."""
    h = shell_object.thickness_m
    without = with_material(shell_object, gas_kind='none')
    forces = [
        ForceCurve(with_material(without, thickness=factor * h)).force(
            data.displacement, shell_object.young_modulus_pa
        )
        for factor in (0.98, 1.02)
    ]
    weight = data.force**2
    local = np.log(forces[1] / forces[0]) / np.log(1.02 / 0.98)
    return float(np.sum(weight * local) / np.sum(weight))


def _slope(curve: ForceCurve, data: SqueezeData, young: float, gauge: float) -> Array:
    """(n,) model stiffness dF/dw [N/m] at the measured displacements."""
    step = 1e-2 * data.displacement
    both = np.concatenate([data.displacement - step, data.displacement + step])
    force = curve.force(both, young, gauge)
    half = len(step)
    return np.asarray((force[half:] - force[:half]) / (2.0 * step))


def _statement(
    shell_object: ShellObject, values: list[float], sigma: Array, correlation: Array
) -> tuple[str, ...]:
    found = [
        'Modulus and thickness are not separable by forces and displacements: with another '
        f'thickness h the same curve gives about E times '
        f'({shell_object.thickness_m * 1e3:g} mm / h)^2.5: what is fixed is E h^2.5.',
        f'A thin-shell fit of a solid wall gives E low by up to {100 * SOLID_BIAS:.0f} % at '
        'h/R 0.08; it is the right modulus for predictions by this model.',
    ]
    if len(values) == 2:
        strength = abs(float(correlation[0, 1]))
        relative = sigma[0] / values[0]
        verdict = (
            'are separable'
            if relative < SEPARABLE_SIGMA and strength < 0.98
            else ('are NOT separable by these data: add larger displacements')
        )
        found.append(
            f'Modulus and pressure {verdict} (correlation {correlation[0, 1]:+.3f}, modulus known '
            f'to {100 * relative:.1f} %).'
        )
    return tuple(found)


def squeeze_data(table: Array, sigma_force: float, sigma_displacement: float) -> SqueezeData:
    """Data from rows (n, 2 to 4): force [N], displacement [m], then their sigmas if given."""
    table = np.atleast_2d(np.asarray(table, dtype=float))
    if table.shape[1] not in (2, 3, 4):
        raise IdentificationError(
            f'the table has {table.shape[1]} columns; give force_n, displacement_m and optionally '
            'sigma_force_n, sigma_displacement_m'
        )
    count = len(table)
    return SqueezeData(
        table[:, 0],
        table[:, 1],
        table[:, 2] if table.shape[1] > 2 else np.full(count, sigma_force),
        table[:, 3] if table.shape[1] > 3 else np.full(count, sigma_displacement),
    )
