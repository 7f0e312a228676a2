# SPDX-License-Identifier: Apache-2.0
"""How rigid pads press on a discretised shell: pressure, force, tangent.

The middle surface stays half a wall away from a pad (where the two touch, that is the outer face
on the pad), and where it does the pad pushes along its own normal; it never pulls, and there is no
friction. At every quadrature point the pressure is p = max(0, l - e g) with gap g, stiffness e and
multiplier l: the augmented Lagrangian, whose first pass is a penalty and whose later ones (l = the
last p) bring the penetration down to any wanted length. Source: J. C. Simo and T. A. Laursen,
Comput. Struct. 42:97 (1992), doi:10.1016/0045-7949(92)90540-G.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.contact.depth_of_force import depth_of_force
from shell_deform.contact.pads import Pad, gap
from shell_deform.surface.limit import LimitSurface

Array = NDArray[np.float64]

# Stiffness of the contact over that of the wall around one control point: in the first pass,
# soft enough for Newton's method to find who touches; and in the last.
FIRST_STIFFNESS, LAST_STIFFNESS = 10.0, 300.0


@dataclass(frozen=True)
class Press:
    """What k pads do to a shell at one state; N = 3 n dofs.

    Attributes:
        gradient: (n, 3) minus the nodal forces of the contacts [N].
        force: push of each pad along its axis [N]. depth: of each pad [m]; both for all contacts
            of the load case, those that are no pads as they were given.
        pressure: (k, p) contact pressure at the quadrature points [Pa].
        stiffness: (p, 3, 3) its part per point [N/m], already weighted.
        rows: (N, f), corner: (f,) how the depths of the f forced pads that touch take part:
            eliminating them from [[K, rows], [rows^T, corner]] gives the stiffness at given force.
        touching: (f,) which contacts those are. missing: what the push of each contact lacks of
            its prescribed force [N].
    """

    gradient: Array
    force: Array
    depth: Array
    pressure: Array
    stiffness: Array
    rows: Array
    corner: Array
    touching: NDArray[np.int64]
    missing: Array

    def eliminated(self, now: Press) -> Array:
        """(N,) nodal forces of `now.missing` when this tangent's depths are eliminated."""
        return np.asarray(self.rows @ (now.missing[self.touching] / self.corner))

    def follow(self, now: Press, step: Array) -> Array:
        """Depths of all contacts after the control points moved by `step` (N,) from `now`."""
        depth = now.depth.copy()
        depth[self.touching] += (now.missing[self.touching] - self.rows.T @ step) / self.corner
        return depth


@dataclass(frozen=True)
class PadField:
    """Pads against one discretised shell.

    Attributes:
        pads: k pads. contacts: (k,) their numbers among all contacts of a load case.
        driven: (k,) whether the depth is prescribed, else the force. shell: the discretisation.
        matrix: (p, n) from control points to quadrature points.
        stiffness: (p,) of the contact [Pa/m]. multipliers: (k, p) pressures known so far [Pa].
    """

    pads: tuple[Pad, ...]
    contacts: NDArray[np.int64]
    driven: NDArray[np.bool_]
    shell: Discretisation
    matrix: sp.csr_matrix
    stiffness: Array
    multipliers: Array

    def start(self, moved: Array, displacement: Array) -> Array:
        """Depth of every contact to start from: as prescribed, else where the pad is now."""
        depth = np.array(displacement, dtype=float)
        driven = self.contacts[self.driven]
        depth[driven] = moved[driven]
        return depth

    def press(self, positions: Array, depth: Array, force: Array) -> Press:
        """Pads on control positions (n, 3): driven ones at `depth` [m], others at `force` [N].

        Both are given for all contacts. A forced pad is taken at `depth` as well, and tells what
        its push lacks; only where it would not touch is it first moved until it carries its force.
        """
        points = self.matrix @ positions
        count = len(self.pads)
        weights, wall = self.shell.weights, 0.5 * self.shell.thickness
        gradient = np.zeros_like(positions)
        forces, depths = np.array(force, dtype=float), np.array(depth, dtype=float)
        pressures = np.zeros((count, len(points)))
        stiffness = np.zeros((len(points), 3, 3))
        rows, corner, touching, missing = [], [], [], np.zeros_like(depths)
        for k, pad in enumerate(self.pads):
            c = self.contacts[k]
            there = gap(pad, float(depths[c]), points)
            pressure = self._pressure(k, there.value - wall)
            if not self.driven[k] and not np.any(pressure > 0.0):
                depths[c] = self._depth(k, points, float(depths[c]), float(force[c]))
                there = gap(pad, float(depths[c]), points)
                pressure = self._pressure(k, there.value - wall)
            pressures[k] = pressure
            push = weights * pressure
            slope = there.normal @ pad.axis
            forces[c] = float(push @ slope)
            gradient -= self.matrix.T @ (push[:, None] * there.normal)
            active = np.flatnonzero(pressure > 0.0)
            hard = weights * self.stiffness
            stiffness[active] += (
                np.einsum('p,pi,pj->pij', hard[active], there.normal[active], there.normal[active])
                - push[active, None, None] * there.hessian()[active]
            )
            if self.driven[k] or not len(active):
                continue
            bent = there.hessian_times(pad.axis)
            mixed = np.zeros_like(points)
            mixed[active] = (push[:, None] * bent - (hard * slope)[:, None] * there.normal)[active]
            rows.append(np.asarray(self.matrix.T @ mixed).reshape(-1))
            corner.append(float(np.sum((hard * slope**2 - push * (bent @ pad.axis))[active])))
            touching.append(c)
            missing[c] = force[c] - forces[c]
        size = positions.size
        return Press(
            gradient,
            forces,
            depths,
            pressures,
            stiffness,
            np.stack(rows, axis=1) if rows else np.zeros((size, 0)),
            np.array(corner),
            np.array(touching, dtype=np.int64),
            missing,
        )

    def augmented(self, press: Press, stiffer: float = 1.0) -> PadField:
        """The field whose multipliers are the pressures found, `stiffer` times as stiff."""
        return replace(self, multipliers=press.pressure, stiffness=stiffer * self.stiffness)

    def penetration(self, press: Press) -> float:
        """How far [m] the multipliers are from the pressures: what augmenting would move."""
        return float(np.max(np.abs(press.pressure - self.multipliers) / self.stiffness))

    def _pressure(self, k: int, clear: Array) -> Array:
        return np.maximum(0.0, self.multipliers[k] - self.stiffness * clear)

    def _depth(self, k: int, points: Array, start: float, force: float) -> float:
        """Depth [m] at which pad k pushes with `force` [N] on a surface that does not yield."""
        pad, wall = self.pads[k], 0.5 * self.shell.thickness
        weights = self.shell.weights

        def excess(depth: float) -> tuple[float, float]:
            there = gap(pad, depth, points)
            pressure = self._pressure(k, there.value - wall)
            slope = there.normal @ pad.axis
            active = pressure > 0.0
            rate = self.stiffness * slope**2 - pressure * (
                there.bend * (there.along @ pad.axis) ** 2
            )
            return (
                float(weights @ (pressure * slope)) - force,
                float(np.sum((weights * rate)[active])),
            )

        return depth_of_force(excess, start, force, float(np.ptp(points, axis=0).max()))


def pad_field(
    shell: Discretisation,
    surface: LimitSurface,
    pads: dict[int, Pad],
    driven: NDArray[np.bool_],
) -> PadField | None:
    """Pads by contact number against a shell on its limit surface, without pressure yet.

    `driven`: for all contacts, whether the displacement is prescribed. None without pads.
    """
    if not pads:
        return None
    contacts = np.array(sorted(pads), dtype=np.int64)
    rest = shell.mesh.vertices
    matrix = shell.value_matrix()
    area = np.maximum(np.asarray(matrix.T @ shell.weights), 1e-30)
    normals = surface.vertex_normals(rest)
    size = len(normals)
    outward = sp.csr_matrix(
        (normals.ravel(), np.arange(3 * size), np.arange(0, 3 * size + 1, 3)),
        shape=(size, 3 * size),
    )
    values = shell.tangent('koiter', rest)[2]
    own = (outward @ shell.pattern.matrix(values) @ outward.T).diagonal()
    stiffness = FIRST_STIFFNESS * np.asarray(matrix @ (np.maximum(own, 0.0) / area))
    return PadField(
        tuple(pads[int(c)] for c in contacts),
        contacts,
        driven[contacts],
        shell,
        matrix,
        stiffness,
        np.zeros((len(pads), len(stiffness))),
    )


def add_point_blocks(shell: Discretisation, blocks: Array, data: Array) -> None:
    """Add value-by-value stiffness blocks (p, 3, 3) at the quadrature points to CSR values.

    Points whose block is zero, nearly all of them, cost nothing.
    """
    points = np.flatnonzero(np.any(blocks != 0.0, axis=(1, 2)))
    element = np.searchsorted(shell.point_offsets, points, side='right') - 1
    sizes = np.diff(shell.node_offsets)[element]
    pattern = shell.pattern
    for size in np.unique(sizes).tolist():
        chosen = np.flatnonzero(sizes == size)
        own, at = element[chosen], points[chosen]
        nodes = shell.nodes[shell.node_offsets[own][:, None] + np.arange(size)]
        values = shell.values[shell.row_offsets[at][:, None] + np.arange(size)]
        start = pattern.block_start[
            pattern.block_offsets[own][:, None, None]
            + size * np.arange(size)[:, None]
            + np.arange(size)
        ]
        row = pattern.row_length[nodes][:, :, None, None, None] * np.arange(3)[:, None]
        where = start[..., None, None] + row + np.arange(3)
        entries = np.einsum('pk,pl,pij->pklij', values, values, blocks[at])
        data += np.bincount(where.ravel(), entries.ravel(), len(data))
