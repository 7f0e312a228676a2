# SPDX-License-Identifier: Apache-2.0
"""The contacts of a grasp and the wrenches that they can carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AFTER, BEFORE = np.array([1, 2, 0]), np.array([2, 0, 1])

FORCES = 4
"""Of a contact: push, two tangential forces, spin torque over its arm."""

LEAST_PUSH, LEAST_NEWTON = 1e-9, 1e-6
"""A contact with less than this share of the largest, or than so much [N], carries nothing."""

LARGEST = {'push': 1e9, 'friction': 1e3, 'arm': 1e3, 'point': 1e6}
"""Of what is taken for a contact's value [N, -, m, m]; more is a mistake of units or worse."""

COINCIDENT = 1e-9
"""Contacts nearer than this share of the size of the grasp are one."""

MANY = 7
"""Contacts that may hold an object without friction."""

UNIFORM_ARM = 2.0 / 3.0
"""Mean arm of an even pressure over the radius of its disc."""


class GraspError(ValueError):
    """Contacts that no measure can be told of; the text says which value is impossible."""


@dataclass(frozen=True)
class GraspContacts:
    """k contacts on the deformed object, in one frame.

    Attributes:
        point: (k, 3) on the deformed outer face [m]. normal: (k, 3) inward unit normal there.
        push: (k,) force along the normal [N]. tangential: (k, 3) force across it [N].
        spin: (k,) torque about the normal [N m]. friction: (k,) coefficient [-].
        arm: (k,) mean arm of the pressure [m], 0 for a point: the spin torque that friction
            carries is friction times push times arm.
    """

    point: Array
    normal: Array
    push: Array
    tangential: Array
    spin: Array
    friction: Array
    arm: Array

    def __post_init__(self) -> None:
        if not self._plainly_right():
            self._refuse()

    def _plainly_right(self) -> bool:
        """Whether one look at all numbers finds nothing wrong: a sample has no time for more."""
        k = len(self.point)
        parts = [getattr(self, name) for name in self.__dataclass_fields__]
        if [len(part) for part in parts] != 7 * [k] or not k:
            return False
        values = np.concatenate([part.ravel() for part in parts])
        if len(values) != 13 * k or not np.abs(values).max() < min(LARGEST.values()):
            return False
        length = np.einsum('ki,ki->k', self.normal, self.normal)
        return bool(np.abs(length - 1.0).max() < 1e-6 and values[-2 * k :].min() >= 0.0)

    def _refuse(self) -> None:
        """Raise GraspError for what cannot be."""
        count = len(self.point)
        for name, size in (
            ('point', (count, 3)), ('normal', (count, 3)), ('push', (count,)),
            ('tangential', (count, 3)), ('spin', (count,)), ('friction', (count,)),
            ('arm', (count,)),
        ):  # fmt: skip
            values = getattr(self, name)
            if values.shape != size:
                raise GraspError(f'{name} has shape {values.shape}; {count} contacts need {size}')
            if not np.all(np.isfinite(values)):
                raise GraspError(f'{name} of a contact is {values.tolist()}; it must be finite')
        length = np.linalg.norm(self.normal, axis=1)
        for i in np.flatnonzero(np.abs(length - 1.0) > 1e-6).tolist():
            raise GraspError(
                f'the normal of contact {i + 1} is {self.normal[i].tolist()}, of length '
                f'{length[i]:.6g}; it must be a unit vector'
            )
        for name, largest in LARGEST.items():
            if np.any(np.abs(getattr(self, name)) > largest):
                raise GraspError(
                    f'{name} of a contact is {getattr(self, name).tolist()}; beyond {largest:g} '
                    'nothing is a contact: look at the units'
                )
        for name in ('friction', 'arm'):
            if np.any(getattr(self, name) < 0.0):
                raise GraspError(
                    f'{name} is {getattr(self, name).tolist()}; it cannot be negative'
                )

    @property
    def count(self) -> int:
        """How many contacts there are."""
        return len(self.point)

    @property
    def pressing(self) -> NDArray[np.bool_]:
        """(k,) whether each contact presses at all: one that does not holds nothing."""
        return self.push > max(LEAST_PUSH * float(self.push.max(initial=0.0)), LEAST_NEWTON)

    def chosen(self, index: NDArray[np.bool_]) -> GraspContacts:
        """Some of the contacts."""
        if index.all():
            return self
        return GraspContacts(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def contacts(
    point: Array,
    normal: Array,
    push: Array | float,
    friction: Array | float,
    arm: Array | float = 0.0,
    force: Array | None = None,
    spin: Array | None = None,
) -> GraspContacts:
    """Contacts from points (k, 3) [m], inward normals (k, 3) and one value for all or (k,) each.

    `force` (k, 3) [N] gives the tangential force; none without it. Raises GraspError.
    """
    point, normal = _vectors('point', point), _vectors('normal', normal)
    count = len(point)
    tangential = np.zeros((count, 3))
    if force is not None:
        tangential = force - np.einsum('ki,ki->k', force, normal)[:, None] * normal
    return GraspContacts(
        point,
        normal,
        _each('push', push, count),
        tangential,
        np.zeros(count) if spin is None else np.asarray(spin, float),
        _each('friction', friction, count),
        _each('arm', arm, count),
    )


def _numbers(name: str, value: object) -> Array:
    """A contact's value as floats; GraspError for what is no number."""
    try:
        found = np.asarray(value)
    except ValueError:
        found = np.asarray(None)
    if found.size and found.dtype.kind not in 'iuf':
        raise GraspError(f'{name} of a contact is {value!r}; it must be a number')
    return np.asarray(found, float)


def _vectors(name: str, value: object) -> Array:
    """(k, 3); one alone may come as (3,)."""
    found = _numbers(name, value)
    if found.size and found.shape[-1] != 3:
        raise GraspError(f'{name} has shape {found.shape}; k contacts need (k, 3)')
    return found.reshape(-1, 3)


def _each(name: str, value: object, count: int) -> Array:
    """(k,) from as many, or from one for all."""
    found = _numbers(name, value)
    if found.shape not in ((), (1,), (count,)):
        raise GraspError(f'{name} has shape {found.shape}; {count} contacts need ({count},)')
    return found.copy() if found.shape == (count,) else np.full(count, found)


def tangents(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (k, 3) across each normal (k, 3), orthogonal to each other.

    Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6 (2017).
    """
    x, y, z = normal.T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return first, second


def cross(a: Array, b: Array) -> Array:
    """Cross product of the last axes; `np.cross` takes several times as long for a few vectors."""
    return a[..., AFTER] * b[..., BEFORE] - a[..., BEFORE] * b[..., AFTER]


def contact_wrenches(grasp: GraspContacts, origin: Array, length: float) -> Array:
    """(6, k, 4) wrench on the object of unit push, tangential forces and spin force.

    Moments about `origin` (3,) over `length` [m]; the spin force is the torque over the arm.
    """
    first, second = tangents(grasp.normal)
    directions = np.stack([grasp.normal, first, second], axis=1)
    offset = (grasp.point - origin) / length
    result = np.zeros((6, grasp.count, FORCES))
    result[:3, :, :3] = directions.transpose(2, 0, 1)
    result[3:, :, :3] = cross(offset[:, None], directions).transpose(2, 0, 1)
    result[3:, :, 3] = (grasp.normal * (grasp.arm / length)[:, None]).T
    return result


def size_of(grasp: GraspContacts) -> float:
    """Mean distance of the contacts from their middle [m]; 1 where they are all in one place."""
    if not grasp.count:
        return 1.0
    away = grasp.point - grasp.point.mean(axis=0)
    size = float(np.sqrt(np.einsum('ki,ki->', away, away) / grasp.count))
    return size if size > 0.0 else 1.0


def why_open(grasp: GraspContacts) -> str:
    """Why these contacts cannot close a grasp whatever they press, or empty."""
    if grasp.count == 0:
        return 'no contact'
    if not grasp.pressing.any():
        return 'no contact presses'
    if grasp.count == 1:
        return 'one contact holds nothing'
    if grasp.pressing.sum() == 1:
        return 'only one contact presses, and one holds nothing'
    away = grasp.point[:, None] - grasp.point[None]
    apart = np.linalg.norm(away, axis=2)
    if apart.max() < COINCIDENT or np.all(apart < COINCIDENT * np.abs(grasp.point).max()):
        return 'all contacts are in one place'
    if np.any(grasp.friction <= 0.0):
        if grasp.friction.any():
            return 'closure is not told of contacts without friction beside others with it'
        if grasp.count < MANY:
            return 'without friction fewer than seven contacts hold nothing'
        return 'closure by shape alone, without friction, is not told'
    size = size_of(grasp)
    wrenches = contact_wrenches(grasp, grasp.point.mean(axis=0), size).reshape(6, -1)
    if np.linalg.matrix_rank(wrenches, tol=1e-9) < 6:
        return 'nothing resists a turn about the line through the contacts'
    return ''
