# SPDX-License-Identifier: Apache-2.0
"""The description beside a recording, `experiment.yaml`: object, poses, scanner, scans, holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from grasp_common import bounded_yaml
from grasp_replay.errors import BagError

# Mean of what makers of desktop laser scanners state; used where a recording names none.
DEFAULT_SCANNER_SIGMA_M = 0.127e-3
FILE_NAME = 'experiment.yaml'


@dataclass(frozen=True)
class ScanEntry:
    """A scan of the recording.

    `held`: taken under load (else undeformed). `window`: the hold it was taken in, first and last
    time in ns, None when the recording does not tell. `object_pose`: x y z qx qy qz qw in the
    frame of the contacts. `published_row`: the row of the published table with the same load.
    """

    stamp: int
    held: bool
    window: tuple[int, int] | None = None
    object_pose: tuple[float, ...] | None = None
    published_row: int | None = None


@dataclass(frozen=True)
class Experiment:
    """What is known about a recording. `synthetic` is True unless the file denies it.

    `scans` is empty where no file says which there are. `finger_body`: what the fingers carried,
    as `read_finger_bodies` takes it, empty for pins. `pins_slide`: pins did not rub, so that what
    they pressed slid sideways. `friction`, `friction_sigma`: at the fingers [-], None where
    unknown. `mass`: of the object [kg], 0 where unknown. `down`: the way it falls, in the frame of
    the object.
    """

    name: str
    object_name: str | None
    folder: Path
    label: str = ''
    synthetic: bool = False
    scanner_sigma: float = DEFAULT_SCANNER_SIGMA_M
    object_pose: tuple[float, ...] | None = None
    scans: tuple[ScanEntry, ...] = ()
    caveats: tuple[str, ...] = ()
    finger_body: str = ''
    pins_slide: bool = False
    friction: float | None = None
    friction_sigma: float | None = None
    mass: float = 0.0
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)

    @property
    def object_file(self) -> str | None:
        """The object's name, or the path of the object file beside the recording."""
        if self.object_name is None:
            return None
        beside = self.folder / self.object_name
        return str(beside) if beside.is_file() else self.object_name


def read_experiment(bag: Path) -> Experiment:
    """The description of a bag; a bare one when there is no file. Raises BagError."""
    folder = bag if bag.is_dir() else bag.parent
    path = folder / FILE_NAME
    if not path.is_file():
        return Experiment(bag.stem, None, folder)
    try:
        document = bounded_yaml.read(path)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BagError(f'{path} cannot be read ({str(error).splitlines()[0]})') from error
    if not isinstance(document, dict):
        raise BagError(f'{path} is no table of keys and values')
    reader = _Reader(path)
    start = reader.number(document, 'start_ns', 0)
    scanner = document.get('scanner') or {}
    sigma = reader.number(scanner, 'noise_sigma_m', DEFAULT_SCANNER_SIGMA_M)
    if not 0.0 < sigma < 0.1:
        raise BagError(f'{path}: scanner.noise_sigma_m is {sigma}; it is in metres, above 0')
    return Experiment(
        name=str(document.get('name', folder.name)),
        object_name=None if document.get('object') is None else str(document['object']),
        folder=folder,
        label=str(document.get('label', '')),
        synthetic=bool(document.get('synthetic', True)),
        scanner_sigma=float(sigma),
        object_pose=reader.pose(document, 'the recording'),
        scans=tuple(reader.scan(entry, int(start)) for entry in document.get('scans') or ()),
        caveats=tuple(str(item) for item in document.get('caveats') or ()),
        finger_body=str(document.get('finger_body') or ''),
        pins_slide=reader.choice(document, 'pins_slide'),
        friction=reader.within(document, 'friction', 10.0),
        friction_sigma=reader.within(document, 'friction_sigma', 10.0),
        mass=reader.within(document, 'mass_kg', 1000.0) or 0.0,
        down=reader.direction(document, 'down', (0.0, 0.0, -1.0)),
    )


class _Reader:
    """Takes values out of the document and names the place when they are wrong."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def number(self, table: Any, key: str, default: float) -> float:
        value = table.get(key, default) if isinstance(table, dict) else default
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BagError(f'{self.path}: {key} is {value!r}, not a number')
        if not math.isfinite(value):
            raise BagError(f'{self.path}: {key} is {value}, not finite')
        return value

    def choice(self, table: dict[str, Any], key: str) -> bool:
        """True or false; false where nothing is said."""
        value = table.get(key, False)
        if not isinstance(value, bool):
            raise BagError(f'{self.path}: {key} is {value!r}, neither true nor false')
        return value

    def within(self, table: dict[str, Any], key: str, most: float) -> float | None:
        """A number from 0 to `most`, or None where there is none."""
        if table.get(key) is None:
            return None
        value = float(self.number(table, key, 0.0))
        if not 0.0 <= value <= most:
            raise BagError(f'{self.path}: {key} is {value}; it lies between 0 and {most:g}')
        return value

    def direction(
        self, table: dict[str, Any], key: str, otherwise: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Three numbers that are not all zero."""
        value = table.get(key)
        if value is None:
            return otherwise
        if not isinstance(value, list) or len(value) != 3:
            raise BagError(f'{self.path}: {key} is {value!r}, not x y z')
        x, y, z = (float(self.number({key: one}, key, 0.0)) for one in value)
        if not math.hypot(x, y, z) > 0.0:
            raise BagError(f'{self.path}: {key} is {value}; a direction is not all zero')
        return x, y, z

    def pose(self, table: dict[str, Any], where: str) -> tuple[float, ...] | None:
        value = table.get('object_pose')
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != 7:
            raise BagError(
                f'{self.path}: object_pose of {where} is {value!r}, not x y z qx qy qz qw'
            )
        return tuple(float(self.number({'object_pose': v}, 'object_pose', 0.0)) for v in value)

    def scan(self, entry: Any, start: int) -> ScanEntry:
        if not isinstance(entry, dict) or 'scan_stamp_ns' not in entry:
            raise BagError(f'{self.path}: a scan without scan_stamp_ns: {entry!r}')
        hold = entry.get('hold')
        window = None
        published = None
        if isinstance(hold, dict):
            window = (
                start + round(self.number(hold, 'from_s', 0.0) * 1e9),
                start + round(self.number(hold, 'to_s', 0.0) * 1e9),
            )
            published = hold.get('published_row')
        stamp = int(self.number(entry, 'scan_stamp_ns', 0))
        return ScanEntry(
            stamp=stamp,
            held=entry.get('kind') != 'undeformed',
            window=window,
            object_pose=self.pose(entry, f'the scan at {stamp}'),
            published_row=None if published is None else int(published),
        )


def published_source(path: Path, object_name: str) -> dict[str, str]:
    """Authors, year, title, place of a published table, and the modulus it prints for an object.

    As its file says. Raises BagError.
    """
    try:
        document = bounded_yaml.read(path)
        source = {str(key): str(value) for key, value in document.get('source', {}).items()}
        young = (document.get(object_name) or {}).get('young_modulus_pa')
        printed = {} if young is None else {'modulus': f'E {float(young) / 1e6:g} MPa as printed'}
        return {**source, **printed}
    except (
        OSError,
        UnicodeDecodeError,
        yaml.YAMLError,
        AttributeError,
        TypeError,
        ValueError,
    ) as error:
        raise BagError(f'{path}: the published table cannot be read ({error})') from error


def read_published(path: Path, object_name: str) -> list[dict[str, float]]:
    """The rows of a published table for one object; empty without them. Raises BagError."""
    try:
        document = bounded_yaml.read(path)
        return [
            {key: value for key, value in row.items() if key != 'object'}
            for row in document['rows']
            if row['object'] == object_name
        ]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise BagError(f'{path}: the published table cannot be read ({error})') from error
