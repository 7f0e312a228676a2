# SPDX-License-Identifier: Apache-2.0
"""The half soda can under one pin, as a thin St Venant solid: quarter model with symmetry.

Lengths in mm, forces in N. The axis of the can is z, its crown is at +y, its straight edges lie
at y = 0 and turn freely about their own line; the ends are free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bags import hexahedra, solid_shell
from bags.hexahedra import Patch
from bags.solid_shell import Contact, Model


@dataclass(frozen=True)
class HalfCan:
    """Half a can (mm, MPa): outer radius, length, wall, aluminium, pin, mesh sizes."""

    outer_radius: float = 33.0
    length: float = 120.0
    thickness: float = 0.1
    young_modulus: float = 69000.0
    poisson_ratio: float = 0.33
    pin_radius: float = 1.0
    finest: float = 0.35
    coarsest: float = 3.0
    growth: float = 1.13


def model(can: HalfCan) -> Model:
    """Quarter of the half can: angle from the crown 0..90 degrees, z from 0 to half the length."""
    radius = can.outer_radius - can.thickness / 2
    arc = hexahedra.graded(radius * np.pi / 2, can.finest, can.coarsest, can.growth)
    along = hexahedra.graded(can.length / 2, can.finest, can.coarsest, can.growth)
    # z before the angle: the local axes are then right-handed with the outward normal.
    height, angle = np.meshgrid(
        hexahedra.with_midpoints(along),
        hexahedra.with_midpoints(arc) / radius,
        indexing='ij',
    )
    normals = np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=-1)
    points = radius * normals + np.stack([0 * angle, 0 * angle, height], axis=-1)
    solid = hexahedra.build([Patch(points, normals)], can.thickness, 1)
    positions = solid.positions
    edge = np.flatnonzero(abs(solid.rest_normals[:, 1]) < 1e-6) + 1
    hinge = [int(n) for n in edge if abs(positions[n - 1, 0] - radius) < 1e-6]
    fixed = [(node, axis) for node in hinge for axis in (1, 2, 3)]
    fixed += [(node, 1) for node in solid_shell.symmetric(solid, [1.0, 0.0, 0.0])]
    fixed += [(node, 3) for node in solid_shell.symmetric(solid, [0.0, 0.0, 1.0])]
    return Model(
        f'half can, outer radius {can.outer_radius} mm, length {can.length} mm, wall '
        f'{can.thickness} mm, straight edges hinged, ends free',
        solid,
        f'*ELASTIC\n{can.young_modulus},{can.poisson_ratio}',
        (Contact((0.0, can.outer_radius, 0.0), (0.0, -1.0, 0.0), can.pin_radius, share=0.25),),
        tuple(fixed),
        tuple(_hinged_between(positions, hinge, edge)),
        sectors=4,
        meta={
            'material': 'St Venant-Kirchhoff',
            'young_modulus_pa': can.young_modulus * 1e6,
            'poisson_ratio': can.poisson_ratio,
            'gas': 'none',
            'symmetry': 'quarter: mirror planes x = 0 and z = 0',
            'supports': 'straight edges (y = 0) hinged on the middle line, ends free',
        },
    )


def _hinged_between(
    positions: np.ndarray, hinge: list[int], edge: np.ndarray
) -> list[tuple[tuple[int, int, float], ...]]:
    """Between the hinged corners, nodes exist only on the two faces: their mean stays put."""
    held = {round(positions[node - 1, 2] * 1e5) for node in hinge}
    by_height: dict[int, list[int]] = {}
    for node in edge.tolist():
        by_height.setdefault(round(positions[node - 1, 2] * 1e5), []).append(node)
    pairs = [nodes for height, nodes in by_height.items() if height not in held]
    return [((a, axis, 1.0), (b, axis, 1.0)) for a, b in pairs for axis in (1, 2, 3)]


def half_soda_can() -> None:
    """The can of the recordings, up to 1.2 N, the published 0.756 N among the loads."""
    can = model(HalfCan())
    linear = solid_shell.solve(can, np.array([0.01]), nonlinear=False)
    slope = float(linear.contact_displacements(0.5)[0, 0]) / 0.01
    can.meta['linear_middle_displacement_per_newton_m'] = round(slope * 1e-3, 9)
    forces = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.756197674594285, 0.85, 1.0, 1.2])
    solid_shell.keep(solid_shell.solve(can, forces), 'half_soda_can')
