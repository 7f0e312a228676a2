# SPDX-License-Identifier: Apache-2.0
"""The model side of a command: an object, and its deformed surface from a mesh file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scan_compare.deformed_surface import (
    DeformedSurface,
    SurfaceError,
    published_mesh,
    surface_from_limit_positions,
)
from scan_compare.scan_file import ScanFileError, read_mesh_file
from scan_compare.units import metres_per_unit
from shell_deform.objects import load_object, object_mesh
from shell_deform.surface.limit import LimitSurface


def surface_of_object(name: str) -> DeformedSurface:
    """Return the object `name` (or an object file) at rest; raises ObjectError."""
    shell = load_object(name)
    mesh = object_mesh(shell)
    return DeformedSurface(LimitSurface(mesh), mesh.vertices, mesh.vertices, shell.thickness_m)


def surface_of_files(
    deformed: str | Path,
    rest: str | Path | None,
    shell: DeformedSurface,
    unit: str = 'm',
) -> DeformedSurface:
    """Return the shell deformed to a mesh file of limit positions on the middle surface.

    The file's vertices stand in the order of the control vertices, as on `deformation/surface`.
    rest: a second file with the same vertices at rest; without it the mesh must be that of
    the object `shell`. Raises ScanFileError or SurfaceError.
    """
    scale = metres_per_unit(unit)
    positions, triangles = _mesh(deformed, scale)
    if rest is None:
        if len(positions) != shell.mesh.vertex_count:
            raise SurfaceError(
                f'{deformed}: {len(positions)} vertices, but the control mesh of the object has '
                f'{shell.mesh.vertex_count}; give the same mesh at rest with --rest'
            )
        at_rest = shell.limit.limit_positions(shell.rest)
        return surface_from_limit_positions(shell.limit, at_rest, positions, shell.thickness)
    at_rest, rest_triangles = _mesh(rest, scale)
    if len(at_rest) != len(positions):
        raise SurfaceError(f'{rest}: {len(at_rest)} vertices, but {deformed} has {len(positions)}')
    if not np.array_equal(triangles, rest_triangles):
        raise SurfaceError(f'{rest} and {deformed} have different triangles')
    limit = LimitSurface(published_mesh(triangles, at_rest))
    return surface_from_limit_positions(limit, at_rest, positions, shell.thickness)


def _mesh(path: str | Path, scale: float) -> tuple[np.ndarray, np.ndarray]:
    raw = read_mesh_file(path)
    if raw.triangles is None:
        raise ScanFileError(f'{path}: a surface needs triangles; this file has points only')
    return scale * raw.points, raw.triangles
