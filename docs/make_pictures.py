"""The project's pictures again: `make pictures`, or `make_pictures.py --only squeeze force`.

squeeze: the ball between two fingers, nonlinear beside linear, from our own solver (GIF).
force: force over displacement of each theory beside the published rows.
report, view, what_if: screenshots of the report, of the live page while the recorded ball is
replayed, and of fingers placed by hand; they need a Chromium, the first two the recording.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
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
from grasp_replay.report.section import level_lines
from shell_deform.building import build_model, object_contacts
from shell_deform.model import ShellModel
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / 'docs' / 'pictures'
BALL = 'tennis_ball'
BAG = ROOT / 'bags' / 'tennis_ball_two_finger'
STEPS = 20
DEEPEST_M = 10.27e-3
MILLI = 1e3
BROWSER_FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--use-gl=angle',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
)


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


def draw_squeeze() -> Path:
    """The animated squeeze: the same force on the ball by nonlinear and by linear theory."""
    nonlinear = squeeze('koiter', np.linspace(0, DEEPEST_M, STEPS + 1)[1:].tolist(), False)
    linear = squeeze('linear', nonlinear.force[1:].tolist(), True)
    scale = Normalize(0.0, 10.0, clip=True)
    frames = []
    # In, hold, out.
    for step in [*range(STEPS + 1), *[STEPS] * 5, *range(STEPS - 2, 0, -2)]:
        figure = _figure(9.0, 3.5)
        for k, (solved, title) in enumerate(((nonlinear, 'nonlinear'), (linear, 'linear'))):
            _draw_ball(figure.add_axes((0.31 * k, 0.0, 0.31, 0.86)), solved, step, scale, title)
        axes = figure.add_axes((0.735, 0.17, 0.25, 0.68))
        for solved, colour, style in ((nonlinear, NONLINEAR, '-'), (linear, LINEAR, '--')):
            axes.plot(solved.displacement * MILLI, solved.force, style, color=colour, lw=1.2)
            axes.plot(solved.displacement[step] * MILLI, solved.force[step], 'o', color=colour)
        axes.set(xlim=(0, 10.5), ylim=(0, 1.08 * nonlinear.force.max()))
        axes.set_xlabel('displacement (mm)', fontsize=9)
        axes.set_title('force per finger (N)', fontsize=9)
        axes.grid(alpha=0.3)
        bar = figure.colorbar(
            ScalarMappable(scale, 'cividis'), cax=figure.add_axes((0.635, 0.17, 0.012, 0.6))
        )
        bar.ax.set_title('mm', fontsize=9)
        figure.text(0.31, 0.03, 'the same force on both', ha='center', fontsize=9)
        frames.append(indexed(_pixels(figure)))
    path = PICTURES / 'squeeze.gif'
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=90, loop=0, optimize=True
    )
    return path


def _published() -> list[dict[str, float]]:
    table = yaml.safe_load((ROOT / 'bags' / 'published' / 'table1.yaml').read_text())
    return [row for row in table['rows'] if row['object'] == BALL]


def draw_force() -> Path:
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
    return path


@contextlib.contextmanager
def _browser(width: int, height: int) -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=shutil.which('chromium'), args=list(BROWSER_FLAGS)
        )
        tab = browser.new_page(viewport={'width': width, 'height': height})
        tab.set_default_timeout(120_000)
        yield tab
        browser.close()


def draw_report() -> Path:
    """The report of the recorded ball, as a browser shows it."""
    path = PICTURES / 'report.png'
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [str(Path(sys.executable).parent / 'grasp_report'), str(BAG), '--out', folder],
            check=True,
        )
        with _browser(1200, 1500) as tab:
            tab.goto((Path(folder) / 'report.html').as_uri())
            tab.wait_for_selector('body.webgl')
            tab.screenshot(path=path)
    return path


class _Processes(contextlib.ExitStack):
    """Started nodes on a ROS domain of their own, ended by SIGINT; their output in a folder."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(self.enter_context(tempfile.TemporaryDirectory()))

    def start(self, *command: str) -> Path:
        """Start an executable of the environment; returns its log file."""
        log = self.folder / f'{command[0]}.log'
        with log.open('wb') as stream:
            process = subprocess.Popen(
                [str(Path(sys.executable).parent / command[0]), *command[1:]],
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={
                    **os.environ,
                    'ROS_DOMAIN_ID': '93',
                    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                },
            )
        self.callback(_end, process)
        return log


def _end(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _wait(log: Path, text: str, seconds: float = 120.0) -> None:
    deadline = time.monotonic() + seconds
    while text not in log.read_text(errors='replace'):
        if time.monotonic() > deadline:
            raise RuntimeError(f'{text!r} did not come within {seconds:g} s: {log.read_text()}')
        time.sleep(0.1)


def _free_port() -> str:
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return str(free.getsockname()[1])


def _deep(tab: Any, least_mm: float) -> bool:
    found = re.search(r'displacement\s+([\d.]+) mm', tab.locator('.grasp-numbers').inner_text())
    return found is not None and float(found.group(1)) >= least_mm


def draw_view() -> Path:
    """The live page while the recorded ball is replayed through the real nodes."""
    path, port = PICTURES / 'view.png', _free_port()
    ball = ('--ros-args', '-p', f'object:={BALL}')
    with _Processes() as nodes, _browser(1280, 860) as tab:
        page = nodes.start('grasp_view', '--ros-args', '-p', f'port:={port}')
        _wait(nodes.start('deformation', *ball), 'serving')
        nodes.start('scan_compare', *ball)
        _wait(page, 'page ready')
        tab.goto(f'http://127.0.0.1:{port}')
        tab.wait_for_selector('.grasp-legend')
        # Slower than recorded, so that a slow browser does not miss the deep dent.
        nodes.start('replay', str(BAG), '--rate', '0.5', '--loop')
        deadline = time.monotonic() + 90
        while not _deep(tab, 8.0) and time.monotonic() < deadline:
            tab.wait_for_timeout(100)
        tab.wait_for_timeout(2000)
        tab.screenshot(path=path)
    return path


def draw_what_if() -> Path:
    """Fingers placed in the page, solved live."""
    path, port = PICTURES / 'what_if.png', _free_port()
    with _Processes() as nodes, _browser(1280, 860) as tab:
        page = nodes.start(
            'grasp_view', '--ros-args', '-p', f'port:={port}', '-p', 'what_if:=true'
        )
        _wait(page, 'serving')
        tab.goto(f'http://127.0.0.1:{port}')
        tab.wait_for_selector('.grasp-legend')
        force = tab.locator('input[value="5"]').first
        force.fill('15')
        force.press('Enter')
        deadline = time.monotonic() + 60
        while not _deep(tab, 4.0) and time.monotonic() < deadline:
            tab.wait_for_timeout(100)
        tab.wait_for_timeout(3000)
        tab.screenshot(path=path)
    return path


DRAWERS = {
    'squeeze': draw_squeeze,
    'force': draw_force,
    'report': draw_report,
    'view': draw_view,
    'what_if': draw_what_if,
}
NEED_BROWSER = ('report', 'view', 'what_if')
NEED_RECORDING = ('report', 'view')


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw all pictures, or those named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--only', nargs='+', choices=DRAWERS, default=list(DRAWERS))
    chosen = parser.parse_args(arguments).only
    # Ending by SIGTERM must end the started nodes too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in chosen:
        missing = [
            what
            for what, needed in (
                ('a chromium', name in NEED_BROWSER and shutil.which('chromium') is None),
                (f'bags/{BAG.name}', name in NEED_RECORDING and not BAG.is_dir()),
            )
            if needed
        ]
        if missing:
            print(f'{name}: left out, it needs {" and ".join(missing)}')
            continue
        path = DRAWERS[name]()
        print(f'{path.relative_to(ROOT)}: {path.stat().st_size / 1e3:.0f} kB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
