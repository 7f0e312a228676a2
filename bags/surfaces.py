# SPDX-License-Identifier: Apache-2.0
"""Deformed outer faces from the kept solid solutions, as fine triangle meshes in SI units.

The scanner simulator samples these; nothing here knows a shell theory.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bags import hexahedra
from bags.calculix import Array

FOLDER = Path(__file__).parent / 'solid'


@dataclass(frozen=True)
class Surface:
    """Triangles of an outer face: vertices (n, 3) in m, outward normals (n, 3), faces (m, 3)."""

    vertices: Array
    normals: Array
    faces: np.ndarray

    def moved(self, rotation: Array, shift: Array) -> Surface:
        """The same surface after x -> rotation x + shift."""
        return Surface(self.vertices @ rotation.T + shift, self.normals @ rotation.T, self.faces)


def from_triangles(vertices: Array, faces: np.ndarray) -> Surface:
    """Area-weighted vertex normals; the faces must be wound so that normals point outward."""
    corners = vertices[faces]
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    return Surface(vertices, normals / np.linalg.norm(normals, axis=1, keepdims=True), faces)


class BallTruth:
    """The two-finger ball: rest and deformed outer face, dents and gas at any kept force."""

    def __init__(self, name: str = 'ball_two_finger') -> None:
        self.file = f'{name}.json'
        self.data = json.loads((FOLDER / self.file).read_text())
        levels = self.data['levels']
        self.forces = np.array([0.0, *(level['force_n'] for level in levels)])
        self.profiles = np.array(
            [self.data['outer_rest_profile_m'], *(level['outer_profile_m'] for level in levels)]
        )
        self.middle = _from_zero(levels, 'middle_displacement_m')
        self.outer = _from_zero(levels, 'outer_displacement_m')

    def profile(self, force: float) -> Array:
        """Outer profile (r, z) in m from pole to equator, linear between the kept forces."""
        return _between(self.forces, self.profiles, force)

    def middle_displacement(self, force: float) -> float:
        """Displacement in m of the point at mid-thickness under the pin."""
        return float(np.interp(force, self.forces, self.middle))

    def outer_displacement(self, force: float) -> float:
        """Displacement in m of the outer face under the pin."""
        return float(np.interp(force, self.forces, self.outer))

    def surface(self, force: float, azimuths: int = 480) -> Surface:
        """The whole outer face, axis z, centred on the ball's centre."""
        half = _refined_profile(self.profile(force))
        whole = np.concatenate([half, half[-2::-1] * [1.0, -1.0]])
        angle = np.arange(azimuths) * 2 * np.pi / azimuths
        ring = whole[1:-1]
        rows = len(ring)
        vertices = np.concatenate(
            [
                np.stack(
                    [
                        np.outer(ring[:, 0], np.cos(angle)),
                        np.outer(ring[:, 0], np.sin(angle)),
                        np.repeat(ring[:, 1:], azimuths, axis=1),
                    ],
                    axis=-1,
                ).reshape(-1, 3),
                [[0.0, 0.0, whole[0, 1]], [0.0, 0.0, whole[-1, 1]]],
            ]
        )
        number = np.arange(rows * azimuths).reshape(rows, azimuths)
        upper, lower = number[:-1], number[1:]
        next_upper, next_lower = np.roll(upper, -1, axis=1), np.roll(lower, -1, axis=1)
        top, bottom = len(vertices) - 2, len(vertices) - 1
        caps = [
            np.stack([np.full(azimuths, top), number[0], np.roll(number[0], -1)], axis=1),
            np.stack([np.full(azimuths, bottom), np.roll(number[-1], -1), number[-1]], axis=1),
        ]
        faces = np.concatenate(
            [
                np.stack([upper, lower, next_upper], axis=-1).reshape(-1, 3),
                np.stack([next_upper, lower, next_lower], axis=-1).reshape(-1, 3),
                *caps,
            ]
        )
        return from_triangles(vertices, faces)


def _from_zero(levels: list[dict], key: str) -> Array:
    return np.array([0.0, *(level[key] for level in levels)])


def _between(forces: Array, values: Array, force: float) -> Array:
    if not forces[0] <= force <= forces[-1]:
        raise ValueError(f'{force} N lies outside the kept loads {forces[0]}..{forces[-1]} N')
    above = min(int(np.searchsorted(forces, force)), len(forces) - 1)
    below = max(above - 1, 0)
    if forces[above] == forces[below]:
        return values[above]
    part = (force - forces[below]) / (forces[above] - forces[below])
    return (1 - part) * values[below] + part * values[above]


def _refined_profile(nodes: Array, pieces: int = 2) -> Array:
    """Points on the quadratic edges of the profile, `pieces` per half edge."""
    local = np.linspace(-1.0, 1.0, 2 * pieces + 1)[:-1]
    values = np.stack([local * (local - 1) / 2, 1 - local**2, local * (local + 1) / 2])
    edges = [values.T @ nodes[start : start + 3] for start in range(0, len(nodes) - 2, 2)]
    return np.concatenate([*edges, nodes[-1:]])


class ShellTruth:
    """A 3-D solution kept as one sector; the whole face by its mirror planes."""

    def __init__(self, name: str) -> None:
        self.file = f'{name}.json'
        self.data = json.loads((FOLDER / self.file).read_text())
        with np.load(FOLDER / f'{name}.npz') as kept:
            self.rest = kept['rest_m'].astype(float)
            self.quads = kept['faces']
            self.forces = np.concatenate([[0.0], kept['force_n']])
            moved = kept['displacement_m'].astype(float)
        self.displacements = np.concatenate([np.zeros((1, *moved.shape[1:])), moved])
        levels = self.data['levels']
        self.middle = np.array([0.0, *(level['middle_displacement_m'][0] for level in levels)])
        self.outer = np.array([0.0, *(level['outer_displacement_m'][0] for level in levels)])
        self.copies = sector_copies(name)

    def middle_displacement(self, force: float) -> float:
        """Displacement in m of the first contact at mid-thickness, along its direction."""
        return float(np.interp(force, self.forces, self.middle))

    def outer_displacement(self, force: float) -> float:
        """Displacement in m of the outer face at the first contact, along its direction."""
        return float(np.interp(force, self.forces, self.outer))

    def surface(self, force: float, pieces: int = 6) -> Surface:
        """The whole outer face in the frame of the model."""
        nodes = self.rest + _between(self.forces, self.displacements, force)
        sector, faces = _refined_quads(nodes, self.quads, pieces)
        parts, triangles, offset = [], [], 0
        for copy in self.copies:
            parts.append(sector @ copy.T)
            turned = faces if np.linalg.det(copy) > 0 else faces[:, ::-1]
            triangles.append(turned + offset)
            offset += len(sector)
        vertices, faces = _welded(np.concatenate(parts), np.concatenate(triangles))
        return from_triangles(vertices, faces)


def sector_copies(name: str) -> list[Array]:
    """The rotations and mirrors that carry the kept sector over the whole object."""
    mirror_x, mirror_y, mirror_z = (np.diag(d) for d in ([-1.0, 1, 1], [1.0, -1, 1], [1.0, 1, -1]))
    same = np.eye(3)
    if name.startswith('half_soda_can'):
        return [same, mirror_x, mirror_z, mirror_x @ mirror_z]
    if name.startswith('off_axis_cup'):
        return [same, mirror_y]
    copies = []
    for third in range(3):
        c, s = np.cos(third * 2 * np.pi / 3), np.sin(third * 2 * np.pi / 3)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        copies += [turn, turn @ mirror_y, turn @ mirror_z, turn @ mirror_y @ mirror_z]
    return copies


def _refined_quads(nodes: Array, quads: np.ndarray, pieces: int) -> tuple[Array, np.ndarray]:
    line = np.linspace(-1.0, 1.0, pieces + 1)
    a, b = (grid.ravel() for grid in np.meshgrid(line, line, indexing='ij'))
    values, _, _ = hexahedra.face_shapes(a, b)
    points = np.einsum('nq,fnd->fqd', values, nodes[quads])
    grid = np.arange((pieces + 1) ** 2).reshape(pieces + 1, pieces + 1)
    c00, c10, c11, c01 = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    cell = np.concatenate(
        [
            np.stack([c00, c10, c11], axis=-1).reshape(-1, 3),
            np.stack([c00, c11, c01], axis=-1).reshape(-1, 3),
        ]
    )
    offsets = np.arange(len(quads))[:, None, None] * (pieces + 1) ** 2
    return points.reshape(-1, 3), (cell[None] + offsets).reshape(-1, 3)


def _welded(vertices: Array, faces: np.ndarray) -> tuple[Array, np.ndarray]:
    """Merge vertices closer than 0.1 micrometre, as neighbours of one edge are."""
    _, first, inverse = np.unique(
        np.round(vertices * 1e7).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    return vertices[first], inverse.reshape(-1)[faces]
