# SPDX-License-Identifier: Apache-2.0
"""One shell under every theory: the same contacts and loads, solved offline.

The thin walls share a mesh; the thick one has a finer one under its pins.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grasp_replay.errors import BagError
from grasp_replay.holds import HeldContacts
from scan_compare.deformed_surface import DeformedSurface, surface_of_outer_face
from scan_compare.dent import Contacts
from shell_deform.assemble.stamps import WallError
from shell_deform.building import build_model, fitting_theory
from shell_deform.contact.finger_bodies import FingerBodies
from shell_deform.contact.loads import ContactPatch
from shell_deform.identify.force_curve import modulus_where
from shell_deform.live.background.contact_tracking import ContactTracker
from shell_deform.model import ShellModel
from shell_deform.objects import ObjectError, ShellObject, load_object
from shell_deform.solve.equilibrium import Equilibrium, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import THICK

Array = NDArray[np.float64]

THIN = ('linear', 'paper', 'koiter')
THEORIES = (*THIN, THICK)
# Relative accuracy of a fitted modulus.
FIT_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Solved:
    """A load case carried by one theory; `surface` is None where it could not be.

    `state` is None where the theory has no model of the object, `message` says why.
    """

    state: Equilibrium | None
    surface: DeformedSurface | None
    message: str = ''


class TheorySet:
    """A shell object, meshed finely where it is touched, ready to be solved by every theory."""

    def __init__(
        self, shell: ShellObject, models: dict[str, ShellModel], without: str = ''
    ) -> None:
        """`without`: why there is no thick wall among the `models`."""
        self.shell = shell
        self.models = models
        self.without = without
        self.pins_slide = False
        """Whether nothing holds what fingers press sideways, since their pins do not rub."""
        self._solvers = {name: EquilibriumSolver(model) for name, model in models.items()}

    @property
    def model(self) -> ShellModel:
        """The shell under the default theory."""
        return self.models['koiter']

    @cached_property
    def nearest_first(self) -> tuple[str, ...]:
        """The theories by how near the wall they are: first the one that `auto` takes for it.

        Then Koiter's, the paper's and the linear one; a thick wall comes last where a thin one is
        as good, since it is less often carried.
        """
        first, _ = fitting_theory(self.shell, self.model)
        return tuple(sorted((*reversed(THIN), THICK), key=lambda name: name != first))

    def with_young(self, young_pa: float) -> TheorySet:
        """The same thin walls with another modulus; they are proportional to it."""
        factor = young_pa / self.shell.young_modulus_pa
        wall = self.model.shell.stiffened(factor)
        models = {
            name: replace(model, shell=wall)
            for name, model in self.models.items()
            if name != THICK
        }
        solid = self.shell.modulus(THICK)
        changed = replace(self.shell, young_modulus_pa=young_pa, solid_young_modulus_pa=solid)
        return self._changed(changed, models)

    def with_solid_young(self, young_pa: float) -> TheorySet:
        """The same thick wall with another modulus."""
        thick = self.models[THICK]
        wall = thick.shell.stiffened(young_pa / self.shell.modulus(THICK))
        changed = replace(self.shell, solid_young_modulus_pa=young_pa)
        return self._changed(changed, {THICK: replace(thick, shell=wall)})

    def _changed(self, shell: ShellObject, models: dict[str, ShellModel]) -> TheorySet:
        found = TheorySet(shell, self.models | models, self.without)
        found.pins_slide = self.pins_slide
        return found

    def tracker(self) -> ContactTracker:
        """What lays contacts on the shell at rest."""
        return ContactTracker(self.model, self.model.rest, slides=self.pins_slide)

    def patches(self, contacts: HeldContacts) -> tuple[ContactPatch, ...]:
        """The patches that the fingers press, laid on the shell at rest."""
        tracker = self.tracker()
        tracker.update(contacts.touches(), self.model.rest)
        return tracker.patches

    def solve(
        self,
        theory: str,
        patches: tuple[ContactPatch, ...],
        push: Array,
        start: Equilibrium | None = None,
    ) -> Solved:
        """The shell under pushes (k,) [N] along the axes of the patches.

        From `start`, and from rest where that leads nowhere: the fingers may press elsewhere now.
        """
        if theory not in self.models:
            return Solved(None, None, self.without)
        found = self._solve(theory, patches, push, start)
        if found.surface is None and start is not None:
            return self._solve(theory, patches, push, None)
        return found

    def _solve(
        self,
        theory: str,
        patches: tuple[ContactPatch, ...],
        push: Array,
        start: Equilibrium | None,
    ) -> Solved:
        solver, h = self._solvers[theory], self.shell.thickness_m
        model = solver.model
        if theory == THICK:
            patches = tuple(
                replace(model.contact(p.point, p.radius, p.axis), slides=p.slides) for p in patches
            )
        try:
            state = solver.solve(forced(patches, push), start)
        except WallError as error:
            # Two pins on one triangle, or one between the points of the mesh.
            return Solved(None, None, str(error))
        if not state.converged:
            return Solved(state, None, state.message)
        if theory != THICK:
            return Solved(state, self.deformed(state.positions))
        rest, face = (
            solver.model.shell.outer_face(unknowns)
            for unknowns in (solver.model.start, state.unknowns)
        )
        return Solved(state, surface_of_outer_face(model.surface, rest, face, h))

    def deformed(self, positions: Array) -> DeformedSurface:
        """The surface of a thin wall that a scan is compared with."""
        model = self.model
        return DeformedSurface(model.surface, model.rest, positions, self.shell.thickness_m)

    def contacts_at_rest(self, patches: tuple[ContactPatch, ...]) -> Contacts:
        """Where the patches lie on the outer face at rest."""
        half = 0.5 * self.shell.thickness_m
        axes = np.stack([patch.axis for patch in patches])
        points = np.stack([patch.point for patch in patches]) - half * axes
        return Contacts(points, axes, np.array([patch.radius for patch in patches]))

    def fit_young(
        self,
        patches: tuple[ContactPatch, ...],
        push: Array,
        displacement_m: float,
        theory: str = 'koiter',
    ) -> float:
        """Young's modulus at which a theory moves the contacts by `displacement_m` [m].

        The displacement is the mean of the contact centres, which does not depend on where the
        object is held to be. Raises BagError when no modulus does.
        """

        changed = self.with_solid_young if theory == THICK else self.with_young

        last: Equilibrium | None = None

        def error(young: float) -> float | None:
            nonlocal last
            shell = changed(young)
            solved = shell.solve(theory, patches, push, last)
            if solved.surface is None or solved.state is None:
                return None
            # The next modulus is near this one: its shape is near this one's, too.
            last = replace(solved.state, history=())
            found = float(np.mean(solved.state.displacement))
            return float(np.log(displacement_m / found)) if found > 0.0 else None

        young = modulus_where(error, self.shell.modulus(theory), FIT_TOLERANCE)
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
    thick: bool = True,
    bodies: FingerBodies | None = None,
) -> TheorySet:
    """An object by name or file, meshed finely at `refine_at` (k, 3) [m]; raises BagError.

    For contacts of `refine_radius` [m], or for `bodies` of fingers. `changes` replaces numbers of
    the object: young_modulus_pa, thickness_m, poisson_ratio or control_vertices.
    """
    try:
        shell = load_object(name_or_file)
        if changes:
            numbers: dict[str, float | int] = dict(changes)
            if 'control_vertices' in numbers:
                numbers['control_vertices'] = int(numbers['control_vertices'])
            shell = replace(shell, **numbers)  # type: ignore[arg-type]
            if 'young_modulus_pa' in changes:
                shell = replace(shell, solid_young_modulus_pa=None)
        if bodies is not None and bodies.files and refine_at is not None:
            shell, refine_at, refine_radius = bodies.touching(shell, refine_at), None, None
        koiter = build_model(shell, 'koiter', None, refine_at, refine_radius)
    except ObjectError as error:
        raise BagError(str(error)) from error
    models = {name: koiter.with_theory(name) for name in THIN}
    if not thick:
        return TheorySet(shell, models, 'not asked for')
    try:
        models[THICK] = build_model(shell, THICK, None, refine_at, refine_radius, True)
    except WallError as error:
        return TheorySet(shell, models, str(error))
    return TheorySet(shell, models)
