# SPDX-License-Identifier: Apache-2.0
"""The shell solver: accuracy and processor time beside Kratos, MuJoCo and CalculiX.

`python tests/benchmarks/solver.py`. Kratos and MuJoCo run from the environment of `make bench-
peers`, or where the interpreter named by PEER_PYTHON has them. Kratos' corotational triangles use
engineering strain, so they are held against the independent solution of that measure (Reissner)
and ours against Koiter's: same pin, same traction, same 24 steps. MuJoCo's shell and CalculiX's
solid are held against Koiter. `--picture FILE` draws accuracy against unknowns and processor
time; `--large` adds 10 242 vertices and Kratos on the whole ball.
"""

from __future__ import annotations

import os

for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(variable, '1')

import argparse  # noqa: E402
import json  # noqa: E402
import resource  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Iterator  # noqa: E402
from dataclasses import dataclass, replace  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

sys.path[:0] = [str(Path(__file__).parent / 'peers'), str(Path(__file__).parents[2])]

import numpy as np  # noqa: E402
import trimesh  # noqa: E402
from bags import axisymmetric, calculix  # noqa: E402
from ball_mesh import octant  # noqa: E402
from figures import show  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.interpolate import CubicSpline  # noqa: E402

from shell_deform.assemble.discretisation import discretise  # noqa: E402
from shell_deform.building import build_model, object_contacts  # noqa: E402
from shell_deform.contact.loads import ContactPatch  # noqa: E402
from shell_deform.model import ShellModel  # noqa: E402
from shell_deform.objects.targets import SphereTarget  # noqa: E402
from shell_deform.solve.equilibrium import LoadCase, displaced  # noqa: E402
from shell_deform.solve.newton import EquilibriumSolver  # noqa: E402
from shell_deform.solve.step_system import NewtonOptions  # noqa: E402
from shell_deform.supports import joined, symmetry  # noqa: E402
from shell_deform.surface.control_mesh import control_mesh  # noqa: E402
from shell_deform.surface.fit import fit_limit_surface, interpolating  # noqa: E402
from shell_deform.surface.loop_basis import basis_rows  # noqa: E402
from shell_deform.surface.outer_ring import with_outer_ring  # noqa: E402
from shell_deform.theory.material import Material  # noqa: E402
from shell_deform.verification.paper_setup import compare  # noqa: E402
from shell_deform.verification.problem import references  # noqa: E402
from shell_deform.verification.spheres import PIN_RADIUS, pinched_sphere  # noqa: E402

Array = NDArray[np.float64]
Row = tuple[str, str, str]

ROOT = Path(__file__).parents[2]
PEERS = Path(__file__).parent / 'peers'
STEPS = np.linspace(0.5, 12.0, 24)
OCTANT_EDGE = 16
NEWTON_GOALS = {642: 30, 2562: 180, 10242: 1000}


@dataclass(frozen=True)
class Curve:
    """One force-displacement curve: largest force error [-], unknowns, processor time [s].

    `from_koiter`: largest difference from Koiter's forces, for a peer of another strain measure.
    """

    name: str
    error: float
    unknowns: int
    cpu_seconds: float
    from_koiter: float = np.nan


def reference(case: str) -> CubicSpline:
    """Force [N] over displacement [mm], E 1 MPa."""
    table = np.array(references()['mission_sphere']['cases'][case]['data'])
    return CubicSpline(np.r_[0.0, table[:, 0]], np.r_[0.0, table[:, 2]])


def our_curve(vertices: int) -> Curve:
    """The whole ball, 0 to 12 mm in 24 steps, mesh building included."""
    start = time.process_time()
    ball = pinched_sphere(31.25e-3, 2.5e-3, 1e6, 0.49, PIN_RADIUS, vertices)
    model = build_model(ball)
    contacts = object_contacts(ball, model)
    states = EquilibriumSolver(model).sweep([displaced(contacts, [w * 1e-3] * 2) for w in STEPS])
    seconds = time.process_time() - start
    forces = np.array([state.force[0] for state in states])
    error = np.abs(forces / reference('koiter_disc2_nu0.49')(STEPS) - 1.0).max()
    return Curve('whole ball, ours', float(error), 3 * len(model.rest), seconds)


def our_octant(edge: int) -> Curve:
    """An octant on Kratos' own triangles, symmetry on its three planes, 24 steps."""
    start = time.process_time()
    points, triangles = octant(edge)
    points = 1e-3 * points
    target = SphereTarget(31.25e-3)
    inner = control_mesh(points, triangles, corners=[])
    mesh = fit_limit_surface(with_outer_ring(interpolating(inner)), target, 3)
    shell = discretise(mesh, Material(1e6, 0.49), 2.5e-3)
    planes = []
    for axis in range(3):
        on_plane = np.flatnonzero(np.abs(points[:, axis]) < 1e-9)
        planes += symmetry(shell, on_plane, np.eye(3)[axis])
    model = ShellModel(shell, supports=joined(planes))
    pin = (quarter_pin(model),)
    cases = [LoadCase(pin, np.array([np.nan]), np.array([1e-3 * w]), held=False) for w in STEPS]
    states = EquilibriumSolver(model).sweep(cases)
    seconds = time.process_time() - start
    forces = 4.0 * np.array([state.force[0] for state in states])
    error = np.abs(forces / reference('koiter_disc2_nu0.49')(STEPS) - 1.0).max()
    return Curve("octant, ours on Kratos' triangles", float(error), 3 * len(model.rest), seconds)


def quarter_pin(model: ShellModel) -> ContactPatch:
    """The pin at the pole of an octant: all of its disc, mirrored into the octant."""
    nodes, gauss = np.polynomial.legendre.leggauss(8)
    arc = PIN_RADIUS * np.sqrt(0.5 * (nodes + 1.0)) / 31.25e-3
    turn = 0.5 * np.pi * (np.arange(12) + 0.5) / 12
    down, around = (grid.ravel() for grid in np.meshgrid(arc, turn, indexing='ij'))
    disc = 31.25e-3 * np.column_stack(
        [np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)]
    )
    pole = np.array([[0.0, 0.0, 31.25e-3]])
    weights = []
    for places, share in ((disc, np.repeat(0.5 * gauss / 12, 12)), (pole, np.ones(1))):
        found = model.surface.closest_point(model.rest, places)
        there = basis_rows(model.shell.mesh, found.triangle, found.parameters)
        row = np.repeat(np.arange(len(share)), np.diff(there.node_offsets))
        values = np.zeros(len(model.rest))
        np.add.at(values, there.nodes, share[row] * there.values)
        weights.append(values)
    return ContactPatch(
        pole[0], np.array([0.0, 0.0, -1.0]), PIN_RADIUS, weights[1], weights[0],
        np.zeros_like(model.rest), 1.0,
    )  # fmt: skip


def peer_answer(script: str, arguments: list[int], forces: Array) -> dict[str, Any] | None:
    """What a peer prints for these forces [N]; None where it is not installed."""
    own = ROOT / '.venv-bench/bin/python'
    python = os.environ.get('PEER_PYTHON', str(own) if own.exists() else sys.executable)
    answer = subprocess.run(
        [python, str(PEERS / script), *map(str, arguments)],
        input=json.dumps(forces.tolist()), capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = [line for line in answer.stdout.splitlines() if line.startswith('{"depth_mm"')]
    return json.loads(lines[0]) if lines else None


def mujoco_curve(edge: int) -> Curve | None:
    """MuJoCo's flexible shell, the whole ball; None where it is not installed."""
    koiter = reference('koiter_disc2_nu0.49')
    result = peer_answer('mujoco_ball.py', [edge], koiter(STEPS))
    if result is None:
        return None
    depth = np.array(result['depth_mm'])
    inside = depth <= STEPS[-1]
    error = float(np.abs(koiter(STEPS)[inside] / koiter(depth[inside]) - 1.0).max())
    name = 'whole ball, MuJoCo flexible shell'
    return Curve(name, error, result['unknowns'], result['cpu_seconds'], error)


def kratos_curve(edge: int, whole: bool) -> Curve | None:
    """Kratos under the forces of the independent solution; None where it is not installed."""
    own = reference('reissner_disc2_nu0.5')
    softer = reference('koiter_disc2_nu0.49')(STEPS) / reference('koiter_disc2_nu0.5')(STEPS)
    measure = CubicSpline(np.r_[0.0, STEPS], np.r_[0.0, own(STEPS) * softer])
    result = peer_answer('kratos_octant.py', [edge, int(whole)], measure(STEPS))
    if result is None:
        return None
    error = np.abs(measure(STEPS) / measure(np.array(result['depth_mm'])) - 1.0).max()
    name = f'{"whole ball" if whole else "octant"}, Kratos thin corotational triangles'
    depth = np.array(result['depth_mm'])
    koiter = reference('koiter_disc2_nu0.49')(depth)
    return Curve(
        name,
        float(error),
        result['unknowns'],
        result['cpu_seconds'],
        float(np.abs(measure(STEPS) / koiter - 1.0)[STEPS >= 1.0].max()),
    )


def calculix_curve() -> Curve | None:
    """The ball as an axisymmetric solid by CalculiX, 24 load steps; None where it is missing."""
    try:
        calculix.solver_path()
    except calculix.CalculixError:
        return None
    koiter = reference('koiter_disc2_nu0.49')
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ball = axisymmetric.Ball(pin='traction', pin_radius=2.0, young_modulus=1.0)
    solved = axisymmetric.solve(ball, 0.96 * koiter(STEPS), np.zeros(len(STEPS)))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    depth = solved.middle_displacement()
    apart = np.abs(0.96 * koiter(STEPS) / koiter(depth) - 1.0)[depth >= 1.0].max()
    unknowns = 2 * len(solved.mesh.positions)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    name = 'axisymmetric solid, CalculiX'
    return Curve(name, float(apart), unknowns, seconds, float(apart))


def newton_step(subdivisions: int) -> tuple[int, float, float]:
    """Vertices, milliseconds (best of 5) of tangent with two threads, factorisation, solve."""
    mesh = trimesh.creation.icosphere(subdivisions)
    shell = discretise(
        control_mesh(31.25e-3 * mesh.vertices, mesh.faces), Material(1e6, 0.5), 2.5e-3
    )
    model = ShellModel(replace(shell, threads=2))
    top = np.array([0.0, 0.0, 1.0])
    pins = (model.contact(top, PIN_RADIUS), model.contact(-top, PIN_RADIUS))
    solver = EquilibriumSolver(model, NewtonOptions())
    state = solver.solve(displaced(pins, [1e-3, 1e-3]))
    times = []
    for _ in range(5):
        start = time.perf_counter(), time.process_time()
        solver.tangent_columns(displaced(pins, [1e-3, 1e-3]), state)
        times.append([time.perf_counter() - start[0], time.process_time() - start[1]])
    wall, processor = 1e3 * np.min(times, axis=0)
    return len(mesh.vertices), float(wall), float(processor)


def said(curve: Curve) -> str:
    """Processor time and error of a curve."""
    return f'{curve.cpu_seconds:.2f} s, {100 * curve.error:.2f} %'


def rows(large: bool) -> Iterator[Row]:
    """What was measured, its value, and its goal."""
    our_curve(650)
    ours = our_curve(650)
    yield (('ball 0-12 mm, 24 steps, CPU s', f'{ours.cpu_seconds:.2f}', '3'))
    yield (('its largest force error, Koiter', f'{100 * ours.error:.2f} %', '0.5 %'))
    eighth = our_octant(OCTANT_EDGE)
    yield ((f'{eighth.name}, {eighth.unknowns} unknowns', said(eighth), '0.5 %'))
    for edge in (OCTANT_EDGE, 24, 36):
        peer = kratos_curve(edge, False)
        if peer is None:
            yield (('Kratos', 'not installed: requirements/bench.txt', ''))
            break
        yield ((f'{peer.name}, {peer.unknowns} unknowns', said(peer), 'information'))
        ratio = f'{peer.cpu_seconds / eighth.cpu_seconds:.1f}'
        yield (('  octant against octant, CPU ratio', ratio, '3'))
        yield (
            ('  its force from Koiter, 1-12 mm', f'{100 * peer.from_koiter:.2f} %', 'see below')
        )
    own, koiter = reference('reissner_disc2_nu0.5'), reference('koiter_disc2_nu0.5')
    apart = 100 * (own([4.0, 8.0, 12.0]) / koiter([4.0, 8.0, 12.0]) - 1.0)
    yield (
        ("Reissner's measure (Kratos' own) over Koiter, 4, 8, 12 mm",
         ', '.join(f'{value:+.2f} %' for value in apart), 'why no 1 %')
    )  # fmt: skip
    mujoco = mujoco_curve(12)
    if mujoco is None:
        yield ('MuJoCo', 'not installed: requirements/bench.txt', '')
    else:
        yield (f'{mujoco.name}, {mujoco.unknowns} unknowns', said(mujoco), 'information')
        ratio = f'{mujoco.cpu_seconds / ours.cpu_seconds:.1f}'
        yield ('  whole ball against whole ball, CPU ratio', ratio, 'information')
    solid = calculix_curve()
    if solid is None:
        yield (('CalculiX', 'not installed: Debian package calculix-ccx', ''))
    else:
        yield ((f'{solid.name}, {solid.unknowns} unknowns', said(solid), 'information'))
    if large:
        peer = kratos_curve(24, True)
        if peer is not None:
            ratio = peer.cpu_seconds / ours.cpu_seconds
            yield ((peer.name, f'{peer.cpu_seconds:.1f} s, {100 * peer.error:.2f} %', ''))
            yield (('whole ball against whole ball, CPU ratio', f'{ratio:.1f}', '10'))
    for subdivisions in (3, 4, 5) if large else (3, 4):
        vertices, wall, processor = newton_step(subdivisions)
        yield (
            (
                f'Newton step at {vertices} vertices, ms wall (CPU)',
                f'{wall:.0f} ({processor:.0f})',
                str(NEWTON_GOALS[vertices]),
            )
        )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    yield (('peak memory, MiB', f'{peak:.0f}', 'reported'))
    for row in compare(0.5):
        yield (
            (
                f'{row.setup}, {row.method}, 0.5 N: depth mm',
                f'{1e3 * row.depth:.4f} in {row.cpu_seconds:.2f} s',
                'comparison',
            )
        )


def draw(path: Path) -> None:
    """Accuracy against unknowns and against processor time."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullFormatter

    our_curve(200)
    families = {
        'Loop Kirchhoff-Love, whole ball': [our_curve(n) for n in (200, 320, 650, 1300)],
        'Loop Kirchhoff-Love, octant': [our_octant(edge) for edge in (8, 12, 16, 24)],
    }
    peers = [kratos_curve(edge, False) for edge in (8, 12, 24, 36)]
    families['Kratos thin corotational triangles, octant'] = [p for p in peers if p is not None]
    flexible = [mujoco_curve(edge) for edge in (5, 8, 12)]
    families['MuJoCo flexible shell, whole ball'] = [p for p in flexible if p is not None]
    solid = calculix_curve()
    families['CalculiX axisymmetric solid, difference from Koiter'] = [solid] if solid else []
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.8), sharey=True, layout='constrained')
    for name, curves in families.items():
        if not curves:
            continue
        error = [100 * curve.error for curve in curves]
        axes[0].loglog([curve.unknowns for curve in curves], error, 'o-', label=name)
        axes[1].loglog([curve.cpu_seconds for curve in curves], error, 'o-', label=name)
    axes[0].set(xlabel='unknowns', ylabel='largest force error, 0.5-12 mm [%]')
    axes[1].set(xlabel='processor time for 24 steps [s]')
    for axis in axes:
        axis.grid(which='both', alpha=0.3)
        axis.xaxis.set_minor_formatter(NullFormatter())
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside lower center', ncols=2)
    figure.suptitle('Pinched ball against the independent solution of the same strain measure')
    figure.savefig(path, dpi=130)


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='The shell solver beside its peers.')
    parser.add_argument('--large', action='store_true', help='10 242 vertices, whole-ball Kratos')
    parser.add_argument('--picture', type=Path, metavar='FILE', help='draw accuracy (PNG)')
    options = parser.parse_args(arguments)
    show(rows(options.large))
    if options.picture:
        draw(options.picture)


if __name__ == '__main__':
    main()
