# SPDX-License-Identifier: Apache-2.0
"""From an object file to a shell model that can be squeezed."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation, discretise
from shell_deform.assemble.thick import thick_shell
from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.objects import ObjectError, ShellObject, Support, object_mesh
from shell_deform.readout import wall_ratio
from shell_deform.supports import (
    SupportRows,
    clamp,
    hold_position,
    joined,
    symmetry,
)
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.outer_ring import extended
from shell_deform.theory import AUTO, KOITER, THICK
from shell_deform.theory.gas import Gas
from shell_deform.theory.material import Material
from shell_deform.theory.thin_wall import WORTH_A_THICK_WALL, excess_stiffness

Array = NDArray[np.float64]
Index = NDArray[np.int64]


THICK_EDGES_PER_RADIUS = 0.25
"""Edge length under a pin as a share of its radius, for a thick wall."""


def build_model(
    shell_object: ShellObject,
    theory: str = 'koiter',
    control_vertices: int | None = None,
    refine_at: npt.ArrayLike | None = None,
    refine_radius: float | None = None,
) -> ShellModel:
    """Mesh, wall, supports and gas of an object; the mesh is graded towards its contacts.

    `theory`: a name in `THEORY_NAMES`, or `auto`: thick where `excess_stiffness` says that Koiter
    is off by more than 2 % and only pins press, else Koiter. `refine_radius` [m] stands in for
    that of the object's contacts. A thick wall has triangles of a quarter of that under a pin: its
    pressure rises towards the rim of the stamp.

    Raises ObjectError for what the object cannot be: a support where it has no edge, sealed gas in
    an open surface.
    """
    mesh = object_mesh(shell_object, control_vertices, refine_at, refine_radius)
    if theory == AUTO:
        model = model_on_mesh(shell_object, mesh)
        theory = fitting_theory(shell_object, model)
        if theory != THICK:
            return model
    if theory == THICK:
        radius = refine_radius or min((c.radius_m for c in shell_object.contacts), default=None)
        if radius is not None:
            finer = THICK_EDGES_PER_RADIUS * radius
            mesh = object_mesh(shell_object, control_vertices, refine_at, finer)
    return model_on_mesh(shell_object, mesh, theory)


def fitting_theory(shell_object: ShellObject, model: ShellModel) -> str:
    """What theory `auto` stands for: thick or koiter, see `build_model`."""
    if any(contact.kind == 'pad' for contact in shell_object.contacts):
        return KOITER
    return THICK if excess_stiffness(wall_ratio(model)) > WORTH_A_THICK_WALL else KOITER


def model_on_mesh(
    shell_object: ShellObject, mesh: ControlMesh, theory: str = 'koiter'
) -> ShellModel:
    """The model of an object on a control mesh whose limit surface is its middle surface."""
    material = Material(shell_object.young_modulus_pa, shell_object.poisson_ratio)
    thickness: float | Array = shell_object.thickness_m
    if shell_object.vertex_thickness_m is not None:
        thickness = extended(shell_object.vertex_thickness_m, mesh)
    shell = (
        thick_shell(mesh, material, thickness)
        if theory == THICK
        else discretise(mesh, material, thickness)
    )
    parts: list[SupportRows] = []
    for support in shell_object.supports:
        parts.extend(_support_rows(shell_object, shell, support))
    gas = shell_object.gas
    if gas.kind == 'sealed' and not mesh.is_closed:
        raise ObjectError(
            f'{shell_object.name}: sealed gas in an open surface; set gas: {{kind: open}}'
        )
    return ShellModel(
        shell,
        theory,
        Gas(gas.kind, gas.gauge_pressure_pa, gas.ambient_pa),
        joined(parts),
    )


def object_contacts(
    shell_object: ShellObject, model: ShellModel, radius: float | None = None
) -> tuple[ContactPatch, ...]:
    """Contact patches at the contacts the object declares, of `radius` [m] or their own.

    A pin presses evenly over its radius; a pad is a rigid body and keeps its own.

    Raises ObjectError when it declares none, or one that is further from the object than its own
    size.
    """
    if not shell_object.contacts:
        raise ObjectError(f'{shell_object.name}: no contacts; add contacts: [{{at_m: …}}]')
    found = []
    rubbing = any(contact.friction > 0.0 for contact in shell_object.contacts)
    for number, contact in enumerate(shell_object.contacts):
        at = np.array(contact.at_m)
        if contact.kind == 'pad':
            patch = model.pad(at, contact.radius_m, contact.curvature_radius_m)
            if rubbing:
                patch = model.with_friction(patch, contact.friction)
        else:
            patch = model.contact(at, radius or contact.radius_m)
        away = float(np.linalg.norm(at - patch.point)) - 0.5 * shell_object.thickness_m
        if away > max(contact.radius_m, shell_object.thickness_m):
            raise ObjectError(
                f'{shell_object.name}: contact {number + 1}, at_m {list(contact.at_m)}, is '
                f'{away:.3g} m away from the object, further than its own radius of '
                f'{contact.radius_m:g} m; give a place on the outer face, in metres'
            )
        found.append(patch)
    return tuple(found)


def with_material(
    shell_object: ShellObject,
    young_modulus: float | None = None,
    poisson_ratio: float | None = None,
    thickness: float | None = None,
    gas_kind: Literal['none', 'open', 'sealed'] | None = None,
) -> ShellObject:
    """The same object with other numbers [Pa], [-], [m]; None keeps a number."""
    changes: dict[str, object] = {}
    if young_modulus is not None:
        changes['young_modulus_pa'] = young_modulus
    if poisson_ratio is not None:
        changes['poisson_ratio'] = poisson_ratio
    if thickness is not None:
        changes['thickness_m'] = thickness
        changes['vertex_thickness_m'] = None
    if gas_kind is not None:
        changes['gas'] = replace(shell_object.gas, kind=gas_kind)
    return replace(shell_object, **changes)  # type: ignore[arg-type]


def boundary_vertices(mesh: ControlMesh) -> tuple[Index, Array]:
    """Vertices (b,) on the rim of the active surface, and the unit rim direction (b, 3) there."""
    used = mesh.triangles[mesh.active]
    edges = np.concatenate([used[:, [0, 1]], used[:, [1, 2]], used[:, [2, 0]]])
    key = np.sort(edges, axis=1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    rim = edges[first[count == 1]]
    vertices = np.unique(rim)
    points = LimitSurface(mesh).limit_positions(mesh.vertices)
    direction = np.zeros((len(mesh.vertices), 3))
    step = points[rim[:, 1]] - points[rim[:, 0]]
    step /= np.linalg.norm(step, axis=1)[:, None]
    np.add.at(direction, rim[:, 0], step)
    np.add.at(direction, rim[:, 1], step)
    chosen = direction[vertices]
    return vertices.astype(np.int64), chosen / np.linalg.norm(chosen, axis=1)[:, None]


def _support_rows(
    shell_object: ShellObject, shell: Discretisation, support: Support
) -> list[SupportRows]:
    mesh, surface = shell.mesh, shell.surface
    points = surface.limit_positions(mesh.vertices)
    rim, along = boundary_vertices(mesh)
    at, plane = _where(shell_object, points, rim, support.where)
    if len(at) == 0:
        raise ObjectError(
            f'{shell_object.name}: support {support.kind} finds no vertex at '
            f'{support.where!r}; the surface has no such edge'
        )
    rows = np.searchsorted(rim, at)
    everything = np.eye(3)
    if support.kind in ('hinged', 'held'):
        return [hold_position(shell, at, everything)]
    normal = surface.vertex_normals(mesh.vertices)[at]
    across = np.cross(normal, along[rows])
    if support.kind == 'clamped':
        return clamp(shell, at, across)
    if plane is None:
        mean = across.mean(axis=0)
        plane = everything[int(np.argmax(np.abs(mean)))]
    if support.kind == 'diaphragm':
        return [hold_position(shell, at, np.linalg.svd(plane[None])[2][1:])]
    return symmetry(shell, at, plane)


def _where(
    shell_object: ShellObject, points: Array, rim: Index, where: str
) -> tuple[Index, Array | None]:
    """Rim vertices that `where` names, and the normal of the plane when it names one."""
    if where == 'boundary':
        return rim, None
    near = 1e-3 * float(np.ptp(points, axis=0).max())
    if '=' in where:
        axis_name, value = (part.strip() for part in where.split('=', 1))
        axis = 'xyz'.index(axis_name)
        return rim[np.abs(points[rim, axis] - float(value)) < near], np.eye(3)[axis]
    axis, side = {
        'lower': (2, -1),
        'upper': (2, 1),
        'ends': (2, 0),
        'left': (0, -1),
        'right': (0, 1),
        'front': (1, -1),
        'back': (1, 1),
        'straight': (1, -1),
    }[where]
    coordinate = points[rim, axis]
    low, high = coordinate.min(), coordinate.max()
    chosen = np.zeros(len(rim), dtype=bool)
    if side <= 0:
        chosen |= coordinate < low + near
    if side >= 0:
        chosen |= coordinate > high - near
    return rim[chosen], np.eye(3)[axis]
