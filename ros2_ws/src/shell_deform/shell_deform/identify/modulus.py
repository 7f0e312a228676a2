# SPDX-License-Identifier: Apache-2.0
"""Young's modulus, and internal pressure where the data allow it, from forces and displacements.

Nonlinear least squares on the nonlinear model: at each measured displacement the model's force is
compared with the measured one, weighed by the gauge's and the encoder's uncertainty. What all rows
share - the gauge's zero and its gain - is estimated along with a prior of its own, so that it
widens the answer instead of averaging out. What cannot be told apart is said: the curve of a thin
sphere fixes about E h^2.5, not E. Scans of the dents fix the thickness (`dent_profile`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from shell_deform.building import with_material
from shell_deform.identify.dent_profile import NINETY_PERCENT, ThicknessFit, interval_above_zero
from shell_deform.identify.force_curve import ForceCurve, IdentificationError
from shell_deform.objects import ShellObject

Array = NDArray[np.float64]

# Fits are repeated until the modulus that the weights were made for is within that share.
SLOPE_TOLERANCE, PASSES = 0.1, 4
# Step of the logarithm of the modulus, and of the pressure over that of the air around.
DIFFERENCE = 1e-4
# A parameter is told apart when its relative sigma is below this.
SEPARABLE_SIGMA = 0.25


@dataclass(frozen=True)
class SqueezeData:
    """n measured pairs per contact.

    Attributes:
        force: (n,) push of each contact [N]. displacement: (n,) of its centre along its axis [m].
        sigma_force: (n,) of each row by itself [N]. sigma_displacement: (n,) [m].
        sigma_zero: of the gauge's zero, the same error in all rows [N].
        sigma_gain: of the gauge's gain, relative [-].
    """

    force: Array
    displacement: Array
    sigma_force: Array
    sigma_displacement: Array
    sigma_zero: float = 0.0
    sigma_gain: float = 0.0

    def __post_init__(self) -> None:
        columns = (self.force, self.displacement, self.sigma_force, self.sigma_displacement)
        if len({len(column) for column in columns}) != 1 or len(self.force) == 0:
            raise IdentificationError('every column of the data needs the same, non-zero length')
        names = ('force', 'displacement', 'sigma_force', 'sigma_displacement')
        for name, column in zip(names, columns, strict=True):
            if not np.all(np.isfinite(column)):
                row = int(np.flatnonzero(~np.isfinite(column))[0])
                raise IdentificationError(f'{name} of row {row + 1} is {column[row]}')
        for name, column in zip(names[1:], columns[1:], strict=True):
            bad = np.flatnonzero(~(column > 0))
            if len(bad):
                raise IdentificationError(
                    f'{name} of row {bad[0] + 1} is {column[bad[0]]:g}; it must be above 0'
                    + ('; only squeezed states say something' if name == 'displacement' else '')
                )
        for name in ('sigma_zero', 'sigma_gain'):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise IdentificationError(f'{name} is {value}; it must be finite, not negative')

    def rows(self, chosen: NDArray[np.int64]) -> SqueezeData:
        """Some of the rows."""
        return SqueezeData(
            self.force[chosen],
            self.displacement[chosen],
            self.sigma_force[chosen],
            self.sigma_displacement[chosen],
            self.sigma_zero,
            self.sigma_gain,
        )


@dataclass(frozen=True)
class Identified:
    """What the data say.

    Attributes:
        names: identified parameters: 'young_modulus_pa', perhaps 'gauge_pressure_pa' or
            'thickness_m'.
        values, sigma: (k,) best values and one standard deviation, the gauge's zero and gain
            and the error of a thick wall's theory included.
        correlation: (k, k). fitted_force: (n,) of the model at the measured displacements [N].
        zero_force: zero of the gauge that the data ask for [N]; 0 without `sigma_zero`.
        reduced_chi_square: near 1 when model and noise explain the data.
        stiffness_product: E h^2.5 [Pa m^2.5], what a thin sphere's curve really fixes.
        solid_modulus, solid_sigma: modulus of the rubber itself [Pa]: thin-shell theory is too
            stiff, by something between nothing and the share of `excess_stiffness`; that of a
            thick wall needs no correction.
        statement: sentences on what is and is not separable.
    """

    names: tuple[str, ...]
    values: Array
    sigma: Array
    correlation: Array
    fitted_force: Array
    zero_force: float
    reduced_chi_square: float
    stiffness_product: float
    solid_modulus: float
    solid_sigma: float
    statement: tuple[str, ...]

    def interval(self, name: str) -> tuple[float, float]:
        """90 % interval of a parameter, or of 'solid_modulus_pa'."""
        if name == 'solid_modulus_pa':
            return interval_above_zero(self.solid_modulus, self.solid_sigma)
        k = self.names.index(name)
        value, sigma = float(self.values[k]), float(self.sigma[k])
        if name == 'gauge_pressure_pa':
            return value - NINETY_PERCENT * sigma, value + NINETY_PERCENT * sigma
        return interval_above_zero(value, sigma)


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
    problem = _Problem(curve, data, pressure, gauge)
    return _identified(problem, _fitted(problem, young, gauge))


class _Problem:
    """Residuals of the measured forces, and their derivatives.

    Parameters are the logarithm of the modulus, with `pressure` the gauge pressure over the
    ambient one, and, as nuisance parameters with a prior of width one, zero and gain of the gauge:
    measured = (1 + gain) model + zero.
    """

    def __init__(
        self, curve: ForceCurve, data: SqueezeData, pressure: bool, known_gauge: float
    ) -> None:
        self.curve, self.data, self.pressure = curve, data, pressure
        self.scale = max(curve.shell_object.gas.ambient_pa, 1.0)
        self.wanted = 2 if pressure else 1
        # what the theory is off by is the same in all rows, too
        self.sigma_gain = float(np.hypot(data.sigma_gain, curve.force_sigma))
        self.shared = [data.sigma_zero > 0.0, self.sigma_gain > 0.0]
        self._known_gauge = known_gauge
        self._solved: dict[tuple[float, float], Array] = {}

    def force(self, parameters: Array) -> Array:
        """(n,) of the model at the measured displacements [N]; solved once per parameters."""
        young = float(np.exp(parameters[0]))
        gauge = float(parameters[1]) * self.scale if self.pressure else self._known_gauge
        if (young, gauge) not in self._solved:
            self._solved[young, gauge] = self.curve.force(self.data.displacement, young, gauge)
        return self._solved[young, gauge]

    def nuisance(self, parameters: Array) -> tuple[float, float]:
        """Zero and gain in units of their priors, 0 where the data have no such error."""
        values = iter(parameters[self.wanted :].tolist())
        zero = next(values) if self.shared[0] else 0.0
        return zero, next(values) if self.shared[1] else 0.0

    def residual(self, parameters: Array, sigma: Array) -> Array:
        """(n + priors,) normalised by sigma (n,) [N]."""
        zero, gain = self.nuisance(parameters)
        force = self.force(parameters)
        expected = force * (1.0 + gain * self.sigma_gain) + zero * self.data.sigma_zero
        return np.concatenate([(expected - self.data.force) / sigma, parameters[self.wanted :]])

    def jacobian(self, parameters: Array, sigma: Array) -> Array:
        """Derivative of the residual; by differences only of what needs the solver."""
        # The steps of the differences do not vanish with the value.
        force, gain = self.force(parameters), self.nuisance(parameters)[1]
        columns = []
        for step in DIFFERENCE * np.eye(len(parameters))[: self.wanted]:
            moved = self.force(parameters + step)
            columns.append((1.0 + gain * self.sigma_gain) * (moved - force) / DIFFERENCE)
        of_shared = np.full_like(force, self.data.sigma_zero), self.sigma_gain * force
        columns += [column for column, there in zip(of_shared, self.shared, strict=True) if there]
        prior = np.eye(len(parameters))[self.wanted :]
        return np.concatenate([np.stack(columns, axis=1) / sigma[:, None], prior])


def _fitted(problem: _Problem, young: float, gauge: float) -> OptimizeResult:
    """The least squares about the best values."""
    data, pressure, priors = problem.data, problem.pressure, sum(problem.shared)
    first = [np.log(young)] + [gauge / problem.scale] * pressure + [0.0] * priors
    low = [-np.inf] + [-0.5] * pressure + [-np.inf] * priors
    high = [np.inf] + [10.0] * pressure + [np.inf] * priors
    for _ in range(PASSES):
        # what an error of the displacement means in force grows with the modulus
        slope = _slope(problem.curve, data, young, gauge)
        sigma = np.hypot(data.sigma_force, slope * data.sigma_displacement)
        fit = least_squares(
            problem.residual, first, problem.jacobian, xtol=1e-8, ftol=1e-10, x_scale='jac',
            bounds=(low, high), args=(sigma,),
        )  # fmt: skip
        before, young = young, float(np.exp(fit.x[0]))
        gauge, first = float(fit.x[1]) * problem.scale if pressure else gauge, fit.x
        if abs(np.log(young / before)) < SLOPE_TOLERANCE:
            break
    return fit


def _identified(problem: _Problem, fit: OptimizeResult) -> Identified:
    """Values, their covariance with the nuisance parameters eliminated, and what they mean."""
    data, wanted, curve = problem.data, problem.wanted, problem.curve
    shell_object = curve.shell_object
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[:wanted, :wanted]
    free = max(1, len(data.force) - wanted)
    deviation = np.sqrt(np.diag(covariance))
    values = np.array([np.exp(fit.x[0]), *(problem.scale * fit.x[1:wanted])])
    sigmas = deviation * np.array([values[0], problem.scale][:wanted])
    correlation = covariance / np.outer(deviation, deviation)
    excess = curve.excess_stiffness
    # anything between none and all of the excess, since it fades in deep dents
    solid = float(values[0]) * (1.0 + 0.5 * excess)
    bias_sigma = float(values[0]) * excess / np.sqrt(12.0)
    return Identified(
        names=('young_modulus_pa', 'gauge_pressure_pa')[:wanted],
        values=values,
        sigma=sigmas,
        correlation=correlation,
        fitted_force=problem.force(fit.x),
        zero_force=problem.nuisance(fit.x)[0] * data.sigma_zero,
        reduced_chi_square=float(2.0 * fit.cost / free),
        stiffness_product=float(values[0]) * shell_object.thickness_m**2.5,
        solid_modulus=solid,
        solid_sigma=float(np.hypot(sigmas[0], bias_sigma)),
        statement=_statement(shell_object, values, sigmas, correlation, excess),
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
    gauge = curve.shell_object.gas.gauge_pressure_pa
    return found, found.zero_force + curve.force(large.displacement, float(found.values[0]), gauge)


def with_thickness(found: Identified, fit: ThicknessFit, exponent: float) -> Identified:
    """What forces and dents say together.

    `found` was identified at the thickness of `fit`; forces fix E h^m, m the `exponent`, and say
    next to nothing else of the thickness.
    """
    young, sigma_young = float(found.values[0]), float(found.sigma[0])
    by_thickness = exponent * young * fit.sigma / fit.thickness
    sigma = float(np.hypot(sigma_young, by_thickness))
    together = -by_thickness / sigma
    relative = fit.sigma / fit.thickness
    verdict = 'are separable by these scans'
    if relative > SEPARABLE_SIGMA:
        verdict = 'are NOT separable by these scans: add denser scans of deeper dents'
    excess = 2.0 * (fit.solid_thickness / fit.thickness - 1.0)
    statement = [
        f'Modulus and thickness {verdict} (correlation {together:+.3f}, thickness known to '
        f'{100 * relative:.1f} %); by force and displacement alone only E h^2.5 is fixed.'
    ]
    if excess:
        statement.append(
            'A thin-shell fit of a solid wall gives E h^2.5 and h low by up to '
            f'{100 * excess / (1.0 + excess):.0f} % each; they are right for predictions by this '
            'model, the solid values are those of the material.'
        )
    solid = found.solid_modulus * (fit.thickness / fit.solid_thickness) ** exponent
    solid_relative = np.hypot(
        found.solid_sigma / found.solid_modulus, exponent * fit.solid_sigma / fit.solid_thickness
    )
    return replace(
        found,
        names=(found.names[0], 'thickness_m'),
        values=np.array([young, fit.thickness]),
        sigma=np.array([sigma, fit.sigma]),
        correlation=np.array([[1.0, together], [together, 1.0]]),
        solid_modulus=solid,
        solid_sigma=float(solid * solid_relative),
        statement=tuple(statement),
    )


def thickness_sensitivity(curve: ForceCurve, data: SqueezeData) -> float:
    """Exponent m in F ~ E h^m over the data's range: how modulus and thickness trade off."""
    shell_object = curve.shell_object
    h = shell_object.thickness_m
    without = with_material(shell_object, gas_kind='none')
    forces = [
        ForceCurve(with_material(without, thickness=factor * h), None, curve.theory).force(
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
    shell_object: ShellObject, values: Array, sigma: Array, correlation: Array, excess: float
) -> tuple[str, ...]:
    found = [
        'Modulus and thickness are not separable by forces and displacements: with another '
        f'thickness h the same curve gives about E times '
        f'({shell_object.thickness_m * 1e3:g} mm / h)^2.5: what is fixed is E h^2.5.'
    ]
    if excess:
        found.append(
            f'A thin-shell fit of a solid wall gives E low by up to '
            f'{100 * excess / (1.0 + excess):.0f} % at this '
            'thickness over radius; it is the right modulus for predictions by this model, the '
            'solid modulus is that of the material.'
        )
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


def squeeze_data(
    table: Array,
    sigma_force: float,
    sigma_displacement: float,
    sigma_zero: float = 0.0,
    sigma_gain: float = 0.0,
) -> SqueezeData:
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
        sigma_zero,
        sigma_gain,
    )
