# SPDX-License-Identifier: Apache-2.0
"""The ball's rows of Table I: one modulus against four forces and displacements.

Every number of a nonlinear theory stands beside that of an independent axisymmetric solver
(`shell_deform.verification.axisymmetric`) with the same modulus.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from shell_deform.building import with_material
from shell_deform.identify.force_curve import ForceCurve, IdentificationError
from shell_deform.objects import ShellObject, load_object
from shell_deform.theory.gas import Gas
from shell_deform.verification.axisymmetric import (
    AxisymmetricError,
    PinnedSphere,
    forces_at,
    pole_displacements,
)

Array = NDArray[np.float64]

BALL, PRINTED = 'tennis_ball', 'tennis_ball_as_printed'
PINS_M = (0.5e-3, 1e-3, 2e-3, 3e-3)
# The paper's measures fold under smaller pins when the mesh is fine.
MEASURE_PIN_M = 2e-3
MEASURES = ('koiter', 'paper_restored', 'paper')
GAUGE_PRESSURES_PA = (0.0, 2e3, 5e3, 10e3, 20e3, 40e3, 80e3)


@dataclass(frozen=True)
class Rows:
    """Published rows of the ball: forces (r,) [N], displacements (r,) [m], their error [m]."""

    force: Array
    displacement: Array
    accuracy: float


class Ball:
    """The squeezed ball with every pin radius and strain measure, meshed once per radius."""

    def __init__(self, name: str = BALL, control_vertices: int | None = None) -> None:
        self.shell: ShellObject = load_object(name)
        self._vertices = control_vertices
        self._curves: dict[tuple[float, str, str], ForceCurve] = {}

    @property
    def pin_radius(self) -> float:
        """Radius of the object's own pins [m]."""
        return self.shell.contacts[0].radius_m

    def curve(
        self, measure: str = 'koiter', pin: float | None = None, gas: str = ''
    ) -> ForceCurve:
        """Force over displacement; `gas` '' is the object's own."""
        pin = self.pin_radius if pin is None else pin
        gas = gas or self.shell.gas.kind
        key = (pin, gas, measure)
        if key not in self._curves:
            base = self._curves.get((pin, gas, 'koiter'))
            if base is None:
                shell = with_material(self.shell, gas_kind=gas)  # type: ignore[arg-type]
                base = ForceCurve(shell, pin, 'koiter', self._vertices)
                self._curves[pin, gas, 'koiter'] = base
            self._curves[key] = base if measure == 'koiter' else base.with_theory(measure)
        return self._curves[key]

    def second_opinion(
        self, measure: str, young: float, pin: float, gas: str, gauge: float
    ) -> PinnedSphere:
        """The same ball for the axisymmetric solver."""
        shell = self.shell
        outer = 0.5 * shell.surface.outer_diameter_m  # type: ignore[union-attr]
        return PinnedSphere(
            outer - 0.5 * shell.thickness_m,
            shell.thickness_m,
            young,
            shell.poisson_ratio,
            pin,
            measure,
            Gas(gas, gauge if gas == 'sealed' else 0.0, shell.gas.ambient_pa),
        )


def as_printed(rows: Rows, ball: Ball) -> dict[str, Any]:
    """(a) The printed modulus: the force that it carries at every published displacement."""
    shell = ball.shell
    curve = ball.curve()
    carried = curve.force(rows.displacement, shell.young_modulus_pa)
    sphere = ball.second_opinion('koiter', shell.young_modulus_pa, ball.pin_radius, 'none', 0.0)
    linear = ball.curve('linear').displacement(rows.force[:1], shell.young_modulus_pa)
    return {
        'young_modulus_pa': shell.young_modulus_pa,
        'gas': shell.gas.kind,
        'pin_radius_m': ball.pin_radius,
        'force_n': carried.tolist(),
        'independent_force_n': forces_at(sphere, rows.displacement).tolist(),
        'published_over_predicted': (rows.force / carried).tolist(),
        'linear_displacement_of_row_one_m': float(linear[0]),
    }


def from_row_one(
    rows: Rows,
    ball: Ball,
    measure: str = 'koiter',
    pin: float | None = None,
    gas: str = '',
    gauge: float = 0.0,
    band: bool = False,
) -> dict[str, Any]:
    """The modulus of the first row alone, and what it predicts for the others.

    With `band` also for the first displacement less and plus the scanner's accuracy.
    """
    pin = ball.pin_radius if pin is None else pin
    gas = gas or ball.shell.gas.kind
    curve = ball.curve(measure, pin, gas)
    first, force = float(rows.displacement[0]), float(rows.force[0])
    found = {
        'theory': measure,
        'pin_radius_m': pin,
        'gas': gas,
        'gauge_pressure_pa': gauge,
        **_predicted(rows, ball, curve, curve.modulus(force, first, gauge), gauge),
    }
    if band:
        found['band'] = [
            _predicted(rows, ball, curve, curve.modulus(force, at, gauge), gauge)
            for at in (first + rows.accuracy, first - rows.accuracy)
        ]
    return found


def from_all_rows(
    rows: Rows, ball: Ball, measure: str = 'koiter', gas: str = ''
) -> dict[str, Any]:
    """The modulus with the least squared difference of all displacements."""
    curve = ball.curve(measure, None, gas)
    start = curve.modulus(float(rows.force[0]), float(rows.displacement[0]))

    def difference(x: Array) -> Array:
        found = curve.displacement(rows.force, start * float(np.exp(x[0])))
        return 1e3 * (found - rows.displacement)

    best = least_squares(difference, [0.05], diff_step=1e-3, xtol=1e-6, ftol=1e-8)
    young = start * float(np.exp(best.x[0]))
    return {
        'theory': measure,
        'pin_radius_m': ball.pin_radius,
        'gas': gas or ball.shell.gas.kind,
        'gauge_pressure_pa': 0.0,
        **_predicted(rows, ball, curve, young, 0.0),
    }


def pressure_scan(rows: Rows, ball: Ball) -> list[dict[str, Any]]:
    """(e) The modulus of row one under several gauge pressures of the unloaded ball."""
    return [from_row_one(rows, ball, gas='sealed', gauge=gauge) for gauge in GAUGE_PRESSURES_PA]


def influences(rows: Rows, ball: Ball) -> list[dict[str, Any]]:
    """(f) The same under other pin radii, and by the other strain measures."""
    return [from_row_one(rows, ball, measure, pin) for pin in PINS_M for measure in MEASURES]


def _predicted(
    rows: Rows, ball: Ball, curve: ForceCurve, young: float, gauge: float
) -> dict[str, Any]:
    theory, gas = curve.theory, curve.shell_object.gas.kind
    try:
        found = curve.displacement(rows.force, young, gauge)
    except IdentificationError:
        found = np.full(len(rows.force), np.nan)
    result: dict[str, Any] = {
        'young_modulus_pa': young,
        'displacement_m': _numbers(found),
        'relative_error': _numbers(found / rows.displacement - 1.0),
        'rms_m': _number(float(np.sqrt(np.mean((found - rows.displacement) ** 2)))),
    }
    if theory in MEASURES:
        sphere = ball.second_opinion(theory, young, curve.pin_radius, gas, gauge)
        result['independent_displacement_m'] = _second(sphere, rows.force)
    return result


def _second(sphere: PinnedSphere, force: Array) -> list[float] | None:
    """None where a wall so soft folds under so small a pin: only a fine mesh sees it."""
    try:
        return [float(value) for value in pole_displacements(sphere, force)]
    except AxisymmetricError:
        return None


def _numbers(values: Array) -> list[float | None]:
    return [_number(float(value)) for value in values]


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
