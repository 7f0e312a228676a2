# SPDX-License-Identifier: Apache-2.0
"""One verified quantity: what was asked, what the reference says, what came out."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.supports import vertex_parameters
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import basis_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Verified:
    """A row of `shell_verify`; `error` is signed and relative to the reference.

    `goal` is the largest |error| allowed, None where the row is not scored.
    """

    name: str
    quantity: str
    reference: float
    source: str
    value: float
    vertices: int
    cpu_seconds: float
    goal: float | None = None

    @property
    def error(self) -> float:
        """(value - reference) / |reference|; plain difference for a reference of zero."""
        difference = self.value - self.reference
        return difference / abs(self.reference) if self.reference else difference

    @property
    def passed(self) -> bool:
        """Whether the error is within the goal."""
        return self.goal is None or abs(self.error) <= self.goal

    def as_dict(self) -> dict[str, Any]:
        """The JSON form of the contract."""
        return {
            'name': self.name,
            'quantity': self.quantity,
            'reference': self.reference,
            'source': self.source,
            'value': self.value,
            'error': self.error,
            'goal': self.goal,
            'vertices': self.vertices,
            'cpu_seconds': self.cpu_seconds,
        }


@dataclass
class Stopwatch:
    """Processor seconds of a block of code, known once it ends."""

    seconds: float = 0.0
    _start: float = field(default_factory=time.process_time)


@contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """Measure the processor time of all threads inside the block."""
    watch = Stopwatch()
    yield watch
    watch.seconds = time.process_time() - watch._start


@cache
def references() -> dict[str, Any]:
    """The published and independent reference values, in the units of their sources."""
    text = resources.files(__package__).joinpath('references.json').read_text()
    result: dict[str, Any] = json.loads(text)
    return result


def point_load(model: ShellModel, vertex: int, axis: Array) -> ContactPatch:
    """A point force at the limit position of a vertex, as the classical problems ask for."""
    mesh = model.shell.mesh
    triangle, parameters = vertex_parameters(mesh.triangles, mesh.active, np.array([vertex]))
    rows = basis_rows(mesh, triangle, parameters)
    values = np.zeros(len(mesh.vertices))
    np.add.at(values, rows.nodes, rows.values)
    point = LimitSurface(mesh).evaluate(mesh.vertices, triangle, parameters).position[0]
    return ContactPatch(
        point=point,
        axis=np.asarray(axis, float) / np.linalg.norm(axis),
        radius=1.0,
        centre=values,
        spread=values,
        moments=np.zeros((len(values), 3)),
        inertia=1.0,
    )


def used_vertices(model: ShellModel) -> int:
    """Control points that carry the surface."""
    return len(np.unique(model.shell.nodes))
