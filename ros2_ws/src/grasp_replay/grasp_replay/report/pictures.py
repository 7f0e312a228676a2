# SPDX-License-Identifier: Apache-2.0
"""The report's drawings: triptychs, dent profiles, force over displacement, linearity.

Colours are cividis, unlit: monotone in lightness, so they read without colour vision and in
grey print. Shape is shown by lines of equal displacement, never by shading the colours.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import cycle

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial import cKDTree

from grasp_common.terminal import in_picture

from .camera import (
    Camera,
    dent_camera,
    faces_viewer,
    is_closed,
    painter_order,
    visible_points,
)
from .errors import ErrorScales, nice_ceiling, scan_displacement, seen_radius, vertex_errors
from .scene import Curve, ErrorLine, Floats, Kind, LinearityTrace, RowScene, thinned
from .section import dent_section, level_lines

NOT_SEEN = (0.80, 0.80, 0.80, 1.0)
INSIDE = (0.45, 0.45, 0.45, 1.0)
NONLINEAR, LINEAR, REST, THICK = '#00457c', '#c05a00', '#909090', '#1b7837'
MARKERS: dict[Kind, str] = {'published': 's', 'measured': 'D', 'synthetic': 'o', 'predicted': '^'}
MILLI = 1e3
SHADES = (0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
PROFILE_POINTS = 800
THEORY_LINES: dict[str, tuple[str, str]] = {
    'koiter': (NONLINEAR, '-'),
    'paper': (REST, '-.'),
    'linear': (LINEAR, '--'),
    'thick': (THICK, ':'),
}


def figure_of(width: float, height: float) -> Figure:
    """An empty figure [inches] that draws without a screen."""
    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as PNG bytes of 256 colours, without the program's version or time in them."""
    FigureCanvasAgg(figure).draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    stream = io.BytesIO()
    indexed(pixels).save(stream, format='PNG', optimize=True)
    return stream.getvalue()


def palette() -> npt.NDArray[np.uint8]:
    """The colours (256, 3) of our pictures: cividis, greys, the two theories' lines."""
    bar = np.round(colormaps['cividis'](np.linspace(0, 1, 190))[:, :3] * 255)
    grey = np.repeat(np.linspace(0, 255, 52)[:, None], 3, axis=1)
    lines = [[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in (NONLINEAR, LINEAR)]
    light = [np.add(255 * (1 - share), np.multiply(share, c)) for c in lines for share in SHADES]
    return np.concatenate([bar, grey, lines, light]).astype(np.uint8)


def indexed(pixels: npt.NDArray[np.uint8]) -> Image.Image:
    """Pixels (h, w, 3) as an image of the palette's nearest colours, without dithering."""
    table = palette()
    red, green, blue = np.moveaxis(pixels.astype(np.int32), -1, 0)
    numbers, where = np.unique((red << 16 | green << 8 | blue).ravel(), return_inverse=True)
    colours = np.stack([numbers >> 16, numbers >> 8 & 255, numbers & 255], axis=1)
    nearest = cKDTree(table.astype(float)).query(colours)[1].astype(np.uint8)
    image = Image.fromarray(nearest[where].reshape(pixels.shape[:2]))
    image.putpalette(table.tobytes())
    return image


def svg(figure: Figure) -> str:
    """The figure as an SVG element, the same text for the same drawing."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({'svg.hashsalt': 'report', 'svg.fonttype': 'path'}):
        figure.savefig(stream, format='svg', metadata={'Date': None, 'Creator': None})
    text = stream.getvalue()
    return text[text.index('<svg') :]


def _surface(
    axes: Axes, camera: Camera, scene: RowScene, vertices: Floats, values: Floats, scale: Normalize
) -> None:
    # The inner side shows only where an object is open: a closed one hides it.
    triangles = scene.triangles
    if is_closed(triangles):
        triangles = triangles[faces_viewer(camera, vertices, triangles)]
    triangles = triangles[painter_order(camera, vertices, triangles)]
    outside = faces_viewer(camera, vertices, triangles)
    flat, _ = camera.project(vertices)
    corner = values[triangles]
    seen = np.isfinite(corner).any(axis=1)
    mean = np.where(np.isfinite(corner), corner, 0.0).sum(axis=1) / np.maximum(
        np.isfinite(corner).sum(axis=1), 1
    )
    colour = colormaps['cividis'](scale(mean))
    colour[~seen] = NOT_SEEN
    colour[~outside] = INSIDE
    axes.add_collection(
        PolyCollection(
            list(flat[triangles] * MILLI), facecolors=colour, edgecolors=colour, linewidths=0.3
        )
    )
    _depth_lines(axes, camera, scene, vertices)


def _line_step(scene: RowScene) -> float:
    """Spacing (m) of the lines of equal displacement: about eight of them down the dent."""
    largest = float(np.linalg.norm(scene.nonlinear - scene.rest, axis=1).max())
    return nice_ceiling(largest / 8 * MILLI) / MILLI


def _depth_lines(axes: Axes, camera: Camera, scene: RowScene, vertices: Floats) -> None:
    moved = np.linalg.norm(vertices - scene.rest, axis=1)
    front = scene.triangles[faces_viewer(camera, vertices, scene.triangles)]
    step = _line_step(scene)
    for level in np.arange(step, moved.max(), step):
        segments = level_lines(vertices, front, moved, float(level))
        flat, _ = camera.project(segments.reshape(-1, 3))
        axes.add_collection(
            LineCollection(
                list(flat.reshape(-1, 2, 2) * MILLI), colors='white', linewidths=0.7, alpha=0.8
            )
        )


def _arrows(axes: Axes, camera: Camera, scene: RowScene, length: float) -> None:
    largest = float(np.linalg.norm(scene.contact_forces, axis=1).max(initial=0.0))
    if largest == 0.0:
        return
    for point, force in zip(scene.contact_points, scene.contact_forces, strict=True):
        tail = point - force / largest * length
        ends, depth = camera.project(np.stack([tail, point]))
        (x0, y0), (x1, y1) = ends * MILLI
        axes.annotate(
            '',
            (x1, y1),
            (x0, y0),
            zorder=4 if depth[0] > 0 else 0,
            arrowprops={'arrowstyle': '-|>', 'color': 'black', 'linewidth': 1.4},
        )


def triptych(scene: RowScene, tops: ErrorScales) -> Figure:
    """Scan, nonlinear, linear from one camera; the error in colour, each theory's own scale."""
    camera = dent_camera(scene)
    figure = figure_of(11.0, 4.3)
    flat, _ = camera.project(np.concatenate([scene.rest, scene.nonlinear, scene.linear]))
    reach = 1.10 * float(np.abs(flat).max()) * MILLI
    radius = seen_radius(scene)
    panels = [figure.add_axes((0.005 + 0.333 * k, 0.14, 0.325, 0.74)) for k in range(3)]
    headings = ['scan', 'nonlinear', 'linear']
    for axes, heading in zip(panels, headings, strict=True):
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect='equal')
        axes.set_axis_off()
        axes.set_title(heading, fontsize=12)
    _scan(figure, panels[0], camera, scene)
    for axes, vertices, errors, top_m in (
        (panels[1], scene.nonlinear, scene.nonlinear_error, tops.nonlinear),
        (panels[2], scene.linear, scene.linear_error, tops.linear),
    ):
        scale = Normalize(0.0, top_m * MILLI, clip=True)
        values = vertex_errors(vertices, scene.scan_points, errors, radius)
        _surface(axes, camera, scene, vertices, values * MILLI, scale)
        mean = float(np.abs(errors).mean()) * MILLI if len(errors) else float('nan')
        axes.set_title(f'{axes.get_title()}, mean error {mean:.2f} mm', fontsize=12)
        bar = figure.colorbar(
            ScalarMappable(scale, 'cividis'),
            cax=axes.inset_axes((0.2, -0.03, 0.6, 0.03)),
            orientation='horizontal',
            extend='max',
        )
        bar.ax.tick_params(labelsize=10, pad=1)
        bar.set_label('|distance scan to surface| (mm), scale of this theory', fontsize=10)
    for axes in panels:
        _arrows(axes, camera, scene, 0.28 * reach / MILLI)
    figure.text(
        0.005,
        0.015,
        f'grey: not seen; lines: displacement every {_line_step(scene) * MILLI:g} mm',
        fontsize=10,
    )
    figure.suptitle(f'{in_picture(scene.title)}  ({scene.kind})', fontsize=12, y=0.985)
    return figure


def _scan(figure: Figure, axes: Axes, camera: Camera, scene: RowScene) -> None:
    size = float(np.ptp(scene.rest, axis=0).max())
    shown = visible_points(camera, scene.scan_points, 0.03 * size, 0.12 * size)
    flat, depth = camera.project(scene.scan_points[shown])
    if not len(flat):
        axes.text(0.5, 0.5, 'no scan points', transform=axes.transAxes, ha='center')
        return
    order = np.argsort(depth, kind='stable')
    flat = flat[order] * MILLI
    displacement = scan_displacement(scene)
    inward = displacement[shown][order] * MILLI
    top = max(float(np.percentile(displacement, 99.5)) * MILLI, 0.1)
    drawn = axes.scatter(
        flat[:, 0],
        flat[:, 1],
        s=3.0,
        c=inward,
        cmap='Greys',
        vmin=-0.55 * top,
        vmax=top,
        linewidths=0,
    )
    bar = figure.colorbar(
        drawn, cax=axes.inset_axes((0.3, -0.03, 0.4, 0.03)), orientation='horizontal'
    )
    bar.ax.set_xlim(0.0, top)
    bar.ax.tick_params(labelsize=10, pad=1)
    axes.text(0.28, -0.03, 'dent (mm)', transform=axes.transAxes, fontsize=10, ha='right')


def profile(scene: RowScene) -> Figure:
    """The cut through the first contact: rest, scan, nonlinear, linear."""
    section = dent_section(scene)
    figure = figure_of(5.2, 3.1)
    axes = figure.add_axes((0.13, 0.15, 0.84, 0.77))
    scan = thinned(section.scan, PROFILE_POINTS) * MILLI
    axes.scatter(
        scan[:, 0], scan[:, 1], s=3, color='black', linewidths=0, label=f'scan ({scene.kind})'
    )
    for segments, colour, style, name in (
        (section.rest, REST, ':', 'rest'),
        (section.nonlinear, NONLINEAR, '-', 'nonlinear'),
        (section.linear, LINEAR, '--', 'linear'),
    ):
        axes.add_collection(
            LineCollection(
                list(segments * MILLI), colors=colour, linestyles=style, linewidths=1.6, label=name
            )
        )
    width = 0.36 * float(np.ptp(scene.rest, axis=0).max()) * MILLI
    half = -0.5 * float(np.ptp(scene.rest, axis=0).max())
    near = np.concatenate([section.nonlinear, section.linear]).reshape(-1, 2)
    near = near[(np.abs(near[:, 0]) * MILLI < width) & (near[:, 1] > half)]
    deep = float(near[:, 1].min(initial=0.0))
    # One scale along and across; what is too low for the frame is filled up below.
    tall = 2 * width * (3.1 * 0.77) / (5.2 * 0.84)
    top = 0.12 * width
    axes.set(
        xlim=(-width, width),
        ylim=(min(deep * MILLI - 0.1 * width, top - tall), top),
        aspect='equal',
        xlabel='across the contact axis (mm)',
        ylabel='along it (mm)',
    )
    axes.set_title(in_picture(scene.title), fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc='lower center', ncols=2)
    return figure


def force_displacement(curves: Sequence[Curve]) -> Figure:
    """Force per contact over displacement, each curve with its kind and its band."""
    figure = figure_of(8.0, 4.6)
    axes = figure.add_axes((0.08, 0.12, 0.90, 0.84))
    others = iter(colormaps['cividis'](np.linspace(0.2, 0.9, max(len(curves), 1))))
    styles = cycle([(0, (5, 1, 1, 1)), (0, (1, 1)), (0, (8, 2))])
    for curve in curves:
        x, y = curve.displacement_m * MILLI, curve.force_n
        label = f'{curve.name} ({curve.kind})'
        if curve.kind == 'predicted':
            colour, style = THEORY_LINES.get(curve.name) or (next(others), next(styles))
            axes.plot(x, y, color=colour, linestyle=style, label=label)
            if curve.lower_n is not None and curve.upper_n is not None:
                axes.fill_between(
                    x, curve.lower_n, curve.upper_n, color=colour, alpha=0.18, linewidth=0
                )
            continue
        band = curve.displacement_band_m
        colour = 'black' if curve.kind == 'published' else next(others)
        axes.errorbar(
            x,
            y,
            xerr=None if band is None else band * MILLI,
            yerr=curve.force_band_n,
            fmt=MARKERS[curve.kind],
            markersize=6,
            capsize=2,
            label=label,
            color=colour,
            markerfacecolor='white' if curve.kind == 'synthetic' else colour,
        )
    axes.set(xlabel='displacement of each contact (mm)', ylabel='force per contact (N)')
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    if curves:
        axes.legend(fontsize=8)
    return figure


def mean_errors(lines: Sequence[ErrorLine]) -> Figure:
    """Mean error of scan to surface over the force: the published ones and ours."""
    figure = figure_of(8.0, 3.8)
    axes = figure.add_axes((0.09, 0.14, 0.89, 0.82))
    for line in lines:
        colour, style = THEORY_LINES.get(line.theory, ('black', (0, (1, 1))))
        published = line.kind == 'published'
        axes.plot(
            line.force_n,
            line.error_m * MILLI,
            color=colour,
            linestyle=(0, (1, 3)) if published else style,
            marker=MARKERS[line.kind],
            markerfacecolor=colour if published else 'white',
            label=f'{line.name} ({line.kind})',
        )
    axes.set(xlabel='force per contact (N)', ylabel='mean distance scan to surface (mm)')
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def linearity(trace: LinearityTrace) -> Figure:
    """The predicted relative error of linear theory over the recording."""
    figure = figure_of(8.0, 3.2)
    axes = figure.add_axes((0.09, 0.17, 0.81, 0.79))
    axes.plot(
        trace.time_s, 100 * trace.linearity, color=NONLINEAR, label='gauge of the transition'
    )
    for level, style in ((5.0, ':'), (10.0, '--')):
        axes.axhline(level, color=REST, linestyle=style, linewidth=1)
    axes.set(xlabel='time in the recording (s)', ylabel='error of linear theory (%)')
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    if len(trace.displacement_m):
        right = axes.twinx()
        right.plot(
            trace.time_s, trace.displacement_m * MILLI, color=LINEAR, linestyle='--', linewidth=1
        )
        right.set_ylabel('linear displacement (mm), dashed')
        right.set_ylim(bottom=0)
    return figure
