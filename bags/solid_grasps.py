# SPDX-License-Identifier: Apache-2.0
"""A ball between two pins off its axis, as a solid: what their contacts turn to as they close.

Both pins stand `lean` off the normal on the same side and close along x. The planes x = 0 and
z = 0 are mirrors: a quarter with one pin. What must hold the pins sideways adds up to zero.
Lengths in mm, forces in N, pressures in MPa inside; results are kept in SI units.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bags import calculix, hexahedra, solid_shell
from bags.axisymmetric import Ball
from bags.calculix import Array
from bags.hexahedra import Patch, Solid
from bags.solid_shell import Contact, Model

KEPT = (
    Path(__file__).parents[1]
    / 'ros2_ws/src/shell_deform/shell_deform/verification/solid_grasps.json'
)
BALL = Ball(thickness=2.5, young_modulus=12.75, poisson_ratio=0.49, pin_radius=2.0)
"""Without air, so that one history of forces is one run."""

MAPPED_FORCES = (5.0, 9.0, 11.0)
"""Past the 2 mm of the map's grasps [N]."""
DEEP_FORCES = {
    'rigid': (4.0, 8.0, 11.0, 13.0, 15.0, 16.0, 17.0, 18.0, 19.0, 19.7, 20.4, 21.0),
    'traction': (0.05, 2.0, 4.0, 6.0, 8.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0),
}
"""To 10 mm under a rigid pin end [N], to 7 or 8 mm under an even dead traction."""
DEEP = [(kind, lean) for lean in (25.0, 15.0) for kind in DEEP_FORCES]
NUMBER = 50


@dataclass(frozen=True)
class Mesh:
    """Element sizes [mm]: under the pin, growth from there, the largest; layers in the wall."""

    finest: float = 0.6
    growth: float = 1.3
    largest: float = 4.0
    layers: int = 2


def patches(radius: float, lean: float, mesh: Mesh) -> list[Patch]:
    """Six quadrilateral patches on the quarter, refined towards the contact on its edge z = 0."""
    contact = np.array([np.cos(lean), np.sin(lean), 0.0])
    pole = np.array([0.0, 0.0, 1.0])
    found = []
    for sign in (1.0, -1.0):
        side = np.array([0.0, sign, 0.0])
        to_side, to_pole = hexahedra.unit(contact + side), hexahedra.unit(contact + pole)
        middle, between = hexahedra.unit(contact + side + pole), hexahedra.unit(side + pole)
        along_side = _fractions(radius * float(np.arccos(contact @ side)) / 2.0, mesh)
        along_pole = _fractions(radius * np.pi / 4.0, mesh)
        even = hexahedra.with_midpoints(np.linspace(0.0, 1.0, 6))
        three = [
            ((contact, to_side, middle, to_pole), along_side, along_pole),
            ((to_side, side, between, middle), even, along_pole),
            ((to_pole, middle, between, pole), along_side, even),
        ]
        for (a, b, c, d), first, second in three:
            # Turned so that the normal of every patch points outward.
            turned = sign > 0.0
            corners = (a, b, c, d) if turned else (a, d, c, b)
            found.append(
                hexahedra.spherical_patch(
                    radius, corners, *((first, second) if turned else (second, first))
                )
            )
    return found


def _fractions(length: float, mesh: Mesh) -> Array:
    edges = hexahedra.graded(length, mesh.finest, mesh.largest, mesh.growth)
    return hexahedra.with_midpoints(edges) / length


def model(ball: Ball, lean: float, mesh: Mesh) -> Model:
    """The quarter with its pin: `ball.pin` traction, or rigid and free to tilt in the plane."""
    solid = hexahedra.build(
        patches(ball.outer_radius - ball.thickness / 2, lean, mesh), ball.thickness, mesh.layers
    )
    fixed = [(node, 1) for node in solid_shell.symmetric(solid, [1.0, 0.0, 0.0])]
    fixed += [(node, 3) for node in solid_shell.symmetric(solid, [0.0, 0.0, 1.0])]
    # Nothing pushes along y; one node keeps the ball from drifting.
    fixed.append((solid.near(np.array([0.0, 0.0, ball.outer_radius])) + 1, 2))
    at = ball.outer_radius * np.array([np.cos(lean), np.sin(lean), 0.0])
    pin = Contact(tuple(at), (-1.0, 0.0, 0.0), ball.pin_radius, 'traction', 0.5)
    equations: tuple[tuple[tuple[int, int, float], ...], ...] = ()
    if ball.pin == 'rigid':
        equations = tilting(solid, at, ball.pin_radius)
        # All of the force on the centre: the equations spread it.
        pin = replace(pin, kind='rigid', radius=1e-3)
    return Model(
        f'ball between two pins {np.degrees(lean):.2f} degrees off the normal', solid,
        calculix.neo_hooke(ball.young_modulus, ball.poisson_ratio), (pin,), tuple(fixed),
        equations, sectors=4,
    )  # fmt: skip


def tilting(
    solid: Solid, at: Array, radius: float
) -> tuple[tuple[tuple[int, int, float], ...], ...]:
    """Outer nodes within `radius` of `at` move along x as a plate that may tilt about z."""
    outer = np.unique(solid.outer)
    places = solid.positions[outer - 1]
    under = np.linalg.norm(places - at, axis=1) <= 1.0001 * radius
    nodes, arm = outer[under], places[under, 1] - at[1]
    centre = int(np.argmin(np.linalg.norm(places[under] - at, axis=1)))
    far = int(np.argmax(np.abs(arm)))
    found = []
    for i, node in enumerate(nodes.tolist()):
        if i in (centre, far):
            continue
        share = arm[i] / arm[far]
        terms = [(node, 1, 1.0), (int(nodes[centre]), 1, share - 1.0)]
        if abs(share) > 1e-12:
            terms.append((int(nodes[far]), 1, -share))
        found.append(tuple(terms))
    return tuple(found)


def outward_at(solid: Solid, positions: Array, node: int) -> Array:
    """Unit normal (3,) of the outer face at a corner node: the mean of the faces around it."""
    corner_a, corner_b = [-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]
    total = np.zeros(3)
    for face in solid.outer:
        where = np.flatnonzero(face[:4] == node)
        if len(where):
            _, slopes_a, slopes_b = hexahedra.face_shapes(
                np.array([corner_a[where[0]]]), np.array([corner_b[where[0]]])
            )
            corners = positions[face - 1]
            total += hexahedra.unit(np.cross(slopes_a[:, 0] @ corners, slopes_b[:, 0] @ corners))
    total[2] = 0.0
    return hexahedra.unit(total)


def record(ball: Ball, lean: float, forces: tuple[float, ...], mesh: Mesh) -> dict[str, object]:
    """States of one grasp, SI: push, depth at mid-thickness, contact, how far its normal leans."""
    history = solid_shell.solve(model(ball, lean, mesh), np.array(forces), timeout=3000.0)
    solid = history.model.solid
    at = ball.outer_radius * np.array([np.cos(lean), np.sin(lean), 0.0])
    node = solid.near(at) + 1
    depth = history.contact_displacements(0.5)[:, 0]
    levels = []
    for k, force in enumerate(forces):
        positions = solid.positions + history.displacements[k]
        normal = outward_at(solid, positions, node)
        levels.append(
            {
                'force_n': force,
                'depth_m': round(1e-3 * float(depth[k]), 9),
                'outer_depth_m': round(1e-3 * float(history.contact_displacements(0.0)[k, 0]), 9),
                'contact_m': np.round(1e-3 * positions[node - 1, :2], 8).tolist(),
                'middle_y_m': round(1e-3 * float(positions[:, 1].mean()), 8),
                'leans_rad': round(float(np.arctan2(normal[1], normal[0])), 7),
            }
        )
    return {
        'lean_rad': round(lean, 9), 'pin': ball.pin, 'elements': len(solid.elements),
        'levels': levels,
    }  # fmt: skip


def mapped_leans(number: int) -> list[float]:
    """Angles [rad] to the normal at which `grasp_map` lays the lines of its first grasps."""
    from shell_deform.building import build_model
    from shell_deform.grasp.sampling import sample_grasp
    from shell_deform.objects import load_object

    shell = replace(load_object('tennis_ball'), contacts=())
    model = build_model(shell)
    mesh = model.shell.mesh
    points = model.surface.limit_positions(model.rest)
    triangles = np.asarray(mesh.triangles[mesh.active], np.int64)
    leans = []
    for k in range(number):
        found = sample_grasp(points, triangles, 'two_pins', 0.35, (0, k))
        out = np.array([hexahedra.unit(point) for point in found.at])
        leans.append(float(np.arccos(-np.einsum('ki,ki->k', out, found.axis)).mean()))
    return leans


def main() -> None:
    """Solve what is not there yet, one solid after the other, or keep what is there."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('part', choices=('deep', 'mapped', 'keep'))
    part = parser.parse_args().part
    folder = Path(__file__).parents[1] / 'out' / 'solid_grasps'
    folder.mkdir(parents=True, exist_ok=True)
    if part == 'keep':
        keep(folder)
        return
    mesh = Mesh(0.5, 1.25, 3.0) if part == 'deep' else Mesh(1.0, 1.35, 5.0)
    jobs = [(f'deep_{kind}_{lean:g}', kind, np.radians(lean)) for kind, lean in DEEP]
    if part == 'mapped':
        jobs = [(f'mapped_{k:02d}', 'traction', x) for k, x in enumerate(mapped_leans(NUMBER))]
    for name, kind, lean in jobs:
        path = folder / f'{name}.json'
        if not path.is_file():
            forces = DEEP_FORCES[kind] if part == 'deep' else MAPPED_FORCES
            found = record(replace(BALL, pin=kind), float(lean), forces, mesh)
            path.write_text(json.dumps(found))
            print(name, flush=True)


def keep(folder: Path) -> None:
    """All solids of `folder` in one file."""
    parts = {
        name: [
            {'name': path.stem, **json.loads(path.read_text())}
            for path in sorted(folder.glob(f'{name}_*.json'))
        ]
        for name in ('deep', 'mapped')
    }
    kept = {
        'source': f'CalculiX CrunchiX {calculix.solver_version()}, C3D20R, neo-Hookean quarter of '
        'a ball between two pins that close along x, no air; made by bags/solid_grasps.py',
        'outer_radius_m': 1e-3 * BALL.outer_radius,
        'thickness_m': 1e-3 * BALL.thickness,
        'pin_radius_m': 1e-3 * BALL.pin_radius,
        'young_modulus_pa': 1e6 * BALL.young_modulus,
        'poisson_ratio': BALL.poisson_ratio,
        'numbers': 'of grasps of `grasp_map` with seed 0 and a lean of at most 0.35 rad',
        **parts,
    }
    KEPT.write_text(json.dumps(kept) + '\n')


if __name__ == '__main__':
    main()
