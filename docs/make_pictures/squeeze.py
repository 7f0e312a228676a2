# SPDX-License-Identifier: Apache-2.0
"""The ball between two fingers, from our own solver: an animation, and force over displacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from docs.make_pictures import BALL, PICTURES, ROOT
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from grasp_replay.report.camera import Camera, faces_viewer, painter_order
from grasp_replay.report.pictures import LINEAR, NONLINEAR, REST, indexed
from grasp_replay.report.section import cut, level_lines
from shell_deform.building import build_model, object_contacts
from shell_deform.model import ShellModel
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions

Array = NDArray[np.float64]
STEPS = 20
DEEPEST_M = 10.27e-3
MILLI = 1e3


@dataclass(frozen=True)
class Squeeze:
    """A ball squeezed in steps: force per finger (s,) N, own displacement (s,) m, outer faces.

    triangles (t, 3); shapes (s, v, 3) m.
    """

    force: Array
    displacement: Array
    triangles: NDArray[np.int32]
    shapes: Array


class _Skin:
    """Where the outer face is sampled: nine small triangles per control triangle."""

    def __init__(self, model: ShellModel, parts: int = 3) -> None:
        surface = model.surface
        mesh = surface.mesh
        grid = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
        number = {place: k for k, place in enumerate(grid)}
        small = [
            (number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in grid if i + j < parts
        ] + [
            (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
            for i, j in grid
            if i + j < parts - 1
        ]
        count = len(mesh.triangles)
        self.surface = surface
        self.triangle = np.repeat(np.arange(count), len(grid))
        self.parameters = np.tile(np.array(grid, dtype=np.float64) / parts, (count, 1))
        self.triangles = (
            np.array(small)[None] + len(grid) * np.arange(count)[:, None, None]
        ).reshape(-1, 3)

    def outer(self, positions: Array, thickness: float) -> Array:
        found = self.surface.evaluate(positions, self.triangle, self.parameters)
        return found.position + 0.5 * thickness * found.normal


def squeeze(theory: str, values: Sequence[float], by_force: bool) -> Squeeze:
    """Solve the ball for displacements (m) or forces (N) of both contacts."""
    ball = load_object(BALL)
    model = build_model(ball, theory)
    contacts = object_contacts(ball, model)
    solver = EquilibriumSolver(model, NewtonOptions())
    skin = _Skin(model)
    state = solver.rest()
    forces, moved, shapes = [0.0], [0.0], [skin.outer(state.positions, ball.thickness_m)]
    for value in values:
        case = (forced if by_force else displaced)(contacts, [value] * len(contacts))
        state = solver.solve(case, state)
        if not state.converged:
            raise RuntimeError(f'{theory}: no equilibrium at {value:g}: {state.message}')
        forces.append(float(np.mean(state.force)))
        moved.append(float(np.mean(state.displacement)))
        shapes.append(skin.outer(state.positions, ball.thickness_m))
    return Squeeze(
        np.array(forces), np.array(moved), skin.triangles.astype(np.int32), np.array(shapes)
    )


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=100)
    FigureCanvasAgg(figure)
    return figure


def _pixels(figure: Figure) -> NDArray[np.uint8]:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]


def _camera() -> Camera:
    toward = np.array([0.62, -0.70, 0.36])
    toward /= np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    return Camera(right, np.cross(toward, right), toward, np.zeros(3))


def _draw_ball(axes: Axes, solved: Squeeze, step: int, scale: Normalize, title: str) -> None:
    camera, vertices = _camera(), solved.shapes[step]
    depth = np.linalg.norm(vertices - solved.shapes[0], axis=1) * MILLI
    order = painter_order(camera, vertices, solved.triangles)
    triangles = solved.triangles[order]
    triangles = triangles[faces_viewer(camera, vertices, triangles)]
    flat, _ = camera.project(vertices)
    colours = colormaps['cividis'](scale(depth[triangles].mean(axis=1)))
    axes.add_collection(
        PolyCollection(
            list(flat[triangles] * MILLI), facecolors=colours, edgecolors=colours, linewidths=0.4
        )
    )
    for level in range(1, int(depth.max()) + 1):
        lines = level_lines(vertices, triangles, depth, float(level))
        ends, _ = camera.project(lines.reshape(-1, 3))
        axes.add_collection(
            LineCollection(
                list(ends.reshape(-1, 2, 2) * MILLI), colors='white', linewidths=0.7, alpha=0.8
            )
        )
    pole = 32.5e-3 - solved.displacement[step]
    for side in (1.0, -1.0):
        ends, near = camera.project(np.array([[side * (pole + 16e-3), 0, 0], [side * pole, 0, 0]]))
        axes.annotate(
            '',
            tuple(ends[1] * MILLI),
            tuple(ends[0] * MILLI),
            zorder=5 if near[0] > 0 else 0,
            arrowprops={'arrowstyle': '-|>', 'color': 'black', 'linewidth': 1.6},
        )
    axes.set(xlim=(-43, 43), ylim=(-38, 38), aspect='equal')
    axes.set_axis_off()
    axes.set_title(
        f'{title}\n{solved.displacement[step] * MILLI:4.1f} mm', fontsize=11, family='monospace'
    )


def _draw_cut(axes: Axes, solutions: Sequence[tuple[Squeeze, str, str]], step: int) -> None:
    """The ball cut through both contacts, at rest and by each theory."""
    rest = solutions[0][0]
    for solved, colour, style, k in ((rest, REST, ':', 0), *((*one, step) for one in solutions)):
        lines = cut(solved.shapes[k], solved.triangles, np.array([0.0, 0.0, 1.0]), 0.0)
        axes.add_collection(
            LineCollection(
                list(lines[..., :2] * MILLI), colors=colour, linestyles=style, linewidths=1.4
            )
        )
    axes.set(xlim=(-36, 36), ylim=(-36, 36), aspect='equal')
    axes.set_axis_off()
    axes.set_title('cut through both pins', fontsize=10)


def draw_squeeze() -> list[Path]:
    """The animated squeeze: the same force on the ball by nonlinear and by linear theory."""
    nonlinear = squeeze('koiter', np.linspace(0, DEEPEST_M, STEPS + 1)[1:].tolist(), False)
    linear = squeeze('linear', nonlinear.force[1:].tolist(), True)
    scale = Normalize(0.0, 10.0, clip=True)
    frames = []
    # In, hold, out.
    for step in [*range(STEPS + 1), *[STEPS] * 5, *range(STEPS - 2, 0, -2)]:
        figure = _figure(9.0, 3.3)
        _draw_ball(
            figure.add_axes((0.0, 0.0, 0.31, 0.88)), nonlinear, step, scale, 'nonlinear theory'
        )
        bar = figure.colorbar(
            ScalarMappable(scale, 'cividis'), cax=figure.add_axes((0.315, 0.17, 0.012, 0.6))
        )
        bar.ax.set_title('mm', fontsize=9)
        both = ((nonlinear, NONLINEAR, '-'), (linear, LINEAR, '-'))
        _draw_cut(figure.add_axes((0.38, 0.03, 0.29, 0.8)), both, step)
        axes = figure.add_axes((0.735, 0.17, 0.25, 0.66))
        for (solved, colour, style), name in zip(both, ('nonlinear', 'linear'), strict=True):
            axes.plot(
                solved.displacement * MILLI, solved.force, style, color=colour, lw=1.4, label=name
            )
            axes.plot(solved.displacement[step] * MILLI, solved.force[step], 'o', color=colour)
        axes.set(xlim=(0, 10.8), ylim=(0, 1.08 * nonlinear.force.max()))
        axes.set_xlabel('displacement (mm)', fontsize=9)
        axes.set_title('force per finger (N)', fontsize=10)
        axes.legend(loc='lower right', fontsize=9)
        axes.grid(alpha=0.3)
        frames.append(indexed(_pixels(figure)))
    path = PICTURES / 'squeeze.gif'
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=90, loop=0, optimize=True
    )
    return [path]


def _published() -> list[dict[str, float]]:
    table = yaml.safe_load((ROOT / 'bags' / 'published' / 'table1.yaml').read_text())
    return [row for row in table['rows'] if row['object'] == BALL]


def draw_force() -> list[Path]:
    """Force over displacement of the ball: three theories, one modulus, the published rows."""
    figure = _figure(7.5, 4.4)
    axes = figure.add_axes((0.09, 0.13, 0.89, 0.84))
    depths = np.linspace(0, 11e-3, 23)[1:].tolist()
    for theory, colour, style in (
        ('koiter', NONLINEAR, '-'),
        ('paper', REST, '-.'),
        ('linear', LINEAR, '--'),
    ):
        solved = squeeze(theory, depths, False)
        axes.plot(
            solved.displacement * MILLI,
            solved.force,
            style,
            color=colour,
            label=f'{theory} (ours)',
        )
    rows = _published()
    axes.errorbar(
        [row['measured_max_displacement_m'] * MILLI for row in rows],
        [row['force_n'] for row in rows],
        xerr=0.127,
        fmt='s',
        color='black',
        capsize=2,
        label='measured (published, Table I)',
    )
    axes.set(
        xlabel='displacement of each contact (mm)',
        ylabel='force per finger (N)',
        xlim=(0, 11),
        ylim=(0, 40),
    )
    axes.grid(alpha=0.3)
    axes.legend()
    path = PICTURES / 'force_displacement.png'
    figure.savefig(path, metadata={'Software': None})
    return [path]
