# SPDX-License-Identifier: Apache-2.0
"""From an object file to a shell model that can be squeezed."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from shell_deform.assemble.discretisation import Discretisation, discretise
from shell_deform.assemble.thick import folded_place, thick_shell
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.contact.bodies import BodyError
from shell_deform.contact.body_file import FingerBody, load_body
from shell_deform.contact.cell_load import CellShape, cell_shares, shaped_by_cells
from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.objects import (
    Contact,
    GripPlace,
    ObjectError,
    ShellObject,
    Support,
    object_mesh,
)
from shell_deform.readout import wall_ratio
from shell_deform.supports import (
    SupportRows,
    clamp,
    hold_position,
    joined,
    symmetry,
)
from shell_deform.supports.grips import Grip, GripError, grip, refuse_few
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.outer_ring import extended
from shell_deform.theory import AUTO, KOITER, THICK
from shell_deform.theory.gas import Gas
from shell_deform.theory.material import Material
from shell_deform.theory.thin_wall import WORTH_A_THICK_WALL, excess_stiffness

Array = NDArray[np.float64]
Index = NDArray[np.int64]


CLOSED_FILLINGS = {'sealed': 'sealed gas', 'liquid': 'a liquid'}
"""What only a closed surface holds, in words."""

THICK_EDGES_PER_RADIUS = 0.25
"""Edge length under a pin as a share of its radius, for a thick wall."""


def build_model(
    shell_object: ShellObject,
    theory: str = 'koiter',
    control_vertices: int | None = None,
    refine_at: npt.ArrayLike | None = None,
    refine_radius: float | None = None,
    sheared_everywhere: bool = False,
) -> ShellModel:
    """Mesh, wall, supports and gas of an object; the mesh is graded towards its contacts.

    `theory`: a name in `THEORY_NAMES`, or `auto`, see `fitting_theory`; the thin wall if none is
    named, which nodes and commands never leave out. `refine_radius` [m] stands in for that of the
    object's contacts. A thick wall has triangles of a quarter of that under a pin: its pressure
    rises towards the rim of the stamp. `sheared_everywhere` gives it shear at all its vertices,
    not only near its pins.

    Raises ObjectError for what the object cannot be: a support where it has no edge, sealed gas in
    an open surface.
    """
    shell_object = _sized(shell_object)
    mesh = object_mesh(shell_object, control_vertices, refine_at, refine_radius)
    reason = ''
    if theory == AUTO:
        model = model_on_mesh(shell_object, mesh)
        theory, reason = fitting_theory(shell_object, model)
        if theory != THICK:
            return replace(model, reason=reason)
    if theory == THICK:
        radius = refine_radius or min((c.radius_m for c in shell_object.contacts), default=None)
        if radius is not None:
            finer = THICK_EDGES_PER_RADIUS * radius
            mesh = object_mesh(shell_object, control_vertices, refine_at, finer)
    return replace(model_on_mesh(shell_object, mesh, theory, sheared_everywhere), reason=reason)


def fitting_theory(shell_object: ShellObject, model: ShellModel) -> tuple[str, str]:
    """What theory `auto` stands for and a sentence why: thick where a thin wall is too stiff.

    That is where `excess_stiffness` is above 2 %, only pins press, numba is at hand, and no point
    of the wall reaches its centre of curvature.
    """
    ratio = wall_ratio(model)
    excess = excess_stiffness(ratio)
    measured = (
        f'the wall is {ratio:.2g} of the radius of curvature, where a thin one is '
        f'{100.0 * excess:.2g} % too stiff (limit {100.0 * WORTH_A_THICK_WALL:g} %)'
    )
    if excess <= WORTH_A_THICK_WALL:
        return KOITER, measured
    if shell_object.grips or any(contact.kind != 'pin' for contact in shell_object.contacts):
        return KOITER, f'{measured}, but more than pins press on it'
    if not HAVE_NUMBA:
        return KOITER, f'{measured}, but a thick one needs numba, which is not installed'
    if (place := folded_place(model.shell)) is not None:
        at = np.round(1e3 * place, 2).tolist()
        return KOITER, f'{measured}, but at {at} mm it reaches its centre of curvature'
    return THICK, measured


def model_on_mesh(
    shell_object: ShellObject,
    mesh: ControlMesh,
    theory: str = 'koiter',
    sheared_everywhere: bool = False,
) -> ShellModel:
    """The model of an object on a control mesh whose limit surface is its middle surface."""
    material = Material(shell_object.modulus(theory), shell_object.poisson_ratio)
    thickness: float | Array = shell_object.thickness_m
    if shell_object.vertex_thickness_m is not None:
        thickness = extended(shell_object.vertex_thickness_m, mesh)
    shell = (
        thick_shell(mesh, material, thickness, everywhere=sheared_everywhere)
        if theory == THICK
        else discretise(mesh, material, thickness)
    )
    parts: list[SupportRows] = []
    for support in shell_object.supports:
        parts.extend(_support_rows(shell_object, shell, support))
    gas = shell_object.gas
    if gas.kind in CLOSED_FILLINGS and not mesh.is_closed:
        raise ObjectError(
            f'{shell_object.name}: {CLOSED_FILLINGS[gas.kind]} in an open surface; set gas: '
            '{kind: open}'
        )
    return ShellModel(
        shell,
        theory,
        Gas(gas.kind, gas.gauge_pressure_pa, gas.ambient_pa),
        joined(parts),
        tuple(_grip(shell_object, shell, place) for place in shell_object.grips),
        shell_object.pressure_pa,
    )


def object_contacts(
    shell_object: ShellObject,
    model: ShellModel,
    radius: float | None = None,
    pins_slide: bool = False,
) -> tuple[ContactPatch, ...]:
    """Contact patches at the contacts the object declares, of `radius` [m] or their own.

    A pin presses evenly over its radius, and holds what it presses sideways unless `pins_slide`;
    pads and fingertips are rigid bodies and keep their own.

    Raises ObjectError when it declares none, one that is further from the object than its own
    size, or a rigid body that starts inside it.
    """
    if not (shell_object.contacts or shell_object.grips):
        raise ObjectError(
            f'{shell_object.name}: no contacts; add contacts: [{{at_m: [x, y, z]}}] to its file, '
            'or give shell_solve --contact X,Y,Z'
        )
    contacts = _sized(shell_object).contacts
    found = []
    for number, contact in enumerate(contacts):
        try:
            patch = _touching(model, contact, radius)
        except BodyError as error:
            raise ObjectError(f'{shell_object.name}: contact {number + 1}: {error}') from error
        _refuse_misplaced(shell_object, model, number + 1, contact, patch)
        found.append(replace(patch, slides=True) if pins_slide and patch.body is None else patch)
    return tuple(found)


def _touching(model: ShellModel, contact: Contact, radius: float | None) -> ContactPatch:
    at = np.array(contact.at_m)
    if contact.finger is not None:
        body = load_body(contact.finger.body, contact.finger.unit)
        touched = model.touched_by(
            body.shape,
            at,
            body.size,
            None if contact.finger.along is None else np.array(contact.finger.along),
            contact.friction,
            None if contact.finger.towards is None else np.array(contact.finger.towards),
        )
        if contact.finger.cells_n is None:
            return touched
        return _felt(model, touched, body, np.array(contact.finger.cells_n))
    if contact.towards is not None:
        return model.plate(at, contact.radius_m, np.array(contact.towards), contact.friction)
    if contact.kind == 'pad':
        return model.pad(at, contact.radius_m, contact.curvature_radius_m, contact.friction)
    return model.contact(at, radius or contact.radius_m)


def _felt(
    model: ShellModel, touched: ContactPatch, body: FingerBody, forces: Array
) -> ContactPatch:
    """The push of a body that touches, where its cells measured `forces` (c,) [N]."""
    if model.theory == THICK:
        raise BodyError(
            'cells_n shape the load of a thin wall; theory thick presses by rigid pins: take '
            'theory koiter'
        )
    if len(forces) != len(body.cells):
        raise BodyError(
            f'cells_n has {len(forces)} numbers, {body.name} has {len(body.cells)} cells; give '
            'one for each'
        )
    shares = cell_shares(forces)
    if not shares.any():
        raise BodyError('no cell in cells_n pushes; give what they measured while touching [N]')
    assert touched.body is not None
    frame = touched.body.origin, touched.body.turn
    shaped = shaped_by_cells(
        touched, model.surface, model.rest, frame, CellShape(body.cells, shares)
    )
    return replace(shaped, body=None)


def _refuse_misplaced(
    shell_object: ShellObject,
    model: ShellModel,
    number: int,
    contact: Contact,
    patch: ContactPatch,
) -> None:
    """Raise ObjectError for a contact that is not on the object's outer face."""
    at, wall = np.array(contact.at_m), shell_object.thickness_m
    where = f'{shell_object.name}: contact {number}, at_m {list(contact.at_m)}, '
    if contact.kind == 'plate':
        return
    away = float(np.linalg.norm(at - patch.point)) - 0.5 * wall
    if away > max(contact.radius_m, wall):
        raise ObjectError(
            f'{where}is {away:.3g} m away from the object, further than its own radius of '
            f'{contact.radius_m:g} m; give a place on the outer face, in metres'
        )
    if contact.kind == 'pin':
        return
    inside = float((at - patch.point) @ patch.axis) + 0.5 * wall
    if contact.finger is not None and contact.finger.towards is not None and patch.body:
        pose = patch.body.posed(0.0, np.zeros(6))
        face = model.outer_face.positions(model.start)
        inside = -float(pose.distance(patch.body.shape, face).value.min())
    if inside > wall:
        raise ObjectError(
            f'{where}starts {inside:.3g} m inside the object; move it out by that, to where it '
            'only touches, or let it face the other way'
        )


def _sized(shell_object: ShellObject) -> ShellObject:
    """The object whose fingertips have the size of their bodies."""
    if all(contact.finger is None for contact in shell_object.contacts):
        return shell_object
    contacts = tuple(
        contact
        if contact.finger is None
        else replace(contact, radius_m=load_body(contact.finger.body, contact.finger.unit).size)
        for contact in shell_object.contacts
    )
    return replace(shell_object, contacts=contacts)


def with_material(
    shell_object: ShellObject,
    young_modulus: float | None = None,
    poisson_ratio: float | None = None,
    thickness: float | None = None,
    gas_kind: Literal['none', 'open', 'sealed', 'liquid'] | None = None,
    pressure: float | None = None,
) -> ShellObject:
    """The same object with other numbers [Pa], [-], [m]; None keeps a number.

    `young_modulus` is for every theory.
    """
    changes: dict[str, object] = {}
    if young_modulus is not None:
        changes['young_modulus_pa'] = young_modulus
        changes['solid_young_modulus_pa'] = None
    if poisson_ratio is not None:
        changes['poisson_ratio'] = poisson_ratio
    if thickness is not None:
        changes['thickness_m'] = thickness
        changes['vertex_thickness_m'] = None
    if gas_kind is not None:
        changes['gas'] = replace(shell_object.gas, kind=gas_kind)
    if pressure is not None:
        changes['pressure_pa'] = pressure
    return replace(shell_object, **changes)  # type: ignore[arg-type]


def _rim_edges(mesh: ControlMesh) -> Index:
    """(b, 2) edges of the active surface that have one triangle."""
    used = mesh.triangles[mesh.active]
    edges = np.concatenate([used[:, [0, 1]], used[:, [1, 2]], used[:, [2, 0]]])
    key = np.sort(edges, axis=1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    return np.asarray(edges[first[count == 1]])


def _mean_of_rim(mesh: ControlMesh, rim: Index, coordinate: Array) -> Array:
    """(b,) mean coordinate of the whole closed edge that each vertex of the rim lies on."""
    edges = np.searchsorted(rim, _rim_edges(mesh))
    links = sp.coo_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(len(rim), len(rim)))
    _, which = connected_components(links, directed=False)
    return np.asarray((np.bincount(which, coordinate) / np.bincount(which))[which])


def boundary_vertices(mesh: ControlMesh) -> tuple[Index, Array]:
    """Vertices (b,) on the rim of the active surface, and the unit rim direction (b, 3) there."""
    rim = _rim_edges(mesh)
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
    at, plane = _where(mesh, points, rim, support.where)
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


def _grip(shell_object: ShellObject, shell: Discretisation, place: GripPlace) -> Grip:
    """A part of the surface held in a pose: an edge, or a patch."""
    points = shell.surface.limit_positions(shell.mesh.vertices)
    if place.where is None:
        at, origin = _patch(shell_object, shell, place, points)
        parts = [hold_position(shell, at, np.eye(3))]
    else:
        rim, along = boundary_vertices(shell.mesh)
        at, _ = _where(shell.mesh, points, rim, place.where)
        origin = np.zeros(3) if place.at_m is None else np.array(place.at_m)
        if place.at_m is None and len(at):
            origin = points[at].mean(axis=0)
        parts = [hold_position(shell, at, np.eye(3))]
        if place.hold == 'clamped':
            normal = shell.surface.vertex_normals(shell.mesh.vertices)[at]
            parts = clamp(shell, at, np.cross(normal, along[np.searchsorted(rim, at)]))
    way_out = 'hold an edge of the object' if place.where else 'a larger radius_m'
    try:
        refuse_few(place.name, points[at], f'{way_out}, or more control vertices')
        axes = [np.eye(3)['xyz'.index(axis)] for axis in place.free]
        return grip(place.name, shell, parts, origin, np.array(axes))
    except GripError as error:
        raise ObjectError(f'{shell_object.name}: {error}') from error


def _patch(
    shell_object: ShellObject, shell: Discretisation, place: GripPlace, points: Array
) -> tuple[Index, Array]:
    """Vertices of a patch in one piece, and its middle (3,) on the middle surface [m]."""
    assert place.at_m is not None and place.radius_m is not None
    foot = shell.surface.closest_point(shell.mesh.vertices, np.array(place.at_m)[None])
    middle = foot.position[0]
    away = float(np.linalg.norm(middle - place.at_m)) - 0.5 * shell_object.thickness_m
    if away > max(place.radius_m, shell_object.thickness_m):
        raise ObjectError(
            f'{shell_object.name}: grip {place.name} is {away:.3g} m away from the object, '
            f'further than its own radius of {place.radius_m:g} m; give a place on the outer '
            'face, in metres'
        )
    inside = np.linalg.norm(points - middle, axis=1) <= place.radius_m
    used = shell.mesh.triangles[shell.mesh.active]
    carried = np.zeros(len(points), dtype=bool)
    carried[used] = True
    inside &= carried
    edges = np.concatenate([used[:, [0, 1]], used[:, [1, 2]], used[:, [2, 0]]])
    edges = edges[inside[edges].all(axis=1)]
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(len(points), len(points)))
    piece = connected_components(graph, directed=False)[1]
    nearest = int(np.argmin(np.where(inside, np.linalg.norm(points - middle, axis=1), np.inf)))
    return np.flatnonzero(inside & (piece == piece[nearest])), middle


def _where(mesh: ControlMesh, points: Array, rim: Index, where: str) -> tuple[Index, Array | None]:
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
    if where in ('lower', 'upper', 'ends'):
        # Circles are held whole: those of a coarse mesh are not flat.
        circles = _mean_of_rim(mesh, rim, coordinate)
        coordinate = circles if where != 'ends' or np.ptp(circles) > near else coordinate
    low, high = coordinate.min(), coordinate.max()
    chosen = np.zeros(len(rim), dtype=bool)
    if side <= 0:
        chosen |= coordinate < low + near
    if side >= 0:
        chosen |= coordinate > high - near
    return rim[chosen], np.eye(3)[axis]
