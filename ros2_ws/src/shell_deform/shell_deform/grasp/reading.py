# SPDX-License-Identifier: Apache-2.0
"""The grasp in an equilibrium of a shell: contacts, how they share loads out, what the wall bears.

What the held patches of a solved shell carry besides their pushes is the tangential force and spin
that the fingers must supply. No gauge sees them: they are values of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch
from shell_deform.grasp.contacts import UNIFORM_ARM, GraspContacts
from shell_deform.grasp.slip import Sharing
from shell_deform.model import ShellModel
from shell_deform.readout import principal, read_out, von_mises
from shell_deform.solve.borders import borders
from shell_deform.solve.equilibrium import Equilibrium, displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.surface.limit import surface_points
from shell_deform.surface.loop_basis import BasisRows, basis_rows

Array = NDArray[np.float64]

SMALL_LOAD = 1e-3
"""Wrench [N, N m] by which the turn of the normals is taken."""

HELD_ROWS = 3
"""Of a held patch: two lateral motions and the spin."""


@dataclass(frozen=True)
class WallState:
    """What the wall bears most.

    Attributes:
        stress: largest von Mises stress at either face [Pa]. stress_at: (3,) where [m].
        strain: largest principal strain at either face [-]. strain_at: (3,) where [m].
        outer: whether the largest stress is at the outer face.
    """

    stress: float
    stress_at: Array
    strain: float
    strain_at: Array
    outer: bool


@dataclass(frozen=True)
class Response:
    """What a wrench on the object does while all fingers stand still.

    Attributes:
        centre: (3,) centre of mass of the wall [m], origin of all wrenches.
        force: (k, 3, 6) change of the fingers' forces per unit wrench [N per N or N m].
        sharing: the same along and across the normals, which turn, too.
        compliance: (6, 6) motion of the object per wrench, see `stiffness`.
    """

    centre: Array
    force: Array
    sharing: Sharing
    compliance: Array


@dataclass(frozen=True)
class OuterFeet:
    """The material points where patches touch, for any state of the shell.

    Attributes:
        rows: of the limit surface at the k feet. half_wall: (k,) [m].
    """

    rows: BasisRows
    half_wall: Array

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
    return OuterFeet(rows, 0.5 * model.shell.thickness[near])


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
    count = len(patches)
    held = state.multipliers[: HELD_ROWS * count].reshape(count, HELD_ROWS)
    force = np.array(
        [
            finger_force(patch, state.force[i : i + 1], held[i, :, None])[:, 0]
            for i, patch in enumerate(patches)
        ]
    ).reshape(count, 3)
    radius = np.array([patch.radius for patch in patches])
    push = np.einsum('ki,ki->k', force, normal)
    return GraspContacts(
        point,
        normal,
        push,
        force - push[:, None] * normal,
        -held[:, 2] * radius,
        np.full(count, friction),
        UNIFORM_ARM * radius if arm is None else np.full(count, arm),
    )


def read_response(
    solver: EquilibriumSolver,
    patches: tuple[ContactPatch, ...],
    state: Equilibrium,
    grasp: GraspContacts,
) -> Response:
    """How the tangent at `state` shares out wrenches that act on the object as its weight does.

    `grasp`: the contacts there, whose normals turn under the load as well. Raises
    SingularMatrixError where the fingers do not hold the object at all.
    """
    model = solver.model
    count = len(patches)
    centre, loads = body_loads(model, state.positions)
    edge = borders(model, displaced(patches, np.zeros(count)))
    system = solver.system(model.tangent(state.positions), edge)
    motion, border = system.solve(loads)
    feet = outer_feet(model, patches)
    turned = np.stack(
        [feet.at(state.positions + SMALL_LOAD * column.reshape(-1, 3))[1] for column in motion.T],
        axis=-1,
    )
    turns = (turned - grasp.normal[:, :, None]) / SMALL_LOAD
    count = len(patches)
    held = border[count : count + HELD_ROWS * count].reshape(count, HELD_ROWS, -1)
    force = np.stack([finger_force(patch, border[i], held[i]) for i, patch in enumerate(patches)])
    spin = np.stack([-held[i, 2] * patch.radius for i, patch in enumerate(patches)])
    return Response(centre, force, shared(grasp, force, spin, turns), loads.T @ motion)


def finger_force(patch: ContactPatch, push: Array, held: Array) -> Array:
    """Forces (3, w) of a finger on its patch from pushes (w,) and multipliers (3, w) of its rows.

    What keeps a curved patch from spinning has a resultant, too: its middle is not its centre.
    """
    rows = patch.held_rows().sum(axis=1)
    return np.asarray(np.outer(patch.axis, push) - rows.T @ held)


def body_loads(model: ShellModel, positions: Array) -> tuple[Array, Array]:
    """Centre of mass (3,) [m] and nodal forces (N, 6) of unit force and moment about it.

    Spread over the mass of the wall as the forces of a rigid motion's acceleration are.
    """
    shell = model.shell
    values = shell.value_matrix()
    mass = shell.weights * shell.thickness
    mass = mass / mass.sum()
    points = values @ positions
    centre = mass @ points
    offset = points - centre
    square = np.einsum('p,pi,pi->', mass, offset, offset)
    inertia = square * np.eye(3) - np.einsum('p,pi,pj->ij', mass, offset, offset)
    traction = np.zeros((len(points), 3, 6))
    traction[:, :, :3] = np.eye(3)
    turns = np.linalg.inv(inertia)
    for axis in range(3):
        traction[:, :, 3 + axis] = np.cross(turns[:, axis], offset)
    traction *= mass[:, None, None]
    nodal = values.T @ traction.reshape(len(points), -1)
    return centre, np.asarray(nodal).reshape(-1, 6)


def read_wall(model: ShellModel, positions: Array) -> WallState:
    """Largest stress and strain at both faces of a deformed shell."""
    found = read_out(model, positions)
    stress = np.stack([von_mises(found.outer_stress), von_mises(found.inner_stress)])
    strain = np.stack(
        [np.abs(principal(face)).max(axis=1) for face in (found.outer_strain, found.inner_strain)]
    )
    face, where = np.unravel_index(int(np.argmax(stress)), stress.shape)
    strained = int(np.argmax(strain.max(axis=0)))
    return WallState(
        float(stress[face, where]),
        found.points[where],
        float(strain.max()),
        found.points[strained],
        bool(face == 0),
    )


def shared(grasp: GraspContacts, force: Array, spin: Array, turns: Array) -> Sharing:
    """What changes of the fingers' forces (k, 3, w) and of the normals (k, 3, w) make of both."""
    push = np.einsum('kaw,ka->kw', force, grasp.normal)
    push += np.einsum('kaw,ka->kw', turns, grasp.tangential)
    across = force - grasp.normal[:, :, None] * push[:, None] - grasp.push[:, None, None] * turns
    return Sharing(push, across, spin)
