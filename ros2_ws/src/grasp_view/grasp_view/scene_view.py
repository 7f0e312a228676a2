# SPDX-License-Identifier: Apache-2.0
"""The 3-D half of the page: a snapshot in, bodies in the browser out.

Lengths are multiplied by `SCALE` on the way out: browsers clip and round a 65 mm ball drawn in
metres. Only what has changed since the last call is sent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser

from .aim import Aim
from .colour_map import RENDERER_TABLE, TABLE, SteadyScale, colour_index, three_digits
from .hand_shape import hand_bodies
from .poses import Floats, Pose, quaternion_wxyz
from .scene_model import (
    QUANTITIES,
    Arrow,
    Mesh,
    Quantity,
    Snapshot,
    Surface,
    arrows,
    deformed,
    friction_cones,
    largest,
    level_lines,
    surface_colours,
    values_of,
)
from .smooth_faces import SmoothFaces
from .unlit_mesh import unlit_glb
from .view_options import ViewOptions
from .windows import Windows

SCALE = 20.0
METRES_PER_NEWTON = 1.2e-3
LABELS = 8
REST_MOVED_M = 2e-5
UNSEEN_M = 2e-6
"""A surface that moved less than this since it was drawn is not sent again: a pixel is wider."""
HAND_OPACITY = 0.5
FORCE, FLAGGED = (20, 20, 20), (200, 60, 20)


@dataclass(frozen=True)
class Legend:
    """The scale that is on the surface now; `gaps`: some of it is grey for want of a value."""

    quantity: Quantity
    top: float
    largest: float
    line_step_m: float = 0.0
    gaps: bool = False

    @property
    def note(self) -> str:
        """What the lines and the grey mean."""
        step = f'lines: displacement every {three_digits(self.line_step_m * 1e3)} mm'
        parts = [step] * bool(self.line_step_m) + [f'grey: {self.quantity.grey}'] * self.gaps
        return '; '.join(parts)


class SceneView:
    """Bodies of one page; `draw` is called with every new snapshot, `drawn` counts surfaces."""

    def __init__(self, server: viser.ViserServer, windows: Windows) -> None:
        self.drawn = 0
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction('+z')
        self._scene.configure_default_lights(enabled=True, cast_shadow=False)
        self._scales = {name: SteadyScale(q.smallest) for name, q in QUANTITIES.items()}
        self._surfaces: list[viser.GlbHandle] = []
        self._front = 0
        self._waiting = False
        self._lines: viser.MeshHandle | None = None
        self._depth: viser.LineSegmentsHandle | None = None
        self._legend: Legend | None = None
        self._rest: viser.MeshHandle | None = None
        self._scan: viser.PointCloudHandle | None = None
        self._arrows: viser.ArrowsHandle | None = None
        self._cones: viser.LineSegmentsHandle | None = None
        self._bodies: dict[str, viser.BoxHandle] = {}
        self._labels: list[viser.LabelHandle] = []
        self._drawn: dict[str, object] = {}
        self._seen: tuple[Floats, Floats | None, float] | None = None
        self._aim = Aim(server, windows)
        self._faces: tuple[Mesh, SmoothFaces] | None = None
        self._rest_drawn: Floats | None = None

    def _changed(self, part: str, *what: object) -> bool:
        """Whether any object behind `part` is another one than at the last call."""
        before = self._drawn.get(part)
        same = (
            isinstance(before, tuple)
            and len(before) == len(what)
            and all(
                a is b or (isinstance(a, float | bool | str) and a == b)
                for a, b in zip(before, what, strict=True)
            )
        )
        self._drawn[part] = what
        return not same

    @staticmethod
    def _frame(snapshot: Snapshot) -> str:
        return '' if snapshot.served is None else snapshot.served.frame

    def draw(self, snapshot: Snapshot, options: ViewOptions) -> Legend:
        """Bring the browsers up to date; returns the scale now on the surface."""
        legend = self._draw_surface(snapshot, options)
        self._draw_rest(snapshot, options)
        self._draw_contacts(snapshot, options)
        self._draw_cones(snapshot, options)
        self._draw_scan(snapshot, options, legend)
        self._draw_hand(snapshot, options)
        if snapshot.mesh is not None:
            shown = snapshot.surface(options.shape)
            self._aim.look((snapshot.mesh.rest if shown is None else shown.position) * SCALE)
        return legend

    def _draw_surface(self, snapshot: Snapshot, options: ViewOptions) -> Legend:
        surface = snapshot.surface(options.shape)
        quantity = options.quantity
        scale = self._scales[quantity.name]
        if surface is None or snapshot.mesh is None:
            self._hide(*self._surfaces, self._lines, self._depth)
            self._drawn.pop('surface', None)
            self._legend = None
            self._seen = None
            return Legend(quantity, scale.top, 0.0)
        asked = self._changed(
            'picture', snapshot.mesh, quantity, options.exaggeration, options.depth_lines,
            options.mesh_lines, options.shape,
        )  # fmt: skip
        arrived = self._changed(
            'surface', surface, snapshot.linear, snapshot.nonlinear, snapshot.scan_error
        )
        if self._legend is not None and not asked and not arrived:
            self._turn()
            return self._legend
        values = values_of(snapshot, quantity, options.shape)
        most = largest(values)
        top = scale.follow(most)
        vertices = deformed(surface, options.exaggeration) * SCALE
        if self._legend is not None and not asked and self._still(vertices, values, top):
            self._turn()
            return self._legend
        self._seen = vertices, values, top
        faces = self._smooth(snapshot.mesh)
        fine = faces.positions(vertices)
        shown = None if values is None else faces.values(values)
        index = surface_colours(shown, len(fine), top)
        self._show(unlit_glb(fine, faces.triangles, RENDERER_TABLE[index]))
        self._show_mesh_lines(vertices, snapshot, options)
        step = self._show_depth_lines(fine, faces, surface, options)
        gaps = values is None or not bool(np.isfinite(values).all())
        self._legend = Legend(quantity, top, most, step, gaps)
        self.drawn += 1
        return self._legend

    def _still(self, vertices: Floats, values: Floats | None, top: float) -> bool:
        """Whether nobody could tell this surface from the one on the screen."""
        if self._seen is None:
            return False
        before, shades, scale = self._seen
        if scale != top or before.shape != vertices.shape:
            return False
        if np.abs(before - vertices).max(initial=0.0) > UNSEEN_M * SCALE:
            return False
        if values is None or shades is None:
            return values is shades
        return bool(np.allclose(values, shades, rtol=0.0, atol=top / 512, equal_nan=True))

    def _smooth(self, mesh: Mesh) -> SmoothFaces:
        if self._faces is None or self._faces[0] is not mesh:
            self._faces = mesh, SmoothFaces(mesh.triangles, len(mesh.rest))
        return self._faces[1]

    @staticmethod
    def _hide(*handles: viser.SceneNodeHandle | None) -> None:
        for handle in handles:
            if handle is not None and handle.visible:
                handle.visible = False

    def _show_depth_lines(
        self, vertices: Floats, faces: SmoothFaces, surface: Surface, options: ViewOptions
    ) -> float:
        """White lines of equal displacement, a tenth of its scale apart; returns that step (m)."""
        depth = np.linalg.norm(surface.moved, axis=1)
        step = self._scales['displacement'].follow(float(depth.max(initial=0.0)) * 1e3) * 1e-4
        depth = faces.values(depth)
        points = level_lines(vertices, faces.triangles, depth, step).astype(np.float32)
        if not options.depth_lines or not len(points):
            self._hide(self._depth)
            return 0.0
        if self._depth is None:
            self._depth = self._scene.add_line_segments(
                '/depth', points, colors=(255, 255, 255), thickness=1.2, thickness_units='screen'
            )
        else:
            self._depth.points = points
        self._depth.visible = True
        return step

    def _show(self, glb: bytes) -> None:
        # A body is gone from the browser while it parses a new file: two take turns, the hidden
        # one is filled and shown at the next call, one frame later.
        if not self._surfaces:
            self._surfaces = [
                self._scene.add_glb(f'/surface_{k}', glb, cast_shadow=False, receive_shadow=False)
                for k in range(2)
            ]
            self._surfaces[1].visible = False
            return
        self._turn()
        hidden = self._surfaces[1 - self._front]
        with self._server.atomic():
            self._surfaces[self._front].visible = True
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
            self._surfaces[self._front].visible = True
            self._surfaces[1 - self._front].visible = False

    def _show_mesh_lines(self, vertices: Floats, snapshot: Snapshot, options: ViewOptions) -> None:
        assert snapshot.mesh is not None
        if not options.mesh_lines:
            self._hide(self._lines)
            return
        if self._lines is None or self._changed('lines', snapshot.mesh):
            self._lines = self._scene.add_mesh_simple(
                '/lines',
                vertices,
                snapshot.mesh.triangles,
                color=(0, 0, 0),
                wireframe=True,
                opacity=0.12,
                cast_shadow=False,
                receive_shadow=False,
            )
        else:
            self._lines.vertices = vertices.astype(np.float32)
        self._lines.visible = True

    def _draw_rest(self, snapshot: Snapshot, options: ViewOptions) -> None:
        surface = snapshot.surface(options.shape)
        if snapshot.mesh is None or not options.rest:
            self._hide(self._rest)
            self._drawn.pop('rest', None)
            return
        rest = snapshot.mesh.rest if surface is None else deformed(surface, 0.0)
        drawn, self._rest_drawn = self._rest_drawn, rest
        still = (
            drawn is not None
            and drawn.shape == rest.shape
            and bool(np.abs(drawn - rest).max(initial=0.0) < REST_MOVED_M)
        )
        if still:
            # Small steps add up: what counts is the distance to what is on the screen.
            self._rest_drawn = drawn
        if not self._changed('rest', snapshot.mesh) and still:
            return
        faces = self._smooth(snapshot.mesh)
        self._rest = self._scene.add_mesh_simple(
            '/rest',
            faces.positions(rest * SCALE),
            faces.triangles,
            color=(120, 120, 120),
            opacity=0.25,
            cast_shadow=False,
            receive_shadow=False,
            side='back',
        )

    def _draw_contacts(self, snapshot: Snapshot, options: ViewOptions) -> None:
        if not self._changed(
            'contacts',
            snapshot.contacts,
            snapshot.object_pose,
            self._frame(snapshot),
            options.contacts,
        ):
            return
        known = arrows(snapshot, METRES_PER_NEWTON) if options.contacts else []
        shown = [arrow for arrow in known if arrow.touching or arrow.flags]
        pulled = [arrow for arrow in shown if arrow.touching and arrow.force > 1e-6]
        if pulled:
            points = np.array([[a.tail, a.head] for a in pulled]) * SCALE
            colours = np.array([FLAGGED if a.flags else FORCE for a in pulled], dtype=np.uint8)
            if self._arrows is None:
                self._arrows = self._scene.add_arrows(
                    '/forces',
                    points,
                    colours,
                    shaft_radius=0.012,
                    head_radius=0.035,
                    head_length=0.08,
                )
            else:
                self._arrows.points = points.astype(np.float32)
                self._arrows.colors = colours
            self._arrows.visible = True
        else:
            self._hide(self._arrows)
        self._label(shown)

    def _label(self, shown: list[Arrow]) -> None:
        for k, arrow in enumerate(shown[:LABELS]):
            if k == len(self._labels):
                self._labels.append(self._scene.add_label(f'/label_{k}', arrow.label))
            handle = self._labels[k]
            if handle.text != arrow.label:
                handle.text = arrow.label
            handle.position = tuple(arrow.tail * SCALE)
            handle.visible = True
        self._hide(*self._labels[len(shown) :])

    def _draw_cones(self, snapshot: Snapshot, options: ViewOptions) -> None:
        if not options.cones:
            self._hide(self._cones)
            self._drawn.pop('cones', None)
            return
        if not self._changed('cones', snapshot.contacts, self._frame(snapshot), options.friction):
            return
        segments = friction_cones(snapshot, options.friction, 0.02) * SCALE
        if self._cones is not None:
            self._cones.remove()
            self._cones = None
        if len(segments):
            self._cones = self._scene.add_line_segments(
                '/cones', segments, colors=(60, 60, 60), thickness=0.004
            )

    def _draw_scan(self, snapshot: Snapshot, options: ViewOptions, legend: Legend) -> None:
        cloud = snapshot.scan_error or snapshot.scan
        error = legend.quantity.name == 'scan error'
        wanted = options.scan == 'always' or (options.scan == 'with scan error' and error)
        if cloud is None or not wanted or not len(cloud.points):
            self._hide(self._scan)
            self._drawn.pop('scan', None)
            return
        top = legend.top if error else 0.0
        if not self._changed('scan', cloud, snapshot.object_pose, self._frame(snapshot), top):
            return
        points = snapshot.in_scene(cloud.frame).points(cloud.points) * SCALE
        if error and cloud.distance is not None:
            colours = TABLE[colour_index(np.abs(cloud.distance) * 1e3, 0.0, top)]
        else:
            colours = np.broadcast_to(np.array([90, 30, 30], dtype=np.uint8), points.shape)
        self._scan = self._scene.add_point_cloud(
            '/scan',
            points.astype(np.float32),
            np.ascontiguousarray(colours),
            point_size=0.006,
            point_shape='circle',
            point_shading='flat',
            precision='float32',
        )

    def _draw_hand(self, snapshot: Snapshot, options: ViewOptions) -> None:
        if not self._changed(
            'hand', snapshot.fingers, snapshot.object_pose, self._frame(snapshot), options.hand
        ):
            return
        bodies = hand_bodies(snapshot.fingers) if options.hand and snapshot.fingers else []
        place = snapshot.in_scene(snapshot.hand_frame)
        for body in bodies:
            pose: Pose = place.after(body.pose)
            handle = self._bodies.get(body.name)
            if handle is None:
                self._bodies[body.name] = handle = self._scene.add_box(
                    f'/hand/{body.name}',
                    color=(205, 208, 214),
                    opacity=HAND_OPACITY,
                    dimensions=np.array(body.size) * SCALE,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            handle.wxyz = tuple(quaternion_wxyz(pose.rotation))
            handle.position = tuple(pose.translation * SCALE)
            handle.visible = True
        shown = {body.name for body in bodies}
        self._hide(*(handle for name, handle in self._bodies.items() if name not in shown))
