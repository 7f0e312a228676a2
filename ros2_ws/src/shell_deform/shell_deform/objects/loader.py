# SPDX-License-Identifier: Apache-2.0
"""Object files: strict reading, and the objects that come with the package."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from grasp_common.options import METRES_PER_UNIT

from ..theory.relaxation import Relaxation, RelaxationError, log_law, prony
from .finger_files import body_names, find_body
from .grip_place import read_grip, read_place
from .shell_object import (
    DEFAULT_CONTACT_RADIUS_M,
    DEFAULT_CONTROL_VERTICES,
    STANDARD_ATMOSPHERE_PA,
    Cone,
    Contact,
    Cylinder,
    Ellipsoid,
    Finger,
    Gas,
    GripPlace,
    HalfCylinder,
    HeightField,
    MeshFile,
    ObjectError,
    Revolution,
    ShellObject,
    Sphere,
    Support,
    Surface,
    edge_names,
    is_closed,
    smallest_radius,
)
from .yaml_reader import Entry, read_document

# What a cell measures at most [N]: beyond, its unit is another one.
MOST_CELL_N = 1e4

_REQUIRED = ('name', 'surface', 'thickness_m', 'young_modulus_pa', 'poisson_ratio')
_OPTIONAL = (
    'solid_young_modulus_pa', 'yield_stress_pa', 'gas', 'supports', 'contacts', 'control_vertices',
    'relaxation', 'source', 'pressure_pa',
)  # fmt: skip
_SUPPORT_KINDS = ('clamped', 'hinged', 'symmetry', 'diaphragm', 'held')


def object_names() -> list[str]:
    """Names of the objects that come with the package."""
    return sorted(path.stem for path in _shipped().glob('*.yaml'))


def load_object(name_or_path: str | Path) -> ShellObject:
    """Read a shipped object by name, or an object file by its path or that of its folder.

    Raises:
        ObjectError: no such object, a folder with several files, or a file with unknown keys,
            missing units or impossible values; the message names file and line.
    """
    path = Path(name_or_path)
    if str(name_or_path) in object_names():
        path = _shipped() / f'{name_or_path}.yaml'
    elif path.is_dir():
        path = _in_folder(path)
    elif not path.is_file():
        raise ObjectError(
            f'no object file {str(name_or_path)!r}; the shipped objects are '
            f'{", ".join(object_names())}'
        )
    return _read(read_document(path), path.resolve().parent)


def _in_folder(folder: Path) -> Path:
    """The object file of a folder as object_prepare, or a recording, leaves one."""
    files = [folder / 'object.yaml'] if (folder / 'object.yaml').is_file() else []
    files = files or sorted(folder.glob('*.yaml'))
    if len(files) != 1:
        found = ', '.join(file.name for file in files) or 'no .yaml file'
        raise ObjectError(f'folder {str(folder)!r} holds {found}: name the object file')
    return files[0]


def shipped_text(name: str) -> str:
    """The object file of a shipped object, comments included.

    Raises:
        ObjectError: there is no such object.
    """
    if name not in object_names():
        raise ObjectError(f'no shipped object {name!r}; there are {", ".join(object_names())}')
    return (_shipped() / f'{name}.yaml').read_text(encoding='utf-8')


def _shipped() -> Path:
    return Path(__file__).parent


def _read(root: Entry, folder: Path) -> ShellObject:
    entries = root.mapping(_REQUIRED, _OPTIONAL)
    surface = _surface(entries['surface'], folder)
    thickness, per_vertex = _thickness(entries['thickness_m'], surface)
    touched = [_contact(entry, surface, folder) for entry in _list(entries, 'contacts')]
    shell = ShellObject(
        name=entries['name'].text(),
        surface=surface,
        thickness_m=thickness,
        young_modulus_pa=_modulus(entries['young_modulus_pa']),
        poisson_ratio=entries['poisson_ratio'].number(above=-1.0, maximum=0.5),
        yield_stress_pa=(
            entries['yield_stress_pa'].number(above=0.0) if 'yield_stress_pa' in entries else None
        ),
        gas=_gas(entries['gas'], surface) if 'gas' in entries else Gas(),
        supports=tuple(_support(entry, surface) for entry in _list(entries, 'supports')),
        contacts=tuple(c for c in touched if isinstance(c, Contact)),
        grips=tuple(c for c in touched if isinstance(c, GripPlace)),
        control_vertices=(
            entries['control_vertices'].whole(12, 1_000_000)
            if 'control_vertices' in entries
            else DEFAULT_CONTROL_VERTICES
        ),
        vertex_thickness_m=per_vertex,
        pressure_pa=entries['pressure_pa'].number(minimum=-1e9, maximum=1e9)
        if 'pressure_pa' in entries
        else 0.0,
        relaxation=_relaxation(entries['relaxation']) if 'relaxation' in entries else None,
        source=entries['source'].text() if 'source' in entries else '',
        solid_young_modulus_pa=(
            _modulus(entries['solid_young_modulus_pa'])
            if 'solid_young_modulus_pa' in entries
            else None
        ),
    )
    if not shell.name:
        raise entries['name'].error('name is empty')
    return shell


def _list(entries: dict[str, Entry], key: str) -> list[Entry]:
    return entries[key].items() if key in entries else []


def _modulus(entry: Entry) -> float:
    return entry.number(above=0.0, maximum=1e13)


def _length(entry: Entry) -> float:
    return entry.number(above=0.0, maximum=1000.0)


def _sphere(entry: Entry, folder: Path) -> Surface:
    return Sphere(_length(entry.mapping(['outer_diameter_m'])['outer_diameter_m']))


def _ellipsoid(entry: Entry, folder: Path) -> Surface:
    values = entry.mapping(['outer_diameters_m'])['outer_diameters_m'].items(3)
    a, b, c = (_length(value) for value in values)
    return Ellipsoid((a, b, c))


def _cylinder(entry: Entry, folder: Path) -> Surface:
    found = entry.mapping(['outer_diameter_m', 'length_m', 'ends'])
    ends = cast(Any, found['ends'].text(['open', 'closed']))
    return Cylinder(_length(found['outer_diameter_m']), _length(found['length_m']), ends)


def _half_cylinder(entry: Entry, folder: Path) -> Surface:
    found = entry.mapping(['outer_diameter_m', 'length_m'])
    return HalfCylinder(_length(found['outer_diameter_m']), _length(found['length_m']))


def _cone(entry: Entry, folder: Path) -> Surface:
    found = entry.mapping(['outer_diameters_m', 'length_m'])
    lower, upper = (_length(value) for value in found['outer_diameters_m'].items(2))
    return Cone((lower, upper), _length(found['length_m']))


def _revolution(entry: Entry, folder: Path) -> Surface:
    rows = entry.mapping(['outer_profile_m'])['outer_profile_m'].items()
    if len(rows) < 2:
        raise entry.error(f'outer_profile_m has {len(rows)} points; at least two are needed')
    points: list[tuple[float, float]] = []
    for position, row in enumerate(rows):
        radius, height = row.items(2)
        inner = 0 < position < len(rows) - 1
        r = radius.number(minimum=0.0, maximum=1000.0)
        if inner and r == 0.0:
            raise row.error(
                'the radius is zero inside the profile; only its ends may touch the axis'
            )
        point = (r, height.number(minimum=-1000.0, maximum=1000.0))
        if points and point == points[-1]:
            raise row.error('this point of the profile repeats the one before')
        points.append(point)
    return Revolution(tuple(points))


def _height_field(entry: Entry, folder: Path) -> Surface:
    found = entry.mapping(['file', 'spacing_m'])
    return HeightField(_file(found['file'], folder), _length(found['spacing_m']))


def _mesh(entry: Entry, folder: Path) -> Surface:
    found = entry.mapping(['file', 'unit', 'face'])
    unit = cast(Any, found['unit'].text(['m', 'cm', 'mm', 'in', 'inch']))
    face = cast(Any, found['face'].text(['outer', 'middle', 'control']))
    return MeshFile(_file(found['file'], folder), unit, face)


_SURFACES: dict[str, Callable[[Entry, Path], Surface]] = {
    'sphere': _sphere,
    'ellipsoid': _ellipsoid,
    'cylinder': _cylinder,
    'half_cylinder': _half_cylinder,
    'cone': _cone,
    'revolution': _revolution,
    'height_field': _height_field,
    'mesh': _mesh,
}


def _surface(entry: Entry, folder: Path) -> Surface:
    kind, inner = entry.one_of(_SURFACES)
    return _SURFACES[kind](inner, folder)


def _file(entry: Entry, folder: Path) -> Path:
    path = folder / entry.text()
    if not path.is_file():
        raise entry.error(f'there is no file {path}')
    return path


def _thickness(entry: Entry, surface: Surface) -> tuple[float, npt.NDArray[np.float64] | None]:
    if not entry.is_list:
        value = entry.number(above=0.0, maximum=1.0)
        radius = smallest_radius(surface)
        if value >= radius:
            raise entry.error(
                f'thickness_m is {value:g}, not below the smallest outer radius {radius:g}'
            )
        return value, None
    if not (isinstance(surface, MeshFile) and surface.face == 'control'):
        raise entry.error('a thickness per vertex needs surface: mesh with face: control')
    values = np.array([item.number(above=0.0, maximum=1.0) for item in entry.items()])
    if len(values) == 0:
        raise entry.error('thickness_m is an empty list')
    values.setflags(write=False)
    return float(values.mean()), values


def _gas(entry: Entry, surface: Surface) -> Gas:
    found = entry.mapping(['kind'], ['gauge_pressure_pa', 'ambient_pa'])
    kind = cast(Any, found['kind'].text(['none', 'open', 'sealed', 'liquid']))
    fills = kind in ('sealed', 'liquid')
    if fills and is_closed(surface) is False:
        what = 'sealed gas' if kind == 'sealed' else 'a liquid'
        raise found['kind'].error(f'an open {surface.kind} cannot hold {what}')
    if not fills and 'gauge_pressure_pa' in found:
        raise found['gauge_pressure_pa'].error(
            f'gauge_pressure_pa needs kind: sealed or liquid, not {kind}'
        )
    ambient = STANDARD_ATMOSPHERE_PA
    if 'ambient_pa' in found:
        ambient = found['ambient_pa'].number(minimum=0.0, maximum=1e8)
    gauge = 0.0
    if 'gauge_pressure_pa' in found:
        gauge = found['gauge_pressure_pa'].number(minimum=-ambient, maximum=1e8)
    return Gas(kind, gauge, ambient)


_LOG_KEYS = ('share_per_decade', 'from_s', 'to_s')


def _relaxation(entry: Entry) -> Relaxation:
    found = entry.mapping(
        ['kind'], [*_LOG_KEYS, 'shares', 'times_s', 'reference_s', 'sigma_per_decade']
    )
    kind = found['kind'].text(['log', 'prony'])
    needed = _LOG_KEYS if kind == 'log' else ('shares', 'times_s')
    allowed = {'kind', 'reference_s', *needed, 'sigma_per_decade' if kind == 'log' else 'to_s'}
    missing = [name for name in needed if name not in found]
    if missing:
        raise entry.error(f'relaxation of kind {kind} lacks {", ".join(missing)}')
    for name, other in found.items():
        if name not in allowed:
            raise other.error(f'{name} does not belong to relaxation of kind {kind}')
    numbers = {
        name: found[name].number() for name in found if name not in ('kind', 'shares', 'times_s')
    }
    reference, last = numbers.get('reference_s'), numbers.get('to_s')
    try:
        if kind == 'log':
            per_decade, first = numbers['share_per_decade'], numbers['from_s']
            sigma = 0.0
            if 'sigma_per_decade' in found:
                sigma = found['sigma_per_decade'].number(minimum=0.0, maximum=1.0)
            return log_law(per_decade, first, numbers['to_s'], reference, sigma)
        shares = np.array([item.number() for item in found['shares'].items()])
        times = np.array([item.number() for item in found['times_s'].items()])
        return prony(shares, times, reference or 0.0, last)
    except RelaxationError as error:
        raise entry.error(f'relaxation: {error}') from error


def _support(entry: Entry, surface: Surface) -> Support:
    found = entry.mapping(['kind', 'where'])
    where = _edge(found['where'], surface)
    return Support(cast(Any, found['kind'].text(_SUPPORT_KINDS)), where)


def _edge(entry: Entry, surface: Surface) -> str:
    where = entry.text()
    names = ('boundary', *edge_names(surface))
    axis, _, level = where.partition('=')
    is_plane = axis in ('x', 'y', 'z') and _is_number(level)
    if where not in names and not is_plane:
        raise entry.error(
            f'where is {where!r}; allowed are {", ".join(names)}, or a plane such as x=0'
        )
    if not is_plane and is_closed(surface):
        raise entry.error(f'a closed {surface.kind} has no {where}')
    return where


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _contact(entry: Entry, surface: Surface, folder: Path) -> Contact | GripPlace:
    rounds = ('radius_m', 'curvature_radius_m')
    fingers = ('body', 'unit', 'along', 'towards', 'cells_n')
    held = ('where', 'hold', 'free')
    found = entry.mapping([], ['at_m', *rounds, 'kind', 'friction', *fingers, *held])
    kinds = ('pin', 'pad', 'fingertip', 'plate', 'grip')
    kind = cast(Any, found['kind'].text(kinds) if 'kind' in found else 'pin')
    if kind == 'grip':
        return read_grip(entry, lambda where: _edge(where, surface))
    refused = {
        'fingertip': rounds,
        'plate': ('curvature_radius_m', 'body', 'unit', 'along', 'cells_n'),
    }.get(kind, fingers)
    for key in (*held, *refused):
        if key in found:
            needed = 'kind: fingertip' if key in fingers else 'kind: pin or pad'
            needed = 'kind: grip' if key in held else needed
            raise found[key].error(f'{key} needs {needed}, not {kind}')
    for key in ('towards', 'radius_m'):
        if kind == 'plate' and key not in found:
            raise entry.error(f'a plate needs {key}')
    if 'at_m' not in found:
        raise entry.error(f'{entry.key} lacks at_m')
    x, y, z = read_place(found['at_m'])
    largest = smallest_radius(surface) if kind == 'pin' else 1000.0
    radius = DEFAULT_CONTACT_RADIUS_M
    if 'radius_m' in found:
        radius = found['radius_m'].number(above=0.0, maximum=largest)
    curvature = None
    if 'curvature_radius_m' in found:
        if kind == 'pin':
            raise found['curvature_radius_m'].error('curvature_radius_m needs kind: pad, not pin')
        curvature = found['curvature_radius_m'].number(minimum=radius, maximum=1e6)
    friction = 0.0
    if 'friction' in found:
        friction = found['friction'].number(minimum=0.0, maximum=10.0)
        if friction > 0.0 and kind == 'pin':
            raise found['friction'].error('friction needs kind: pad or fingertip, not pin')
    finger = _finger(entry, found, folder) if kind == 'fingertip' else None
    if finger is not None and finger.cells_n is not None and friction > 0.0:
        raise found['friction'].error(
            'friction is that of a rigid body; with cells_n the push lies where it was measured'
        )
    towards = _direction(found['towards']) if kind == 'plate' else None
    return Contact((x, y, z), radius, kind, curvature, friction, finger, towards)


def _finger(entry: Entry, found: dict[str, Entry], folder: Path) -> Finger:
    if 'body' not in found:
        raise entry.error(
            f'kind: fingertip needs a body: {", ".join(body_names())}, or a body file'
        )
    file = find_body(found['body'].text(), folder)
    if file is None:
        raise found['body'].error(
            f'there is no body {found["body"].text()!r}; give a file, or one of '
            f'{", ".join(body_names())}'
        )
    unit = found['unit'].text(METRES_PER_UNIT) if 'unit' in found else None
    if 'unit' in found and file.suffix.lower() in ('.yaml', '.yml'):
        raise found['unit'].error('unit is that of a mesh; a parameter file has its own')
    along, towards = (_direction(found.get(key)) for key in ('along', 'towards'))
    cells = None
    if 'cells_n' in found:
        cells = tuple(
            item.number(minimum=-MOST_CELL_N, maximum=MOST_CELL_N)
            for item in found['cells_n'].items()
        )
    return Finger(file, unit, along, towards, cells)


def _direction(entry: Entry | None) -> tuple[float, float, float] | None:
    if entry is None:
        return None
    x, y, z = (value.number(minimum=-1e6, maximum=1e6) for value in entry.items(3))
    if x == y == z == 0.0:
        raise entry.error(f'{entry.key} is a direction; it cannot be [0, 0, 0]')
    return x, y, z
