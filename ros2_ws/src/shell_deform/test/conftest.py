# SPDX-License-Identifier: Apache-2.0
"""Small shells that several test files squeeze."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from shell_deform.assemble.discretisation import discretise
from shell_deform.model import ShellModel
from shell_deform.surface.control_mesh import control_mesh, moved
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory.material import Material

sys.path.insert(0, str(Path(__file__).parent))


def sphere_mesh(radius, subdivisions):
    """Icosphere whose limit surface passes through the sphere at every vertex."""
    icosphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    mesh = control_mesh(icosphere.vertices * radius, icosphere.faces)
    surface = LimitSurface(mesh)
    points = mesh.vertices
    for _ in range(30):
        limit = surface.limit_positions(points)
        points = points + radius * limit / np.linalg.norm(limit, axis=1)[:, None] - limit
    return moved(mesh, points)


@pytest.fixture(scope='session')
def sphere():
    """Make a sphere model: `sphere(radius, thickness, subdivisions, young, poisson, **model)`."""

    def make(radius, thickness, subdivisions=2, young=1e6, poisson=0.5, **model):
        shell = discretise(sphere_mesh(radius, subdivisions), Material(young, poisson), thickness)
        return ShellModel(shell, **model)

    return make


@pytest.fixture(scope='session')
def ball(sphere):
    """The mission sphere on 642 uniform control vertices: R 31.25 mm, h 2.5 mm, E 1 MPa."""
    return sphere(31.25e-3, 2.5e-3, subdivisions=3)
