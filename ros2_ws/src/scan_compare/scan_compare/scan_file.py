# SPDX-License-Identifier: Apache-2.0
"""A scan from a file or a cloud of points: welding and unit, whatever it came in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from grasp_common.formats import RawMesh, ScanFileError, parse_mesh, read_mesh_file
from scan_compare.scan import Scan, clean
from scan_compare.units import UnitError, choose_unit, robust_extent

__all__ = ['Scan', 'ScanFileError', 'parse_scan', 'read_mesh_file', 'read_scan', 'scan_of']


def read_scan(
    path: str | Path, unit: str | None = None, expected_size_m: float | None = None
) -> Scan:
    """Read a scan from any file that `formats` reads: STL, PLY, OBJ, OFF, PCD, VRML 2, text.

    unit: of the file ('mm', 'inch', 'm', ...); None infers it from `expected_size_m`, the largest
    side of the scanned object [m]. Raises ScanFileError, whose message names the file, if it
    cannot be read, holds no points, or if the unit does not fit the object.
    """
    # the text is given up before points are welded: both at once would be the most memory needed
    return _explained(scan_of(read_mesh_file(path), str(path), unit, expected_size_m))


def parse_scan(
    data: bytes,
    suffix: str,
    source: str,
    unit: str | None = None,
    expected_size_m: float | None = None,
) -> Scan:
    """Read a scan from the bytes of a file of type `suffix`; see `read_scan`."""
    return _explained(scan_of(parse_mesh(data, suffix, source), source, unit, expected_size_m))


def _explained(scan: Scan) -> Scan:
    """Return a scan from a file with the choice of its unit among its notes."""
    return (
        scan
        if scan.unit_inferred
        else replace(scan, notes=(*scan.notes, f'unit declared: {scan.unit}'))
    )


def scan_of(
    raw: RawMesh, source: str, unit: str | None = None, expected_size_m: float | None = None
) -> Scan:
    """Weld and scale points and faces from a file, a bag or a topic: the one way they all go.

    `raw` is worked on where it is. Raises ScanFileError as `read_scan` does.
    """
    given = len(raw.points)
    cleaned = clean(raw.points, raw.triangles)
    if len(cleaned.points) == 0:
        raise ScanFileError(no_points(source, given))
    try:
        chosen = choose_unit(robust_extent(cleaned.points), unit, expected_size_m)
    except UnitError as error:
        raise ScanFileError(f'{source}: {error}') from None
    points = cleaned.points
    points *= chosen.metres
    notes = (*raw.notes, *cleaned.notes)
    if chosen.inferred:
        notes = (*notes, chosen.explanation)
    return Scan(points, cleaned.triangles, chosen.name, chosen.inferred, source, notes)


def no_points(source: str, given: int) -> str:
    """Return the sentence for a scan none of whose `given` points can be used."""
    found = f'all {given} points are NaN or infinite' if given else 'the scan has no points'
    return f'{source}: {found}; scan or export the object again'
