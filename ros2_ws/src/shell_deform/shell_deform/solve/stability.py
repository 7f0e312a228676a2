# SPDX-License-Identifier: Apache-2.0
"""How far a state is from snapping: the smallest stiffness of the motions that its controls allow.

At a limit or bifurcation point some motion meets no stiffness. Its stiffness falls to zero on the
way there, which an unloaded shell's does not, so their ratio is the margin. It comes from inverse
iteration (Lanczos) through the bordered system; the number of negative modes, which iteration
alone cannot promise, from the inertia of the factorisation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.linalg as sla
from numpy.typing import NDArray

from shell_deform.model import ShellModel
from shell_deform.solve.borders import Borders, borders, negative_directions
from shell_deform.solve.equilibrium import Equilibrium, LoadCase
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

TOLERANCE = 1e-4


@dataclass(frozen=True)
class SnapMargin:
    """Nearness of a state to snapping, under the controls of its load case.

    Attributes:
        margin: smallest stiffness here over that of the undeformed shell: 1 unloaded, 0 at the
            snap, negative beyond it.
        stiffness: of the softest motion [N/m]: twice its energy per squared root-mean-square
            displacement over the surface.
        rest_stiffness: the same of the undeformed shell [N/m]; pass it on to save its solution.
        negative_modes: directions of negative stiffness; 0 for a stable state.
        mode: (n, 3) the softest motion of the control points, at a root-mean-square of one.
    """

    margin: float
    stiffness: float
    rest_stiffness: float
    negative_modes: int
    mode: Array


def snap_margin(
    solver: EquilibriumSolver,
    case: LoadCase,
    state: Equilibrium,
    rest_stiffness: float | None = None,
) -> SnapMargin:
    """Margin to snap of `state` while the controls of `case` hold.

    Contacts whose displacement is prescribed keep the mean motion of their patch; forced ones give
    way. `rest_stiffness` [N/m]: from an earlier margin with the same contacts and controls.
    """
    case.refuse_pads('the margin to snap')
    solver.take(solver.model.on_contacts(case.contacts))
    bordering = symmetric(borders(solver.model, case))
    if rest_stiffness is None:
        rest_stiffness = smallest_stiffness(solver, bordering, solver.model.start)[0]
    stiffness, mode, negative = smallest_stiffness(solver, bordering, solver.met(state).unknowns)
    return SnapMargin(stiffness / rest_stiffness, stiffness, rest_stiffness, negative, mode)


def symmetric(bordering: Borders) -> Borders:
    """Borders whose driven contacts keep what their force works on, so that inertia counts."""
    return replace(bordering, measure=-bordering.push)


def smallest_stiffness(
    solver: EquilibriumSolver, bordering: Borders, positions: Array
) -> tuple[float, Array, int]:
    """Stiffness [N/m] nearest to zero at the unknowns `positions`, the motion (n, 3) of
    the control points there, and the number of negative modes.

    `bordering` must be symmetric. A state beyond the snap has a negative one.
    """
    model = solver.model
    tangent = model.tangent(positions)
    system = solver.system(tangent, bordering)
    weight = np.zeros(3 * len(model.start))
    weight[: 3 * len(model.rest)] = np.repeat(np.sqrt(surface_shares(model)), 3)

    def flexibility(x: Array) -> Array:
        return weight * system.solve(weight * x.reshape(-1), refinements=0)[0]

    size = len(weight)
    operator = sla.LinearOperator((size, size), matvec=flexibility, dtype=np.float64)
    start = weight * np.cos(np.arange(1.0, size + 1.0))
    values, vectors = sla.eigsh(operator, k=1, which='LM', v0=start, tol=TOLERANCE)
    stiffness = 1.0 / float(values[0])
    mode = stiffness * system.solve(weight * vectors[:, 0], refinements=0)[0]
    return (
        stiffness,
        mode.reshape(-1, 3)[: len(model.rest)],
        negative_directions(system, bordering),
    )


def surface_shares(model: ShellModel) -> Array:
    """(n,) share of the surface that follows each control point; sum 1."""
    shell = model.shell
    shares = np.asarray(shell.value_matrix().T @ shell.weights) / shell.area
    return np.maximum(shares, 0.0)
