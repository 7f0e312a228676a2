# SPDX-License-Identifier: Apache-2.0
"""Loop subdivision limit surfaces on any manifold triangle mesh."""

from .closest_point import ClosestPoints
from .control_mesh import ControlMesh, MeshError, control_mesh, moved
from .limit import LimitSurface, SurfacePoints
from .loop_basis import BasisRows, QuadratureBasis, basis_rows, quadrature_basis

__all__ = [
    'BasisRows',
    'ClosestPoints',
    'ControlMesh',
    'LimitSurface',
    'MeshError',
    'QuadratureBasis',
    'SurfacePoints',
    'basis_rows',
    'control_mesh',
    'moved',
    'quadrature_basis',
]
