# SPDX-License-Identifier: Apache-2.0
"""The shell at rest with its factorised tangent, as the background process hands it to the node.

With it the node answers contacts that no equilibrium knows yet. It travels once, through an
anonymous file: the pickled structure first, its arrays behind it, so that the node uses the arrays
where they lie. Both ends are the same program, started by the node itself.
"""

from __future__ import annotations

import mmap
import os
import pickle
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import contact_patch
from shell_deform.live.background.condensed import CondensedSystem, SprungFactor, contact_rows
from shell_deform.live.background.small_loads import small_loads
from shell_deform.model import ShellModel, Tangent

Array = NDArray[np.float64]

PROBES = 8
"""Places where the bend of the response is measured."""

ALIGNED = 64


@dataclass(frozen=True)
class RestShell:
    """Everything linear theory from rest needs, for contacts at any place.

    Attributes:
        model: the shell. control: (n, 3) control points in equilibrium without contacts [m].
        tangent, factor: there.
        curl: second order of a contact's displacement over the square of its first [1/m], the
            largest of several places: by how much linear theory is off at a new one.
        pins_slide: whether nothing holds contacts sideways.
    """

    model: ShellModel
    control: Array
    tangent: Tangent
    factor: SprungFactor
    curl: float
    pins_slide: bool = False


def largest_curl(
    model: ShellModel,
    control: Array,
    tangent: Tangent,
    factor: SprungFactor,
    beat: Callable[[], None],
) -> float:
    """`RestShell.curl` from contacts of two walls' radius spread over the surface.

    `beat` is called at each.
    """
    surface = model.surface
    points = surface.limit_positions(model.rest)
    radius = 2.0 * float(model.shell.thickness.mean())
    found = []
    for vertex in _spread(points, PROBES):
        beat()
        try:
            rows = contact_rows(model, (contact_patch(surface, points[vertex], radius),))
            system = CondensedSystem(factor, tangent, rows)
            small = small_loads(model, control, system, rows)
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            # No contact can lie there: beside a crease, on a rim.
            continue
        if small.compliance[0, 0] > 0.0:
            found.append(abs(float(small.second_order[0, 0])) / float(small.compliance[0, 0]) ** 2)
    return max(found, default=1.0 / radius)


def _spread(points: Array, count: int) -> list[int]:
    """Indices of `count` points far from each other: each time the one farthest from all."""
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


def packed(shell: RestShell) -> int:
    """Descriptor of an anonymous file with the shell in it."""
    buffers: list[pickle.PickleBuffer] = []
    structure = pickle.dumps(shell, protocol=5, buffer_callback=buffers.append)
    views = [buffer.raw() for buffer in buffers]
    head = np.array([len(structure), len(views), *(len(view) for view in views)], np.int64)
    descriptor = os.memfd_create('shell_deform_rest', os.MFD_CLOEXEC)
    with os.fdopen(os.dup(descriptor), 'wb') as file:
        file.write(head.tobytes())
        file.write(structure)
        for view in views:
            file.seek(_aligned(file.tell()))
            file.write(view)
    return descriptor


def unpacked(descriptor: int) -> RestShell:
    """The shell in an anonymous file, its arrays where they lie; closes the descriptor."""
    mapped = memoryview(mmap.mmap(descriptor, 0))
    os.close(descriptor)
    length, count = np.frombuffer(mapped, np.int64, 2)
    sizes = np.frombuffer(mapped, np.int64, int(count), 16)
    at = 16 + 8 * int(count)
    structure = mapped[at : at + int(length)]
    at += int(length)
    views = []
    for size in sizes.tolist():
        at = _aligned(at)
        views.append(mapped[at : at + size])
        at += size
    shell = pickle.loads(structure, buffers=views)
    assert isinstance(shell, RestShell)
    return shell


def _aligned(at: int) -> int:
    return (at + ALIGNED - 1) // ALIGNED * ALIGNED
