# SPDX-License-Identifier: Apache-2.0
"""(h) The can's row: its support is the unknown, and no verdict between theories follows.

The paper states no support. Straight edges that rest on springs along the ground go from sliding
to hinged; under either theory some spring gives the published displacement.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from shell_deform.building import boundary_vertices, build_model, object_contacts
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject, Support, load_object
from shell_deform.solve.equilibrium import forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import SupportRows, hold_position, joined

Array = NDArray[np.float64]

CAN = 'half_soda_can'
THEORIES = ('linear', 'koiter')
X, Y, Z = np.eye(3)
SOFTEST, STIFFEST = 3e2, 3e5
"""Springs along the ground that are tried [N/m per m of edge]."""

EDGE = 'straight'
SLIDING = 'straight edges slide outward, ends free'
NAMED = {
    'straight edges hinged, ends free': (Support('hinged', EDGE),),
    'straight edges clamped, ends free': (Support('clamped', EDGE),),
    'straight edges hinged, ends rigid diaphragms': (
        Support('hinged', EDGE),
        Support('diaphragm', 'ends'),
    ),
}


def can_rows(row: dict[str, float], control_vertices: int | None = None) -> dict[str, Any]:
    """Depth under the published force for several supports, and the spring that meets it."""
    can = load_object(CAN)
    force = row['force_n']
    supports = []
    for name, held in NAMED.items():
        model = build_model(replace(can, supports=held), 'koiter', control_vertices)
        supports.append({'support': name, **_depths(can, model, force)})
    bare = build_model(replace(can, supports=()), 'koiter', control_vertices)
    supports.append({'support': SLIDING, **_depths(can, _on_springs(bare, 0.0), force)})
    target = row['measured_max_displacement_m']
    return {
        'force_n': force,
        'displacement_m': target,
        'supports': supports,
        'spring_n_per_m2': {
            theory: _spring(can, bare.with_theory(theory), force, target) for theory in THEORIES
        },
    }


def _on_springs(bare: ShellModel, spring: float) -> ShellModel:
    """Straight edges on the ground, held along it by a spring [N/m per m]; nothing else."""
    points = bare.surface.limit_positions(bare.rest)
    rim, _ = boundary_vertices(bare.shell.mesh)
    edge = rim[points[rim, 1] < points[rim, 1].min() + 1e-6]
    parts = [hold_position(bare.shell, edge, Y[None])]
    # nothing else prevents sliding along the axis of the can
    middle = edge[np.argsort(np.abs(points[edge, 2]))[:2]]
    parts.append(hold_position(bare.shell, middle, Z[None]))
    if spring:
        sideways = hold_position(bare.shell, edge, X[None])
        share = spring * float(np.ptp(points[edge, 2])) / (0.5 * len(edge))
        parts.append(replace(sideways, stiffness=np.full(len(sideways.stiffness), share)))
    rows: SupportRows | None = joined(parts)
    return replace(bare, supports=rows)


def _depth(can: ShellObject, model: ShellModel, force: float) -> float | None:
    state = EquilibriumSolver(model).solve(forced(object_contacts(can, model), [force]))
    return float(state.displacement[0]) if state.converged else None


def _depths(can: ShellObject, model: ShellModel, force: float) -> dict[str, float | None]:
    return {f'{theory}_m': _depth(can, model.with_theory(theory), force) for theory in THEORIES}


def _spring(can: ShellObject, bare: ShellModel, force: float, target: float) -> float | None:
    """Spring [N/m per m] with which the force gives the target depth, None outside the range."""

    def excess(logarithm: float) -> float:
        found = _depth(can, _on_springs(bare, float(np.exp(logarithm))), force)
        return np.inf if found is None else float(np.log(found / target))

    low, high = np.log(SOFTEST), np.log(STIFFEST)
    while high - low > 1e-2 and not np.isfinite(excess(low)):
        low = 0.5 * (low + high)
    if excess(low) * excess(high) > 0.0:
        return None
    return float(np.exp(brentq(excess, low, high, xtol=1e-2)))
