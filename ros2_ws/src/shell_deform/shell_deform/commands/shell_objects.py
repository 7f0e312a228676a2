# SPDX-License-Identifier: Apache-2.0
"""`shell_objects`: the known objects and their numbers."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from grasp_common.command_line import parse
from grasp_common.terminal import complain, print_table
from shell_deform.commands.shell_objects_options import RENAMED, build_parser
from shell_deform.objects import (
    ObjectError,
    ShellObject,
    load_object,
    object_fit_report,
    object_mesh,
    object_names,
)
from shell_deform.objects.loader import shipped_text
from shell_deform.objects.reference import schema
from shell_deform.theory.relaxation import Relaxation


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the shipped objects, or the given ones; 0 done, 1 an object cannot be read."""
    options = parse('shell_deform', build_parser(), arguments, RENAMED)
    try:
        if options.schema:
            json.dump(schema(), sys.stdout, indent=2)
            print()
            return 0
        if options.copy is not None:
            return _copied(options.copy, options.out, options.json)
        shells = [load_object(name) for name in options.objects or object_names()]
        described = [_described(shell, options.mesh_fit) for shell in shells]
    except ObjectError as error:
        complain('shell_objects', error)
        return 1
    if options.json:
        json.dump({'objects': described}, sys.stdout, indent=2)
        print()
    else:
        _print_table(shells, described)
    return 0


def _copied(name: str, folder: Path, as_json: bool) -> int:
    """Copy a shipped object file, never over another; raises ObjectError."""
    target = folder / f'{name}.yaml'
    text = shipped_text(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with target.open('x', encoding='utf-8') as stream:
            stream.write(text)
    except FileExistsError:
        raise ObjectError(f'{target} is there already; give another folder with --out') from None
    except OSError as error:
        raise ObjectError(f'{target} cannot be written: {error.strerror}') from error
    if as_json:
        print(json.dumps({'file': str(target)}))
    else:
        print(target)
    return 0


def _described(shell: ShellObject, with_mesh: bool) -> dict[str, Any]:
    surface = {
        key: str(value) if isinstance(value, Path) else value
        for key, value in vars(shell.surface).items()
    }
    result: dict[str, Any] = {
        'name': shell.name,
        'surface': {shell.surface.kind: surface},
        'thickness_m': shell.thickness_m,
        'young_modulus_pa': shell.young_modulus_pa,
        'poisson_ratio': shell.poisson_ratio,
        'yield_stress_pa': shell.yield_stress_pa,
        'gas': asdict(shell.gas),
        'supports': [asdict(support) for support in shell.supports],
        'contacts': [asdict(contact) for contact in shell.contacts],
        'grips': [asdict(grip) for grip in shell.grips],
        'pressure_pa': shell.pressure_pa,
        'control_vertices': shell.control_vertices,
        'source': shell.source,
    }
    if shell.solid_young_modulus_pa is not None:
        result['solid_young_modulus_pa'] = shell.solid_young_modulus_pa
    if shell.vertex_thickness_m is not None:
        result['vertex_thickness_m'] = shell.vertex_thickness_m.tolist()
    if shell.relaxation is not None:
        result['relaxation'] = _relaxation(shell.relaxation)
    if with_mesh:
        result['mesh'] = asdict(object_fit_report(shell, object_mesh(shell)))
    return result


def _print_table(shells: Sequence[ShellObject], described: Sequence[dict]) -> None:
    headings = ['name', 'surface [mm]', 'h [mm]', 'E [MPa]', 'nu', 'gas', 'held', 'touched [mm]']
    rows = [
        [
            shell.name,
            _shape(shell),
            f'{1e3 * shell.thickness_m:g}',
            f'{1e-6 * shell.young_modulus_pa:g}',
            f'{shell.poisson_ratio:g}',
            _gas(shell),
            ', '.join(
                [
                    *(f'{support.where} {support.kind}' for support in shell.supports),
                    *(f'{grip.name} gripped' for grip in shell.grips),
                ]
            )
            or '-',
            ', '.join(f'{c.kind} r {1e3 * c.radius_m:g}' for c in shell.contacts) or '-',
        ]
        for shell in shells
    ]
    meshes = [description['mesh'] for description in described if 'mesh' in description]
    if meshes:
        headings.append('control mesh')
    for row, mesh in zip(rows, meshes, strict=False):
        row.append(
            f'{mesh["vertices"]} vertices, edges {1e3 * mesh["shortest_edge_m"]:.2f} to '
            f'{1e3 * mesh["longest_edge_m"]:.2f} mm, fit {1e6 * mesh["rms_error_m"]:.2g} um '
            f'rms, {1e6 * mesh["maximum_error_m"]:.2g} um at most'
        )
    print_table(headings, rows, 'Thin shells')


def _shape(shell: ShellObject) -> str:
    parts = []
    for key, value in vars(shell.surface).items():
        if isinstance(value, str | Path):
            parts.append(str(value))
        elif isinstance(value, float):
            parts.append(f'{key.removesuffix("_m").replace("_", " ")} {1e3 * value:g}')
        elif np.ndim(value) == 1:
            sizes = ' x '.join(f'{1e3 * size:g}' for size in value)
            parts.append(f'{key.removesuffix("_m").replace("_", " ")} {sizes}')
        else:
            parts.append(f'profile of {len(value)} points')
    return f'{shell.surface.kind.replace("_", " ")}: {", ".join(parts)}'


def _relaxation(law: Relaxation) -> dict[str, Any]:
    """The law as an object file states it."""
    if law.per_decade is not None:
        return {
            'kind': 'log', 'share_per_decade': law.per_decade, 'from_s': law.first,
            'to_s': law.last, 'reference_s': law.reference, 'sigma_per_decade': law.sigma,
        }  # fmt: skip
    at_once = float(law(0.0))
    return {
        'kind': 'prony', 'shares': (law.shares / at_once).tolist(),
        'times_s': law.times.tolist(), 'reference_s': law.reference, 'to_s': law.last,
    }  # fmt: skip


def _gas(shell: ShellObject) -> str:
    if shell.gas.kind != 'sealed':
        return shell.gas.kind
    return f'sealed, {1e-5 * shell.gas.gauge_pressure_pa:g} bar gauge'


if __name__ == '__main__':
    sys.exit(main())
