# SPDX-License-Identifier: Apache-2.0
"""What a deformed shell says of itself: strains and stresses at both faces, energy, curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.thick import MOST_INCOMPRESSIBLE, ThickShell
from shell_deform.model import ShellModel
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.crossing import crossing
from shell_deform.surface.fit import MOST_THIN, thin_share, thinnest
from shell_deform.theory import THEORIES
from shell_deform.theory.material import Material
from shell_deform.theory.thin_wall import (
    THICKEST,
    WORTH_A_WARNING,
    thick_wall_error,
    thick_wall_warning,
    thickness_over_radius,
)

Array = NDArray[np.float64]

TORN_STRAIN = 1.0
"""A wall of which a face is stretched to more than twice its length counts as torn."""

SMALL_STRAIN_LIMIT = 0.2

NEVER_MEETS = 0.2
"""Walls that moved by less of the smallest extent of the object have not met."""

FACE_STEPS = 12
"""Newton steps on the stretch across a free face; it settles in five."""


class ReadoutError(ValueError):
    """A state that cannot be read out."""


@dataclass(frozen=True)
class Readout:
    """Fields at the p quadrature points, in the reference frame of each.

    Attributes:
        points: (p, 3) deformed middle surface [m]. tangents: (p, 2, 3) its reference frame.
        membrane_strain: (p, 3) e_11, e_22, 2 e_12 [-].
        curvature_change: (p, 3) k_11, k_22, 2 k_12 [1/m].
        outer_strain, inner_strain: (p, 3) in-plane strain of the faces at +h/2 and -h/2 [-].
        outer_stress, inner_stress: (p, 3) s_11, s_22, s_12 of the faces [Pa].
        energy_density: (p,) strain energy per undeformed area [J/m^2].
        volume: volume inside the middle surface [m^3]; meaningless for open surfaces.
        warnings: sentences on strains and stresses beyond what the model is good for.
    """

    points: Array
    tangents: Array
    membrane_strain: Array
    curvature_change: Array
    outer_strain: Array
    inner_strain: Array
    outer_stress: Array
    inner_stress: Array
    energy_density: Array
    volume: float
    warnings: tuple[str, ...]


def read_out(model: ShellModel, positions: Array, yield_stress: float | None = None) -> Readout:
    """Strains, stresses and energy at the unknowns `positions` under the model's theory.

    Of a thin wall these are its control points (n, 3), of a thick one all its unknowns. Raises
    ReadoutError where a thick wall has no equilibrium at a point.

    The face at distance z along the normal carries the strain e - z k, since k is the change of
    the second fundamental form.
    """
    shell = model.shell
    if isinstance(shell, ThickShell):
        return _read_out_thick(shell, positions, yield_stress)
    strain = THEORIES[model.theory].strains(shell.derivatives(positions), shell.reference)
    membrane, change = strain[:, :3], strain[:, 3:]
    half = 0.5 * shell.thickness[:, None]
    outer, inner = membrane - half * change, membrane + half * change
    law = shell.membrane / shell.thickness[:, None, None]

    def stress(face: Array) -> Array:
        return np.einsum('pij,pj->pi', law, face)

    resultant = np.einsum('pij,pj->pi', shell.membrane, membrane)
    moment = np.einsum('pij,pj->pi', shell.bending, change)
    energy = 0.5 * np.einsum('pi,pi->p', resultant, membrane)
    energy += 0.5 * np.einsum('pi,pi->p', moment, change)
    result_outer, result_inner = stress(outer), stress(inner)
    return Readout(
        points=np.asarray(shell.value_matrix() @ positions),
        tangents=shell.reference.tangents,
        membrane_strain=membrane,
        curvature_change=change,
        outer_strain=outer,
        inner_strain=inner,
        outer_stress=result_outer,
        inner_stress=result_inner,
        energy_density=energy,
        volume=shell.volume(positions)[0],
        warnings=_warnings(outer, inner, result_outer, result_inner, yield_stress),
    )


def _read_out_thick(shell: ThickShell, unknowns: Array, yield_stress: float | None) -> Readout:
    """`read_out` of a thick wall: its faces are stretched as its own kinematics says."""
    states = shell.point_states(unknowns, np.arange(len(shell.weights)))
    if states is None:
        raise ReadoutError('a point of the wall has no equilibrium: there is nothing to read out')
    metric, bent = states[:, 6:9], states[:, 9:12]
    rest_bent = -shell.reference.curvature[:, [0, 2, 1]]
    half = np.array([0.5, 0.5, 1.0])
    twice = np.array([1.0, 1.0, 2.0])
    identity = np.array([1.0, 1.0, 0.0])
    faces = [_face_metric(shell, states, side) for side in (1.0, -1.0)]
    outer, inner = (half * (face - identity) for face in faces)
    outer_stress, inner_stress = (neo_hookean_stress(face, shell.material) for face in faces)
    return Readout(
        points=np.asarray(shell.value_matrix() @ unknowns[: len(shell.mesh.vertices)]),
        tangents=shell.reference.tangents,
        membrane_strain=half * (metric - identity),
        curvature_change=-twice * (bent - rest_bent),
        outer_strain=outer,
        inner_strain=inner,
        outer_stress=outer_stress,
        inner_stress=inner_stress,
        energy_density=states[:, 5],
        volume=shell.volume(unknowns)[0],
        warnings=_stress_warnings(outer_stress, inner_stress, yield_stress),
    )


def _face_metric(shell: ThickShell, states: Array, side: float) -> Array:
    """(p, 3) right Cauchy-Green components (11, 22, 12) at height `side` h / 2, all points.

    `states` (p, 17) are those of all points.
    """
    h, z = shell.thickness, 0.5 * side * shell.thickness
    zeta = (states[:, 0] * z + states[:, 1] * z**2 / h)[:, None]
    metric = states[:, 6:9] + 2.0 * zeta * states[:, 9:12] + zeta**2 * states[:, 12:15]
    k_11, k_12, k_22 = (-shell.reference.curvature).T
    shifter = np.stack([1.0 + z * k_11, z * k_12, z * k_12, 1.0 + z * k_22], axis=1)
    inverse = np.linalg.inv(shifter.reshape(-1, 2, 2))
    full = np.stack([metric[:, 0], metric[:, 2], metric[:, 2], metric[:, 1]], axis=1)
    turned = inverse @ full.reshape(-1, 2, 2) @ inverse
    return np.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], axis=1)


def neo_hookean_stress(metric: Array, material: Material) -> Array:
    """(p, 3) true stress 11, 22, 12 [Pa] of a free face with the in-plane metric (p, 3).

    The face carries no normal stress, which gives its stretch across: Newton's method on its
    logarithm. Components along the material principal directions, turned with the wall.
    """
    nu = min(material.poisson_ratio, MOST_INCOMPRESSIBLE)
    shear = 0.5 * material.young_modulus / (1.0 + nu)
    bulk = material.young_modulus / 3.0 / (1.0 - 2.0 * nu)
    tensor = metric[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
    squares, directions = np.linalg.eigh(tensor)
    area = np.sqrt(squares.prod(axis=1))
    log = -nu / (1.0 - nu) * np.log(area)
    for _ in range(FACE_STEPS):
        across = np.exp(2.0 * log)
        trace = squares.sum(axis=1) + across
        j = area * np.exp(log)
        scale = shear * j ** (-5.0 / 3.0)
        stress = scale * (across - trace / 3.0) + bulk * (j - 1.0)
        slope = scale * (4.0 / 3.0 * across - 5.0 / 3.0 * (across - trace / 3.0)) + bulk * j
        log = log - stress / slope
    across, j = np.exp(2.0 * log), area * np.exp(log)
    trace = squares.sum(axis=1) + across
    principal_stress = shear * j[:, None] ** (-5.0 / 3.0) * (squares - trace[:, None] / 3.0)
    principal_stress += bulk * (j - 1.0)[:, None]
    full = np.einsum('pik,pk,pjk->pij', directions, principal_stress, directions)
    return np.stack([full[:, 0, 0], full[:, 1, 1], full[:, 0, 1]], axis=1)


def support_forces(model: ShellModel, positions: Array, loads: Array) -> Array:
    """Nodal forces (n, 3) [N] that the supports exert at an equilibrium under nodal `loads`.

    Taken from the wall, not from the springs of the supports: it keeps its digits however stiff
    these are.
    """
    return model.wall_force(positions) - loads


def principal(components: Array, engineering_shear: bool = True) -> Array:
    """Principal values (p, 2), larger first, of plane components (p, 3: 11, 22, shear)."""
    shear = 0.5 * components[:, 2] if engineering_shear else components[:, 2]
    middle = 0.5 * (components[:, 0] + components[:, 1])
    radius = np.hypot(0.5 * (components[:, 0] - components[:, 1]), shear)
    return np.stack([middle + radius, middle - radius], axis=1)


def von_mises(stress: Array) -> Array:
    """Equivalent stress (p,) [Pa] of plane stresses (p, 3: 11, 22, 12)."""
    s_1, s_2, s_12 = stress.T
    return np.sqrt(s_1**2 + s_2**2 - s_1 * s_2 + 3.0 * s_12**2)


def wall_ratio(model: ShellModel) -> float:
    """Thickness over the smaller radius of curvature of the undeformed shell."""
    mean, gauss = model.shell.reference.mean_and_gauss
    return thickness_over_radius(mean, gauss, model.shell.thickness)


def thickness_warning(model: ShellModel) -> str | None:
    """A sentence when the wall is too thick for the theory of the model, else None."""
    ratio = wall_ratio(model)
    if not isinstance(model.shell, ThickShell):
        return thick_wall_warning(ratio)
    error = thick_wall_error(ratio)
    if error <= WORTH_A_WARNING:
        return None
    if ratio > THICKEST:
        known = 'no solid was compared with a wall like that'
    else:
        known = f'beside solids its force is up to {100.0 * error:.0f} % off'
    return (
        f'the wall is {ratio:.2g} of the radius of curvature, thick for theory thick, too: {known}'
    )


def mesh_warning(mesh: ControlMesh) -> str | None:
    """A sentence when too much of a surface lies on triangles that bend badly, else None.

    So look meshes that are fine at small contacts and have few control vertices beside them.
    """
    share = thin_share(mesh)
    if share <= MOST_THIN:
        return None
    return (
        f'the mesh is too coarse beside its contacts: {100.0 * share:.2g} % of it lies on long '
        f'triangles, down to {thinnest(mesh):.2g} degrees, and forces are too large (4 % where '
        '0.3 %, 24 % where 1 % do); take more control vertices (control_vertices, --vertices) or '
        'wider contacts'
    )


def _warnings(
    outer: Array, inner: Array, outer_stress: Array, inner_stress: Array, limit: float | None
) -> tuple[str, ...]:
    found = []
    strain = max(float(np.abs(principal(face)).max()) for face in (outer, inner))
    if strain > SMALL_STRAIN_LIMIT:
        found.append(
            f'surface strain reaches {100 * strain:.0f} %: beyond '
            f'{100 * SMALL_STRAIN_LIMIT:.0f} % a linear wall law is a stretch'
        )
    return (*found, *_stress_warnings(outer_stress, inner_stress, limit))


def _stress_warnings(outer: Array, inner: Array, limit: float | None) -> tuple[str, ...]:
    if limit is None:
        return ()
    stress = max(float(von_mises(face).max()) for face in (outer, inner))
    if stress <= limit:
        return ()
    return (
        f'surface stress reaches {stress / 1e6:.3g} MPa, above the yield stress of '
        f'{limit / 1e6:.3g} MPa: the real wall stays bent',
    )


def passes_through_itself(model: ShellModel, positions: Array) -> Array | None:
    """(3,) where the middle surface of control points (n, 3) crosses itself [m], else None.

    One that does so undeformed says nothing, and is not looked at.
    """
    mesh = model.shell.mesh
    rest, now = map(model.surface.limit_positions, (model.rest, positions))
    moved = float(np.linalg.norm(now - rest, axis=1).max())
    if moved < NEVER_MEETS * float(np.ptp(rest, axis=0).min()):
        return None
    triangles = np.asarray(mesh.triangles[mesh.active], dtype=np.int64)
    at = crossing(triangles, now)
    return None if at is None or crossing(triangles, rest) is not None else at
