# SPDX-License-Identifier: Apache-2.0
"""The one door to all formats: by the name of the file, or by its first bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from grasp_common.bounded_yaml import regular
from grasp_common.formats.envelope import opened
from grasp_common.formats.obj import read_obj
from grasp_common.formats.off import read_off
from grasp_common.formats.pcd import read_pcd
from grasp_common.formats.ply import read_ply
from grasp_common.formats.raw import RawMesh, ScanFileError
from grasp_common.formats.stl import read_stl
from grasp_common.formats.table import read_table
from grasp_common.formats.vrml import read_vrml

Reader = Callable[[bytes], RawMesh]

FORMATS: dict[str, Reader] = {
    '.stl': read_stl,
    '.ply': read_ply,
    '.obj': read_obj,
    '.off': read_off,
    '.coff': read_off,
    '.wrl': read_vrml,
    '.vrml': read_vrml,
    '.wrz': read_vrml,
    '.pcd': read_pcd,
    '.xyz': read_table,
    '.txt': read_table,
    '.asc': read_table,
    '.csv': read_table,
    '.pts': read_table,
}

_BY_CONTENT: tuple[tuple[re.Pattern[bytes], Reader], ...] = (
    (re.compile(rb'ply[ \t]*[\r\n]'), read_ply),
    (re.compile(rb'#VRML'), read_vrml),
    (re.compile(rb'(\s*#[^\n]*\n)*VERSION [.0-9]+\s+FIELDS '), read_pcd),
    (re.compile(rb'(ST)?C?N?OFF\b'), read_off),
    (re.compile(rb'solid\b'), read_stl),
)


def read_mesh_file(path: str | Path) -> RawMesh:
    """Read vertices and triangles as they stand in the file: order kept, nothing welded.

    Raises ScanFileError, whose message names the file.
    """
    try:
        data = regular(Path(path)).read_bytes()
    except OSError as error:
        raise ScanFileError(f'{path}: {error.strerror or error}') from None
    return parse_mesh(data, _suffix(Path(path)), str(path))


def _suffix(path: Path) -> str:
    """What the file is under its compression: `.stl` for `a.stl.gz`."""
    return Path(path.stem).suffix if path.suffix.lower() == '.gz' else path.suffix


def parse_mesh(data: bytes, suffix: str, source: str) -> RawMesh:
    """Read vertices and triangles from the bytes of a file of type `suffix`.

    Raises ScanFileError, whose message names the `source`.
    """
    try:
        if not data:
            raise ScanFileError('the file is empty; export or copy it again')
        content, notes = opened(data, suffix)
        if not content:
            raise ScanFileError('the file is empty under its compression; export it again')
        raw = _reader(content, suffix)(content)
    except ScanFileError as error:
        raise ScanFileError(f'{source}: {error}') from None
    return replace(raw, notes=(*notes, *raw.notes)) if notes else raw


def _reader(data: bytes, suffix: str) -> Reader:
    """Return the reader for a file; its content decides where the name says nothing or lies."""
    named = FORMATS.get(suffix.lower())
    for pattern, reader in _BY_CONTENT:
        if pattern.match(data):
            # any text may begin with the word "solid"; the other marks are sure
            return named if named is not None and reader is read_stl else reader
    if named is None:
        known = ', '.join(FORMATS)
        raise ScanFileError(f'unknown scan format {suffix!r}; export one of {known}')
    return named
