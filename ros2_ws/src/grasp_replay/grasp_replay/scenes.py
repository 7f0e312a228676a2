"""A run as shapes and plots for the report page."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_replay.pipeline import Outcome, Row
from grasp_replay.report import Curve, LinearityTrace, PublishedRow, RowScene
from grasp_replay.report.scene import Kind
from grasp_replay.sample_trace import SampleTrace
from scan_compare.deformed_surface import DeformedSurface

Array = NDArray[np.float64]


def kind_of(outcome: Outcome) -> Kind:
    """Where scans and forces of a run come from."""
    return 'synthetic' if outcome.experiment.synthetic else 'measured'


def scenes(outcome: Outcome) -> list[RowScene]:
    """One scene per row that both linear and koiter theory carry."""
    places = _Places(outcome.rows[0].reference.surface)
    return [
        _scene(outcome, row, places)
        for row in outcome.rows
        if row.compared['koiter'] is not None and row.compared['linear'] is not None
    ]


class _Places:
    """Corners and edge middles of every triangle: where surfaces are drawn, and their triangles.

    The smooth surface is drawn with four flat triangles per patch.
    """

    def __init__(self, surface: DeformedSurface) -> None:
        mesh = surface.mesh
        active = np.flatnonzero(mesh.active)
        corners = mesh.triangles[active].astype(np.int64)
        edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        unique, middle = np.unique(edges, axis=0, return_inverse=True)
        used, corner = np.unique(corners, return_inverse=True)
        corner = corner.reshape(-1, 3)
        middle = middle.reshape(-1, 3) + len(used)
        a, b, c = corner.T
        ab, bc, ca = middle.T
        self.triangles = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        ).astype(np.int32)
        self.triangle = np.zeros(len(used) + len(unique), np.int64)
        self.parameters = np.zeros((len(self.triangle), 2))
        for column, where in zip(
            (a, b, c, ab, bc, ca),
            ((0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)),
            strict=True,
        ):
            self.triangle[column] = active
            self.parameters[column] = where

    def outer(self, surface: DeformedSurface) -> Array:
        """Points (v, 3) of the outer face [m]."""
        return surface.evaluate(self.triangle, self.parameters).position


def _scene(outcome: Outcome, row: Row, places: _Places) -> RowScene:
    koiter, linear = row.compared['koiter'], row.compared['linear']
    assert koiter is not None and linear is not None
    # Both errors belong to the same scan points, shown where koiter's registration puts them.
    used = koiter.used & linear.used
    contacts = row.contacts
    return RowScene(
        key=f'row_{row.number}',
        title=f'{outcome.shell.shell.name}, {row.force:.2f} N per finger',
        kind=kind_of(outcome),
        force_n=row.force,
        triangles=places.triangles,
        rest=places.outer(koiter.surface.at_rest()),
        nonlinear=places.outer(koiter.surface),
        linear=places.outer(linear.surface),
        scan_points=koiter.points[used],
        nonlinear_error=koiter.distances.distance[used],
        linear_error=linear.distances.distance[used],
        contact_points=contacts.point,
        contact_forces=contacts.push[:, None] * contacts.normal,
        noise_floor_m=koiter.noise_floor_m,
    )


def curves(outcome: Outcome, published: list[dict[str, Any]]) -> list[Curve]:
    """Force over displacement: the recording, each theory, and the published rows apart."""
    rows = outcome.rows
    measured = [(row.reference.measured_max_displacement_m, row.force) for row in rows]
    pins = [(float(np.mean(row.contacts.travel)), row.force) for row in rows]
    found = [
        _curve('scan profile', kind_of(outcome), measured),
        _curve('pin separation', kind_of(outcome), pins),
    ]
    for theory in ('linear', 'paper', 'koiter'):
        values = [
            (row.solved[theory].surface.max_displacement, row.force)  # type: ignore[union-attr]
            for row in rows
            if row.solved[theory].surface is not None
        ]
        found.append(_curve(theory, 'predicted', [(0.0, 0.0), *values]))
    if published:
        values = [(row['measured_max_displacement_m'], row['force_n']) for row in published]
        found.append(_curve('paper, Table I', 'published', values))
    return [curve for curve in found if len(curve.displacement_m)]


def _curve(name: str, kind: Kind, values: list[Any]) -> Curve:
    known = [(x, y) for x, y in values if x is not None and np.isfinite(x)]
    pairs = np.array(known, dtype=np.float64).reshape(-1, 2)
    return Curve(name, kind, pairs[:, 0], pairs[:, 1])


def published_rows(published: list[dict[str, Any]], name: str) -> list[PublishedRow]:
    """The published table as the report shows it, with our predictions for its forces."""
    return [
        PublishedRow(
            object_name=name,
            force_lbf=float(row['force_lbf']),
            max_displacement_m=float(row['measured_max_displacement_m']),
            nonlinear_error_m=float(row['nonlinear_mean_error_m']),
            linear_error_m=float(row['linear_mean_error_m']),
            predicted_m={
                theory: value
                for theory, value in row['predicted_max_displacement_m'].items()
                if value is not None
            },
        )
        for row in published
    ]


def linearity(trace: SampleTrace) -> LinearityTrace:
    """The gauge of the transition over the recording."""
    return LinearityTrace(trace.time_s, trace.linear_error, trace.linear_displacement_m)
