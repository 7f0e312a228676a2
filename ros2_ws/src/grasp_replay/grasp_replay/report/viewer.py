# SPDX-License-Identifier: Apache-2.0
"""The turnable pictures' data: rows packed as small integers inside the page.

Positions are 16-bit steps of the row's box (65 mm / 65535 = 1 um), scalars 8-bit steps of the
page's scale, 255 = not seen by the scanner; all little-endian, base64.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from matplotlib import colormaps

from .camera import dent_camera
from .errors import ErrorScales, seen_radius, vertex_errors
from .scene import Floats, RowScene, thinned

NOT_SEEN = 255
TOP_STEP = 254
SCAN_POINTS = 4000


def _text(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode('ascii')


def _steps(values: Floats, top: float) -> np.ndarray:
    steps = np.round(np.clip(np.nan_to_num(np.abs(values)) / top, 0.0, 1.0) * TOP_STEP)
    return np.where(np.isfinite(values), steps, NOT_SEEN).astype(np.uint8)


def colour_table() -> str:
    """256 x RGB bytes in base64: cividis, then light grey for `not seen`."""
    table = np.round(colormaps['cividis'](np.linspace(0.0, 1.0, 255))[:, :3] * 255)
    return _text(np.vstack([table, [204, 204, 204]]).astype(np.uint8))


def displacement_top(scene: RowScene) -> float:
    """The largest displacement (m) of the row's two theories."""
    moved = [
        np.linalg.norm(shape - scene.rest, axis=1) for shape in (scene.nonlinear, scene.linear)
    ]
    return max(float(np.max(values)) for values in moved) or 1e-6


def pack(scene: RowScene, tops: ErrorScales) -> dict[str, Any]:
    """One row as a JSON-ready dictionary; `viewer.js` is its only reader."""
    points = thinned(scene.scan_points, SCAN_POINTS)
    shapes = {'rest': scene.rest, 'nonlinear': scene.nonlinear, 'linear': scene.linear}
    everything = np.concatenate([*shapes.values(), points])
    low = everything.min(axis=0)
    size = float(np.ptp(everything, axis=0).max()) or 1.0

    def place(positions: Floats) -> str:
        return _text(np.round((positions - low) / size * 65535.0).astype('<u2'))

    camera = dent_camera(scene)
    radius = seen_radius(scene)
    top = displacement_top(scene)
    corners = scene.triangles
    index = '<u2' if len(scene.rest) < 65536 else '<u4'
    return {
        'key': scene.key,
        'size': size,
        'errorTop': {'nonlinear': tops.nonlinear, 'linear': tops.linear},
        'displacementTop': top,
        'index': 2 if index == '<u2' else 4,
        'triangles': _text(corners.astype(index)),
        'shapes': {name: place(shape) for name, shape in shapes.items()},
        'error': {
            name: _text(
                _steps(vertex_errors(shapes[name], scene.scan_points, errors, radius), top_m)
            )
            for name, errors, top_m in (
                ('nonlinear', scene.nonlinear_error, tops.nonlinear),
                ('linear', scene.linear_error, tops.linear),
            )
        },
        'displacement': {
            name: _text(_steps(np.linalg.norm(shapes[name] - scene.rest, axis=1), top))
            for name in ('nonlinear', 'linear')
        },
        'scan': place(points),
        'centre': [float(value) for value in (camera.centre - low) / size],
        'camera': [float(v) for axis in (camera.right, camera.up, camera.toward) for v in axis],
    }
