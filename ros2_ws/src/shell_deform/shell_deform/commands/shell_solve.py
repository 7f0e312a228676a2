# SPDX-License-Identifier: Apache-2.0
"""shell_solve: squeeze, twist, bend or pull one object; JSON, mesh and picture out."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_common.command_line import parse
from grasp_common.terminal import complain, fixed, print_table, significant, tracked
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.commands.console import CommandError, print_json, run
from shell_deform.commands.gripping import GripSweep, grip_sweep
from shell_deform.commands.shell_solve_hold import Held, hold, print_hold, relaxation_of
from shell_deform.commands.shell_solve_options import build_parser
from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.objects import Contact, ShellObject, load_object
from shell_deform.picture import surface_figure
from shell_deform.readout import passes_through_itself, read_out
from shell_deform.solve.equilibrium import Equilibrium, displaced, forced
from shell_deform.solve.first_touch import FirstTouchError, alone, first_touch
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.squeeze import finger_readings, warnings_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Solved:
    """One load case: its state, its time [s], and how far: the contacts' mean depth from first
    touch [m], or the value of a `GripSweep`.
    """

    state: Equilibrium
    depth: float
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = parse('shell_deform', build_parser(), arguments)
    return run('shell_solve', lambda: _solve(options))


def _solve(options: argparse.Namespace) -> None:
    loaded = time.process_time()
    shell_object = with_material(
        load_object(options.object),
        options.young,
        options.poisson,
        options.thickness,
        options.gas,
        options.pressure,
    )
    if options.contact:
        pins = tuple(Contact((x, y, z), radius, 'pin') for x, y, z, radius in options.contact)
        shell_object = replace(shell_object, contacts=pins)
    model = build_model(
        shell_object, options.theory, options.vertices, refine_radius=options.pin_radius
    )
    contacts = object_contacts(shell_object, model, options.pin_radius, options.pins_slide)
    sweep = grip_sweep(options, shell_object.name, model, contacts)
    solver = EquilibriumSolver(model, NewtonOptions(stability=True))
    try:
        if sweep is None:
            state, results, ended, held = _squeezed(options, shell_object, solver, contacts)
        else:
            state, results, ended, held = _gripped(sweep, shell_object, solver, options.hold)
    except FirstTouchError as error:
        raise CommandError(f'{shell_object.name}: {error}') from error
    cpu = time.process_time() - loaded
    model = solver.model.of(state.shell)
    readout = read_out(model, state.unknowns, shell_object.yield_stress_pa)
    slip = sweep and sweep.slip_warning([(solved.depth, solved.state) for solved in results])
    for warning in [*warnings_of(model, state, readout), *([slip] if slip else [])]:
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
                'theory_reason': model.reason,
                'vertices': len(model.rest),
                'cpu_seconds': cpu,
                'points': [
                    {**_point(solved, sweep), **_fingers(shell_object, model, solved.state)}
                    for solved in results
                ],
                **({'hold': [one.row(sweep) for one in held]} if options.hold else {}),
                'message': ended,
            }
        )
    elif results or not ended:
        title = f'{shell_object.name}, {model.theory} theory, {len(model.rest)} control vertices'
        if model.reason:
            complain('shell_solve', f'note: theory {model.theory}: {model.reason}')
        _print_table(f'{title}, {cpu:.2f} s processor time', results, sweep)
        if held:
            print_hold(held, sweep)
    if ended:
        # What converged has been printed, drawn and written: the end comes last.
        raise CommandError(ended)


def _squeezed(
    options: argparse.Namespace,
    shell_object: ShellObject,
    solver: EquilibriumSolver,
    contacts: tuple[ContactPatch, ...],
) -> tuple[Equilibrium, list[Solved], str, list[Held]]:
    """Last state and rows of a squeeze, why it ended early, if it did, and the hold after it."""
    by_force = options.force is not None
    values = options.force if by_force else options.displacement_sweep
    if values is None:
        raise CommandError(
            'say what is to happen: --displacement-sweep or --force at the contacts, or '
            '--twist, --bend, --pull or --turn of the grips'
        )
    if not contacts:
        raise CommandError(
            f'{shell_object.name} has grips and no other contacts; use --twist, --bend, --pull or '
            '--turn'
        )
    law = relaxation_of(shell_object) if options.hold else None
    results: list[Solved] = []
    began, touch = first_touch(solver, contacts)
    state = began
    for value in tracked(values, 'load cases'):
        start = time.perf_counter()
        wanted = [value] * len(contacts)
        case = forced(contacts, wanted) if by_force else displaced(contacts, touch + wanted)
        found = solver.solve(case, state)
        if not found.converged:
            unit = 'N' if by_force else 'm'
            ended = f'{shell_object.name}: no equilibrium at {value:g} {unit}: {found.message}'
            ended += '; use a displacement sweep' if by_force else '; use smaller steps'
            return state, results, ended, []
        at = passes_through_itself(solver.model, found.positions)
        if at is not None:
            unit = 'N' if by_force else 'm'
            return state, results, _collapsed(shell_object, f'{value:g} {unit}', at), []
        state = found
        depth = float(np.mean(state.displacement - touch))
        results.append(Solved(state, depth, time.perf_counter() - start))
    if law is None:
        return state, results, '', []
    held, ended = hold(
        solver, law, [case], began, lambda one: float(np.mean(one.displacement - touch)),
        options.hold,
    )  # fmt: skip
    return held[-1].state if held else state, results, ended, held


def _collapsed(shell_object: ShellObject, said: str, at: Array) -> str:
    """What is said of a state that no wall can take."""
    return (
        f'{shell_object.name}: at {said} the wall passes through itself near '
        f'{np.round(at, 4).tolist()} m: it has collapsed, and its sides are not held apart here; '
        'go less far'
    )


def _gripped(
    sweep: GripSweep, shell_object: ShellObject, solver: EquilibriumSolver, seconds: float | None
) -> tuple[Equilibrium, list[Solved], str, list[Held]]:
    """The same of grips that move and are held for `seconds`; the value of a row is how far."""
    law = relaxation_of(shell_object) if seconds else None
    results: list[Solved] = []
    state = began = alone(solver)
    if sweep.axial is not None:
        state = solver.solve(sweep.case(0.0), began)
        if not state.converged:
            ended = (
                f'{shell_object.name}: no equilibrium under --axial {sweep.axial:g} N, it stands '
                f'about {state.load_fraction * sweep.axial:.3g} N: {state.message}; give less'
            )
            return state, results, ended, []
    for value in tracked(sweep.values, 'poses'):
        start = time.perf_counter()
        found = solver.solve(sweep.case(value), state)
        if not found.converged:
            said = sweep.said(value)
            ended = f'{shell_object.name}: no equilibrium at {said}: {found.message}'
            return state, results, f'{ended}; go there in smaller steps, or less far', []
        try:
            sweep.refuse_torn(found, value)
        except CommandError as error:
            return state, results, f'{shell_object.name}: {error}', []
        at = passes_through_itself(solver.model, found.positions)
        if at is not None:
            return state, results, _collapsed(shell_object, sweep.said(value), at), []
        state = found
        results.append(Solved(state, value, time.perf_counter() - start))
    if law is None or not seconds:
        return state, results, '', []
    cases = [sweep.case(value) for value in sweep.values]
    held, ended = hold(solver, law, cases, began, lambda _: sweep.values[-1], seconds)
    return held[-1].state if held else state, results, ended, held


def _point(solved: Solved, sweep: GripSweep | None) -> dict[str, Any]:
    state = solved.state
    first: dict[str, Any] = {
        'displacement_m': solved.depth,
        'force_n': float(np.mean(state.force)) if len(state.force) else 0.0,
    }
    return {
        **(first if sweep is None else sweep.point(solved.depth, state)),
        'energy_j': state.energy,
        'gas_pressure_pa': state.gas_pressure,
        'iterations': state.iterations,
        'seconds': solved.seconds,
        'stable': state.stable is not False,
        'end': state.end.value,
    }


def _fingers(shell_object: ShellObject, model: ShellModel, state: Equilibrium) -> dict[str, Any]:
    """Contact regions and touch cells of the rigid bodies, where there are any."""
    fingers = [
        {
            'push_n': finger.push,
            'friction_n': finger.friction,
            'area_m2': finger.area,
            'sticking_m2': finger.sticking,
            'cells_n': finger.cells.tolist(),
        }
        for finger in finger_readings(shell_object, model, state)
    ]
    return {'fingers': fingers} if fingers else {}


def _write_mesh(path: Path, model: ShellModel, state: Equilibrium) -> None:
    import trimesh

    mesh = model.shell.mesh
    points = model.surface.limit_positions(state.positions)
    trimesh.Trimesh(points, mesh.triangles[mesh.active], process=False).export(path)


def _draw(path: Path, shell_object: ShellObject, model: ShellModel, state: Equilibrium) -> None:
    mesh = model.shell.mesh
    points = model.surface.limit_positions(state.positions)
    moved = points - model.surface.limit_positions(model.rest)
    title = f'{shell_object.name}, {1e3 * np.linalg.norm(moved, axis=1).max():.3g} mm at most'
    if len(state.force):
        title = (
            f'{shell_object.name}: {np.mean(state.force):.3g} N per contact, '
            f'{1e3 * np.max(state.displacement):.3g} mm'
        )
    figure = surface_figure(points, mesh.triangles[mesh.active], moved, title)
    figure.savefig(path, bbox_inches='tight')


def _print_table(title: str, results: list[Solved], sweep: GripSweep | None) -> None:
    force, torque, energy, gas = 0.0, 0.0, 0.0, 0.0
    for solved in results:
        wrench = solved.state.grip_wrench
        force = max([force, *np.abs(solved.state.force), *np.abs(wrench[:, :3]).ravel()])
        torque = max([torque, *np.abs(wrench[:, 3:]).ravel()])
        energy = max(energy, solved.state.energy)
        gas = max(gas, abs(solved.state.gas_pressure))
    rows = []
    for solved in results:
        state = solved.state
        if sweep is None:
            push = significant(float(np.mean(state.force)), 5, force)
            cells = [fixed(1e3 * solved.depth, 4), push]
        else:
            cells = sweep.row(solved.depth, state, (force, torque))
        rows.append(
            [
                *cells,
                significant(1e3 * state.energy, 5, 1e3 * energy),
                significant(1e-3 * state.gas_pressure, 4, 1e-3 * gas),
                'yes' if state.stable is not False else 'NO',
            ]
        )
    first = ('displacement [mm]', 'force [N]') if sweep is None else sweep.headings
    print_table((*first, 'energy [mJ]', 'gas [kPa]', 'stable'), rows, title)
