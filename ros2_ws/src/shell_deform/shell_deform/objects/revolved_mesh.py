# SPDX-License-Identifier: Apache-2.0
"""Control meshes of surfaces of revolution, with sharp edges kept and poles capped."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..surface.control_mesh import ControlMesh, control_mesh
from .profile import Piece
from .rings import RingMesh, ring_count_with_caps, ring_mesh, row_height

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LARGEST_STRETCH = 1.3
"""How far rows may differ in height from equilateral triangles."""


@dataclass(frozen=True)
class _Section:
    """How one piece is divided; conformal height = height in the ring mesh + offset."""

    around: int
    rows: int
    spacing: float
    offset: float
    lower_cap: bool
    upper_cap: bool

    @property
    def count(self) -> int:
        """Number of vertices."""
        caps = int(self.lower_cap) + int(self.upper_cap)
        if caps == 0:
            return self.around * (self.rows + 1)
        return ring_count_with_caps(self.around // 6, self.rows, caps)

    def mesh(self) -> RingMesh:
        """Its rings."""
        return ring_mesh(self.around, self.rows, self.spacing, self.lower_cap, self.upper_cap)


def revolved_mesh(
    pieces: list[Piece], vertices: int, lower_edge: float | None, upper_edge: float | None
) -> ControlMesh:
    """Triangulate a surface of revolution; vertices lie on it.

    Args:
        pieces: meridian, from below.
        vertices: about how many vertices to use.
        lower_edge, upper_edge: wanted edge lengths at the poles [m]; None for triangles of
            about one size.
    """
    has_pole = pieces[0].starts_on_axis() or pieces[-1].ends_on_axis()
    first, step = (12, 6) if has_pole else (6, 1)
    best: tuple[float, list[_Section]] | None = None
    for around in range(first, max(first + 1, 6 * round(math.sqrt(vertices))), step):
        sections = [
            _section(
                piece,
                around,
                lower_edge if number == 0 else None,
                upper_edge if number == len(pieces) - 1 else None,
            )
            for number, piece in enumerate(pieces)
        ]
        count = sum(section.count for section in sections) - around * (len(pieces) - 1)
        missed = abs(math.log(count / vertices))
        if best is None or missed < best[0]:
            best = missed, sections
    assert best is not None
    return _assembled(pieces, best[1])


def _section(
    piece: Piece, around: int, lower_edge: float | None, upper_edge: float | None
) -> _Section:
    even = row_height(around)
    lower, upper = piece.starts_on_axis(), piece.ends_on_axis()
    table, arc = piece.arc_of_height()
    widest = float(piece.curve(np.linspace(0.0, piece.length, 200))[:, 0].max())
    usual = 2.0 * math.pi * widest / around
    bottom, top = float(table[0]), float(table[-1])
    cap = math.log(around / 6.0)
    if lower:
        bottom = float(np.interp(lower_edge or usual, arc, table)) + cap
    if upper:
        top = float(np.interp(piece.length - (upper_edge or usual), arc, table)) - cap
    rows = max(0 if lower != upper else 1, round((top - bottom) / even))
    spacing = (top - bottom) / rows if rows else even
    if lower or upper:
        spacing = min(max(spacing, even / LARGEST_STRETCH), LARGEST_STRETCH * even)
    middle = 0.5 * (bottom + top - rows * spacing)
    offset = middle if lower == upper else (top - rows * spacing if lower else bottom)
    return _Section(around, rows, spacing, offset, lower, upper)


def _assembled(pieces: list[Piece], sections: list[_Section]) -> ControlMesh:
    points: list[FloatArray] = []
    faces: list[IntArray] = []
    creases: list[IntArray] = []
    turn, count = 0.0, 0
    shared: IntArray | None = None
    for piece, section in zip(pieces, sections, strict=True):
        mesh, rows = section.mesh(), section.rows
        place = _placed(piece, mesh, rows, section.offset)
        longitude = mesh.longitude + turn
        own = np.full(len(place), -1, dtype=np.int64)
        if shared is not None:
            own[mesh.row == 0] = shared
            creases.append(np.column_stack([shared, np.roll(shared, -1)]))
        fresh = own < 0
        own[fresh] = count + np.arange(int(fresh.sum()))
        count += int(fresh.sum())
        east = np.column_stack([np.cos(longitude), np.sin(longitude)])
        points.append(np.column_stack([place[:, :1] * east, place[:, 1]])[fresh])
        faces.append(own[mesh.triangles])
        shared = own[mesh.row == rows]
        turn += math.pi * (rows % 2) / section.around
    edges = np.concatenate(creases) if creases else None
    return control_mesh(np.concatenate(points), np.concatenate(faces), edges, corners=[])


def _placed(piece: Piece, mesh: RingMesh, rows: int, offset: float) -> FloatArray:
    """(n, 2) places (r, z) of the vertices; rings at a fixed end lie exactly there."""
    table, arc = piece.arc_of_height()
    height = mesh.height + offset
    share = np.interp(height, table, arc)
    low, high = height < table[0], height > table[-1]
    if piece.starts_on_axis():
        share[low] = arc[0] * np.exp(height[low] - table[0])
    else:
        share[mesh.row == 0] = 0.0
    if piece.ends_on_axis():
        share[high] = piece.length - (piece.length - arc[-1]) * np.exp(table[-1] - height[high])
    else:
        share[mesh.row == rows] = piece.length
    return piece.curve(share)
