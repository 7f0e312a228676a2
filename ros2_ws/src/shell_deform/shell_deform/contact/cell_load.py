# SPDX-License-Identifier: Apache-2.0
"""Measured touch cells as the shape of a load.

A rigid body decides by contact where it presses. A finger with a soft cover, or one whose pose is
not known well, is better served by what its own cells measured: the push then lies over the cells
in the shares that they felt, evenly over each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shell_deform.contact.loads import ContactPatch
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import basis_rows

Array = NDArray[np.float64]

FAINTEST = 0.02
"""Cells below this share of the strongest one are noise, not load."""

NOISE = 4.0
"""Nor are cells load that push by less than so many times what a quarter of all pull by."""

POINTS_PER_SIDE = 3
"""The push of a cell lies in so many points squared."""


def cell_pitch(cells: Array) -> float:
    """Width of cells with centres (c, 3) [m]: how far the next one is; 0 for a single one."""
    if len(cells) < 2:
        return 0.0
    return float(np.median(cKDTree(cells).query(cells, 2)[0][:, 1]))


def square_parts(per_side: int) -> Array:
    """(per_side^2, 3) centres of equal parts of the unit square about 0, in the plane z = 0."""
    side = (np.arange(per_side) + 0.5) / per_side - 0.5
    x, y = (grid.ravel() for grid in np.meshgrid(side, side))
    return np.column_stack([x, y, np.zeros_like(x)])


@dataclass(frozen=True)
class CellShape:
    """How the push of one finger lies on its c touch cells.

    Attributes:
        cells: (c, 3) centres in the frame of the finger [m]. shares: (c,) of the push, sum 1.
    """

    cells: Array
    shares: Array

    def differs(self, other: CellShape) -> float:
        """Share of the push that lies on other cells."""
        if len(self.shares) != len(other.shares):
            return 1.0
        return 0.5 * float(np.abs(self.shares - other.shares).sum())


def cell_shares(forces: Array) -> Array:
    """(c,) shares of the push among cells that measured `forces` (c,) [N]; all 0 where none did.

    Cells only push: what pulls is noise, and tells how large that is where many do; what is not
    much larger, or faint beside the strongest, is noise, too.
    """
    noise = NOISE * max(0.0, -float(np.percentile(forces, 25.0))) if len(forces) else 0.0
    felt = np.where(forces > max(FAINTEST * forces.max(initial=0.0), noise), forces, 0.0)
    total = float(felt.sum())
    return felt / total if total > 0.0 else felt


def shaped_by_cells(
    patch: ContactPatch,
    surface: LimitSurface,
    control: Array,
    frame: tuple[Array, Array],
    shape: CellShape,
) -> ContactPatch:
    """The patch with its push where touch cells feel it; its centre stays what is measured.

    Args:
        patch: at the place where the finger touches.
        control: (n, 3) control points of the shell that the finger touches now [m].
        frame: origin (3,) of the finger [m], and its axes (3, 3) in columns.
        shape: what its cells felt.
    """
    origin, axes = frame
    cells, shares = shape.cells, shape.shares
    loaded = np.flatnonzero(shares > 0.0)
    within = (cell_pitch(cells) or patch.radius) * square_parts(POINTS_PER_SIDE)
    places = (cells[loaded, None] + within).reshape(-1, 3) @ axes.T + origin
    weight = np.repeat(shares[loaded] / len(within), len(within))
    found = surface.closest_point(control, places)
    rest = surface.evaluate(surface.mesh.vertices, found.triangle, found.parameters).position
    rows = basis_rows(surface.mesh, found.triangle, found.parameters)
    row_of = np.repeat(np.arange(len(weight)), np.diff(rows.node_offsets))
    weighted = weight[row_of] * rows.values
    spread, moments = np.zeros_like(patch.spread), np.zeros_like(patch.moments)
    np.add.at(spread, rows.nodes, weighted)
    offset = rest - weight @ rest
    np.add.at(moments, rows.nodes, weighted[:, None] * offset[row_of])
    across = offset - np.outer(offset @ patch.axis, patch.axis)
    inertia = float(weight @ np.einsum('pi,pi->p', across, across))
    return replace(patch, spread=spread, moments=moments, inertia=inertia)
