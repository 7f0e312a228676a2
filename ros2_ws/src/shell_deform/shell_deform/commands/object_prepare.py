# SPDX-License-Identifier: Apache-2.0
"""`object_prepare`: from a scan of the undeformed object to an object file."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml
from rich.console import Console
from scipy.spatial import cKDTree

from grasp_common.command_line import parse
from grasp_common.options import METRES_PER_UNIT
from grasp_common.terminal import counted, say
from shell_deform.commands.console import CommandError, print_json, run
from shell_deform.commands.object_prepare_options import RENAMED, build_parser
from shell_deform.objects import load_object
from shell_deform.objects.file_mesh import read_triangles, write_control_mesh
from shell_deform.objects.object_mesh import EDGES_PER_RADIUS
from shell_deform.objects.prepare import (
    PreparedScan,
    Refinement,
    prepare,
    vertex_thickness,
)
from shell_deform.objects.primitive_fit import capped_share, fitting_primitive
from shell_deform.surface import LimitSurface
from shell_deform.surface.scan_fit import ScanFit

FloatArray = npt.NDArray[np.float64]

UNSEEN = (0.8, 0.8, 0.8, 1.0)
"""Colour of triangles where the scan has no point."""
HAND_SIZE_M = (0.02, 0.5)
"""Largest sides of objects that a hand holds [m]; their ratio is below 25.4."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Prepare one object; 0 done, 1 failed with one sentence, 2 wrong arguments."""
    parser = build_parser()
    options = parse('shell_deform', parser, arguments, RENAMED)
    if options.gauge_pressure is not None and options.gas != 'sealed':
        parser.error('--gauge-pressure needs --gas sealed')
    if options.error is not None and options.vertices is not None:
        parser.error('give --vertices or --error, not both')
    return run('object_prepare', lambda: _prepare(options))


def _prepare(options: argparse.Namespace) -> None:
    name = options.name or options.scan.stem
    thickness = options.thickness
    if thickness is None:
        thickness = _read_thickness(options.thickness_file)
    console = Console(stderr=True)
    with console.status(f'reading {options.scan}') as status:
        vertices, triangles = read_triangles(options.scan, options.unit)
        _refuse_size(options, vertices)
        status.update(f'fitting {len(vertices)} points')
        contacts = np.array(options.contact, dtype=np.float64).reshape(-1, 4)
        prepared = prepare(
            vertices,
            triangles,
            thickness,
            face=options.face,
            control_vertices=options.vertices or 640,
            error=options.error,
            longest_rim=options.close_holes,
            refinement=Refinement(
                contacts[:, :3], lambda surface: EDGES_PER_RADIUS * float(contacts[:, 3].min())
            ),
        )
        _refuse_far_contacts(contacts, prepared.points)
        status.update('writing the results')
        files = _write(options, name, prepared, thickness)
    report = _report(name, prepared, files)
    report['warnings'] += _what_is_missing(prepared, report)
    if options.json:
        print_json(report)
        return
    fit = report['fit']
    say(
        f'{name}: {report["vertices"]} control vertices; scan to surface {1e3 * fit["rms_m"]:.3g} '
        f'mm rms, {_systematic(prepared.fit)}; '
        f'{counted(report["scan"]["pieces"], "piece")} found, '
        f'{counted(report["scan"]["holes_closed"], "hole")} closed, '
        f'{counted(report["open_rims"], "rim")} open'
    )
    for warning in report['warnings']:
        say(f'warning: {warning}')
    for path in files.values():
        say(path)


def _refuse_size(options: argparse.Namespace, vertices: FloatArray) -> None:
    """A scan read in a wrong unit is off by 25.4 or 1000: no hand holds it."""
    size = float(np.ptp(np.quantile(vertices, (0.005, 0.995), axis=0), axis=0).max())
    low, high = HAND_SIZE_M
    if options.size is not None:
        low, high = 0.5 * options.size, 1.6 * options.size
    if low <= size <= high:
        return
    fitting = [
        (unit, size / METRES_PER_UNIT[options.unit] * metres)
        for unit, metres in METRES_PER_UNIT.items()
        if unit != 'in' and low <= size / METRES_PER_UNIT[options.unit] * metres <= high
    ]
    hint = ' or '.join(f'--unit {unit} makes it {1e3 * other:.4g} mm' for unit, other in fitting)
    raise CommandError(
        f'{options.scan}: in {options.unit} the object is {1e3 * size:.4g} mm large, which is not '
        f'between {1e3 * low:.4g} and {1e3 * high:.4g} mm; {hint or "check the unit"}, or state '
        'its true size with --size'
    )


def _refuse_far_contacts(contacts: FloatArray, points: FloatArray) -> None:
    """Contacts lie on the scanned face; anything else is a slip of unit or frame."""
    if not len(contacts):
        return
    distance, _ = cKDTree(points).query(contacts[:, :3])
    allowed = np.maximum(contacts[:, 3], 0.02 * float(np.ptp(points, axis=0).max()))
    far = np.flatnonzero(distance > allowed)
    if len(far):
        x, y, z = contacts[far[0], :3]
        raise CommandError(
            f'contact {x:g},{y:g},{z:g} lies {distance[far[0]]:.3g} m from the scan; give it in '
            'm, in the frame of the scan'
        )


def _write(
    options: argparse.Namespace, name: str, prepared: PreparedScan, thickness: float | FloatArray
) -> dict[str, str]:
    """Write all files, or none: they are made in a folder of their own and moved at the end."""
    options.out.mkdir(parents=True, exist_ok=True)
    files = {
        'control_mesh': f'{name}_control.ply',
        'error_map': f'{name}_error.npz',
        'picture': f'{name}_fit.png',
        'object': f'{name}.yaml',
    }
    with tempfile.TemporaryDirectory(dir=options.out, prefix='.part_') as folder:
        part = Path(folder)
        write_control_mesh(part / files['control_mesh'], prepared.fit.mesh)
        content = _content(options, name, prepared, thickness, files['control_mesh'])
        text = yaml.safe_dump(content, sort_keys=False)
        (part / files['object']).write_text(text, encoding='utf-8')
        load_object(part / files['object'])
        np.savez_compressed(
            part / files['error_map'],
            points_m=prepared.points,
            distance_m=prepared.fit.distance,
            counted=prepared.fit.counted,
        )
        _draw(part / files['picture'], prepared)
        for file in files.values():
            os.replace(part / file, options.out / file)
    return {key: str(options.out / file) for key, file in files.items()}


def _content(
    options: argparse.Namespace,
    name: str,
    prepared: PreparedScan,
    thickness: float | FloatArray,
    control_mesh: str,
) -> dict[str, Any]:
    """The object file."""
    mesh = prepared.fit.mesh
    walls = vertex_thickness(mesh, thickness)
    return {
        'name': name,
        'surface': {'mesh': {'file': control_mesh, 'unit': 'm', 'face': 'control'}},
        'thickness_m': float(thickness) if walls is None else walls.tolist(),
        'young_modulus_pa': options.young,
        'poisson_ratio': options.poisson,
        **_gas(options),
        'contacts': [
            {'at_m': list(contact[:3]), 'radius_m': contact[3], 'kind': 'pin'}
            for contact in options.contact
        ],
        'control_vertices': mesh.vertex_count,
        'source': f'fitted to the {options.face} face of {options.scan.name} ({options.unit}), '
        f'{1e3 * prepared.fit.rms_m:.3g} mm rms',
    }


def _gas(options: argparse.Namespace) -> dict[str, Any]:
    if options.gas is None:
        return {}
    gas: dict[str, Any] = {'kind': options.gas}
    if options.gauge_pressure is not None:
        gas['gauge_pressure_pa'] = options.gauge_pressure
    return {'gas': gas}


def _report(name: str, prepared: PreparedScan, files: dict[str, str]) -> dict[str, Any]:
    fit, mesh = prepared.fit, prepared.fit.mesh
    counted = np.abs(fit.distance[fit.counted])
    return {
        'object': name,
        'vertices': mesh.vertex_count,
        'irregular_vertices': len(mesh.irregular_vertices),
        'open_rims': _rim_count(mesh.boundary_edges),
        'scan': prepared.report,
        'fit': {
            'points': len(fit.distance),
            'counted': int(fit.counted.sum()),
            'rms_m': fit.rms_m,
            'systematic_m': fit.systematic_m,
            'p95_m': float(np.quantile(counted, 0.95)),
        },
        'thickness_over_radius': prepared.slenderness,
        'warnings': prepared.warnings(),
        'files': files,
    }


def _what_is_missing(prepared: PreparedScan, report: dict[str, Any]) -> list[str]:
    """Sentences on an open shape and on the primitive that the scan shows; kept in the report."""
    found = []
    if report['open_rims']:
        share = capped_share(prepared.scan)
        report['missing_lid_share'] = share
        found.append(
            f'the shape is open: {counted(report["open_rims"], "rim")}, whose flat lids would be '
            f'{100.0 * share:.0f} % of it; scan the rest, or raise --close-holes'
        )
    primitive = fitting_primitive(prepared.scan)
    if primitive is not None:
        report['primitive'] = {
            'surface': primitive.surface,
            'rms_m': primitive.rms_m,
            'missing_share': primitive.missing,
        }
        found.append(primitive.sentence())
    return found


def _systematic(fit: ScanFit) -> str:
    if fit.systematic_m == 0.0:
        return 'nothing systematic seen above the noise'
    return f'of which {1e3 * fit.systematic_m:.3g} mm systematic'


def _rim_count(edges: npt.NDArray[np.int32]) -> int:
    following = {int(a): int(b) for a, b in edges}
    rims = 0
    while following:
        rims += 1
        first, vertex = following.popitem()
        while vertex != first:
            vertex = following.pop(vertex)
    return rims


def _draw(path: Path, prepared: PreparedScan) -> None:
    """Distances of the scan from the fitted face, on the surface and as a histogram."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    fit, mesh = prepared.fit, prepared.fit.mesh
    distance, triangle = 1e3 * fit.distance[fit.counted], fit.triangle[fit.counted]
    count = np.bincount(triangle, minlength=mesh.triangle_count)
    total = np.bincount(triangle, distance, minlength=mesh.triangle_count)
    seen = count > 0
    mean = total[seen] / count[seen]
    corners = 1e3 * LimitSurface(mesh).limit_positions(mesh.vertices)
    scale = plt.Normalize(*(np.array([-1.0, 1.0]) * max(np.quantile(np.abs(mean), 0.98), 1e-9)))
    colours = plt.get_cmap('coolwarm')
    figure = plt.figure(figsize=(11.0, 4.5), dpi=140)
    space = figure.add_subplot(1, 2, 1, projection='3d')
    painted = np.tile(UNSEEN, (mesh.triangle_count, 1))
    painted[seen] = colours(scale(mean))
    space.add_collection3d(Poly3DCollection(corners[mesh.triangles], facecolors=painted))
    low, high = corners.min(axis=0), corners.max(axis=0)
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(high - low)
    for axis, share in zip('xyz', (high - low) / (high - low).max(), strict=True):
        # As many numbers as have room along a side of that length.
        space.locator_params(axis=axis, nbins=max(2, round(5 * share)))
    space.set(xlabel='x (mm)', ylabel='y (mm)', zlabel='z (mm)')
    figure.colorbar(
        plt.cm.ScalarMappable(scale, colours),
        ax=space,
        label='scan outside the fitted face, mean per triangle (mm)',
        shrink=0.8,
        pad=0.15,
    )
    histogram = figure.add_subplot(1, 2, 2)
    histogram.hist(distance, bins=80)
    histogram.set_xlabel('distance (mm)')
    histogram.set_ylabel('scan points')
    histogram.set_title(
        f'{mesh.vertex_count} control vertices, {1e3 * fit.rms_m:.3g} mm rms,\n{_systematic(fit)}'
    )
    figure.tight_layout()
    figure.savefig(path, metadata={'Software': None})
    plt.close(figure)


def _read_thickness(path: Path) -> FloatArray:
    try:
        table = np.loadtxt(path, delimiter=',', ndmin=2)
    except (OSError, ValueError) as error:
        raise CommandError(f'{path}: no table of x, y, z, thickness: {error}') from error
    if table.shape[1] != 4 or not np.isfinite(table).all() or (table[:, 3] <= 0.0).any():
        raise CommandError(
            f'{path}: needs four finite columns x, y, z, thickness with thickness above zero; it '
            f'has {table.shape[1]}'
        )
    return table


if __name__ == '__main__':
    sys.exit(main())
