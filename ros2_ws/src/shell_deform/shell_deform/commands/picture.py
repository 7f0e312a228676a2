"""A picture of a squeezed object: the surface coloured by displacement, and its load."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject
from shell_deform.solve.equilibrium import Equilibrium


def draw_state(
    path: Path, shell_object: ShellObject, model: ShellModel, state: Equilibrium
) -> None:
    """Write a PNG of the middle surface, coloured by displacement [mm]."""
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    mesh = model.shell.mesh
    rest = 1e3 * model.surface.limit_positions(model.rest)
    points = 1e3 * model.surface.limit_positions(state.positions)
    moved = np.linalg.norm(points - rest, axis=1)
    faces = mesh.triangles[mesh.active]
    colours = plt.get_cmap('cividis')
    scale = plt.Normalize(0.0, max(float(moved.max()), 1e-12))
    figure = plt.figure(figsize=(7.0, 5.5), dpi=140)
    axes = figure.add_subplot(projection='3d')
    axes.add_collection3d(
        Poly3DCollection(
            points[faces],
            facecolors=colours(scale(moved[faces].mean(axis=1))),
            edgecolors=(0, 0, 0, 0.15),
            linewidths=0.2,
        )
    )
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = 0.5 * (low + high), 0.5 * float((high - low).max())
    for set_limits, middle in zip(
        (axes.set_xlim, axes.set_ylim, axes.set_zlim), centre, strict=True
    ):
        set_limits(middle - half, middle + half)
    axes.set_box_aspect((1, 1, 1))
    axes.set_xlabel('x [mm]')
    axes.set_ylabel('y [mm]')
    axes.set_zlabel('z [mm]')
    axes.view_init(elev=22, azim=35)
    axes.set_title(
        f'{shell_object.name}: {np.mean(state.force):.3g} N per contact, '
        f'{1e3 * np.max(state.displacement):.3g} mm'
    )
    figure.colorbar(
        plt.cm.ScalarMappable(scale, colours), ax=axes, label='displacement [mm]', shrink=0.7
    )
    figure.savefig(path, bbox_inches='tight')
    plt.close(figure)
