# SPDX-License-Identifier: Apache-2.0
"""Experiments of other people: what they measured, how E is known, and what comes out here.

Only numbers that were read in the source count as measured. Felt, rate, hysteresis and friction of
the plates are in none of the answers. Nothing here is a goal: an experiment judges, or it tells
what is not known of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.building import build_model, object_contacts
from shell_deform.objects import ShellObject
from shell_deform.objects.shell_object import Contact, Ellipsoid, Gas, Sphere
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

# ITF acceptance test of a tennis ball: preload and load [N], band of the travel between [m].
PRELOAD_N, LOAD_N = 15.57, 95.64
BAND_M = (5.6e-3, 7.4e-3)
CORE_YOUNG_PA = 19.2e6
ITF = (
    'ITF Technical Booklet, test TB 03/01, by a calibration report; '
    'Tennis Warehouse University 2021'
)
FITTED = 'fitted once to the middle of the band: 60 x 3.5 mm core at 83 kPa, 19.2 MPa'


@dataclass(frozen=True)
class Experiment:
    """One measured number beside ours; `measured` as (lowest, highest), None where unreadable."""

    name: str
    quantity: str
    measured: tuple[float, float] | None
    ours: float
    young: str
    source: str
    remark: str

    @property
    def verdict(self) -> str:
        """Whether ours lies within what was measured; how far off a single number it is."""
        if self.measured is None:
            return 'no number to compare with'
        low, high = self.measured
        if low == high:
            return f'differs by {self.ours - low:+.2g}'
        return 'within' if low <= self.ours <= high else 'outside'

    def as_dict(self) -> dict[str, Any]:
        """All fields and the verdict, for JSON."""
        return asdict(self) | {'verdict': self.verdict}


def _pads(half: float, rim: float, axis: int = 2) -> tuple[Contact, ...]:
    places = []
    for end in (half, -half):
        at = [0.0, 0.0, 0.0]
        at[axis] = end
        places.append(Contact((at[0], at[1], at[2]), rim, 'pad'))
    return tuple(places)


def between_plates(thing: ShellObject, depths: Array, vertices: int) -> Array:
    """Force [N] of each plate at depths (n,) [m] of each; NaN from where none is found."""
    model = build_model(thing, control_vertices=vertices)
    contacts = object_contacts(thing, model)
    solver, found = EquilibriumSolver(model), np.full(len(depths), np.nan)
    state = solver.rest()
    for i, depth in enumerate(depths):
        state = solver.solve(displaced(contacts, [depth, depth]), state)
        if not state.converged:
            break
        found[i] = state.force[0]
    return found


def tennis_core(
    gas: Gas, young: float = CORE_YOUNG_PA, diameter: float = 0.060, wall: float = 3.5e-3
) -> ShellObject:
    """A rubber core between plates."""
    return ShellObject(
        'core', Sphere(diameter), wall, young, 0.49, gas=gas,
        contacts=_pads(0.5 * diameter, 0.3 * diameter),
    )  # fmt: skip


@cache
def forward_deformation(core: ShellObject, deepest: float = 6e-3, vertices: int = 500) -> float:
    """Travel [m] of both plates together from preload to load of the ITF test."""
    depths = np.linspace(deepest / 12, deepest, 12)
    force = between_plates(core, depths, vertices)
    known = np.isfinite(force)
    reached = np.interp([PRELOAD_N, LOAD_N], force[known], depths[known])
    return float(2.0 * (reached[1] - reached[0]))


def tennis_ball() -> Iterator[Experiment]:
    """The acceptance test of approved balls, their pressures, a puncture, and the paper's ball."""
    punctured = forward_deformation(tennis_core(Gas('open')))
    blown = forward_deformation(tennis_core(Gas('sealed', 83e3)))
    yield Experiment(
        'itf_forward_deformation', 'travel from 15.57 to 95.64 N at 83 kPa [m]', BAND_M,
        blown, FITTED, ITF, 'a fit: says only that such a core is possible',
    )  # fmt: skip
    for pressure in (41.5e3, 85.6e3):
        yield Experiment(
            'pressure_of_new_balls', f'the same at {1e-3 * pressure:g} kPa [m]', BAND_M,
            forward_deformation(tennis_core(Gas('sealed', pressure))), FITTED,
            '75 new balls by hypodermic gauge (hobby quality)',
            'all of them were sold as approved',
        )  # fmt: skip
    yield Experiment(
        'punctured_ball', 'change of stiffness without pressure', (-0.35, -0.35),
        blown / punctured - 1.0, FITTED,
        'The dynamic impact characteristics of tennis balls with tennis rackets, J. Sports Sci.',
        'theirs is dynamic, ours static; a softer core of the same band gives -37 %',
    )  # fmt: skip
    shipped = tennis_core(Gas('sealed', 0.0), 12.75e6, 0.065, 2.5e-3)
    yield Experiment(
        'shipped_tennis_ball', 'travel of the object tennis_ball [m]', BAND_M,
        forward_deformation(shipped, 9e-3), 'identified from the published row 1', ITF,
        "the paper's ball is about three times softer (E h^2) than an approved one",
    )  # fmt: skip


def table_tennis_ball() -> Iterator[Experiment]:
    """Celluloid, R 20 mm, h 0.4 mm: the modulus is known by tension of strips."""
    wall, young = 0.4e-3, 2.2e9
    ball = ShellObject(
        'table-tennis ball', Sphere(0.0404), wall, young, 0.35, gas=Gas('sealed', 0.0),
        contacts=_pads(0.0202, 0.015),
    )  # fmt: skip
    depths = wall * np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0])
    force = between_plates(ball, depths, 800)
    yield Experiment(
        'table_tennis_plates', 'R F / (E h^3) at two walls of depth', None,
        float(0.020 * force[-1] / (young * wall**3)), 'tension and bending of strips, 2.2 GPa',
        'Shorter, Smith, Coveney & Busfield, J. Mech. Mater. Struct. 5(5) (2010) 700',
        'the curve is drawn, not tabulated: its axes end at 14; it agrees with 2.2 GPa',
    )  # fmt: skip


def egg() -> Iterator[Experiment]:
    """A hen's egg end-on and sideways: the ratio needs no modulus."""
    length, width, wall = 0.057, 0.044, 0.36e-3
    travel = []
    for axis, half in ((2, 0.5 * length), (0, 0.5 * width)):
        shell = ShellObject(
            'egg', Ellipsoid((width, width, length)), wall, 32e9, 0.307,
            contacts=_pads(half, 0.012, axis),
        )  # fmt: skip
        depths = np.linspace(0.02e-3, 0.18e-3, 9)
        force = between_plates(shell, depths, 1200)
        known = np.isfinite(force)
        path = np.r_[0.0, depths[known]]
        upto = float(np.interp(45.0, np.r_[0.0, force[known]], path))
        fine = np.linspace(0.0, upto, 200)
        load = np.interp(fine, path, np.r_[0.0, force[known]])
        travel.append(float(np.sum(0.5 * (load[1:] + load[:-1]) * np.diff(fine))))
    yield Experiment(
        'egg_orientation', 'energy to 45 N, sideways over end-on', (1.30, 1.30),
        travel[1] / travel[0], 'not needed: a ratio',
        'Sutanto et al., Commun. Phys. 2025, doi 10.1038/s42005-025-02087-0',
        'their shapes were not readable: L/B 1.2 to 1.3 gives 1.44 to 1.69; compliance of the '
        'machine lowers theirs',
    )  # fmt: skip


EXPERIMENTS: tuple[Callable[[], Iterator[Experiment]], ...] = (
    tennis_ball,
    table_tennis_ball,
    egg,
)
