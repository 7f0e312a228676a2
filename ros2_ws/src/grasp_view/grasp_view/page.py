# SPDX-License-Identifier: Apache-2.0
"""The browser page: 3-D scene, controls, plots. It knows nothing of ROS.

The node calls `update` with what it knows; buttons call back with a command's name from the
server's own threads, so the node puts them in a queue.
"""

from __future__ import annotations

import html
import io
import time
from collections.abc import Callable, Sequence

import viser
from PIL import Image

from . import plot_export, words
from .aim import VIEWS
from .colour_map import legend_html
from .curve_svg import hold_curve_html, turn_curve_html
from .curves import Curves
from .front_page import TITLE, FrontPage
from .grasp_measures import hold_html
from .own_server import OwnServer
from .phone_sheet import PhoneSheets
from .plot_panel import STAMP, PlotPanel
from .probe import Probe, probe_html
from .replay_panel import ReplayPanel, ReplayState
from .scale_bar import scale_html
from .scene_model import DISPLACEMENT, QUANTITIES, SHAPES, Snapshot
from .scene_view import SceneView
from .section import section_of
from .section_svg import section_html
from .surface_layer import Legend
from .time_series import History, TimeSeries
from .view_options import SCAN_CHOICES, ViewOptions
from .visitors import Visitors, Window

Command = Callable[[str], None]
BUTTONS = {
    'tare': ('Tare gauges', 'Zero the strain gauges; the hand must be open and still'),
    'compare': ('Compare scan', 'Compare the newest scan with the surface of its time'),
}
PLOT_PERIOD_S = 0.5
TEXT_PERIOD_S = 0.25


class PageError(RuntimeError):
    """The page cannot be served; the text says on which address and what to do."""


class Page:
    """One served page with everything on it."""

    def __init__(
        self,
        host: str,
        port: int,
        command: Command,
        series: TimeSeries,
        history: History[Snapshot],
        curves: Curves,
        buttons: Sequence[str] = tuple(BUTTONS),
    ) -> None:
        """Serve on http://host:port; raises PageError where that cannot be done.

        buttons: the names in `BUTTONS` to offer beside the screenshot.
        """
        self._parts: dict[str, str] = {}
        try:
            self.server = OwnServer(host, port, FrontPage(self._overlay))
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
        self._series, self._history, self._curves = series, history, curves
        self._visitors = Visitors(self.server)
        self.scene = SceneView(self.server, self._visitors)
        self._probe = Probe(self.server)
        self._sheets = PhoneSheets(self._visitors)
        self._command = command
        self._texts: dict[str, str] = {}
        self._next_plot = self._next_text = 0.0
        self._build(buttons)
        self._plots: dict[int, PlotPanel] = {}

    def _build(self, buttons: Sequence[str]) -> None:
        gui = self.server.gui
        gui.set_panel_label('Grasp')
        self._state = gui.add_html(words.state_html(words.told(Snapshot(), 0.0, 1e9)))
        self._largest, self._numbers = gui.add_html(''), gui.add_html('')
        self._hold = gui.add_html(hold_html(None))
        self._section = gui.add_html(section_html(None))
        self._held, self._turned = gui.add_html(''), gui.add_html('')
        self.replay = ReplayPanel(self.server, self._command)
        self._quantity = gui.add_dropdown(
            'Colour',
            tuple(QUANTITIES),
            initial_value=DISPLACEMENT.name,
            hint='The quantity on the surface; light only darkens its colours a little',
        )
        self._shape = gui.add_dropdown('Answer', SHAPES, initial_value='served')
        view = gui.add_button_group('View', VIEWS, hint='Turn to all of it, to a finger, or above')
        view.on_click(lambda _: self.scene.look(view.value))
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
            export = gui.add_button_group(
                'Export plots', ('CSV', 'PNG'), hint='All numbers over the last seconds'
            )
            export.on_click(lambda event: self._export(event, export.value))
            self._answer = gui.add_html('')
        self._live.on_update(lambda _: self._look_back())

    def show_cones(self) -> None:
        """Draw the friction cones from the start."""
        self._cones.value = True  # type: ignore[misc]

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
        try:
            picture = client.get_render(900, 1200, transport_format='png')
        except RuntimeError:
            # The browser left before it had drawn: nobody waits for the picture.
            return
        stream = io.BytesIO()
        Image.fromarray(picture).save(stream, format='PNG')
        client.send_file_download('grasp.png', stream.getvalue(), save_immediately=True)

    def _export(self, event: viser.GuiEvent, kind: str) -> None:
        if event.client is None or not len(self._series):
            return
        made = plot_export.csv if kind == 'CSV' else plot_export.png
        name = f'grasp_plots.{kind.lower()}'
        event.client.send_file_download(name, made(self._series), save_immediately=True)

    def answer(self, text: str) -> None:
        """Show what came of the last command."""
        self._answer.content = f'<div class="grasp-answer">{html.escape(text)}</div>'

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

    def update(
        self,
        snapshot: Snapshot,
        replay: ReplayState | None,
        answer_age: float = 0.0,
        since_reset: float = float('inf'),
    ) -> None:
        """Show `snapshot`, or the remembered one under the time slider; and where a replay is.

        answer_age: s since the last answer came; since_reset: s since the time jumped.
        """
        now = time.monotonic()
        self.replay.show(replay)
        if not self._live.value:
            snapshot = self._history.at(self._left_at + float(self._back.value)) or snapshot
        legend = self.scene.draw(snapshot, self.options)
        if now >= self._next_text:
            self._next_text = now + TEXT_PERIOD_S
            self._write(snapshot, legend, words.told(snapshot, answer_age, since_reset))
        if now >= self._next_plot:
            self._next_plot = now + PLOT_PERIOD_S
            self._draw_plots(snapshot.time)

    def _draw_plots(self, shown: float) -> None:
        """All diagrams, with a line at the surface of the stamp `shown` (s)."""
        visitors = self._visitors.all
        for number in self._plots.keys() - visitors.keys():
            del self._plots[number]
        for number, visitor in tuple(visitors.items()):
            if number not in self._plots:
                self._plots[number] = PlotPanel(visitor, self._series)
            if self._live.value or self._plots[number].empty:
                self._plots[number].draw()
            else:
                self._plots[number].mark(self._series.when(STAMP, shown))

    def _write(self, snapshot: Snapshot, legend: Legend, now: words.Told) -> None:
        quantity = legend.quantity
        numbers = words.numbers_html(words.numbers_of(snapshot, legend))
        section = None
        if snapshot.mesh is not None:
            section = section_of(snapshot, self.scene.surface.topology(snapshot.mesh).faces)
        for name, element, text in (
            ('state', self._state, words.state_html(now)),
            ('largest', self._largest, words.largest_html(snapshot, now)),
            ('numbers', self._numbers, numbers),
            ('hold', self._hold, hold_html(snapshot.grasp, snapshot.closure)),
            ('section', self._section, section_html(section)),
            ('held', self._held, hold_curve_html(self._curves.hold)),
            ('turned', self._turned, turn_curve_html(self._curves.turn)),
        ):
            if self._texts.get(name) != text:
                element.content = self._texts[name] = text
        reading = self._probe.read(snapshot, self.options, self.scene.surface)
        largest = words.largest_text(snapshot, now)
        scale = legend_html(quantity.name, quantity.unit, legend.low, legend.top, legend.note)
        self._sheets.show(scale)
        self._parts = {
            'title': f'{snapshot.object_name} · {TITLE}'.removeprefix(' · '),
            'header': words.header_html(snapshot),
            'legend': scale,
            'chip': f'<b>{now.word}</b> {largest}',
            'probe': probe_html(reading),
        }

    def _overlay(self, tab: str, width: int, height: int) -> dict[str, str]:
        """What stands over the scene in that tab, of that window's width and picture's height."""
        window = Window(width, height)
        # A phone has its legend in the sheet, and beside the picture what scrolls out of it.
        parts = {**self._parts, 'legend' if width and window.phone else 'chip': ''}
        visitor = self._visitors.of_tab(tab)
        if visitor is not None and width and height:
            # A phone may be turned, a window be drawn out.
            visitor.window = window
            parts['scale'] = scale_html(visitor.reach / height)
        return parts

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()
