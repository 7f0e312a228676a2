# SPDX-License-Identifier: Apache-2.0
"""Meshes and clouds of other projects: our reader beside trimesh and meshio.

`python tests/benchmarks/foreign_meshes.py FOLDER ...` reads every file below the folders, such as
the test models of trimesh, assimp, libigl and PCL. A file agrees when points (for a cloud) or
faces, box, area and enclosed volume are those of one of the two libraries. What differs, what we
alone read and what we refuse is listed with its sentence. Exit 1 when one differs or crashes.
"""

from __future__ import annotations

import argparse
import logging
import sys
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import trimesh

from grasp_common.formats import ScanFileError, read_mesh_file

CLOSE = 1e-6
"""Coordinates agree within this share of the largest side of the box."""


@dataclass(frozen=True)
class Measures:
    """What two readers can agree on, however they number their vertices."""

    points: int
    faces: int
    low: np.ndarray
    high: np.ndarray
    area: float
    volume: float

    def same(self, other: Measures) -> bool:
        """Within CLOSE, and ten times that for area and volume."""
        size = max(float((self.high - self.low).max()), 1e-30)
        near = CLOSE * max(size, float(np.abs(self.high).max()))
        return (
            self.faces == other.faces
            and (self.faces > 0 or self.points == other.points)
            and np.allclose(self.low, other.low, rtol=0, atol=near)
            and np.allclose(self.high, other.high, rtol=0, atol=near)
            and abs(self.area - other.area) <= 10 * CLOSE * max(self.area, size**2 * CLOSE)
            and abs(self.volume - other.volume) <= 10 * CLOSE * max(abs(self.volume), size**3)
        )


def measures(points: np.ndarray, triangles: np.ndarray | None) -> Measures:
    """Measure points (n, 3) and triangles (m, 3) or None."""
    points = np.asarray(points, float)[:, :3]
    used = points[np.all(np.isfinite(points), axis=1)]
    if triangles is None or not len(triangles):
        if not len(used):
            return Measures(0, 0, np.zeros(3), np.zeros(3), 0.0, 0.0)
        return Measures(len(points), 0, used.min(0), used.max(0), 0.0, 0.0)
    used = points[np.unique(triangles)]
    # about the middle of the box: the volume of an open mesh depends on the origin
    a, b, c = (points[triangles[:, k]] - (used.min(0) + used.max(0)) / 2 for k in range(3))
    normal = np.cross(b - a, c - a)
    return Measures(
        len(points),
        len(triangles),
        used.min(0),
        used.max(0),
        0.5 * float(np.linalg.norm(normal, axis=1).sum()),
        float(np.einsum('ij,ij->', a, normal)) / 6.0,
    )


def by_trimesh(file: Path) -> Measures:
    """As trimesh reads the file, nothing merged."""
    found = trimesh.load(file, process=False, maintain_order=True, skip_materials=True)
    if isinstance(found, trimesh.Scene):
        found = found.to_geometry() if found.geometry else trimesh.Trimesh()
    return measures(found.vertices, getattr(found, 'faces', None))


def by_meshio(file: Path) -> Measures:
    """As meshio reads the file, polygons cut into fans."""
    found = meshio.read(file)
    fans = [
        cells.data[:, [0, k, k + 1]]
        for cells in found.cells
        if cells.dim == 2
        for k in range(1, cells.data.shape[1] - 1)
    ]
    return measures(found.points, np.concatenate(fans) if fans else None)


ORACLES: tuple[Callable[[Path], Measures], ...] = (by_trimesh, by_meshio)


def verdict(file: Path) -> tuple[str, str]:
    """Class of a file and what to say of it."""
    try:
        raw = read_mesh_file(file)
    except ScanFileError as error:
        return 'refused', str(error)
    except Exception as error:  # the very thing that is looked for
        return 'crashed', repr(error)
    ours = measures(raw.points, raw.triangles)
    others = []
    for oracle in ORACLES:
        try:
            # meshio ends the process over what it does not know
            others.append(oracle(file))
        except (Exception, SystemExit):
            continue
        if ours.same(others[-1]):
            return 'agree', ''
    text = f'{file}: {ours.points} points, {ours.faces} faces, area {ours.area:.6g}'
    if not any(other.points or other.faces for other in others):
        return ('agree', '') if others and not ours.points else ('ours alone', text)
    beside = '; '.join(f'{o.points}, {o.faces}, {o.area:.6g}' for o in others)
    return 'differ', f'{text}; others {beside}'


def main() -> int:
    """Print what does not agree, and the numbers of each class."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folders', nargs='+', type=Path, help='folders of meshes and clouds')
    options = parser.parse_args()
    warnings.filterwarnings('ignore')
    logging.disable(logging.CRITICAL)
    files = sorted(file for one in options.folders for file in one.rglob('*') if file.is_file())
    tally: Counter[str] = Counter()
    for file in files:
        kind, text = verdict(file)
        tally[kind] += 1
        if text:
            print(f'{kind}: {text}', flush=True)
    print(f'{len(files)} files: ' + ', '.join(f'{n} {kind}' for kind, n in tally.most_common()))
    return int(bool(tally['differ'] or tally['crashed']))


if __name__ == '__main__':
    sys.exit(main())
