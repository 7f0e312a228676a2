"""Control meshes, triangles and points that come from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..surface.control_mesh import ControlMesh, MeshError, control_mesh
from ..surface.limit import LimitSurface
from .shell_object import MeshFile, ObjectError

FloatArray = npt.NDArray[np.float64]

UNIT_M = {'m': 1.0, 'cm': 0.01, 'mm': 0.001, 'in': 0.0254}
"""Metres per unit of a mesh file."""


def read_triangles(
    path: Path, unit: str, *, merge: bool = True
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Vertices (n, 3) [m] and triangles (m, 3) of any file that trimesh reads.

    Args:
        merge: make vertices at the same place one.

    Raises:
        ObjectError: the file cannot be read or holds no triangle.
    """
    mesh = _loaded(path, 'mesh')
    if len(getattr(mesh, 'faces', ())) == 0:
        raise ObjectError(f'{path}: holds no triangles')
    _check_finite(path, mesh.vertices)
    if merge:
        mesh.merge_vertices()
    return np.asarray(mesh.vertices) * UNIT_M[unit], np.asarray(mesh.faces, dtype=np.int64)


def read_points(path: Path, unit: str) -> FloatArray:
    """Points (n, 3) [m] of any mesh or point cloud that trimesh reads.

    Raises:
        ObjectError: the file cannot be read or holds no point.
    """
    loaded = _loaded(path, None)
    parts = getattr(loaded, 'geometry', {'': loaded}).values()
    points = [np.asarray(getattr(part, 'vertices', ())).reshape(-1, 3) for part in parts]
    if sum(map(len, points)) == 0:
        raise ObjectError(f'{path}: holds no points')
    found = np.concatenate(points).astype(np.float64)
    _check_finite(path, found)
    return found * UNIT_M[unit]


def _loaded(path: Path, force: Literal['mesh'] | None) -> Any:
    # Fifteen megabytes that only mesh files need, in every node's memory if imported above.
    import trimesh

    if not path.is_file():
        raise ObjectError(f'{path}: there is no such file')
    try:
        return trimesh.load(path, force=force, process=False)
    except Exception as error:
        what = 'a mesh' if force else 'a mesh or point cloud'
        raise ObjectError(f'{path}: cannot be read as {what}: {error}') from error


def _check_finite(path: Path, vertices: FloatArray) -> None:
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise ObjectError(f'{path}: vertex {bad} is not finite: {vertices[bad].tolist()}')


def control_file(name: str, surface: MeshFile) -> ControlMesh:
    """The control mesh that a file holds.

    Raises:
        ObjectError: the file holds no mesh that can carry a surface.
    """
    # A control mesh keeps its numbering, unless its format has none.
    merge = surface.file.suffix.lower() == '.stl'
    vertices, triangles = read_triangles(surface.file, surface.unit, merge=merge)
    try:
        return control_mesh(vertices, triangles)
    except MeshError as error:
        raise ObjectError(f'{name}: {surface.file}: {error}') from error


def write_control_mesh(path: Path, mesh: ControlMesh) -> None:
    """Write control points [m] in full precision and triangles as a PLY text file."""
    header = [
        'ply',
        'format ascii 1.0',
        'comment control mesh of a Loop subdivision surface, unit m',
        f'element vertex {mesh.vertex_count}',
        *(f'property double {axis}' for axis in 'xyz'),
        f'element face {mesh.triangle_count}',
        'property list uchar int vertex_indices',
        'end_header',
    ]
    points = [' '.join(repr(x) for x in vertex) for vertex in mesh.vertices.tolist()]
    faces = [f'3 {a} {b} {c}' for a, b, c in mesh.triangles.tolist()]
    path.write_text('\n'.join([*header, *points, *faces]) + '\n', encoding='ascii')


class LimitTarget:
    """The limit surface of a given control mesh."""

    def __init__(self, mesh: ControlMesh) -> None:
        self._mesh = mesh
        self._surface = LimitSurface(mesh)

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (p, 3) [m] and outward unit normals (p, 3)."""
        found = self._surface.closest_point(self._mesh.vertices, points)
        return found.position, found.normal

    def outline(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points, and no direction: the outline is where the mesh has it."""
        return self.project(points)[0], np.zeros((len(points), 2, 3))
