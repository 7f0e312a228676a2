# SPDX-License-Identifier: Apache-2.0
"""The paper's own minimiser: conjugate gradients from its initial displacement field.

Section IV of the paper: near every contact the displacement is at first linear in the distance
from it and proportional to its force; the radius of the deformed area is found by minimising the
potential energy, then conjugate gradients refine all control points until the gradient vanishes.
Kept for comparison: Newton's method (`newton.py`) reaches the same state sooner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.solve.borders import borders
from shell_deform.solve.equilibrium import LoadCase, LoadCaseError

Array = NDArray[np.float64]

# Radius of the deformed area is looked for between these multiples of sqrt(R h).
RADIUS_RANGE = (0.5, 6.0)


@dataclass(frozen=True)
class Minimum:
    """What the minimiser found.

    Attributes:
        converged: whether the gradient fell below its tolerance. message: the minimiser's words.
        positions: (n, 3) control points [m]. displacement: (k,) of each contact centre [m].
        energy: strain and gas energy [J]. residual: unbalanced nodal force over the loads [-].
        iterations: conjugate directions taken. evaluations: gradients computed.
        radius: of the initial field [m].
    """

    converged: bool
    message: str
    positions: Array
    displacement: Array
    energy: float
    residual: float
    iterations: int
    evaluations: int
    radius: float


def minimise(
    model: ShellModel, case: LoadCase, tolerance: float = 1e-5, iterations: int = 20000
) -> Minimum:
    """Minimum of the potential energy under the forces of `case`, in the paper's way.

    Supports and held contacts are kept exactly, by projection: stiff springs would slow conjugate
    gradients down without end. `tolerance`: residual force over the loads.
    Raises LoadCaseError where a displacement is prescribed or nothing pushes.
    """
    if np.any(case.driven) or not np.any(case.force):
        raise LoadCaseError('conjugate gradients need forces: prescribe force, not displacement')
    case.refuse_pads('the conjugate-gradient minimiser')
    bordering = borders(model, case)
    rows = bordering.held
    if model.held is not None:
        rows = np.concatenate([rows, model.held.dense(len(model.rest))], axis=1)
        model = model.with_theory(model.theory, supports=None, grips=())
    basis = la.orth(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), rcond=1e-9)
    load = bordering.push @ case.force + bordering.dead
    wall = float(model.shell.thickness.max())
    scale = float(np.linalg.norm(load))

    def allowed(x: Array) -> Array:
        return x - basis @ (basis.T @ x)

    def potential(x: Array) -> tuple[float, Array]:
        moved = wall * allowed(x)
        energy, gradient = model.gradient(model.rest + moved.reshape(-1, 3))
        return (energy - float(load @ moved)) / (scale * wall), allowed(gradient - load) / scale

    def along(radius: float) -> Array:
        return initial_field(model, case, radius).reshape(-1) / wall

    span = [factor * _bending_length(model, case.contacts) for factor in RADIUS_RANGE]
    radius = float(
        minimize_scalar(
            lambda r: potential(along(r))[0],
            bounds=span,
            method='bounded',
            options={'xatol': 1e-2 * span[0]},
        ).x
    )
    found = minimize(
        potential,
        allowed(along(radius)),
        jac=True,
        method='CG',
        options={'gtol': tolerance, 'norm': 2, 'maxiter': iterations},
    )
    moved = wall * allowed(found.x)
    energy, _ = model.gradient(model.rest + moved.reshape(-1, 3))
    residual = float(np.linalg.norm(found.jac))
    return Minimum(
        converged=residual <= 10.0 * tolerance,
        message=str(found.message),
        positions=model.rest + moved.reshape(-1, 3),
        displacement=bordering.measure.T @ moved,
        energy=energy,
        residual=residual,
        iterations=int(found.nit),
        evaluations=int(found.nfev),
        radius=radius,
    )


def initial_field(model: ShellModel, case: LoadCase, radius: float) -> Array:
    """Displacements (n, 3) [m]: cones of `radius` [m] about the contacts, high as their force.

    A force F is given the depth F R / (8 sqrt(E h D)) that linear theory has for a point force on
    a sphere (E. Reissner 1946).
    """
    field = np.zeros_like(model.rest)
    for contact, force in zip(case.contacts, case.force, strict=True):
        depth = force * _compliance(model, contact)
        distance = np.linalg.norm(model.rest - contact.point, axis=1)
        field += (depth * np.maximum(1.0 - distance / radius, 0.0))[:, None] * contact.axis
    return field


def _at(model: ShellModel, contact: ContactPatch) -> tuple[float, int]:
    """Radius of curvature [m] and nearest quadrature point of a contact."""
    points = model.shell.value_matrix() @ model.rest
    near = int(np.argmin(np.linalg.norm(points - contact.point, axis=1)))
    b_11, _, b_22 = model.shell.reference.curvature[near]
    return 2.0 / max(abs(float(b_11 + b_22)), 1e-9), near


def _compliance(model: ShellModel, contact: ContactPatch) -> float:
    radius, near = _at(model, contact)
    stretching, bending = model.shell.membrane[near, 0, 0], model.shell.bending[near, 0, 0]
    ratio = model.shell.membrane[near, 0, 1] / stretching
    return radius / (8.0 * float(np.sqrt((1.0 - ratio**2) * stretching * bending)))


def _bending_length(model: ShellModel, contacts: tuple[ContactPatch, ...]) -> float:
    radius, near = _at(model, contacts[0])
    return float(np.sqrt(radius * model.shell.thickness[near]))
