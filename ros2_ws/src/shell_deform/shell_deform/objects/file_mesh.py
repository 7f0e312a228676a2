# SPDX-License-Identifier: Apache-2.0
"""Control meshes, triangles and points that come from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from grasp_common.formats import RawMesh, ScanFileError, read_mesh_file
from grasp_common.formats.welding import middle_and_size, weld
from grasp_common.options import METRES_PER_UNIT

from ..surface.control_mesh import ControlMesh, MeshError, control_mesh
from ..surface.limit import LimitSurface
from .shell_object import MeshFile, ObjectError

FloatArray = npt.NDArray[np.float64]


def read_triangles(
    path: Path, unit: str, *, merge: bool = True
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Vertices (n, 3) [m] and triangles (m, 3) of any file that `grasp_common.formats` reads.

    Args:
        merge: make vertices at the same place one.

    Raises:
        ObjectError: the file cannot be read or holds no triangle.
    """
    mesh = _loaded(path)
    if mesh.triangles is None or len(mesh.triangles) == 0:
        raise ObjectError(
            f'{path}: holds no triangles, only {len(mesh.points)} points; make a mesh of them '
            'first (scanner software, MeshLab, CloudCompare)'
        )
    _check_finite(path, mesh.points)
    vertices, triangles = mesh.points, mesh.triangles.astype(np.int64)
    if merge:
        kept, number = weld(vertices, np.ones(len(vertices), bool), *_middle(vertices))
        vertices, triangles = vertices[kept], number[triangles].astype(np.int64)
    return vertices * METRES_PER_UNIT[unit], triangles


def read_points(path: Path, unit: str) -> FloatArray:
    """Points (n, 3) [m] of any mesh or point cloud that `grasp_common.formats` reads.

    Raises:
        ObjectError: the file cannot be read or holds no point.
    """
    points = _loaded(path).points
    if len(points) == 0:
        raise ObjectError(f'{path}: holds no points')
    _check_finite(path, points)
    return np.asarray(points * METRES_PER_UNIT[unit], dtype=np.float64)


def _loaded(path: Path) -> RawMesh:
    if not path.is_file():
        raise ObjectError(f'{path}: there is no such file')
    try:
        return read_mesh_file(path)
    except ScanFileError as error:
        raise ObjectError(str(error)) from error


def _middle(vertices: FloatArray) -> tuple[FloatArray, float]:
    return middle_and_size(vertices, np.ones(len(vertices), bool))


def _check_finite(path: Path, vertices: FloatArray) -> None:
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise ObjectError(
            f'{path}: vertex {bad} is not finite: {vertices[bad].tolist()}; delete such points in '
            'the scanner software and export it again'
        )


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
