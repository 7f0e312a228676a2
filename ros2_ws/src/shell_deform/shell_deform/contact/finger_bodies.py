# SPDX-License-Identifier: Apache-2.0
"""Which rigid body each finger carries: `barrett_fingertip`, or `1: a.yaml, 2: b.stl mm`.

A body is one that comes with the package, by name, or a file; the numbers of a mesh need their
unit behind its name. One without a finger's number is for all the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.body_file import FingerBody, load_body
from shell_deform.objects.finger_files import body_names, find_body
from shell_deform.objects.shell_object import Contact, Finger, ObjectError, ShellObject

Array = NDArray[np.float64]

OTHERS = 0
"""Stands for all fingers without a body of their own."""

Carried = TypeVar('Carried')

FEWEST_ENDS = 3.0
"""The end of a body counts as this many half widths away where it has none near."""


@dataclass(frozen=True)
class FingerBodies:
    """What fingers carry.

    Attributes:
        files: (finger, file, unit or None) of each; finger `OTHERS` for all without an own one.
    """

    files: tuple[tuple[int, Path, str | None], ...]

    def loaded(self) -> dict[int, FingerBody]:
        """The bodies by the numbers of their fingers. Raises ObjectError."""
        return {finger: load_body(path, unit) for finger, path, unit in self.files}

    def on(self, shell_object: ShellObject) -> ShellObject:
        """The object whose pins are fingers that carry these, so that its mesh is for them."""
        if not self.files:
            return shell_object
        by_finger = {finger: Finger(path, unit) for finger, path, unit in self.files}
        contacts = []
        for number, contact in enumerate(shell_object.contacts, 1):
            finger = of_finger(by_finger, number)
            contacts.append(contact if finger is None else _carried(contact, finger))
        return replace(shell_object, contacts=tuple(contacts))

    def touching(self, shell_object: ShellObject, places: Array) -> ShellObject:
        """The object touched at places (k, 3) [m] by the narrowest body: its mesh is for that."""
        fingers = [
            (load_body(path, unit).size, Finger(path, unit)) for _, path, unit in self.files
        ]
        size, finger = min(fingers, key=itemgetter(0))
        contacts = tuple(
            Contact((float(x), float(y), float(z)), size, 'fingertip', finger=finger)
            for x, y, z in places
        )
        return replace(shell_object, contacts=contacts)


def of_finger(bodies: Mapping[int, Carried], finger: int) -> Carried | None:
    """What a finger carries: its own body, or that of all without one; None for none."""
    return bodies.get(finger, bodies.get(OTHERS))


def _carried(contact: Contact, finger: Finger) -> Contact:
    return replace(contact, kind='fingertip', finger=finger) if contact.kind == 'pin' else contact


def read_finger_bodies(text: str) -> FingerBodies:
    """What a text says; raises ObjectError for one that cannot be read, or names no body."""
    found: list[tuple[int, Path, str | None]] = []
    for part in filter(None, (part.strip() for part in text.split(','))):
        number, separator, rest = part.partition(':')
        finger = OTHERS
        if separator:
            if not number.strip().isdigit():
                raise ObjectError(
                    f'{part!r} names no finger; write NUMBER: BODY, as in 1: {body_names()[0]}'
                )
            finger = int(number)
        words = rest.split() if separator else part.split()
        if not 1 <= len(words) <= 2:
            raise ObjectError(
                f'{part!r} names no body; one of {", ".join(body_names())}, or a file'
            )
        path = find_body(words[0], Path.cwd())
        if path is None:
            raise ObjectError(
                f'there is no body {words[0]!r}; one of {", ".join(body_names())}, or a file'
            )
        if any(finger == other for other, _, _ in found):
            raise ObjectError(f'finger {finger or "(all)"} carries two bodies in {text!r}')
        found.append((finger, path, words[1] if len(words) > 1 else None))
    return FingerBodies(tuple(found))


def sizes(bodies: Sequence[FingerBody]) -> tuple[float, float]:
    """Width of the narrowest face [m], and how far from its origin a body ends, at most [m]."""
    width = min(2.0 * body.size for body in bodies)
    ends = [min(body.shape.size, FEWEST_ENDS * body.size) for body in bodies]
    return width, float(np.max(ends))
