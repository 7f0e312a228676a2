"""Reading a scan from a file: format, unit, welding; everything a scanner user may bring."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from scan_compare.formats.obj import read_obj
from scan_compare.formats.ply import read_ply
from scan_compare.formats.raw import RawMesh, ScanFileError
from scan_compare.formats.stl import read_stl
from scan_compare.formats.xyz import read_xyz
from scan_compare.scan import Scan, clean
from scan_compare.units import UnitError, choose_unit, robust_extent
from scan_compare.vrml import read_vrml

__all__ = ['FORMATS', 'Scan', 'ScanFileError', 'parse_scan', 'read_mesh_file', 'read_scan']

FORMATS: dict[str, Callable[[bytes], RawMesh]] = {
    '.stl': read_stl,
    '.ply': read_ply,
    '.obj': read_obj,
    '.wrl': read_vrml,
    '.vrml': read_vrml,
    '.xyz': read_xyz,
    '.txt': read_xyz,
    '.asc': read_xyz,
    '.csv': read_xyz,
    '.pts': read_xyz,
}


def read_scan(
    path: str | Path, unit: str | None = None, expected_size_m: float | None = None
) -> Scan:
    """Read a scan from STL, PLY, OBJ, XYZ or VRML 2.

    unit: of the file ('mm', 'inch', 'm', ...); None infers it from `expected_size_m`, the largest
    side of the scanned object [m]. Raises ScanFileError, whose message names the file, if it
    cannot be read, holds no points, or if the unit does not fit the object.
    """
    name = str(path)
    # the text is given up before points are welded: both at once would be the most memory needed
    raw = _parse(_read_bytes(path), Path(path).suffix, name)
    return _scan(raw, name, unit, expected_size_m)


def parse_scan(
    data: bytes,
    suffix: str,
    source: str,
    unit: str | None = None,
    expected_size_m: float | None = None,
) -> Scan:
    """Read a scan from the bytes of a file of type `suffix`; see `read_scan`."""
    return _scan(_parse(data, suffix, source), source, unit, expected_size_m)


def _scan(raw: RawMesh, source: str, unit: str | None, expected_size_m: float | None) -> Scan:
    cleaned = clean(raw.points, raw.triangles)
    if len(cleaned.points) == 0:
        raise ScanFileError(no_points(source, len(raw.points)))
    try:
        chosen = choose_unit(robust_extent(cleaned.points), unit, expected_size_m)
    except UnitError as error:
        raise ScanFileError(f'{source}: {error}') from None
    points = cleaned.points
    points *= chosen.metres
    return Scan(
        points,
        cleaned.triangles,
        chosen.name,
        chosen.inferred,
        source,
        (*raw.notes, *cleaned.notes, chosen.explanation),
    )


def no_points(source: str, given: int) -> str:
    """Return the sentence for a scan none of whose `given` points can be used."""
    found = f'all {given} points are NaN or infinite' if given else 'the scan has no points'
    return f'{source}: {found}; scan or export the object again'


def read_mesh_file(path: str | Path) -> RawMesh:
    """Read vertices and triangles as they stand in the file: order kept, nothing welded.

    For surfaces whose vertex order carries meaning. Raises ScanFileError.
    """
    return _parse(_read_bytes(path), Path(path).suffix, str(path))


def _read_bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ScanFileError(f'{path}: {error.strerror or error}') from None


def _parse(data: bytes, suffix: str, source: str) -> RawMesh:
    if not data:
        raise ScanFileError(f'{source}: the file is empty; export or copy it again')
    reader = FORMATS.get(suffix.lower()) or _reader_by_content(data)
    if reader is None:
        known = ', '.join(FORMATS)
        raise ScanFileError(f'{source}: unknown scan format {suffix!r}; known: {known}')
    try:
        return reader(data)
    except ScanFileError as error:
        raise ScanFileError(f'{source}: {error}') from None


def _reader_by_content(data: bytes) -> Callable[[bytes], RawMesh] | None:
    for magic, reader in ((b'ply', read_ply), (b'#VRML', read_vrml), (b'solid', read_stl)):
        if data.startswith(magic):
            return reader
    return None
