# SPDX-License-Identifier: Apache-2.0
"""A picture of a deformed surface: shaded by the displacement, to scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


def surface_figure(
    points: Array, faces: NDArray[np.integer], displacement: Array, title: str
) -> Figure:
    """A figure of points (n, 3) [m] joined by faces (m, 3), coloured by their displacement (n, 3).

    It belongs to no window: `figure.savefig(path)` writes it. Needs matplotlib.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = 1e3 * points
    moved = 1e3 * np.linalg.norm(displacement, axis=1)
    scale = ScalarMappable(
        Normalize(0.0, max(float(moved.max()), 1e-12)), matplotlib.colormaps['cividis']
    )
    figure = Figure(figsize=(7.0, 5.5), dpi=140)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(projection='3d')
    axes.add_collection3d(
        Poly3DCollection(
            corners[faces],
            facecolors=scale.to_rgba(moved[faces].mean(axis=1)),
            edgecolors=(0, 0, 0, 0.15),
            linewidths=0.2,
        )
    )
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre, half = 0.5 * (low + high), 0.5 * float((high - low).max())
    axes.set(
        xlim=(centre[0] - half, centre[0] + half),
        ylim=(centre[1] - half, centre[1] + half),
        zlim=(centre[2] - half, centre[2] + half),
        xlabel='x [mm]',
        ylabel='y [mm]',
        zlabel='z [mm]',
        title=title,
    )
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=22, azim=35)
    figure.colorbar(scale, ax=axes, label='displacement [mm]', shrink=0.7)
    return figure
