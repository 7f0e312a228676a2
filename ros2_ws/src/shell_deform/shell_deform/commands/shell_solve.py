# SPDX-License-Identifier: Apache-2.0
"""shell_solve: squeeze one object by force or displacement; JSON, mesh and picture out."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_common.command_line import parse
from grasp_common.terminal import complain, fixed, print_table, significant, tracked
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.commands.console import CommandError, print_json, run
from shell_deform.commands.shell_solve_options import build_parser
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject, load_object
from shell_deform.picture import surface_figure
from shell_deform.readout import read_out
from shell_deform.solve.equilibrium import Equilibrium, displaced, forced
from shell_deform.solve.first_touch import first_touch
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions
from shell_deform.squeeze import warnings_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Solved:
    """One load case: its state, the contacts' mean depth from first touch [m], its time [s]."""

    state: Equilibrium
    depth: float
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = parse('shell_deform', build_parser(), arguments)
    return run('shell_solve', lambda: _solve(options))


def _solve(options: argparse.Namespace) -> None:
    loaded = time.perf_counter(), time.process_time()
    shell_object = with_material(
        load_object(options.object),
        options.young,
        options.poisson,
        options.thickness,
        options.gas,
    )
    model = build_model(
        shell_object, options.theory, options.vertices, refine_radius=options.pin_radius
    )
    contacts = object_contacts(shell_object, model, options.pin_radius)
    solver = EquilibriumSolver(model, NewtonOptions(stability=True))
    by_force = options.force is not None
    values = options.force if by_force else options.displacement_sweep
    results: list[Solved] = []
    (state, touch), ended = first_touch(solver, contacts), ''
    for value in tracked(values, 'load cases'):
        start = time.perf_counter()
        wanted = [value] * len(contacts)
        case = forced(contacts, wanted) if by_force else displaced(contacts, touch + wanted)
        found = solver.solve(case, state)
        if not found.converged:
            unit = 'N' if by_force else 'm'
            ended = f'{shell_object.name}: no equilibrium at {value:g} {unit}: {found.message}'
            ended += '; use a displacement sweep' if by_force else '; use smaller steps'
            break
        state = found
        depth = float(np.mean(state.displacement - touch))
        results.append(Solved(state, depth, time.perf_counter() - start))
    cpu = time.process_time() - loaded[1]
    model = solver.model
    readout = read_out(model, state.unknowns, shell_object.yield_stress_pa)
    for warning in warnings_of(model, state, readout):
        complain('shell_solve', f'note: {warning}')
    if options.mesh:
        _write_mesh(options.mesh, model, state)
    if options.picture:
        _draw(options.picture, shell_object, model, state)
    if options.json:
        print_json(
            {
                'object': shell_object.name,
                'theory': model.theory,
                'vertices': len(model.rest),
                'cpu_seconds': cpu,
                'points': [_point(solved) for solved in results],
                'message': ended,
            }
        )
    elif results or not ended:
        _print_table(shell_object, model.theory, len(model.rest), cpu, results)
    if ended:
        # What converged has been printed, drawn and written: the end comes last.
        raise CommandError(ended)


def _point(solved: Solved) -> dict[str, Any]:
    state = solved.state
    return {
        'displacement_m': solved.depth,
        'force_n': float(np.mean(state.force)),
        'energy_j': state.energy,
        'gas_pressure_pa': state.gas_pressure,
        'iterations': state.iterations,
        'seconds': solved.seconds,
        'stable': state.stable is not False,
        'end': state.end.value,
    }


def _write_mesh(path: Path, model: ShellModel, state: Equilibrium) -> None:
    import trimesh

    mesh = model.shell.mesh
    points = model.surface.limit_positions(state.positions)
    trimesh.Trimesh(points, mesh.triangles[mesh.active], process=False).export(path)


def _draw(path: Path, shell_object: ShellObject, model: ShellModel, state: Equilibrium) -> None:
    mesh = model.shell.mesh
    points = model.surface.limit_positions(state.positions)
    moved = points - model.surface.limit_positions(model.rest)
    title = (
        f'{shell_object.name}: {np.mean(state.force):.3g} N per contact, '
        f'{1e3 * np.max(state.displacement):.3g} mm'
    )
    figure = surface_figure(points, mesh.triangles[mesh.active], moved, title)
    figure.savefig(path, bbox_inches='tight')


def _print_table(
    shell_object: ShellObject, theory: str, vertices: int, cpu: float, results: list[Solved]
) -> None:
    points = [_point(solved) for solved in results]
    force = max((abs(point['force_n']) for point in points), default=0.0)
    energy = max((point['energy_j'] for point in points), default=0.0)
    rows = [
        [
            fixed(1e3 * point['displacement_m'], 4),
            significant(point['force_n'], 5, force),
            significant(1e3 * point['energy_j'], 5, 1e3 * energy),
            f'{1e-3 * point["gas_pressure_pa"]:.4g}',
            'yes' if point['stable'] else 'NO',
        ]
        for point in points
    ]
    print_table(
        ('displacement [mm]', 'force [N]', 'energy [mJ]', 'gas [kPa]', 'stable'),
        rows,
        f'{shell_object.name}, {theory} theory, {vertices} control vertices, '
        f'{cpu:.2f} s processor time',
    )
