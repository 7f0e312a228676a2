# SPDX-License-Identifier: Apache-2.0
"""What the report draws: one `RowScene` per row of the table, and the curves beside them.

Everything is in SI units and in the object's frame. Surfaces are **outer faces** (what a scanner
sees), as triangles: hand over the limit surface sampled finely enough to look smooth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
Kind = Literal['measured', 'synthetic', 'published', 'predicted']
KINDS: tuple[Kind, ...] = ('measured', 'synthetic', 'published', 'predicted')


class ReportError(ValueError):
    """The report cannot be drawn from what was given; the text names the row and the remedy."""


def _require(condition: bool, where: str, text: str) -> None:
    if not condition:
        raise ReportError(f'{where}: {text}')


def _floats(values: npt.ArrayLike, columns: int, where: str) -> Floats:
    array = np.ascontiguousarray(values, dtype=np.float64)
    shape = (columns,) if columns else ()
    _require(
        array.ndim == 1 + len(shape) and array.shape[1:] == shape,
        where,
        f'has shape {array.shape}, needs (n{", " + str(columns) if columns else ""})',
    )
    _require(bool(np.isfinite(array).all()), where, 'holds NaN or infinite values')
    array.setflags(write=False)
    return array


def thinned(points: Floats, count: int) -> Floats:
    """Every k-th of the points, so that at most `count` remain: the same ones at every call."""
    return points if len(points) <= count else points[:: -(-len(points) // count)]


@dataclass(frozen=True)
class RowScene:
    """One row of the table as shapes.

    key: names the row's files, letters, digits, `_` and `-` only, unique in the report.
    title: heading of the row, e.g. `tennis ball, 2.39 lbf per finger`.
    kind: where scan and force come from; never mixed in one row.
    force_n: force per finger in N.
    triangles: (t, 3) faces of the three surfaces, outward by the right-hand rule.
    rest, nonlinear, linear: (v, 3) m, outer face at rest, by the nonlinear theory, by the linear.
    scan_points: (p, 3) m, registered into the object's frame.
    nonlinear_error, linear_error: (p,) m, signed distance of each scan point to that surface,
    positive outside.
    scan_displacement: (p,) m, optional, inward distance of each scan point from the rest face.
    contact_points, contact_forces: (k, 3) m and N, forces of the fingers on the object.
    noise_floor_m: mean unsigned distance that scanner noise alone produces, if known.
    """

    key: str
    title: str
    kind: Kind
    force_n: float
    triangles: Ints
    rest: Floats
    nonlinear: Floats
    linear: Floats
    scan_points: Floats
    nonlinear_error: Floats
    linear_error: Floats
    contact_points: Floats
    contact_forces: Floats
    scan_displacement: Floats | None = None
    noise_floor_m: float | None = None

    def __post_init__(self) -> None:
        where = f'row {self.key!r}'
        _require(
            bool(self.key)
            and all(c.isalnum() or c in '_-' for c in self.key)
            and self.key.isascii(),
            where,
            'the key may hold ASCII letters, digits, _ and - only',
        )
        _require(self.kind in KINDS, where, f'kind {self.kind!r} is not one of {", ".join(KINDS)}')
        for name in ('rest', 'nonlinear', 'linear', 'scan_points'):
            object.__setattr__(self, name, _floats(getattr(self, name), 3, f'{where}, {name}'))
        for name in ('contact_points', 'contact_forces'):
            object.__setattr__(self, name, _floats(getattr(self, name), 3, f'{where}, {name}'))
        names = ['nonlinear_error', 'linear_error']
        if self.scan_displacement is not None:
            names.append('scan_displacement')
        for name in names:
            array = _floats(getattr(self, name), 0, f'{where}, {name}')
            _require(
                len(array) == len(self.scan_points),
                f'{where}, {name}',
                f'has {len(array)} values for {len(self.scan_points)} scan points',
            )
            object.__setattr__(self, name, array)
        triangles = np.ascontiguousarray(self.triangles, dtype=np.int32)
        _require(
            triangles.ndim == 2 and triangles.shape[1] == 3 and len(triangles) > 0,
            f'{where}, triangles',
            f'has shape {triangles.shape}, needs (t, 3) with t > 0',
        )
        vertices = len(self.rest)
        for name in ('nonlinear', 'linear'):
            count = len(getattr(self, name))
            _require(
                count == vertices,
                f'{where}, {name}',
                f'has {count} vertices, rest has {vertices}',
            )
        _require(
            int(triangles.min()) >= 0 and int(triangles.max()) < vertices,
            f'{where}, triangles',
            f'names vertices outside 0..{vertices - 1}',
        )
        triangles.setflags(write=False)
        object.__setattr__(self, 'triangles', triangles)
        _require(
            len(self.contact_points) == len(self.contact_forces),
            where,
            f'{len(self.contact_points)} contact points but {len(self.contact_forces)} forces',
        )


@dataclass(frozen=True)
class Curve:
    """One line of the force-displacement plot.

    displacement_m, force_n: (n,) per contact; lower_n, upper_n: (n,) optional band of the force of
    a prediction; displacement_band_m, force_band_n: half-widths of the bars on an experiment's
    points. kind decides the label and the line style; points of an experiment are markers.
    """

    name: str
    kind: Kind
    displacement_m: Floats
    force_n: Floats
    lower_n: Floats | None = None
    upper_n: Floats | None = None
    displacement_band_m: float | None = None
    force_band_n: float | None = None

    def __post_init__(self) -> None:
        where = f'curve {self.name!r}'
        _require(self.kind in KINDS, where, f'kind {self.kind!r} is not one of {", ".join(KINDS)}')
        for name in ('displacement_m', 'force_n', 'lower_n', 'upper_n'):
            values = getattr(self, name)
            if values is None:
                continue
            array = _floats(values, 0, f'{where}, {name}')
            _require(
                len(array) == len(self.displacement_m),
                f'{where}, {name}',
                f'has {len(array)} values, displacement_m has {len(self.displacement_m)}',
            )
            object.__setattr__(self, name, array)


@dataclass(frozen=True)
class ErrorLine:
    """Mean errors (n,) m over forces (n,) N of one theory, published or ours.

    theory: koiter, paper, linear or another, for the colour; name: what the legend calls it.
    """

    name: str
    theory: str
    kind: Kind
    force_n: Floats
    error_m: Floats


@dataclass(frozen=True)
class LinearityTrace:
    """The gauge of the transition over the recording.

    time_s: (n,) s from the bag's start; linearity: (n,) the predicted relative error of linear
    theory; displacement_m: (n,) the largest displacement by linear theory.
    """

    time_s: Floats
    linearity: Floats
    displacement_m: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name in ('time_s', 'linearity', 'displacement_m'):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            _require(array.ndim == 1, f'linearity trace, {name}', f'has shape {array.shape}')
            object.__setattr__(self, name, array)
        _require(
            len(self.time_s) == len(self.linearity)
            and len(self.displacement_m) in (0, len(self.time_s)),
            'linearity trace',
            f'{len(self.time_s)} times, {len(self.linearity)} values, '
            f'{len(self.displacement_m)} displacements',
        )


@dataclass(frozen=True)
class PublishedRow:
    """One row of the paper's Table I, and what we predict for its published force.

    Errors in m; `predicted_m`: displacement by model, in m; a model is a theory and its modulus
    (e.g. `koiter, E 12.75 MPa`).
    """

    object_name: str
    force_lbf: float
    max_displacement_m: float
    nonlinear_error_m: float
    linear_error_m: float
    predicted_m: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Section:
    """A part of the page that another module writes, placed after the table.

    key: names the section's anchor; title: its heading; body: HTML, escaped by its maker. The
    page's style knows `.wide` round a table, `.note` under it, `.published`, `.predicted`,
    `.measured` and `.synthetic` cells, and `figure` with `figcaption`.
    """

    key: str
    title: str
    body: Markup
