# SPDX-License-Identifier: Apache-2.0
"""The peers of `scan.py`, each in its own way: small_gicp, libigl, Open3D.

`python scan_tools.py FILE.npz`, with points (n, 3), the true pose, samples and flat control facets
of the outer face; prints one JSON list of [what, value] and says which tool is not there.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from types import ModuleType

import numpy as np

Row = tuple[str, str]


def small_gicp(module: ModuleType, data: Mapping[str, np.ndarray]) -> Iterator[Row]:
    """Registration onto samples of the surface; how far the ball's centre is off."""
    began = time.perf_counter(), time.process_time()
    result = module.align(
        data['samples'], data['points'], registration_type='GICP', downsampling_resolution=0.7e-3,
        max_correspondence_distance=5e-3, num_threads=2,
    )  # fmt: skip
    used = _since(began)
    found = np.asarray(result.T_target_source)
    at = data['rotation'].T @ -data['translation']
    centre = 1e3 * float(np.linalg.norm(found[:3, :3] @ at + found[:3, 3]))
    yield 'small_gicp, registration only', f'{used}, centre off by {centre:.3f} mm'


def igl(module: ModuleType, data: Mapping[str, np.ndarray]) -> Iterator[Row]:
    """Distances alone, in the true pose, to flat facets."""
    aligned = _aligned(data)
    began = time.perf_counter(), time.process_time()
    squared = module.point_mesh_squared_distance(aligned, data['outer'], data['triangles'])[0]
    used = _since(began)
    mean = 1e3 * float(np.sqrt(squared).mean())
    yield 'libigl, distances to the flat control facets', f'{used}, mean {mean:.3f} mm'


def open3d(module: ModuleType, data: Mapping[str, np.ndarray]) -> Iterator[Row]:
    """Distances alone, in the true pose, to flat facets."""
    scene = module.t.geometry.RaycastingScene()
    scene.add_triangles(
        module.core.Tensor(data['outer'].astype(np.float32)),
        module.core.Tensor(data['triangles'].astype(np.uint32)),
    )
    queries = module.core.Tensor(_aligned(data).astype(np.float32))
    began = time.perf_counter(), time.process_time()
    distance = scene.compute_distance(queries).numpy()
    used = _since(began)
    mean = 1e3 * float(distance.mean())
    yield 'Open3D, distances to the flat control facets', f'{used}, mean {mean:.3f} mm'


def _aligned(data: Mapping[str, np.ndarray]) -> np.ndarray:
    return data['points'] @ data['rotation'].T + data['translation']


def _since(began: tuple[float, float]) -> str:
    wall, processor = time.perf_counter() - began[0], time.process_time() - began[1]
    return f'{wall:.2f} s ({processor:.2f} s processor)'


TOOLS: dict[str, Callable[[ModuleType, Mapping[str, np.ndarray]], Iterator[Row]]] = {
    'small_gicp': small_gicp,
    'igl': igl,
    'open3d': open3d,
}


def main() -> None:
    """Time every tool that is installed."""
    with np.load(sys.argv[1]) as stored:
        data = dict(stored)
    found: list[Row] = []
    for name, measure in TOOLS.items():
        try:
            module = importlib.import_module(name)
        except ImportError as error:
            found.append((name, f'not available here: {error}'))
            continue
        found += measure(module, data)
    print(json.dumps(found))


if __name__ == '__main__':
    main()
