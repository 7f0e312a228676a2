# SPDX-License-Identifier: Apache-2.0
"""An orthographic depth buffer: scan, model and error map seen by the same camera.

Everything is drawn as points into a depth buffer and shaded from the depths themselves, so that a
cloud of half a million points, a mesh and a smooth surface go through the same few lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, median_filter

LIGHT = np.array([-0.4, 0.5, 0.77])


@dataclass(frozen=True)
class Camera:
    """Looks along -view; right and up span the picture; centre and half_width [m]."""

    right: np.ndarray
    up: np.ndarray
    view: np.ndarray
    centre: np.ndarray
    half_width: float
    pixels: int = 480

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return columns, rows (fractions of pixels) and depth towards the viewer [m]."""
        arms = points - self.centre
        scale = 0.5 * self.pixels / self.half_width
        column = 0.5 * self.pixels + scale * (arms @ self.right)
        row = 0.5 * self.pixels - scale * (arms @ self.up)
        return column, row, arms @ self.view


@dataclass(frozen=True)
class Layer:
    """What a camera sees: depth (p, p) [m], NaN for background, and the value drawn there."""

    depth: np.ndarray
    value: np.ndarray


def camera_towards(outward: np.ndarray, points: np.ndarray, tilt: float = 0.75) -> Camera:
    """Return a camera that sees the face whose outward direction is given from the side.

    tilt: tangent of the angle between the viewing direction and `outward`. `outward` points
    upwards in the picture.
    """
    outward = outward / np.linalg.norm(outward)
    helper = np.eye(3)[int(np.argmin(np.abs(outward)))]
    aside = np.cross(outward, helper)
    aside /= np.linalg.norm(aside)
    view = outward + tilt * aside
    view /= np.linalg.norm(view)
    up = outward - (outward @ view) * view
    up /= np.linalg.norm(up)
    low, high = np.quantile(points, (0.001, 0.999), axis=0)
    half_width = 0.56 * float(np.linalg.norm(high - low)) / np.sqrt(3.0) * 1.25
    return Camera(np.cross(up, view), up, view, 0.5 * (low + high), half_width)


def draw(
    camera: Camera, points: np.ndarray, values: np.ndarray, footprint: int | None = None
) -> Layer:
    """Draw `points` (n, 3) with `values` (n,) as squares of 2 footprint + 1 pixels.

    Without a footprint the squares just close the gaps between evenly spread points.
    """
    size = camera.pixels
    if footprint is None:
        footprint = int(np.clip(np.ceil(0.9 * size / np.sqrt(max(len(points), 1))), 1, 5))
    column, row, depth = camera.project(points)
    column, row = np.floor(column).astype(int), np.floor(row).astype(int)
    # the viewer's nearest point is written last and stays
    order = np.argsort(depth, kind='stable')
    column, row, depth, values = column[order], row[order], depth[order], values[order]
    best = np.full(size * size, -np.inf)
    shown = np.full(size * size, np.nan)
    for shift_row in range(-footprint, footprint + 1):
        for shift_column in range(-footprint, footprint + 1):
            r, c = row + shift_row, column + shift_column
            inside = (r >= 0) & (r < size) & (c >= 0) & (c < size)
            pixel = r[inside] * size + c[inside]
            front_depth = np.full(size * size, -np.inf)
            front_value = np.full(size * size, np.nan)
            front_depth[pixel] = depth[inside]
            front_value[pixel] = values[inside]
            nearer = front_depth > best
            best[nearer] = front_depth[nearer]
            shown[nearer] = front_value[nearer]
    best[np.isinf(best)] = np.nan
    return Layer(best.reshape(size, size), shown.reshape(size, size))


def shade(camera: Camera, layer: Layer) -> np.ndarray:
    """Return brightness (p, p) in 0..1 from the slopes of the depth buffer."""
    background = np.isnan(layer.depth)
    floor = np.nanmin(layer.depth) if not background.all() else 0.0
    depth = gaussian_filter(median_filter(np.where(background, floor, layer.depth), 5), 1.5)
    pixel = 2.0 * camera.half_width / camera.pixels
    down, right = np.gradient(depth, pixel)
    normal = np.stack((-right, down, np.ones_like(depth)), axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = LIGHT / np.linalg.norm(LIGHT)
    brightness = 0.3 + 0.7 * np.clip(normal @ light, 0.0, 1.0)
    # the silhouette's slope is an artefact of the background depth
    return np.where(background, 1.0, np.clip(brightness, 0.35, 1.0))
