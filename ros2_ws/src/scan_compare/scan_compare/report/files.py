# SPDX-License-Identifier: Apache-2.0
"""Writing a comparison: JSON, CSV, PLY with the error as a scalar, pictures, offline page."""

from __future__ import annotations

import base64
import html
import json
from pathlib import Path
from string import Template

import numpy as np

from scan_compare.comparison import Comparison
from scan_compare.report.table import HEADING, NONE, Row, rows, verdict

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Scan comparison: $title</title>
<style>
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1100px;padding:0 1rem;
color:#222;background:#fff}
img{max-width:100%;height:auto}table{border-collapse:collapse;margin:1rem 0}
td,th{padding:.2rem .8rem;border-bottom:1px solid #ddd;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}
.verdict{padding:.6rem 1rem;border-left:4px solid #888;background:#f4f4f4}
</style></head><body>
<h1>Scan comparison</h1>
<p>Scan <b>$title</b> against the deformed outer face$face.</p>
<p class="verdict">$verdict</p>
<img alt="scan, model and error map from one camera; profile; histogram" src="$picture">
<img alt="deformed patches on the undeformed shape" src="$patches">
<table><tr>$heading</tr>
$rows
</table>
<h2>Registration</h2><p>$registration</p>
$notes
</body></html>
""")


def dump_json(comparison: Comparison) -> str:
    """Return the statistics as one JSON document; the same comparison gives the same text."""
    return json.dumps(comparison.to_json(), indent=1, sort_keys=True, allow_nan=False) + '\n'


def write_report(comparison: Comparison, directory: Path, limit_m: float | None = None) -> None:
    """Write every file of a report into `directory`, which is made if missing.

    comparison.json, comparison.csv, error.csv and error.ply (points in the object's frame with
    their signed distance), comparison.png, patches.png, report.html.
    """
    # imported here: statistics and the live node do without matplotlib, which starts slowly
    from scan_compare.report.pictures import comparison_picture, patches_picture

    directory.mkdir(parents=True, exist_ok=True)
    picture = comparison_picture(comparison, limit_m)
    patches = patches_picture(comparison)
    contents: dict[str, bytes] = {
        'comparison.json': dump_json(comparison).encode(),
        'comparison.csv': _table_csv(comparison).encode(),
        'error.csv': _points_csv(comparison).encode(),
        'error.ply': _points_ply(comparison),
        'comparison.png': picture,
        'patches.png': patches,
        'report.html': _page(comparison, picture, patches).encode(),
    }
    for name, content in contents.items():
        write_whole(directory / name, content)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there complete or not at all."""
    partial = path.with_name(path.name + '.part')
    partial.write_bytes(content)
    partial.replace(path)


def _table_csv(comparison: Comparison) -> str:
    lines = [
        'statistic,whole_scan,in_dent,outside_dent,unit,'
        'whole_scan_percent_of_max_displacement,in_dent_percent_of_max_displacement'
    ]
    for what, *cells in rows(comparison):
        lines.append(
            ','.join((f'"{what.strip()}"', *('' if cell == NONE else cell for cell in cells)))
        )
    return '\n'.join(lines) + '\n'


def _points_csv(comparison: Comparison) -> str:
    table = np.column_stack(
        (
            comparison.points,
            comparison.distances.distance,
            comparison.used,
            comparison.in_dent,
        )
    )
    lines = ['x_m,y_m,z_m,distance_m,used,in_dent']
    lines += [f'{x:.7f},{y:.7f},{z:.7f},{d:.7f},{u:.0f},{n:.0f}' for x, y, z, d, u, n in table]
    return '\n'.join(lines) + '\n'


def _points_ply(comparison: Comparison) -> bytes:
    record = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('distance', '<f4')])
    points = np.empty(len(comparison.points), record)
    for axis, name in enumerate('xyz'):
        points[name] = comparison.points[:, axis]
    points['distance'] = comparison.distances.distance
    header = [
        'ply',
        'format binary_little_endian 1.0',
        'comment metres, object frame; distance is signed, positive outside the model',
        f'element vertex {len(points)}',
        *(f'property float {name}' for name in record.names or ()),
    ]
    body = points.tobytes()
    if comparison.triangles is not None:
        faces = np.empty(len(comparison.triangles), [('count', 'u1'), ('corners', '<i4', 3)])
        faces['count'] = 3
        faces['corners'] = comparison.triangles
        header += [f'element face {len(faces)}', 'property list uchar int vertex_indices']
        body += faces.tobytes()
    return '\n'.join([*header, 'end_header\n']).encode() + body


def _page(comparison: Comparison, picture: bytes, patches: bytes) -> str:
    notes = ''.join(f'<li>{html.escape(note)}</li>' for note in comparison.notes)
    return _PAGE.substitute(
        title=html.escape(comparison.source),
        face='' if comparison.surface.is_outer else ' (middle surface + half a thickness)',
        verdict=html.escape(verdict(comparison)),
        picture=_data_url(picture),
        patches=_data_url(patches),
        heading=''.join(f'<th>{html.escape(name)}</th>' for name in HEADING),
        rows='\n'.join(_html_row(row) for row in rows(comparison)),
        registration=html.escape(comparison.registration.text),
        notes=f'<h2>Notes</h2><ul>{notes}</ul>' if notes else '',
    )


def _html_row(row: Row) -> str:
    what, *cells = row
    numbers = ''.join(f'<td class="n">{html.escape(cell)}</td>' for cell in cells)
    return f'<tr><td>{html.escape(what)}</td>{numbers}</tr>'


def _data_url(png: bytes) -> str:
    return 'data:image/png;base64,' + base64.b64encode(png).decode()
