# SPDX-License-Identifier: Apache-2.0
"""The grammar of the commands: options that several have are described here, once.

The same name means the same in every command, takes the same kind of value in the same unit, and
begins its help with the same words. `docs/options.md` lists them all; a test holds them to it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

METRES_PER_UNIT = {
    **{'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6},
    **{'inch': 0.0254, 'in': 0.0254, 'ft': 0.3048},
}
"""Length [m] of one of each unit that files come in: for commands, nodes and object files."""

UNIT_NAMES = tuple(METRES_PER_UNIT)

UNITS_OF_VALUES = {
    'M': '[m]', 'PA': '[Pa]', 'N': '[N]', 'N,N,…': '[N]', 'S': '[s]', 'MS': '[ms]', 'HZ': '[Hz]',
    'KG': '[kg]', 'DEGREES': '[degrees]', 'NU': '[-]', 'SHARE': '[-]', 'POSE': '[m]',
}  # fmt: skip
"""What a value is called in a usage text, and the unit that its help then names."""


@dataclass(frozen=True)
class Option:
    """What all commands say of an option: its value (None: of its choices, or a switch), its help.

    names: further spellings, mostly the key of object files that the option overrides.
    """

    meaning: str
    value: str | None = None
    names: tuple[str, ...] = ()
    fixed: tuple[tuple[str, Any], ...] = ()


_SWITCH = (('action', 'store_true'),)
_FILE = (('type', Path),)
_UNIT = (('choices', UNIT_NAMES),)

SHARED = {
    '--object': Option('name or object file; see shell_objects', 'NAME|FILE'),
    '--out': Option('where the files go', 'DIR', fixed=_FILE),
    '--json': Option('one JSON document on stdout', fixed=_SWITCH),
    '--plot': Option('plot (PNG)', 'FILE', fixed=_FILE),
    '--theory': Option('theory of the wall'),
    '--vertices': Option('control vertices, about', 'COUNT'),
    '--young': Option("Young's modulus [Pa]", 'PA', ('--young-modulus-pa',)),
    '--poisson': Option("Poisson's ratio [-], above -1, up to 0.5", 'NU', ('--poisson-ratio',)),
    '--thickness': Option('wall thickness [m]', 'M', ('--thickness-m',)),
    '--gas': Option('what fills the object'),
    '--force': Option('push of each contact [N]', 'N'),
    '--contact': Option('a pin on the outer face [m]', 'X,Y,Z[,RADIUS]'),
    '--pin-radius': Option('radius of the contacts [m]', 'M'),
    '--unit': Option('unit of the scan', fixed=_UNIT),
    '--scan-unit': Option('unit of the scans', fixed=_UNIT),
    '--scanner-sigma': Option('noise of a scan point along the normal [m]', 'M'),
    '--hand': Option('which hand'),
    '--seed': Option('of the random numbers', 'SEED'),
    '--processes': Option('tasks at once', 'COUNT'),
    '--scheduler': Option('Dask scheduler, for example tcp://host:8786', 'ADDRESS'),
    '--regex': Option('topics whose whole name matches', 'REGEX'),
    '--exclude-regex': Option('but not topics whose whole name matches', 'REGEX'),
    '--exclude-topics': Option('but not these', 'TOPIC', fixed=(('nargs', '+'),)),
}


def add(
    parser: Any, name: str, more: str = '', *, short: tuple[str, ...] = (), **given: Any
) -> argparse.Action:
    """Add a shared option to a parser or a group; `more` goes on after what all commands say."""
    option = SHARED[name]
    words = {**dict(option.fixed), **given}
    if option.value is not None:
        words.setdefault('metavar', option.value)
    added: argparse.Action = parser.add_argument(
        *short,
        name,
        *option.names,
        dest=name[2:].replace('-', '_'),
        help=option.meaning + more,
        **words,
    )
    return added
