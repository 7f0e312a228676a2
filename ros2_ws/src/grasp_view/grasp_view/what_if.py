# SPDX-License-Identifier: Apache-2.0
"""Fingers placed on an object by hand: where they touch, how they push, on which variant of it.

Pure numbers: lengths in m, forces in N, everything in the object's frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .poses import Floats
from .scene_model import CONTACT, Contacts, Mesh

_OBJECT_KEYS = (
    'name', 'surface', 'thickness_m', 'young_modulus_pa', 'poisson_ratio', 'yield_stress_pa',
    'gas', 'supports', 'contacts', 'control_vertices', 'source',
)  # fmt: skip


@dataclass(frozen=True)
class Touch:
    """A place on the rest surface: point (3,) on the middle surface, outward unit normal (3,)."""

    point: Floats
    outward: Floats


@dataclass(frozen=True)
class Finger:
    """A finger that pushes along the surface's inward normal."""

    number: int
    touch: Touch
    force: float


def vertex_normals(mesh: Mesh) -> Floats:
    """Outward unit normals (n, 3) of the rest surface, exact on a ball however it is meshed.

    Corners weighted by the sine of their angle over both edges (Max, J. Graph. Tools 4(2):1,
    1999): by area, normals of a graded mesh lean by a degree or two.
    """
    normals = np.zeros_like(mesh.rest)
    for k in range(3):
        here, after, before = (mesh.triangles[:, (k + j) % 3] for j in range(3))
        first, second = mesh.rest[after] - mesh.rest[here], mesh.rest[before] - mesh.rest[here]
        size = np.einsum('ij,ij->i', first, first) * np.einsum('ij,ij->i', second, second)
        np.add.at(
            normals, here, np.cross(first, second) / np.where(size > 0.0, size, 1.0)[:, None]
        )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1.0)


def hits(mesh: Mesh, normals: Floats, origin: Floats, direction: Floats) -> list[Touch]:
    """Where a ray meets the rest surface, nearest first (Moeller and Trumbore 1997)."""
    a, b, c = (mesh.rest[mesh.triangles[:, k]] for k in range(3))
    first, second = b - a, c - a
    across = np.cross(direction, second)
    determinant = np.einsum('ij,ij->i', first, across)
    usable = np.abs(determinant) > 1e-18
    inverse = 1.0 / np.where(usable, determinant, 1.0)
    moved = origin - a
    u = np.einsum('ij,ij->i', moved, across) * inverse
    other = np.cross(moved, first)
    v = (other @ direction) * inverse
    along = np.einsum('ij,ij->i', other, second) * inverse
    edge = 1e-9
    found = np.flatnonzero(
        usable & (u >= -edge) & (v >= -edge) & (u + v <= 1 + edge) & (along > 0.0)
    )
    touches = []
    for k in found[np.argsort(along[found])]:
        weights = np.array([1 - u[k] - v[k], u[k], v[k]])
        corners = mesh.triangles[k]
        outward = weights @ normals[corners]
        touches.append(Touch(weights @ mesh.rest[corners], outward / np.linalg.norm(outward)))
    return touches


def opposite(mesh: Mesh, normals: Floats, touch: Touch) -> Touch | None:
    """The place that a push along the inward normal would come out at; None for an open edge."""
    size = float(np.ptp(mesh.rest, axis=0).max())
    through = hits(mesh, normals, touch.point - 1e-3 * size * touch.outward, -touch.outward)
    return through[-1] if through else None


def pointed(mesh: Mesh, normals: Floats, origin: Floats, direction: Floats) -> Touch:
    """Where a ray meets the rest surface first; beside the body, the place nearest to the ray.

    So a pointer that leaves the outline takes its finger along it, whichever way it came there.
    """
    met = hits(mesh, normals, origin, direction)
    if met:
        return met[0]
    along = direction / np.linalg.norm(direction)
    starts, ends = mesh.triangles.ravel(), mesh.triangles[:, [1, 2, 0]].ravel()
    away, edge = mesh.rest[starts] - origin, mesh.rest[ends] - mesh.rest[starts]
    away -= np.outer(away @ along, along)
    across = edge - np.outer(edge @ along, along)
    length = np.einsum('ij,ij->i', across, across)
    share = -np.einsum('ij,ij->i', away, across) / np.where(length > 0.0, length, 1.0)
    share = np.clip(share, 0.0, 1.0)
    k = int(np.linalg.norm(away + share[:, None] * across, axis=1).argmin())
    outward = (1.0 - share[k]) * normals[starts[k]] + share[k] * normals[ends[k]]
    return Touch(mesh.rest[starts[k]] + share[k] * edge[k], outward / np.linalg.norm(outward))


def nearest(mesh: Mesh, normals: Floats, point: Floats) -> Touch:
    """The place of the rest surface nearest to `point`, along the normal of the nearest vertex."""
    k = int(np.linalg.norm(mesh.rest - point, axis=1).argmin())
    size = float(np.ptp(mesh.rest, axis=0).max())
    met = hits(mesh, normals, point + size * normals[k], -normals[k])
    return min(
        [*met, Touch(mesh.rest[k], normals[k])],
        key=lambda touch: float(np.linalg.norm(touch.point - point)),
    )


def contacts_of(
    fingers: Sequence[Finger], thickness: float, radius: float, stamp: float = 0.0
) -> Contacts:
    """The fingers as `hand/contacts`: on the outer face, along the inward normal."""
    outward = np.array([finger.touch.outward for finger in fingers]).reshape(-1, 3)
    points = np.array([finger.touch.point for finger in fingers]).reshape(-1, 3)
    force = np.array([finger.force for finger in fingers])
    count = len(fingers)
    return Contacts(
        stamp,
        'object',
        points + 0.5 * thickness * outward,
        -outward,
        -outward * force[:, None],
        np.full(count, 0.01),
        np.full(count, radius),
        np.array([finger.number for finger in fingers], dtype=np.int64),
        np.where(force > 0.0, CONTACT, 0).astype(np.int64),
    )


def object_variant(
    described: Mapping[str, Any], young_modulus_pa: float, gauge_pressure_pa: float
) -> dict[str, Any]:
    """An object file's content from what `shell_objects --json` says, with other numbers.

    The modulus of a solid wall changes by the same share.
    """
    variant = {
        key: _known(described[key]) for key in _OBJECT_KEYS if described.get(key) not in (None, [])
    }
    variant['young_modulus_pa'] = young_modulus_pa
    solid = described.get('solid_young_modulus_pa')
    if solid is not None:
        share = young_modulus_pa / float(described['young_modulus_pa'])
        variant['solid_young_modulus_pa'] = share * float(solid)
    gas = variant.get('gas')
    if gas is not None:
        sealed = gas.get('kind') == 'sealed'
        variant['gas'] = (
            {**gas, 'gauge_pressure_pa': gauge_pressure_pa} if sealed else {'kind': gas['kind']}
        )
    return variant


def _known(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _known(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_known(inner) for inner in value]
    return value
