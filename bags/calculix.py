# SPDX-License-Identifier: Apache-2.0
"""CalculiX as the independent source of shape truth: run a deck, read back its printed tables.

Only the generator of the recordings needs the solver (`ccx`, Debian package `calculix-ccx`).
Facts on the input and the output format: CalculiX CrunchiX user's manual, version 2.20.
"""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_HEADER = re.compile(r'^\s*(\S[^(]*)\(([^)]*)\) for set (\S+) and time\s+(\S+)')


class CalculixError(RuntimeError):
    """The solver is missing, failed, or did not reach the end of the load history."""


def solver_path() -> str:
    """Path of the `ccx` executable; CalculixError says what to install when there is none."""
    path = shutil.which('ccx')
    if path is None:
        raise CalculixError('ccx is not on PATH: install the Debian package calculix-ccx')
    return path


def solver_version() -> str:
    """The version line of the installed solver, for example `2.20`."""
    run = subprocess.run([solver_path(), '-v'], capture_output=True, text=True, timeout=30)
    found = re.search(r'Version\s+(\S+)', run.stdout)
    return found.group(1) if found else 'unknown'


def node_lines(nodes: Mapping[int, Iterable[float]]) -> str:
    """The data lines of a *NODE card, at the full precision of the reader."""
    return '\n'.join(
        f'{number},' + ','.join(f'{value:.12g}' for value in position)
        for number, position in nodes.items()
    )


def element_lines(elements: NDArray[np.int64], first: int = 1) -> str:
    """The data lines of an *ELEMENT card, at most 16 entries a line as the manual asks."""
    lines: list[str] = []
    for number, nodes in enumerate(elements.tolist(), first):
        entries = [str(number), *map(str, nodes)]
        lines.extend(
            ','.join(entries[start : start + 15]) + (',' if start + 15 < len(entries) else '')
            for start in range(0, len(entries), 15)
        )
    return '\n'.join(lines)


def set_lines(name: str, kind: str, members: Iterable[int]) -> str:
    """A whole *NSET (kind `N`) or *ELSET (kind `EL`) card."""
    numbers = [str(int(member)) for member in members]
    rows = [', '.join(numbers[start : start + 12]) for start in range(0, len(numbers), 12)]
    return f'*{kind}SET,{kind}SET={name}\n' + ',\n'.join(rows)


def neo_hooke(young_modulus: float, poisson_ratio: float) -> str:
    """A *HYPERELASTIC, NEO HOOKE card: C10 = mu / 2 and D1 = 2 / K."""
    shear = young_modulus / (2.0 * (1.0 + poisson_ratio))
    bulk = young_modulus / (3.0 * (1.0 - 2.0 * poisson_ratio))
    return f'*HYPERELASTIC,NEO HOOKE\n{shear / 2.0:.12g},{2.0 / bulk:.12g}'


def mooney_rivlin(young_modulus: float, poisson_ratio: float, share: float) -> str:
    """A *HYPERELASTIC, MOONEY-RIVLIN card: C10 + C01 = mu / 2, of which C01 is `share`."""
    shear = young_modulus / (2.0 * (1.0 + poisson_ratio))
    bulk = young_modulus / (3.0 * (1.0 - 2.0 * poisson_ratio))
    first, second = (1.0 - share) * shear / 2.0, share * shear / 2.0
    return f'*HYPERELASTIC,MOONEY-RIVLIN\n{first:.12g},{second:.12g},{2.0 / bulk:.12g}'


def run(
    deck: str, name: str, timeout: float = 900.0, threads: int = 1, partial: bool = False
) -> dict[float, dict]:
    """Solve a deck and return its printed tables, {time: {(quantity, set): {number: values}}}.

    Raises what `printed` raises.
    """
    return read_tables(printed(deck, name, timeout, threads, partial))


def printed(
    deck: str, name: str, timeout: float = 900.0, threads: int = 1, partial: bool = False
) -> str:
    """Solve a deck and return what it printed.

    Raises CalculixError with the last lines of the solver when it does not finish, unless
    `partial` asks for the steps that converged before it gave up.
    """
    with tempfile.TemporaryDirectory(prefix='ccx_') as folder:
        directory = Path(folder)
        (directory / f'{name}.inp').write_text(deck)
        environment = {**os.environ, 'OMP_NUM_THREADS': str(threads)}
        try:
            solved = subprocess.run(
                ['nice', '-n', '10', solver_path(), '-i', name],
                cwd=directory,
                env=environment,
                capture_output=True,
                text=True,
                timeout=timeout,
            )
        except subprocess.TimeoutExpired as error:
            raise CalculixError(f'{name}: not solved within {timeout:.0f} s') from error
        tail = '\n'.join(solved.stdout.splitlines()[-12:])
        finished = solved.returncode == 0 and 'Job finished' in solved.stdout
        if not finished and not (partial and '*ERROR: increment size' in solved.stdout):
            raise CalculixError(f'{name}: ccx ended with code {solved.returncode}:\n{tail}')
        return (directory / f'{name}.dat').read_text()


def read_tables(text: str) -> dict[float, dict]:
    """Parse the tables that *NODE PRINT and *EL PRINT write into the .dat file."""
    tables: dict[float, dict] = {}
    rows: dict[int, Array] | None = None
    for line in text.splitlines():
        header = _HEADER.match(line)
        if header:
            quantity, _, name, time = header.groups()
            rows = {}
            tables.setdefault(float(time), {})[quantity.strip(), name] = rows
            continue
        fields = line.split()
        if rows is None or not fields:
            continue
        rows[int(fields[0])] = np.array([float(value) for value in fields[1:]])
    return tables


def keep_deck(deck: str, path: Path) -> None:
    """Store a deck gzipped with a fixed time stamp, so that equal decks are equal files."""
    with path.open('wb') as raw, gzip.GzipFile('', 'wb', 9, raw, mtime=0) as packed:
        packed.write(deck.encode())
