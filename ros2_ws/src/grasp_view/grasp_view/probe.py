# SPDX-License-Identifier: Apache-2.0
"""The probe: the value, its sigma and the place of the point that a visitor tapped.

The tapped point stays with its material: three vertices and their weights, read again with every
picture.
"""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np
import viser

from .colour_map import three_digits
from .layer import SCALE
from .poses import Floats
from .scene_model import DISPLACEMENT, Snapshot, deformed, values_of
from .smooth_faces import Ints
from .surface_layer import SurfaceLayer
from .view_options import ViewOptions

MARK_RADIUS = 0.012
# A ray along an edge meets both of its faces, whatever rounding does.
EDGE = 1e-9


@dataclass(frozen=True)
class Reading:
    """What stands under the probe: value and sigma in `unit` (NaN where unknown), place in m."""

    quantity: str
    unit: str
    value: float
    sigma: float
    place: Floats


def hit(
    origin: Floats, direction: Floats, vertices: Floats, triangles: Ints
) -> tuple[Ints, Floats] | None:
    """The first face that a ray meets: its corners (3,) and weights (3,); None for none.

    T. Moeller and B. Trumbore 1997, doi:10.1080/10867651.1997.10487468.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    first, second = b - a, c - a
    across = np.cross(direction, second)
    size = np.einsum('ij,ij->i', first, across)
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        inverse = 1.0 / size
        away = origin - a
        u = np.einsum('ij,ij->i', away, across) * inverse
        turned = np.cross(away, first)
        v = turned @ direction * inverse
        far = np.einsum('ij,ij->i', second, turned) * inverse
        inside = (
            (np.abs(size) > 1e-18) & (np.minimum(u, v) >= -EDGE) & (u + v <= 1 + EDGE) & (far > 0)
        )
    if not inside.any():
        return None
    nearest = int(np.flatnonzero(inside)[far[inside].argmin()])
    weights = np.array([1.0 - u[nearest] - v[nearest], u[nearest], v[nearest]])
    return triangles[nearest], weights


class Probe:
    """Listens to taps on the scene; the last one counts, a tap beside the object takes it away."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self._ray: tuple[Floats, Floats] | None = None
        self._at: tuple[Ints, Floats] | None = None
        self._mark: viser.IcosphereHandle | None = None

        @server.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            self._ray = np.array(event.ray_origin) / SCALE, np.array(event.ray_direction)

    def read(
        self, snapshot: Snapshot, options: ViewOptions, layer: SurfaceLayer
    ) -> Reading | None:
        """What is under the probe in `snapshot`; None without a probe."""
        surface = snapshot.surface(options.shape)
        if surface is None or snapshot.mesh is None:
            self._at = None
        else:
            shown = deformed(surface, options.exaggeration)
            faces = layer.topology(snapshot.mesh).faces
            fine = faces.positions(shown)
            ray, self._ray = self._ray, None
            if ray is not None:
                self._at = hit(*ray, fine, faces.triangles)
            if self._at is not None and int(self._at[0].max()) >= len(fine):
                self._at = None
        if self._at is None or surface is None:
            if self._mark is not None and self._mark.visible:
                self._mark.visible = False
            return None
        corners, weights = self._at
        self._show(weights @ fine[corners])
        values = values_of(snapshot, options.quantity, options.shape)
        value = np.nan if values is None else weights @ faces.values(values)[corners]
        sigma = np.nan
        if options.quantity is DISPLACEMENT:
            there = weights @ faces.values(surface.sigma)[corners]
            sigma = float(there) * DISPLACEMENT.factor
        place = weights @ faces.positions(surface.position)[corners]
        quantity = options.quantity
        return Reading(quantity.name, quantity.unit, float(value), float(sigma), place)

    def _show(self, place: Floats) -> None:
        if self._mark is None:
            self._mark = self._scene.add_icosphere(
                '/probe', radius=MARK_RADIUS, color=(255, 255, 255), cast_shadow=False
            )
        self._mark.position = tuple(place * SCALE)
        self._mark.visible = True


def probe_html(reading: Reading | None) -> str:
    """The card of a reading; empty without one."""
    if reading is None:
        return ''
    value = three_digits(reading.value) if np.isfinite(reading.value) else 'unknown'
    plus = f' ± {three_digits(reading.sigma)}' if np.isfinite(reading.sigma) else ''
    x, y, z = (three_digits(1e3 * float(p)).replace('-', '−') for p in reading.place)
    return (
        f'<b>{value.replace("-", "−")}</b>{plus} {html.escape(reading.unit)}'
        f'<p>{html.escape(reading.quantity)} at x {x}, y {y}, z {z} mm</p>'
    )
