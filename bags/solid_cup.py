# SPDX-License-Identifier: Apache-2.0
"""A free-form plastic cup gripped off its axis: half of it as a thin neo-Hooke solid.

The cup stands on z = 0 with its foot clamped; its wall follows a curved profile, its rim is free.
Two pins press along the local normals at +-`azimuth` from the x axis: not opposite each other, so
nothing but the foot balances them. The plane y = 0 is a mirror. Lengths in mm, forces in N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from bags import calculix, hexahedra, solid_shell
from bags.calculix import Array
from bags.hexahedra import Patch
from bags.solid_shell import Contact, Model


@dataclass(frozen=True)
class Cup:
    """A cup (mm, MPa): outer profile, wall, polypropylene, where the pins press."""

    profile_r: tuple[float, ...] = (26.0, 27.2, 30.0, 31.5, 31.0, 32.5, 36.0)
    profile_z: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    thickness: float = 0.4
    young_modulus: float = 1300.0
    poisson_ratio: float = 0.4
    azimuth_deg: float = 75.0
    contact_z: float = 66.0
    pin_radius: float = 1.0
    finest: float = 0.4
    coarsest: float = 4.0
    growth: float = 1.25


def profile(cup: Cup) -> CubicSpline:
    """Outer radius over height: the natural spline through the given points."""
    return CubicSpline(cup.profile_z, cup.profile_r, bc_type='natural')


def _around(total: float, at: float, cup: Cup) -> Array:
    """Edges from 0 to `total`, finest about `at`, mirrored growth to both sides."""
    below = at - hexahedra.graded(at, cup.finest, cup.coarsest, cup.growth)[::-1]
    above = at + hexahedra.graded(total - at, cup.finest, cup.coarsest, cup.growth)
    return np.concatenate([below, above[1:]])


def model(cup: Cup) -> Model:
    """The half y >= 0 with one of the two pins."""
    outline = profile(cup)
    azimuth = np.radians(cup.azimuth_deg)
    mean = float(outline(cup.contact_z))
    around = hexahedra.with_midpoints(_around(np.pi * mean, azimuth * mean, cup)) / mean
    up = hexahedra.with_midpoints(_around(cup.profile_z[-1], cup.contact_z, cup))
    angle, height = np.meshgrid(around, up, indexing='ij')
    radius, slope = outline(height), outline(height, 1)
    length = np.hypot(1.0, slope)
    normals = np.stack([np.cos(angle) / length, np.sin(angle) / length, -slope / length], axis=-1)
    outer = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    solid = hexahedra.build(
        [Patch(outer - cup.thickness / 2 * normals, normals)], cup.thickness, 1
    )
    foot = _foot(solid, float(outline(0.0)), float(outline(0.0, 1)), cup.thickness)
    fixed = [(node, axis) for node in foot for axis in (1, 2, 3)]
    fixed += [(node, 2) for node in solid_shell.symmetric(solid, [0.0, 1.0, 0.0])]
    tilt = float(outline(cup.contact_z, 1))
    normal = np.array([np.cos(azimuth), np.sin(azimuth), -tilt]) / np.hypot(1.0, tilt)
    centre = (mean * np.cos(azimuth), mean * np.sin(azimuth), cup.contact_z)
    return Model(
        f'plastic cup, height {cup.profile_z[-1]} mm, wall {cup.thickness} mm, foot clamped, '
        f'two pins {2 * cup.azimuth_deg} degrees apart at height {cup.contact_z} mm',
        solid,
        calculix.neo_hooke(cup.young_modulus, cup.poisson_ratio),
        (Contact(centre, tuple(-normal), cup.pin_radius),),
        tuple(fixed),
        sectors=2,
        meta={
            'material': 'neo-Hooke',
            'young_modulus_pa': cup.young_modulus * 1e6,
            'poisson_ratio': cup.poisson_ratio,
            'gas': 'none (open at the rim)',
            'symmetry': 'half: mirror plane y = 0, the second pin at its mirror image',
            'supports': 'foot (the edge at z = 0) clamped, rim free',
            'outer_profile_rz_m': [
                [round(float(outline(z)) * 1e-3, 9), round(float(z) * 1e-3, 9)]
                for z in np.linspace(0.0, cup.profile_z[-1], 46)
            ],
        },
    )


def _foot(solid: hexahedra.Solid, radius: float, slope: float, thickness: float) -> list[int]:
    """Nodes on the end face of the wall at the foot: on the normal through the outer edge."""
    length = np.hypot(1.0, slope)
    distance = np.hypot(*solid.positions[:, :2].T)
    # Height of the end face over the distance from the axis: it is square to the wall.
    expected = (radius - distance) * slope
    near = abs(distance - radius) < thickness * 1.01 / length + 1e-6
    return (np.flatnonzero(near & (abs(solid.positions[:, 2] - expected) < 1e-4)) + 1).tolist()


def off_axis_cup() -> None:
    """The cup of the recordings, up to 7 N a finger."""
    forces = np.array([0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0])
    solid_shell.keep(solid_shell.solve(model(Cup()), forces), 'off_axis_cup')
