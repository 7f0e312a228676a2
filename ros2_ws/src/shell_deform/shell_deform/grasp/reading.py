# SPDX-License-Identifier: Apache-2.0
"""The grasp in an equilibrium of a shell: contacts, how they share loads out, what the wall bears.

What the held patches of a solved shell carry besides their pushes is the tangential force and spin
that the fingers must supply. No gauge sees them: they are values of the model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.thick import ThickShell
from shell_deform.contact.loads import ContactPatch
from shell_deform.grasp.contacts import UNIFORM_ARM, GraspContacts, contacts
from shell_deform.grasp.slip import Sharing, Slipping
from shell_deform.grasp.window import UNKNOWN
from shell_deform.model import ShellModel
from shell_deform.readout import principal, read_out, von_mises, wall_ratio
from shell_deform.solve.borders import borders
from shell_deform.solve.equilibrium import Equilibrium, displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import GRIP_TOLERANCE, free_rigid_modes
from shell_deform.surface.limit import surface_points
from shell_deform.surface.loop_basis import BasisRows, basis_rows
from shell_deform.theory.reference import sharpest_curvature

Array = NDArray[np.float64]

SMALL_LOAD = 1e-3
"""Wrench [N, N m] by which the turn of the normals is taken."""

HELD_ROWS = 3
"""Of a held patch: two lateral motions and the spin."""

NORMAL_SIGMA, NORMAL_SIGMA_THIN = 0.02, 0.6
"""Sigma of a deformed normal [rad], and of a thin theory as much more per h/R: fibres that do not
shear turn too far (3 degrees at R/h 12.5, `verification/solid_grasps.json`)."""

STRESS_SIGMA = 0.03
"""Relative sigma [-] of a resolved stress, by solids (`verification/solid_dents.json`)."""

LONGEST_EDGE, LONGEST_BENT, NARROWEST_PIN, DEEPEST_DENT = 1.25, 0.6, 1.5, 0.5
"""A stress under a pin is resolved up to this edge over its radius and over the bending length
sqrt(R h), from this radius over the wall thickness on, and up to this dent over the same."""


@dataclass(frozen=True)
class WallState:
    """What the wall bears most.

    Attributes:
        stress: largest von Mises stress at either face [Pa]. stress_at: (3,) where [m].
        strain: largest principal strain at either face [-]. strain_at: (3,) where [m].
        outer: whether the largest stress is at the outer face.
        unresolved: why the stress may be far from the truth, or empty.
    """

    stress: float
    stress_at: Array
    strain: float
    strain_at: Array
    outer: bool
    unresolved: str

    @property
    def doubt(self) -> float:
        """Relative sigma of the stress [-]; `UNKNOWN` where it is not resolved."""
        return UNKNOWN if self.unresolved else STRESS_SIGMA


@dataclass(frozen=True)
class Response:
    """What a wrench on the object does while all fingers stand still.

    Attributes:
        centre: (3,) centre of mass of the wall [m], origin of all wrenches.
        force: (k, 3, 6) change of the fingers' forces per unit wrench [N per N or N m].
        sharing: the same along and across the normals, which turn, too; None where the fingers
            let the object move as a body, and the forces then zero.
        compliance: (6, 6) motion of the object per wrench, see `stiffness`; None likewise.
        slipping: what is left of regions that slip; None where all contacts are pins.
    """

    centre: Array
    force: Array
    sharing: Sharing | None
    compliance: Array | None
    slipping: Slipping | None = None


@dataclass(frozen=True)
class OuterFeet:
    """The material points where patches touch, for any state of the shell.

    Attributes:
        rows: of the limit surface at the k feet. half_wall: (k,) [m].
        edge: (k,) longest edge [m] of the triangle that each lies in. bending: (k,) bending
            length sqrt(R h) there, R the smaller radius of curvature [m].
    """

    rows: BasisRows
    half_wall: Array
    edge: Array
    bending: Array

    def at(self, positions: Array) -> tuple[Array, Array]:
        """Points (k, 3) on the outer face [m] and inward normals (k, 3) at control points."""
        if not len(self.half_wall):
            return np.zeros((0, 3)), np.zeros((0, 3))
        found = surface_points(self.rows, positions)
        return found.position + self.half_wall[:, None] * found.normal, -found.normal


def outer_feet(model: ShellModel, patches: tuple[ContactPatch, ...]) -> OuterFeet:
    """The feet of the centres of patches on the undeformed shell."""
    at_rest = np.array([patch.point for patch in patches]).reshape(-1, 3)
    place = model.surface.closest_point(model.rest, at_rest)
    rest_points = model.shell.value_matrix() @ model.rest
    near = [int(np.argmin(np.linalg.norm(rest_points - point, axis=1))) for point in at_rest]
    rows = basis_rows(model.surface.mesh, place.triangle, place.parameters)
    corners = model.rest[model.surface.mesh.triangles[place.triangle]]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    wall = model.shell.thickness[near]
    sharpest = sharpest_curvature(*surface_points(rows, model.rest).curvatures())
    bending = np.sqrt(wall / np.maximum(sharpest, 1e-12))
    return OuterFeet(rows, 0.5 * wall, edges.max(axis=1, initial=0.0), bending)


def normal_sigma(model: ShellModel) -> float:
    """Sigma of the deformed normals [rad] under a model's theory."""
    if isinstance(model.shell, ThickShell):
        return NORMAL_SIGMA
    return float(np.hypot(NORMAL_SIGMA, NORMAL_SIGMA_THIN * wall_ratio(model)))


def read_contacts(
    model: ShellModel,
    patches: tuple[ContactPatch, ...],
    state: Equilibrium,
    friction: float,
    arm: float | None = None,
) -> GraspContacts:
    """The contacts of pins at an equilibrium whose patches were held.

    `arm` [m] of the spin torque for all; by default that of an even pressure over each patch.
    """
    point, normal = outer_feet(model, patches).at(state.positions)
    held = state.multipliers[: HELD_ROWS * len(patches)]
    found = held_contacts(patches, point, normal, state.force, held, friction)
    return found if arm is None else replace(found, arm=np.full(len(patches), arm))


def held_contacts(
    patches: tuple[ContactPatch, ...],
    point: Array,
    normal: Array,
    pushed: Array,
    multipliers: Array,
    friction: float,
) -> GraspContacts:
    """Pins at points (k, 3) with normals (k, 3) that push (k,) [N] and hold by multipliers."""
    count = len(patches)
    held = multipliers.reshape(count, HELD_ROWS)
    force = np.array(
        [
            finger_force(patch, pushed[i : i + 1], held[i, :, None])[:, 0]
            for i, patch in enumerate(patches)
        ]
    ).reshape(count, 3)
    radius = np.array([patch.radius for patch in patches])
    push = np.einsum('ki,ki->k', force, normal)
    return contacts(
        point, normal, push, friction, UNIFORM_ARM * radius, force, -held[:, 2] * radius
    )


def read_response(
    solver: EquilibriumSolver,
    patches: tuple[ContactPatch, ...],
    state: Equilibrium,
    grasp: GraspContacts,
) -> Response:
    """How the tangent at `state` shares out wrenches that act on the object as its weight does.

    `grasp`: the contacts there, whose normals turn under the load as well.
    """
    model = solver.model.on_contacts(patches)
    if model is not solver.model:
        solver = EquilibriumSolver(model)
    count = len(patches)
    centre, loads = body_loads(body_mass(model), state.positions)
    if not holds_still(model, patches, grasp):
        return unheld(centre, count)
    bordering = borders(model, displaced(patches, np.zeros(count)))
    system = solver.system(model.tangent(state.unknowns), bordering)
    # A thick wall has more unknowns than its control points.
    padded = np.concatenate([loads, np.zeros((model.start.size - len(loads), 6))])
    motion, border = system.solve(padded)
    motion = motion[: len(loads)]
    held = border[count : count + HELD_ROWS * count].reshape(count, HELD_ROWS, -1)
    answer = Answer(centre, loads, motion, border[:count], held)
    return answered(patches, outer_feet(model, patches), state.positions, grasp, answer)


def holds_still(
    model: ShellModel, patches: tuple[ContactPatch, ...], grasp: GraspContacts
) -> bool:
    """Whether the contacts that press, standing still, keep the object from moving as a body.

    One contact, or all in one place, let it rock: its stiffness there is that of round-off.
    """
    modes = model.free_modes[: model.rest.size]
    rows = [
        row.reshape(-1)
        for patch, presses in zip(patches, grasp.pressing, strict=True)
        if presses
        for row in (patch.displacement_row(), *(() if patch.slides else patch.held_rows()))
    ]
    held = np.array(rows).reshape(-1, len(modes)).T
    return not free_rigid_modes(modes, held, GRIP_TOLERANCE).shape[1]


def unheld(centre: Array, count: int) -> Response:
    """The response of `count` contacts that do not hold an object about `centre`."""
    return Response(centre, np.zeros((count, 3, 6)), None, None)


@dataclass(frozen=True)
class Answer:
    """What a shell between fingers that stand still does under unit wrenches about `centre`.

    Attributes:
        centre: (3,) [m]. loads: (3 n, 6) nodal forces of the wrenches. motion: (3 n, 6) of the
            control points. push: (k, 6) multipliers of the fingers' places.
        held: (k, 3, 6) of the rows that hold their patches.
    """

    centre: Array
    loads: Array
    motion: Array
    push: Array
    held: Array


def answered(
    patches: tuple[ContactPatch, ...],
    feet: OuterFeet,
    positions: Array,
    grasp: GraspContacts,
    answer: Answer,
) -> Response:
    """The response of a grasp at control points (n, 3), its normals turning under the load."""
    turned = np.stack(
        [feet.at(positions + SMALL_LOAD * column.reshape(-1, 3))[1] for column in answer.motion.T],
        axis=-1,
    )
    turns = (turned - grasp.normal[:, :, None]) / SMALL_LOAD
    force = np.stack(
        [finger_force(patch, answer.push[i], answer.held[i]) for i, patch in enumerate(patches)]
    )
    spin = np.stack([-answer.held[i, 2] * patch.radius for i, patch in enumerate(patches)])
    return Response(
        answer.centre, force, shared(grasp, force, spin, turns), answer.loads.T @ answer.motion
    )


def finger_force(patch: ContactPatch, push: Array, held: Array) -> Array:
    """Forces (3, w) of a finger on its patch from pushes (w,) and multipliers (3, w) of its rows.

    What keeps a curved patch from spinning has a resultant, too: its middle is not its centre.
    """
    rows = patch.held_rows().sum(axis=1)
    return np.asarray(np.outer(patch.axis, push) - rows.T @ held)


def body_mass(model: ShellModel) -> sp.csr_matrix:
    """(n, n) mass of the wall over its control points, all of it 1."""
    shell = model.shell
    mass = shell.weights * shell.thickness
    values = shell.value_matrix()
    return (values.T @ sp.diags(mass / mass.sum()) @ values).tocsr()


def body_loads(mass: sp.csr_matrix, positions: Array) -> tuple[Array, Array]:
    """Centre of mass (3,) [m] and nodal forces (3 n, 6) of unit force and moment about it.

    Spread over the `mass` (n, n) of the wall as the forces of a rigid motion's acceleration are;
    `positions` (n, 3) of the control points.
    """
    own = mass @ np.ones(len(positions))
    centre = own @ positions
    offset = positions - centre
    carried = mass @ offset
    moments = offset.T @ carried
    inertia = np.trace(moments) * np.eye(3) - moments
    turns = np.linalg.inv(inertia)
    nodal = np.zeros((len(positions), 3, 6))
    nodal[:, :, :3] = own[:, None, None] * np.eye(3)
    for axis in range(3):
        nodal[:, :, 3 + axis] = np.cross(turns[:, axis], carried)
    return centre, nodal.reshape(-1, 6)


@dataclass(frozen=True)
class WallReader:
    """Largest stress and strain at both faces of one shell under pins, state after state.

    Attributes:
        model, patches, feet: of the shell, its k pins and where they stand.
        under: (k, p) pressure of a unit push at each quadrature point [Pa/N], none of bodies.
    """

    model: ShellModel
    patches: tuple[ContactPatch, ...]
    feet: OuterFeet
    under: Array

    def at(self, unknowns: Array, force: Array, dent: Array) -> WallState:
        """The wall at all its unknowns, under pushes (k,) [N] that dent it by (k,) [m].

        Under a pin the outer face carries its pressure as well: von Mises stress does not change
        when the same pressure is taken off all three principal stresses.
        """
        found = read_out(self.model, unknowns)
        outer = found.outer_stress.copy()
        outer[:, :2] += (force @ self.under)[:, None]
        stress = np.stack([von_mises(outer), von_mises(found.inner_stress)])
        strain = np.stack(
            [
                np.abs(principal(face)).max(axis=1)
                for face in (found.outer_strain, found.inner_strain)
            ]
        )
        face, where = np.unravel_index(int(np.argmax(stress)), stress.shape)
        strained = int(np.argmax(strain.max(axis=0)))
        return WallState(
            float(stress[face, where]),
            found.points[where],
            float(strain.max()),
            found.points[strained],
            bool(face == 0),
            self.unresolved(dent),
        )

    def unresolved(self, dent: Array) -> str:
        """Why the stress under pins that dent the wall by (k,) [m] is not told, or empty."""
        wall = 2.0 * self.feet.half_wall
        for i, patch in enumerate(self.patches):
            if isinstance(self.model.shell, ThickShell):
                return 'stresses under the pins of a thick wall were compared with no solid'
            if patch.body is not None:
                return 'a rigid body presses on a line that no shell theory resolves'
            longest = min(LONGEST_EDGE * patch.radius, LONGEST_BENT * self.feet.bending[i])
            if self.feet.edge[i] > longest:
                return (
                    f'edges of {1e3 * self.feet.edge[i]:.2g} mm under a pin where '
                    f'{1e3 * longest:.2g} mm are needed: ask for more control vertices'
                )
            if patch.radius < NARROWEST_PIN * wall[i]:
                return (
                    f'a pin of {1e3 * patch.radius:.2g} mm is too narrow for a wall of '
                    f'{1e3 * wall[i]:.2g} mm: a thin shell tells the stress there wrongly'
                )
            if dent[i] > DEEPEST_DENT * wall[i]:
                return f'a dent of {dent[i] / wall[i]:.2g} walls was compared with no solid'
        return ''


def wall_reader(model: ShellModel, patches: tuple[ContactPatch, ...]) -> WallReader:
    """A reader of the wall under these patches."""
    shell = model.shell
    points = np.asarray(shell.value_matrix() @ model.rest)
    under = np.zeros((len(patches), len(points)))
    for i, patch in enumerate(patches):
        if patch.body is not None:
            continue
        inside = np.linalg.norm(points - patch.point, axis=1) <= patch.radius
        normal = np.cross(*shell.reference.tangents[inside].transpose(1, 0, 2))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        under[i, inside] = np.abs(normal @ patch.axis) / (np.pi * patch.radius**2)
    return WallReader(model, patches, outer_feet(model, patches), under)


def shared(grasp: GraspContacts, force: Array, spin: Array, turns: Array) -> Sharing:
    """What changes of the fingers' forces (k, 3, w) and of the normals (k, 3, w) make of both."""
    push = np.einsum('kaw,ka->kw', force, grasp.normal)
    push += np.einsum('kaw,ka->kw', turns, grasp.tangential)
    across = force - grasp.normal[:, :, None] * push[:, None] - grasp.push[:, None, None] * turns
    return Sharing(push, across, spin)
