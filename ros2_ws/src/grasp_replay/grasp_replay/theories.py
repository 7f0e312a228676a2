# SPDX-License-Identifier: Apache-2.0
"""One shell under the three theories: the same mesh, contacts and loads, solved offline."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp_replay.errors import BagError
from grasp_replay.holds import HeldContacts
from scan_compare.deformed_surface import DeformedSurface
from scan_compare.dent import Contacts
from shell_deform.building import build_model
from shell_deform.contact.loads import ContactPatch
from shell_deform.identify.force_curve import modulus_where
from shell_deform.live.background.contact_tracking import ContactTracker
from shell_deform.model import ShellModel
from shell_deform.objects import ObjectError, ShellObject, load_object
from shell_deform.solve.equilibrium import Equilibrium, forced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

THEORIES = ('linear', 'paper', 'koiter')
# Relative accuracy of a fitted modulus.
FIT_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Solved:
    """A load case carried by one theory; `surface` is None where it could not be."""

    state: Equilibrium
    surface: DeformedSurface | None


class TheorySet:
    """A shell object, meshed finely where it is touched, ready to be solved by every theory."""

    def __init__(self, shell: ShellObject, models: dict[str, ShellModel]) -> None:
        self.shell = shell
        self.models = models
        self._solvers = {name: EquilibriumSolver(model) for name, model in models.items()}

    @property
    def model(self) -> ShellModel:
        """The shell under the default theory."""
        return self.models['koiter']

    def with_young(self, young_pa: float) -> TheorySet:
        """The same mesh with another modulus; the wall is proportional to it."""
        factor = young_pa / self.shell.young_modulus_pa
        wall = self.model.shell.stiffened(factor)
        return TheorySet(
            replace(self.shell, young_modulus_pa=young_pa),
            {name: replace(model, shell=wall) for name, model in self.models.items()},
        )

    def patches(self, contacts: HeldContacts) -> tuple[ContactPatch, ...]:
        """The patches that the fingers press, laid on the shell at rest."""
        tracker = ContactTracker(self.model, self.model.rest)
        tracker.update(contacts.touches(), self.model.rest)
        return tracker.patches

    def solve(
        self,
        theory: str,
        patches: tuple[ContactPatch, ...],
        push: Array,
        start: Equilibrium | None = None,
    ) -> Solved:
        """The shell under pushes (k,) [N] along the axes of the patches."""
        state = self._solvers[theory].solve(forced(patches, push), start)
        if not state.converged:
            return Solved(state, None)
        return Solved(state, self.deformed(state.positions))

    def deformed(self, positions: Array) -> DeformedSurface:
        """The surface that a scan is compared with."""
        model = self.model
        return DeformedSurface(model.surface, model.rest, positions, self.shell.thickness_m)

    def contacts_at_rest(self, patches: tuple[ContactPatch, ...]) -> Contacts:
        """Where the patches lie on the outer face at rest."""
        half = 0.5 * self.shell.thickness_m
        axes = np.stack([patch.axis for patch in patches])
        points = np.stack([patch.point for patch in patches]) - half * axes
        return Contacts(points, axes, np.array([patch.radius for patch in patches]))

    def fit_young(
        self, patches: tuple[ContactPatch, ...], push: Array, displacement_m: float
    ) -> float:
        """Young's modulus at which koiter theory moves the contacts by `displacement_m` [m].

        The displacement is the mean of the contact centres, which does not depend on where the
        object is held to be. Raises BagError when no modulus does.
        """

        def error(young: float) -> float | None:
            solved = self.with_young(young).solve('koiter', patches, push)
            found = float(np.mean(solved.state.displacement))
            if solved.surface is None or not found > 0.0:
                return None
            return float(np.log(displacement_m / found))

        young = modulus_where(error, self.shell.young_modulus_pa, FIT_TOLERANCE)
        if young is not None:
            return young
        raise BagError(
            f"{self.shell.name}: no Young's modulus moves the contacts by "
            f'{1e3 * displacement_m:.3f} mm under {np.round(push, 3).tolist()} N'
        )


def theory_set(
    name_or_file: str,
    refine_at: Array | None = None,
    refine_radius: float | None = None,
    changes: dict[str, float] | None = None,
) -> TheorySet:
    """An object by name or file, meshed finely at `refine_at` (k, 3) [m]; raises BagError.

    `changes` replaces numbers of the object: young_modulus_pa, thickness_m, poisson_ratio or
    control_vertices.
    """
    try:
        shell = load_object(name_or_file)
        if changes:
            numbers: dict[str, float | int] = dict(changes)
            if 'control_vertices' in numbers:
                numbers['control_vertices'] = int(numbers['control_vertices'])
            shell = replace(shell, **numbers)  # type: ignore[arg-type]
        koiter = build_model(shell, refine_at=refine_at, refine_radius=refine_radius)
    except ObjectError as error:
        raise BagError(str(error)) from error
    return TheorySet(shell, {name: koiter.with_theory(name) for name in THEORIES})
