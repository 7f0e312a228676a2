# SPDX-License-Identifier: Apache-2.0
"""A run as shapes and plots for the report page."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_replay.pipeline import Outcome, Row
from grasp_replay.report import Curve, LinearityTrace, PublishedRow, RowScene
from grasp_replay.report.scene import Kind
from grasp_replay.results import linear_own_modulus, models_of
from grasp_replay.sample_trace import SampleTrace
from grasp_replay.theories import THEORIES
from scan_compare.deformed_surface import DeformedSurface

Array = NDArray[np.float64]

CURVE_STEPS = 16
# Stated accuracy of the scanner behind the published table (section V of the paper).
NEXTENGINE_M = 0.127e-3


def kind_of(outcome: Outcome) -> Kind:
    """Where scans and forces of a run come from."""
    return 'synthetic' if outcome.experiment.synthetic else 'measured'


def scenes(outcome: Outcome) -> list[RowScene]:
    """One scene per row that both linear and koiter theory carry."""
    places = _Places(outcome.shell.deformed(outcome.shell.model.rest))
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
    depth_sigma, force_sigma = _sigmas(rows)
    found = [
        replace(
            _curve('scan profile', kind_of(outcome), measured),
            displacement_band_m=float(depth_sigma.max()),
            force_band_n=float(force_sigma.max()),
        ),
        replace(
            _curve('pin separation', kind_of(outcome), pins),
            force_band_n=float(force_sigma.max()),
        ),
    ]
    predicted = [
        _curve(theory, 'predicted', _solved_curve(outcome, theory)) for theory in THEORIES
    ]
    share = modulus_share(outcome, predicted[THEORIES.index('koiter')])
    for curve in predicted:
        lower, upper = ((1.0 + sign * share) * curve.force_n for sign in (-1.0, 1.0))
        found.append(replace(curve, lower_n=lower, upper_n=upper) if share else curve)
    if published:
        values = [(row['measured_max_displacement_m'], row['force_n']) for row in published]
        table = _curve('paper, Table I', 'published', values)
        found.append(replace(table, displacement_band_m=NEXTENGINE_M))
    return [curve for curve in found if len(curve.displacement_m)]


def _sigmas(rows: tuple[Row, ...]) -> tuple[Array, Array]:
    """Standard deviations per row: of the measured depth [m], of the mean push [N]."""
    depth = [[p.apex_sigma_m for p in row.reference.profiles] or [0.0] for row in rows]
    force = [np.linalg.norm(row.contacts.sigma) / len(row.contacts.sigma) for row in rows]
    return np.array([max(values) for values in depth]), np.array(force)


def _solved_curve(outcome: Outcome, theory: str) -> list[tuple[float, float]]:
    """(displacement [m], force [N]) from nothing to the largest load that the theory carries."""
    last = max(outcome.rows, key=lambda row: row.force)
    found, state = [(0.0, 0.0)], None
    # A straight line needs no points between its ends.
    steps = 1 if theory == 'linear' else CURVE_STEPS
    for share in np.linspace(0.0, 1.0, steps, endpoint=False)[1:]:
        solved = outcome.shell.solve(theory, last.patches, share * last.contacts.push, state)
        if solved.surface is None:
            return found
        state = solved.state
        found.append((solved.surface.max_displacement, share * last.force))
    surface = last.solved[theory].surface
    return found if surface is None else [*found, (surface.max_displacement, last.force)]


def modulus_share(outcome: Outcome, koiter: Curve) -> float:
    """Relative standard deviation of a modulus fitted on row 1; 0 where it was not fitted.

    At a given depth the force is proportional to the modulus: what row 1 leaves open is its
    force, and its depth times the slope of the `koiter` curve there, both relative.
    """
    first = outcome.rows[0]
    depth = first.reference.measured_max_displacement_m
    if not outcome.young_from.startswith('fitted') or not depth or len(koiter.force_n) < 3:
        return 0.0
    depth_sigma, force_sigma = _sigmas(outcome.rows)
    x, y = np.log(koiter.displacement_m[1:]), np.log(koiter.force_n[1:])
    slope = float(np.interp(np.log(depth), x, np.gradient(y, x)))
    return float(np.hypot(force_sigma[0] / first.force, slope * depth_sigma[0] / depth))


def bands(outcome: Outcome, drawn: list[Curve]) -> str:
    """What the bands and bars of the `drawn` curves mean."""
    bars = 'Bars: one standard deviation of force and of the extrapolated depth'
    koiter = next((curve for curve in drawn if curve.name == 'koiter'), None)
    share = 0.0 if koiter is None else modulus_share(outcome, koiter)
    band = f'; bands: the modulus, which row 1 fixes to {100 * share:.1f} %' if share else ''
    return f"{bars}; published: the scanner's stated 0.127 mm{band}."


def _curve(name: str, kind: Kind, values: list[Any]) -> Curve:
    known = [(x, y) for x, y in values if x is not None and np.isfinite(x)]
    pairs = np.array(known, dtype=np.float64).reshape(-1, 2)
    return Curve(name, kind, pairs[:, 0], pairs[:, 1])


def published_rows(published: list[dict[str, Any]], name: str) -> list[PublishedRow]:
    """The published table as the report shows it, with our predictions for its forces."""
    own = linear_own_modulus(published)
    return [
        PublishedRow(
            object_name=name,
            force_lbf=float(row['force_lbf']),
            max_displacement_m=float(row['measured_max_displacement_m']),
            nonlinear_error_m=float(row['nonlinear_mean_error_m']),
            linear_error_m=float(row['linear_mean_error_m']),
            predicted_m=models_of(row, own),
        )
        for row in published
    ]


def linearity(trace: SampleTrace) -> LinearityTrace:
    """The gauge of the transition over the recording."""
    return LinearityTrace(trace.time_s, trace.linear_error, trace.linear_displacement_m)
