# SPDX-License-Identifier: Apache-2.0
"""The browser page: 3-D scene, controls, plots. It knows nothing of ROS.

The node calls `update` with what it knows; buttons call back with a command's name from the
server's own threads, so the node puts them in a queue.
"""

from __future__ import annotations

import html
import io
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import viser
from PIL import Image

from .colour_map import legend_html, three_digits
from .own_server import OwnServer
from .plot_panel import PlotPanel
from .replay_panel import ReplayPanel, ReplayState
from .scene_model import DISPLACEMENT, QUANTITIES, SHAPES, Snapshot
from .scene_view import Legend, SceneView
from .time_series import History, TimeSeries
from .view_options import SCAN_CHOICES, ViewOptions
from .windows import Windows

Command = Callable[[str], None]
BUTTONS = {
    'tare': ('Tare gauges', 'Zero the strain gauges; the hand must be open and still'),
    'compare': ('Compare scan', 'Compare the newest scan with the surface of its time'),
}
STATE_COLOURS = {
    'NO_HAND': '#666666',
    'FREE': '#2a5f8f',
    'CONTACT': '#1f6b3a',
    'SATURATED': '#9a5b00',
    'STALE': '#a32020',
    'FAULT': '#a32020',
}
# Label in the banner: name in `Snapshot.numbers`, SI unit.
NUMBERS = {
    'displacement': ('max_displacement', 'm'),
    'linear theory off by': ('linearity', ''),
    'strain energy': ('strain_energy', 'J'),
    'nonlinear age': ('nonlinear_age', 's'),
    'scan mean error': ('mean_error', 'm'),
    'noise floor': ('noise_floor', 'm'),
}
PLOT_PERIOD_S = 0.5
TEXT_PERIOD_S = 0.25


class PageError(RuntimeError):
    """The page cannot be served; the text says on which address and what to do."""


def state_html(state: str, lines: Mapping[str, str]) -> str:
    """The banner: the state in words on its colour, and numbers beside it."""
    colour = STATE_COLOURS.get(state, '#666666')
    name = html.escape(state or 'waiting for deformation/state')
    cells = ''.join(
        f'<span>{html.escape(key)}</span> <b style="text-align:right">{html.escape(value)}</b> '
        for key, value in lines.items()
    )
    return (
        f'<div class="grasp-state" style="background:{colour};color:#fff;padding:0.3em 1em;'
        f'font-weight:600">{name}</div><div class="grasp-numbers" style="display:grid;'
        'grid-template-columns:auto auto;gap:0.05em 1em;padding:0.4em 1em;font-size:0.85em;'
        f'font-variant-numeric:tabular-nums">{cells}</div>'
    )


def with_unit(value: float, unit: str) -> str:
    """A number in SI as people read it: m in mm, J in mJ, s in ms below one second, 1 in %."""
    factor, shown = {'m': (1e3, 'mm'), 'J': (1e3, 'mJ'), 's': (1e3, 'ms'), '': (1e2, '%')}[unit]
    if unit == 's' and value >= 1.0:
        return f'{value:.1f} s'
    return f'{three_digits(value * factor)} {shown}'


def numbers_of(snapshot: Snapshot, legend: Legend) -> dict[str, str]:
    """The banner's numbers with their units, only those that are known."""
    lines = {
        label: with_unit(snapshot.numbers[name], unit)
        for label, (name, unit) in NUMBERS.items()
        if np.isfinite(snapshot.numbers.get(name, np.nan))
    }
    if legend.quantity is not DISPLACEMENT:
        largest = f'{three_digits(legend.largest)} {legend.quantity.unit}'
        lines[f'largest {legend.quantity.name}'] = largest
    return lines


class Page:
    """One served page with everything on it."""

    def __init__(
        self,
        host: str,
        port: int,
        command: Command,
        series: TimeSeries,
        history: History[Snapshot],
        buttons: Sequence[str] = tuple(BUTTONS),
    ) -> None:
        """Serve on http://host:port; raises PageError where that cannot be done.

        buttons: the names in `BUTTONS` to offer beside the screenshot.
        """
        try:
            self.server = OwnServer(host, port)
        except OSError as error:
            raise PageError(
                f'cannot serve on {host}:{port}: {error}; parameter host is an address of this '
                'machine, or 0.0.0.0 for all of them'
            ) from error
        if self.server.get_port() != port and port != 0:
            taken = self.server.get_port()
            self.server.stop()
            raise PageError(
                f'port {port} on {host} is taken (the next free one would be {taken}); '
                'choose another by the parameter port'
            )
        self._series, self._history = series, history
        self._windows = Windows(self.server)
        self.scene = SceneView(self.server, self._windows)
        self._command = command
        self._legend_text = self._state_text = ''
        self._next_plot = self._next_text = 0.0
        self._build(buttons)
        self._plots: dict[int, PlotPanel] = {}

    def _build(self, buttons: Sequence[str]) -> None:
        gui = self.server.gui
        gui.configure_theme(
            control_layout='floating',
            control_width='medium',
            show_logo=False,
            show_share_button=False,
            brand_color=(0, 69, 124),
        )
        gui.set_panel_label('Grasp')
        self._state = gui.add_html(state_html('', {}))
        self._legend = gui.add_html('')
        self._quantity = gui.add_dropdown(
            'Colour',
            tuple(QUANTITIES),
            initial_value=DISPLACEMENT.name,
            hint="The quantity on the surface, unlit: its colours are the legend's",
        )
        self._shape = gui.add_dropdown('Answer', SHAPES, initial_value='served')
        self._exaggeration = gui.add_slider('Exaggerate', 1.0, 10.0, 0.5, 1.0)
        with gui.add_folder('Show', expand_by_default=False):
            self._rest = gui.add_checkbox('Rest shape', True)
            self._depth = gui.add_checkbox('Lines of equal displacement', True)
            self._lines = gui.add_checkbox('Mesh lines', False)
            self._contacts = gui.add_checkbox('Forces', True)
            self._scan = gui.add_dropdown('Scan', SCAN_CHOICES)
            self._hand = gui.add_checkbox('Hand', True)
            self._cones = gui.add_checkbox('Friction cones', False)
            self._friction = gui.add_slider('Friction coefficient', 0.05, 1.5, 0.05, 0.5)
        self.replay = ReplayPanel(self.server, self._command)
        with gui.add_folder('Look back', expand_by_default=False):
            self._live = gui.add_checkbox('Live', True, hint='Off: look back with the slider')
            self._back = gui.add_slider('Seconds', -1.0, 0.0, 0.01, 0.0, disabled=True)
            self._left_at = 0.0
        with gui.add_folder('Actions'):
            for name in buttons:
                label, hint = BUTTONS[name]
                gui.add_button(label, hint=hint).on_click(self._caller(name))
            gui.add_button('Screenshot', hint='Save the 3-D picture as PNG').on_click(
                self._screenshot
            )
            self._answer = gui.add_html('')
        self._live.on_update(lambda _: self._look_back())

    def _caller(self, name: str) -> Callable[[object], None]:
        return lambda _: self._command(name)

    def _look_back(self) -> None:
        self._back.disabled = self._live.value
        first, self._left_at = self._history.ends
        self._back.min = min(round(first - self._left_at, 2), -0.01)

    def _screenshot(self, event: viser.GuiEvent) -> None:
        client = event.client
        if client is None:
            return
        picture = client.get_render(900, 1200, transport_format='png')
        stream = io.BytesIO()
        Image.fromarray(picture).save(stream, format='PNG')
        client.send_file_download('grasp.png', stream.getvalue(), save_immediately=True)

    def answer(self, text: str) -> None:
        """Show what came of the last command."""
        self._answer.content = (
            '<div class="grasp-answer" style="padding:0.2em 1em;font-size:0.85em">'
            f'{html.escape(text)}</div>'
        )

    @property
    def options(self) -> ViewOptions:
        """What the visitor chose to see."""
        return ViewOptions(
            QUANTITIES[self._quantity.value],
            self._shape.value,
            float(self._exaggeration.value),
            self._rest.value,
            self._depth.value,
            self._lines.value,
            self._contacts.value,
            self._scan.value,
            self._hand.value,
            self._cones.value,
            float(self._friction.value),
        )

    @property
    def live(self) -> bool:
        """False while the visitor looks back in time."""
        return bool(self._live.value)

    @property
    def watched(self) -> bool:
        """Whether any browser is connected."""
        return bool(self.server.get_clients())

    def update(self, snapshot: Snapshot, replay: ReplayState | None) -> None:
        """Show `snapshot`, or the remembered one under the time slider; and where a replay is."""
        now = time.monotonic()
        self.replay.show(replay)
        if not self._live.value:
            snapshot = self._history.at(self._left_at + float(self._back.value)) or snapshot
        legend = self.scene.draw(snapshot, self.options)
        if now >= self._next_text:
            self._next_text = now + TEXT_PERIOD_S
            self._write(snapshot, legend)
        if now >= self._next_plot:
            self._next_plot = now + PLOT_PERIOD_S
            self._draw_plots()

    def _draw_plots(self) -> None:
        clients = self.server.get_clients()
        for number in self._plots.keys() - clients.keys():
            del self._plots[number]
        for number, client in clients.items():
            if number not in self._plots:
                self._plots[number] = PlotPanel(
                    client, self._series, self._windows.of(client).narrow
                )
            self._plots[number].draw()

    def _write(self, snapshot: Snapshot, legend: Legend) -> None:
        quantity = legend.quantity
        text = legend_html(quantity.name, quantity.unit, 0.0, legend.top, legend.note)
        if text != self._legend_text:
            self._legend.content = self._legend_text = text
        text = state_html(snapshot.state, numbers_of(snapshot, legend))
        if text != self._state_text:
            self._state.content = self._state_text = text

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()
