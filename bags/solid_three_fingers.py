# SPDX-License-Identifier: Apache-2.0
"""The ball under three pins 120 degrees apart on its equator: a twelfth of it as a solid.

The sector lies between the mirror planes y = 0 (through the first contact, on +x), 60 degrees
from it, and z = 0. Lengths in mm, forces in N, pressures in MPa.

`python -m bags.solid_three_fingers` puts two fingers on an eighth of the same mesh and prints how
far they go in beside the axisymmetric solid, with two and four elements through the wall (needs
ccx, five minutes).
"""

from __future__ import annotations

import json

import numpy as np

from bags import calculix, hexahedra, solid_shell
from bags.axisymmetric import Ball, ball_of
from bags.calculix import Array
from bags.hexahedra import Patch
from bags.solid_shell import Contact, Model

CHECKED_N = (6.0, 12.0, 16.502902192616453)
"""Kept forces of the two-finger ball at which its mesh is checked."""


def sector_patches(
    radius: float, finest: float, growth: float, rest: int, angle: float = np.pi / 3
) -> list[Patch]:
    """Three quadrilateral patches on the sector of this angle, refined towards the contact."""
    contact = np.array([1.0, 0.0, 0.0])
    side = np.array([np.cos(angle), np.sin(angle), 0.0])
    pole = np.array([0.0, 0.0, 1.0])
    middle = hexahedra.unit(contact + side + pole)
    contact_side, side_pole, contact_pole = (
        hexahedra.unit(contact + side),
        hexahedra.unit(side + pole),
        hexahedra.unit(contact + pole),
    )
    largest = 3.5
    along_side = _fractions(radius * angle / 2, finest, largest, growth)
    along_pole = _fractions(radius * np.pi / 4, finest, largest, growth)
    even = hexahedra.with_midpoints(np.linspace(0.0, 1.0, rest + 1))
    return [
        hexahedra.spherical_patch(
            radius, (contact, contact_side, middle, contact_pole), along_side, along_pole
        ),
        hexahedra.spherical_patch(
            radius, (contact_side, side, side_pole, middle), even, along_pole
        ),
        hexahedra.spherical_patch(
            radius, (contact_pole, middle, side_pole, pole), along_side, even
        ),
    ]


def _fractions(length: float, finest: float, largest: float, growth: float) -> Array:
    return hexahedra.with_midpoints(hexahedra.graded(length, finest, largest, growth)) / length


def model(
    ball: Ball, finest: float = 0.3, growth: float = 1.16, layers: int = 2, fingers: int = 3
) -> Model:
    """The sector with its three mirror planes, pin on the outer face, rubber of `ball`.

    `fingers`: two or three, all around the equator.
    """
    radius, angle = ball.outer_radius - ball.thickness / 2, np.pi / fingers
    patches = sector_patches(radius, finest, growth, 6, angle)
    solid = hexahedra.build(patches, ball.thickness, layers)
    slanted = np.array([-np.sin(angle), np.cos(angle), 0.0])
    on_axis = np.flatnonzero(np.hypot(*solid.positions[:, :2].T) < 1e-5) + 1
    fixed = [(node, 2) for node in solid_shell.symmetric(solid, [0.0, 1.0, 0.0])]
    fixed += [(node, 3) for node in solid_shell.symmetric(solid, [0.0, 0.0, 1.0])]
    fixed += [(int(node), axis) for node in on_axis for axis in (1, 2)]
    mirrored = sorted(set(solid_shell.symmetric(solid, slanted)) - set(on_axis.tolist()))
    equations = tuple(((node, 2, slanted[1]), (node, 1, slanted[0])) for node in mirrored)
    if fingers == 2:
        equations, fixed = (), fixed + [(node, 1) for node in mirrored]
    return Model(
        'tennis ball under three pins 120 degrees apart on the equator',
        solid,
        calculix.neo_hooke(ball.young_modulus, ball.poisson_ratio),
        (
            Contact(
                (ball.outer_radius, 0.0, 0.0), (-1.0, 0.0, 0.0), ball.pin_radius, 'rigid', 0.25
            ),
        ),
        tuple(fixed),
        equations,
        sectors=4 * fingers,
        gas_centre=(0.0, 0.0, 0.0),
        meta={
            'material': 'neo-Hooke',
            'young_modulus_pa': round(ball.young_modulus * 1e6, 1),
            'poisson_ratio': ball.poisson_ratio,
            'gas': 'ambient air 101325 Pa sealed in, isothermal, V0 inside the inner face',
            'symmetry': 'twelfth: mirror planes y = 0, 60 degrees about z from it, z = 0; '
            'three contacts 120 degrees apart about z',
        },
    )


def layered_ball(ball: Ball, kept: str, forces: Array, guess: Array) -> None:
    """The same with four elements through the wall, kept under another name.

    Two of them, as the recordings have them, let pins in too deep, see `main`. `guess`: gas
    pressures [MPa] at the `forces` [N].
    """
    solid_shell.keep(
        solid_shell.solve_sealed(model(ball, layers=4), forces, guess, timeout=5400.0), kept
    )


def three_finger_ball(ball: Ball) -> None:
    """The three-finger ball of the recordings, up to 18 N a finger."""
    forces = np.array([1.0, 2.5, 4.0, 5.5, 7.0, 8.5, 10.0, 11.5, 13.0, 14.5, 16.0, 18.0])
    # Half again what two fingers press out of the ball, from its axisymmetric solution.
    guess = 1.5 * 8.0e-6 * forces**2
    solid_shell.keep(solid_shell.solve_sealed(model(ball), forces, guess), 'ball_three_finger')


def main() -> int:
    """Print how far two fingers go into this mesh beside the axisymmetric solid."""
    told = json.loads((solid_shell.FOLDER / 'ball_two_finger.json').read_text())
    levels = {level['force_n']: level for level in told['levels']}
    ball = ball_of(told)
    gas = np.array([1e-6 * levels[force]['gas_gauge_pressure_pa'] for force in CHECKED_N])
    for layers in (2, 4):
        pressed = model(ball, layers=layers, fingers=2)
        found = solid_shell.solve(pressed, np.array(CHECKED_N), gas, timeout=5400.0)
        for force, moved in zip(CHECKED_N, found.contact_displacements(0.0)[:, 0], strict=True):
            wanted = 1e3 * levels[force]['outer_displacement_m']
            print(
                f'{layers} layers, {force:.2f} N: {moved:.4f} mm, axisymmetric {wanted:.4f} mm, '
                f'{100.0 * (moved / wanted - 1.0):+.2f} %',
                flush=True,
            )
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
