# SPDX-License-Identifier: Apache-2.0
"""Meshes for the surface tests, and a subdivision of its own as an independent oracle."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
import trimesh

from shell_deform.surface import ControlMesh, control_mesh


def sphere(levels: int, radius: float = 1.0) -> ControlMesh:
    ball = trimesh.creation.icosphere(levels)
    return control_mesh(ball.vertices * radius, ball.faces)


def tetrahedron() -> ControlMesh:
    points = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return control_mesh(points, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def random_ball(count: int, seed: int) -> ControlMesh:
    """Points thrown on a sphere: every valence, several irregular vertices in one triangle."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    hull = trimesh.convex.convex_hull(points / np.linalg.norm(points, axis=1)[:, None])
    return control_mesh(hull.vertices, hull.faces)


def grid_arrays(
    columns: int, rows: int, noise: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Unit squares cut along their diagonal; vertex (i, j) is number i (rows + 1) + j."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing='ij')
    z = noise * np.random.default_rng(seed).normal(size=x.size)
    number = np.arange(x.size).reshape(x.shape)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel(), z]), faces


def torus(columns: int, rows: int) -> ControlMesh:
    """A closed mesh on which every vertex has six neighbours."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing='ij')
    a, b = 2 * np.pi * i / columns, 2 * np.pi * j / rows
    points = np.stack([(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)], -1)
    number = i * rows + j
    right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    corner = np.roll(right, -1, axis=1)
    quads = [np.stack([number, right, corner], -1), np.stack([number, corner, up], -1)]
    return control_mesh(points.reshape(-1, 3), np.concatenate([q.reshape(-1, 3) for q in quads]))


def fan(valence: int, noise: float = 0.2, seed: int = 0) -> ControlMesh:
    """A disc of two rings around one inner vertex of any valence."""
    angle = 2 * np.pi * np.arange(valence) / valence
    inner = np.column_stack([np.cos(angle), np.sin(angle)])
    outer = np.column_stack([np.cos(angle + np.pi / valence), np.sin(angle + np.pi / valence)]) * 2
    flat = np.concatenate([[[0.0, 0.0]], inner, 2 * inner, outer])
    points = np.column_stack([flat, noise * np.random.default_rng(seed).normal(size=len(flat))])
    faces = []
    for i in range(valence):
        a, b = 1 + i, 1 + (i + 1) % valence
        far_a, far_b, between = a + valence, b + valence, 1 + 2 * valence + i
        faces += [(0, a, b), (a, between, b), (a, far_a, between), (b, between, far_b)]
    return control_mesh(points, faces)


def subdivided(mesh: ControlMesh) -> ControlMesh:
    """One Loop subdivision in plain dictionaries, written apart from the package's own.

    Triangle t becomes triangles 4 t ... 4 t + 3: its three corner pieces, then the middle one.
    """
    points, faces = mesh.vertices, mesh.triangles.tolist()
    opposite = defaultdict(list)
    for a, b, c in faces:
        for i, j, k in ((a, b, c), (b, c, a), (c, a, b)):
            opposite[frozenset((i, j))].append(k)
    creases = {frozenset(edge) for edge in mesh.crease_edges.tolist()}
    sharp = {edge for edge, apexes in opposite.items() if len(apexes) == 1 or edge in creases}
    corners = set(np.flatnonzero(mesh.is_corner).tolist())
    sharp_ends = defaultdict(set)
    around = defaultdict(set)
    for edge in opposite:
        i, j = edge
        around[i].add(j)
        around[j].add(i)
        if edge in sharp:
            sharp_ends[i].add(j)
            sharp_ends[j].add(i)
    excess = {}
    for triangle, face in enumerate(faces):
        for vertex in face:
            if len(sharp_ends[vertex]) < 2:
                continue
            size = len(_sector(vertex, triangle, faces, sharp))
            angle = (math.pi / 2 if vertex in corners else math.pi) / size
            excess[vertex, triangle] = 0.125 - 0.25 * math.cos(angle)
    owners = defaultdict(list)
    for triangle, (a, b, c) in enumerate(faces):
        for pair in ((a, b), (b, c), (c, a)):
            owners[frozenset(pair)].append(triangle)
    new = []
    for vertex, neighbours in around.items():
        ends = sharp_ends[vertex]
        if vertex in corners:
            moved = points[vertex]
        elif len(ends) == 2:
            moved = 0.75 * points[vertex] + 0.125 * points[list(ends)].sum(axis=0)
        else:
            k = len(neighbours)
            beta = (40 - (3 + 2 * math.cos(2 * math.pi / k)) ** 2) / (64 * k)
            moved = (1 - k * beta) * points[vertex] + beta * points[list(neighbours)].sum(axis=0)
        new.append((vertex, moved))
    result = np.empty((len(points) + len(opposite), 3))
    for vertex, moved in new:
        result[vertex] = moved
    number = {}
    for position, (edge, apexes) in enumerate(opposite.items()):
        i, j = edge
        number[edge] = len(points) + position
        if edge in sharp:
            result[number[edge]] = 0.5 * (points[i] + points[j])
            continue
        shift = excess.get((j, owners[edge][0]), 0.0) - excess.get((i, owners[edge][0]), 0.0)
        result[number[edge]] = (
            (0.375 + shift) * points[i]
            + (0.375 - shift) * points[j]
            + 0.125 * points[apexes].sum(axis=0)
        )
    children = []
    for a, b, c in faces:
        ab, bc, ca = (number[frozenset(pair)] for pair in ((a, b), (b, c), (c, a)))
        children += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab)]
    half = {number[edge]: edge for edge in creases if edge in number}
    fine_creases = [(vertex, end) for vertex, edge in half.items() for end in edge]
    return control_mesh(result, children, fine_creases or None, sorted(corners))


def _sector(vertex: int, triangle: int, faces: list, sharp: set) -> set:
    """Triangles around a vertex that are reached from one of them without a sharp edge."""
    mine = [t for t, face in enumerate(faces) if vertex in face]
    found, pending = {triangle}, [triangle]
    while pending:
        current = set(faces[pending.pop()])
        for other in mine:
            common = current & set(faces[other])
            if other not in found and len(common) == 2 and frozenset(common) not in sharp:
                found.add(other)
                pending.append(other)
    return found
