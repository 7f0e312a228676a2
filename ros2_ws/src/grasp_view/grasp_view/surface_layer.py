# SPDX-License-Identifier: Apache-2.0
"""The coloured surface: lit, outlined, with lines of equal displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser

from .colour_map import (
    NO_VALUE,
    SIGNED_TABLE,
    TABLE,
    SteadyScale,
    colour_index,
    linear_light,
    renderer_colours,
    three_digits,
)
from .layer import SCALE, Memory, hide
from .level_lines import level_lines
from .poses import Floats
from .scene_model import (
    QUANTITIES,
    Mesh,
    Quantity,
    Snapshot,
    Surface,
    deformed,
    largest,
    values_of,
)
from .shading import Hollow, light_on, lit_colours, normals_of
from .smooth_faces import SmoothFaces
from .unlit_mesh import Body, unlit_glb
from .view_options import ViewOptions
from .visitors import Visitors

UNSEEN_M = 2e-6
"""A surface that moved less than this since it was drawn is not sent again: a pixel is wider."""
OUTLINE_SHARE = 0.0035
BOLD = 5
INK, WHITE = (23, 32, 43), (255, 255, 255)
OUTLINE = renderer_colours(np.array([INK], dtype=np.uint8))[0]


@dataclass(frozen=True)
class Legend:
    """The scale that is on the surface now; `gaps`: some of it is grey for want of a value."""

    quantity: Quantity
    top: float
    largest: float
    line_step_m: float = 0.0
    gaps: bool = False

    @property
    def low(self) -> float:
        """The lower end of the scale."""
        return self.quantity.low(self.top)

    @property
    def note(self) -> str:
        """What the lines and the grey mean."""
        step = self.line_step_m * 1e3
        lines = (
            f'lines: displacement every {three_digits(step)} mm, '
            f'bold every {three_digits(BOLD * step)} mm'
        )
        sign = 'positive: the scan lies outside of the model'
        return '; '.join(
            [lines] * bool(self.line_step_m)
            + [sign] * self.quantity.signed
            + [f'grey: {self.quantity.grey}'] * self.gaps
        )


class Topology:
    """What is made once a mesh: the finer faces, and the hollows of its rest shape."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.faces = SmoothFaces(mesh.triangles, len(mesh.rest))
        self.hollow = Hollow(self.faces.positions(mesh.rest), self.faces.triangles)


class SurfaceLayer:
    """The body and its lines; `legend` is the scale now on it, `drawn` counts surfaces."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.drawn = 0
        self.scales = {name: SteadyScale(q.smallest) for name, q in QUANTITIES.items()}
        self.legend: Legend | None = None
        self._server = server
        self._scene = server.scene
        self._bodies: list[viser.GlbHandle] = []
        self._front = 0
        self._waiting = False
        self._mesh_lines: viser.MeshHandle | None = None
        self._lines: dict[tuple[bool, bool], viser.LineSegmentsHandle] = {}
        self._seen: tuple[Floats, Floats | None, float] | None = None
        self._topology: Topology | None = None
        self._asked, self._arrived, self._wired = Memory(), Memory(), Memory()

    def topology(self, mesh: Mesh) -> Topology:
        """What was made for this mesh."""
        if self._topology is None or self._topology.mesh is not mesh:
            self._topology = Topology(mesh)
        return self._topology

    def draw(self, snapshot: Snapshot, options: ViewOptions, visitors: Visitors) -> None:
        """Draw the chosen answer in the chosen quantity, if anybody could tell the difference."""
        surface, quantity = snapshot.surface(options.shape), options.quantity
        scale = self.scales[quantity.name]
        if surface is None or snapshot.mesh is None:
            hide(*self._bodies, self._mesh_lines, *self._lines.values())
            self._arrived.forget()
            self.legend = self._seen = None
            return
        asked = self._asked.changed(
            snapshot.mesh, quantity, options.exaggeration, options.depth_lines,
            options.mesh_lines, options.shape,
        )  # fmt: skip
        arrived = self._arrived.changed(
            surface, snapshot.linear, snapshot.nonlinear, snapshot.scan_error
        )
        if self.legend is not None and not asked and not arrived:
            self._turn()
            return
        values = values_of(snapshot, quantity, options.shape)
        most = largest(values)
        top = scale.follow(most)
        vertices = deformed(surface, options.exaggeration)
        if self.legend is not None and not asked and self._still(vertices, values, top):
            self._turn()
            return
        self._seen = vertices, values, top
        made = self.topology(snapshot.mesh)
        fine = made.faces.positions(vertices)
        self._show(self._file(made, fine, values, quantity, top))
        self._show_mesh_lines(vertices, snapshot.mesh, options)
        step = self._show_lines(fine, made.faces, surface, options)
        gaps = values is None or not bool(np.isfinite(values).all())
        self.legend = Legend(quantity, top, most, step, gaps)
        self.drawn += 1

    @staticmethod
    def _file(
        made: Topology, fine: Floats, values: Floats | None, quantity: Quantity, top: float
    ) -> bytes:
        """The body with its light in its colours, and the dark hull that outlines it."""
        triangles = made.faces.triangles
        low = quantity.low(top)
        if values is None:
            colours = np.broadcast_to(NO_VALUE, (len(fine), 3))
            share = np.full(len(fine), np.nan)
        else:
            shown = made.faces.values(values)
            table = SIGNED_TABLE if quantity.signed else TABLE
            colours = table[colour_index(shown, low, top)]
            share = np.abs(shown) / top
        normals = normals_of(fine, triangles)
        lit = lit_colours(colours, light_on(normals, made.hollow.depth(fine, normals), share))
        rim = OUTLINE_SHARE * float(np.ptp(fine, axis=0).max())
        return unlit_glb(
            [
                Body(fine * SCALE, triangles, renderer_colours(lit)),
                Body((fine + rim * normals) * SCALE, triangles[:, ::-1], OUTLINE, both=False),
            ]
        )

    def _still(self, vertices: Floats, values: Floats | None, top: float) -> bool:
        """Whether nobody could tell this surface from the one on the screen."""
        if self._seen is None:
            return False
        before, shades, scale = self._seen
        if scale != top or before.shape != vertices.shape:
            return False
        if np.abs(before - vertices).max(initial=0.0) > UNSEEN_M:
            return False
        if values is None or shades is None:
            return values is shades
        return bool(np.allclose(values, shades, rtol=0.0, atol=top / 512, equal_nan=True))

    def _show_lines(
        self, fine: Floats, faces: SmoothFaces, surface: Surface, options: ViewOptions
    ) -> float:
        """Lines of equal displacement, a tenth of its scale apart; returns that step (m).

        Ink where the colour under a line is light, white where it is dark, every fifth bold.
        """
        size = np.linalg.norm(surface.moved, axis=1)
        step = self.scales['displacement'].follow(float(size.max(initial=0.0)) * 1e3) * 1e-4
        found = level_lines(fine * SCALE, faces.triangles, faces.values(size), step)
        own = options.quantity.name == 'displacement'
        kinds: dict[tuple[bool, bool], list[Floats]] = {}
        for level, points in found if options.depth_lines else ():
            under = TABLE[round(min(level * 0.1, 1.0) * 255)] if own else np.array([220, 220, 220])
            light = bool(linear_light(under) @ np.array([0.2126, 0.7152, 0.0722]) > 0.25)
            kinds.setdefault((light, level % BOLD == 0), []).append(points)
        for light, bold in ((a, b) for a in (True, False) for b in (True, False)):
            drawn = self._lines.get((light, bold))
            if (light, bold) not in kinds:
                hide(drawn)
                continue
            lines = np.concatenate(kinds[light, bold]).astype(np.float32)
            if drawn is None:
                self._lines[light, bold] = drawn = self._scene.add_line_segments(
                    f'/depth/{"ink" if light else "white"}_{"bold" if bold else "thin"}',
                    lines,
                    colors=INK if light else WHITE,
                    thickness=2.4 if bold else 1.1,
                    thickness_units='screen',
                )
            drawn.points = lines
            drawn.visible = True
        return step if kinds else 0.0

    def _show(self, glb: bytes) -> None:
        # A body is gone from the browser while it parses a new file: two take turns, the hidden
        # one is filled and shown at the next call, one frame later.
        if not self._bodies:
            self._bodies = [
                self._scene.add_glb(f'/surface_{k}', glb, cast_shadow=False, receive_shadow=0.3)
                for k in range(2)
            ]
            self._bodies[1].visible = False
            return
        self._turn()
        hidden = self._bodies[1 - self._front]
        with self._server.atomic():
            self._bodies[self._front].visible = True
            hidden.visible = False
            hidden.glb_data = glb
        self._waiting = True

    def _turn(self) -> None:
        """Show the body that was filled at the last call."""
        if not self._waiting:
            return
        self._waiting = False
        self._front = 1 - self._front
        with self._server.atomic():
            self._bodies[self._front].visible = True
            self._bodies[1 - self._front].visible = False

    def _show_mesh_lines(self, vertices: Floats, mesh: Mesh, options: ViewOptions) -> None:
        if not options.mesh_lines:
            hide(self._mesh_lines)
            return
        if self._mesh_lines is None or self._wired.changed(mesh):
            self._mesh_lines = self._scene.add_mesh_simple(
                '/lines',
                vertices * SCALE,
                mesh.triangles,
                color=(0, 0, 0),
                wireframe=True,
                opacity=0.12,
                cast_shadow=False,
                receive_shadow=False,
            )
        else:
            self._mesh_lines.vertices = (vertices * SCALE).astype(np.float32)
        self._mesh_lines.visible = True
