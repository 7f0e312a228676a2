# SPDX-License-Identifier: Apache-2.0
"""Fingertips by name or file: parameter files, and convex triangle meshes of any finger.

A body file (YAML) holds `name`, `source` and one of `fingertip` (a pad with a rounded end),
`ball`, `rod`, `pad`, `plate` and `mesh`; numbers in SI, with their unit in the key. A mesh has z
out of its pad and x along the finger; it touches with its foremost point, or the middle of its
flat. Where any of them has touch cells, `cells_m` lists their places [x, y] on its face, seen
along z; a fingertip may instead give their rows and columns along its bent pad.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.spatial
from numpy.typing import NDArray

from grasp_common.options import METRES_PER_UNIT
from shell_deform.contact.bodies import (
    BodyError,
    RoundBar,
    RoundedHull,
    Shape,
    ball,
    plate,
    rod,
)
from shell_deform.contact.fingertip import Fingertip
from shell_deform.objects.file_mesh import read_triangles
from shell_deform.objects.shell_object import ObjectError
from shell_deform.objects.yaml_reader import Entry, read_document

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# A mesh may lack so much of the volume of its hull, and a vertex lie so deep in it over its size.
CONVEX, DEEPEST = 1e-2, 2e-3
# The foremost points of a mesh lie within this share of its size.
FOREMOST = 1e-4
# From corner to corner [m]: a mesh beyond is in another unit than it is said to be.
SMALLEST, LARGEST = 5e-4, 1.0
# More corners than these take too long at every step.
MOST_CORNERS = 1000
# As many touch cells of one finger as the background process is told of.
MOST_CELLS = 64
# A cell is dropped on the face until it is so near [m]; where the face is steeper it has none.
ON_FACE, STEEPEST = 1e-9, 0.05


@dataclass(frozen=True)
class FingerBody:
    """A rigid body that fingers carry.

    Attributes:
        name: of it. shape: in its own frame, z out of the pad at the object, x to the tip.
        size: half the width of its face [m]. cells: (c, 3) centres of its touch cells in that
            frame [m], none where it has none.
    """

    name: str
    shape: Shape
    size: float
    cells: Array


def load_body(path: Path, unit: str | None = None) -> FingerBody:
    """The body in a parameter file, or in a triangle mesh whose numbers have this `unit`.

    Raises:
        ObjectError: it cannot be read, or is no body that can touch: with holes, not convex.
    """
    try:
        if path.suffix.lower() in ('.yaml', '.yml'):
            return _read(read_document(path), path.resolve().parent)
        if unit is None:
            raise ObjectError(f'{path}: a mesh needs the unit of its numbers; add unit: mm')
        shape, size = _from_mesh(path, unit)
        return FingerBody(path.stem, shape, size, np.zeros((0, 3)))
    except BodyError as error:
        raise ObjectError(f'{path}: {error}') from error


def _read(root: Entry, folder: Path) -> FingerBody:
    root.key = 'the body'
    found = root.mapping(['name'], [*_KINDS, 'source', 'cells_m'])
    kinds = [kind for kind in _KINDS if kind in found]
    if len(kinds) != 1:
        raise root.error(f'the body needs exactly one of {", ".join(_KINDS)}')
    shape, size, cells = _KINDS[kinds[0]](found[kinds[0]], folder)
    if 'cells_m' in found:
        if len(cells):
            raise found['cells_m'].error('the rows and columns of the cells are given, too')
        cells = _cells(found['cells_m'], shape)
    if len(cells) > MOST_CELLS:
        raise root.error(
            f'the body has {len(cells)} touch cells; at most {MOST_CELLS} are told: give blocks '
            'of them as one'
        )
    return FingerBody(found['name'].text(), shape, size, cells)


def _cells(entry: Entry, shape: Shape) -> Array:
    """(c, 3) places on the face of touch cells that are listed as seen along z."""
    rows = [[one.number(minimum=-1.0, maximum=1.0) for one in item.items(2)]
            for item in entry.items()]  # fmt: skip
    places = np.column_stack([np.array(rows).reshape(-1, 2), np.full(len(rows), shape.front)])
    for _ in range(60):
        # The distance of a convex body is convex along a line: Newton's method comes from above.
        found = shape.distance(places)
        if (np.abs(found.value) < ON_FACE).all():
            return places
        places[:, 2] -= found.value / np.maximum(found.normal[:, 2], STEEPEST)
    beside = int(np.argmax(np.abs(found.value)))
    raise entry.error(f'cell {beside}, {rows[beside]}, lies beside the face of the body')


def _length(entry: Entry) -> float:
    return entry.number(above=0.0, maximum=10.0)


_Read = tuple[Shape, float, Array]


def _fingertip(entry: Entry, folder: Path) -> _Read:
    keys = ('heel_m', 'flat_to_m', 'touch_at_m')
    sizes = ('width_m', 'height_m', 'edge_radius_m')
    found = entry.mapping([*keys, *sizes, 'arcs'], ['cell_rows_m', 'cell_columns_m'])
    heel, flat_to, touch = (found[key].number(minimum=-10.0, maximum=10.0) for key in keys)
    width, height, rounding = (_length(found[key]) for key in sizes)
    arcs = []
    for item in found['arcs'].items():
        arc = item.mapping(['radius_m', 'turn_rad'])
        arcs.append((_length(arc['radius_m']), arc['turn_rad'].number(above=0.0, maximum=np.pi)))
    shape = Fingertip(heel, flat_to, touch, tuple(arcs), width, height, rounding)
    rows, columns = (
        [item.number(minimum=-10.0, maximum=10.0) for item in found[key].items()]
        if key in found
        else []
        for key in ('cell_rows_m', 'cell_columns_m')
    )
    along, across = np.repeat(rows, len(columns)), np.tile(columns, len(rows))
    return shape, 0.5 * width, shape.placed(along, across)


def _ball(entry: Entry, folder: Path) -> _Read:
    radius = _length(entry.mapping(['radius_m'])['radius_m'])
    return ball(radius), radius, np.zeros((0, 3))


def _rod(entry: Entry, folder: Path) -> _Read:
    found = entry.mapping(['radius_m', 'length_m'])
    radius = _length(found['radius_m'])
    return rod(radius, _length(found['length_m'])), radius, np.zeros((0, 3))


def _pad(entry: Entry, folder: Path) -> _Read:
    found = entry.mapping(['radius_m'], ['curvature_radius_m'])
    radius, curvature = _length(found['radius_m']), 0.0
    if 'curvature_radius_m' in found:
        curvature = 1.0 / found['curvature_radius_m'].number(minimum=radius, maximum=1e6)
    return RoundBar(radius, curvature), radius, np.zeros((0, 3))


def _plate(entry: Entry, folder: Path) -> _Read:
    found = entry.mapping(['width_m', 'length_m', 'edge_radius_m'])
    width, length = _length(found['width_m']), _length(found['length_m'])
    rounding = _length(found['edge_radius_m'])
    return plate(width, length, rounding), 0.5 * min(width, length), np.zeros((0, 3))


def _mesh(entry: Entry, folder: Path) -> _Read:
    found = entry.mapping(['file', 'unit'])
    path = folder / found['file'].text()
    if not path.is_file():
        raise found['file'].error(f'there is no file {path}')
    shape, size = _from_mesh(path, found['unit'].text(METRES_PER_UNIT))
    return shape, size, np.zeros((0, 3))


_KINDS: dict[str, Callable[[Entry, Path], _Read]] = {
    'fingertip': _fingertip,
    'ball': _ball,
    'rod': _rod,
    'pad': _pad,
    'plate': _plate,
    'mesh': _mesh,
}


def _from_mesh(path: Path, unit: str) -> tuple[RoundedHull, float]:
    """The hull of a closed convex mesh, its foremost point at the origin; half its width [m]."""
    vertices, triangles = read_triangles(path, unit)
    edges = np.sort(np.concatenate([triangles[:, [a, (a + 1) % 3]] for a in range(3)]), axis=1)
    count = np.unique(edges, axis=0, return_counts=True)[1]
    if np.any(count != 2):
        raise ObjectError(
            f'{path}: the mesh of a finger has holes: {np.count_nonzero(count != 2)} of its edges '
            'do not lie between two triangles; close them'
        )
    used = vertices[np.unique(triangles)]
    try:
        hull = scipy.spatial.ConvexHull(used)
    except scipy.spatial.QhullError as error:
        raise ObjectError(f'{path}: the mesh of a finger lies in one plane') from error
    corner = vertices[triangles]
    volume = abs(np.einsum('ti,ti->', corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))) / 6.0
    size = float(np.linalg.norm(np.ptp(used, axis=0)))
    if not SMALLEST < size < LARGEST:
        raise ObjectError(
            f'{path}: in {unit} the finger measures {size:.3g} m from corner to corner, and '
            f'fingers measure {SMALLEST:g} to {LARGEST:g} m; give the unit of its numbers'
        )
    deepest = max(
        float(-(part @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1).min())
        for part in np.array_split(used, len(used) // 500 + 1)
    )
    if deepest > DEEPEST * size or abs(hull.volume - volume) > CONVEX * hull.volume:
        raise ObjectError(
            f'{path}: the mesh of a finger is not convex: it lies up to {1e3 * deepest:.3g} mm '
            f'inside its convex hull and fills {100 * volume / hull.volume:.3g} % of it; give the '
            'pad alone, or its convex hull'
        )
    corners = used[hull.vertices]
    if len(corners) > MOST_CORNERS:
        raise ObjectError(
            f'{path}: the hull of a finger has {len(corners)} corners, more than {MOST_CORNERS}; '
            'take a coarser mesh'
        )
    front = corners[corners[:, 2] > corners[:, 2].max() - FOREMOST * size]
    middle = front.mean(axis=0)
    if len(front) > 2:
        middle = 0.5 * (front.max(axis=0) + front.min(axis=0))
    width = float(np.ptp(corners[:, :2], axis=0).min())
    return RoundedHull(corners - middle, 0.0), 0.5 * width
