# SPDX-License-Identifier: Apache-2.0
"""Pictures of a comparison, drawn with matplotlib without any display."""

from __future__ import annotations

from io import BytesIO

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.stats import norm

from grasp_common.terminal import in_picture
from scan_compare.comparison import Comparison
from scan_compare.deformed_surface import DeformedSurface
from scan_compare.report.camera import Camera, Layer, camera_towards, draw, shade

ERROR_COLOURS = 'RdBu_r'
PLAIN = np.array([0.78, 0.80, 0.84])
MODEL = np.array([0.62, 0.74, 0.90])
BORDER = np.array([0.85, 0.10, 0.10])
POINTS_DRAWN = 200_000


def colour_limit(comparisons: list[Comparison]) -> float:
    """Return one symmetric colour limit [m] for several comparisons: 99 % of all errors fit."""
    errors = np.concatenate([np.abs(c.distances.distance[c.used]) for c in comparisons])
    floor = max(comparison.noise_floor_m for comparison in comparisons)
    return max(float(np.quantile(errors, 0.99)), 2.0 * floor)


def comparison_picture(comparison: Comparison, limit_m: float | None = None) -> bytes:
    """Return a PNG: scan, model and error map from one camera, profile and histogram.

    limit_m: colour limit of the error map [m], by default `colour_limit` of this comparison.
    """
    limit = colour_limit([comparison]) if limit_m is None else limit_m
    figure = Figure(figsize=(13.5, 8.2), dpi=100)
    grid = figure.add_gridspec(2, 6, height_ratios=(1.25, 1.0))
    camera = camera_of(comparison)
    model = model_layer(comparison.surface, camera)
    chosen = _drawn(comparison)
    scan = draw(camera, comparison.points[chosen], np.zeros(chosen.size))
    errors = draw(camera, comparison.points[chosen], comparison.distances.distance[chosen])
    pictures = (
        (grid[0, 0:2], 'scan', _plain(camera, scan, PLAIN)),
        (grid[0, 2:4], 'model (outer face)', _plain(camera, model, MODEL)),
        (grid[0, 4:6], 'scan - model', _coloured(camera, errors, limit)),
    )
    for place, title, image in pictures:
        axes = figure.add_subplot(place)
        axes.imshow(image, interpolation='nearest')
        axes.set_title(title)
        axes.set_axis_off()
    _colour_bar(figure, comparison, limit)
    _profile_axes(figure.add_subplot(grid[1, 0:3]), comparison)
    _histogram_axes(figure.add_subplot(grid[1, 3:6]), comparison, limit)
    figure.subplots_adjust(left=0.06, right=0.9, top=0.95, bottom=0.08, wspace=0.5, hspace=0.12)
    return _png(figure)


def patches_picture(comparison: Comparison) -> bytes:
    """Return a PNG in the manner of the paper's Figure 4.

    The deformed patches lie on the undeformed shape (the scan, or the model at rest without one);
    red curves border them, dark points mark the largest displacement.
    """
    surface = comparison.surface
    camera = camera_of(comparison)
    if comparison.undeformed_points is not None:
        base = draw(
            camera, comparison.undeformed_points, np.zeros(len(comparison.undeformed_points))
        )
        title = 'deformed patches on the undeformed scan'
    else:
        base = model_layer(surface.at_rest(), camera)
        title = 'deformed patches on the model at rest'
    image = _plain(camera, base, PLAIN)
    samples = surface.samples
    threshold = surface.dent_threshold
    dent = samples.displacement > threshold
    if dent.any():
        patch = draw(camera, samples.position[dent], samples.displacement[dent], 2)
        seen = _in_front(patch, base, surface)
        colours = matplotlib.colormaps['viridis_r'](
            Normalize(threshold, surface.max_displacement)(patch.value)
        )[..., :3]
        shaded = colours * shade(camera, patch)[..., None]
        image[seen] = 0.25 * image[seen] + 0.75 * shaded[seen]
        edge = np.abs(samples.displacement - threshold) < 0.12 * threshold
        border = draw(camera, samples.position[edge], np.zeros(int(edge.sum())), 1)
        image[_in_front(border, base, surface)] = BORDER
    figure = Figure(figsize=(6.2, 6.2), dpi=100)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.9))
    axes.imshow(image, interpolation='nearest')
    if dent.any():
        deepest = samples.displacement > 0.995 * surface.max_displacement
        darkest = draw(camera, samples.position[deepest], np.zeros(int(deepest.sum())), 1)
        row, column = np.nonzero(_in_front(darkest, base, surface))
        axes.plot(column, row, '.', color='black', markersize=3)
    axes.set_title(
        f'{in_picture(title)}\nlargest displacement {1e3 * surface.max_displacement:.2f} mm',
        fontsize=10,
    )
    axes.set_axis_off()
    return _png(figure)


def _in_front(layer: Layer, base: Layer, surface: DeformedSurface) -> np.ndarray:
    """Return which pixels of `layer` lie on the near side: in a dent, not behind the object."""
    return np.isfinite(layer.depth) & ~(layer.depth < base.depth - 0.4 * surface.extent)


def camera_of(comparison: Comparison) -> Camera:
    """Return the camera of a comparison: towards the dent that the scan shows best."""
    rest = comparison.surface.at_rest().samples.position
    if comparison.profiles:
        best = max(comparison.profiles, key=lambda profile: int(profile.count.sum()))
        contact = best.contact
        outward = contact - rest.mean(axis=0)
    else:
        outward = comparison.points[comparison.used].mean(axis=0) - rest.mean(axis=0)
    if not np.linalg.norm(outward) > 0.0:
        outward = np.array([0.0, 0.0, 1.0])
    return camera_towards(outward, rest)


def model_layer(surface: DeformedSurface, camera: Camera) -> Layer:
    """Draw the smooth outer face."""
    position = surface.samples.position
    return draw(camera, position, np.zeros(len(position)))


def _drawn(comparison: Comparison) -> np.ndarray:
    used = np.flatnonzero(comparison.used)
    return used[:: max(1, len(used) // POINTS_DRAWN)]


def _plain(camera: Camera, layer: Layer, colour: np.ndarray) -> np.ndarray:
    image = np.ones((camera.pixels, camera.pixels, 3))
    seen = np.isfinite(layer.depth)
    image[seen] = colour * shade(camera, layer)[seen, None]
    return image


def _coloured(camera: Camera, layer: Layer, limit: float) -> np.ndarray:
    image = np.ones((camera.pixels, camera.pixels, 3))
    seen = np.isfinite(layer.depth)
    colours = matplotlib.colormaps[ERROR_COLOURS](Normalize(-limit, limit)(layer.value))[..., :3]
    image[seen] = (colours * (0.4 + 0.6 * shade(camera, layer)[..., None]))[seen]
    return image


def _colour_bar(figure: Figure, comparison: Comparison, limit: float) -> None:
    mappable = ScalarMappable(Normalize(-1e3 * limit, 1e3 * limit), ERROR_COLOURS)
    place = figure.add_axes((0.925, 0.57, 0.012, 0.3))
    bar = figure.colorbar(mappable, cax=place, label='signed distance [mm]')
    largest = comparison.measured_max_displacement_m or comparison.surface.max_displacement
    if largest > 2.0 * comparison.noise_floor_m:
        share = 100.0 * limit / largest
        bar.ax.set_title(f'$\\pm${share:.1f} %\nof max. disp.', fontsize=8)


def _profile_axes(axes: Axes, comparison: Comparison) -> None:
    for number, profile in enumerate(comparison.profiles):
        colour = f'C{number}'
        radius, depth = 1e3 * profile.radius, 1e3 * profile.depth
        axes.plot(
            radius, depth, 'o', markersize=3, color=colour, label=f'scan, contact {number + 1}'
        )
        axes.plot(radius, 1e3 * profile.model, '-', color=colour, label='model')
        style = 'extrapolated' if profile.extrapolated else 'seen'
        axes.errorbar(
            [0.0], [1e3 * profile.apex_m], [2e3 * profile.apex_sigma_m], fmt='D', color=colour,
            markerfacecolor='none', label=f'apex, {style}: {1e3 * profile.apex_m:.2f} mm',
        )  # fmt: skip
    if comparison.profiles:
        axes.invert_yaxis()
        axes.legend(fontsize=8)
    else:
        axes.text(0.5, 0.5, 'no dent seen', ha='center', va='center', transform=axes.transAxes)
    axes.set_xlabel('distance from the contact axis [mm]')
    axes.set_ylabel('depth along the contact normal [mm]')
    axes.set_title('profile through the dent (ring means)')
    axes.grid(alpha=0.3)


def _histogram_axes(axes: Axes, comparison: Comparison, limit: float) -> None:
    millimetres = 1e3 * comparison.distances.distance[comparison.used]
    edges = np.linspace(-1.5e3 * limit, 1.5e3 * limit, 81)
    axes.hist(millimetres, edges.tolist(), density=True, color='0.6', label='scan - model')
    sigma = 1e3 * comparison.scanner_sigma_m
    x = np.linspace(edges[0], edges[-1], 400)
    axes.plot(x, norm.pdf(x, scale=sigma), 'k--', label=f'scanner noise, sigma {sigma:.3f} mm')
    axes.axvline(0.0, color='k', linewidth=0.5)
    axes.set_yscale('log')
    axes.set_ylim(bottom=1e-4)
    axes.set_xlabel('signed distance [mm]')
    axes.set_ylabel('density [1/mm]')
    axes.set_title(
        f'mean {1e3 * comparison.vertex.mean_m:.3f} mm, floor '
        f'{1e3 * comparison.noise_floor_m:.3f} mm'
    )
    axes.legend(fontsize=8)


def _png(figure: Figure) -> bytes:
    stream = BytesIO()
    # no version of the library in the file: the same comparison gives the same bytes
    figure.savefig(stream, format='png', metadata={'Software': None})
    return stream.getvalue()
