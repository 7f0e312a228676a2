"""The shell solver: accuracy and processor time beside Kratos.

`python tests/benchmarks/solver.py`. Kratos runs where the interpreter named by PEER_PYTHON (or
this one) has it; see requirements/bench.txt. Its corotational triangles use engineering strain, so
they are held against the independent solution of that measure (Reissner), ours against Koiter's:
same pin, same traction, same 24 steps. `--picture FILE` draws accuracy against unknowns and
processor time; `--large` adds 10 242 vertices and Kratos on the whole ball.
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
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
import trimesh  # noqa: E402
from scipy.interpolate import CubicSpline  # noqa: E402

from shell_deform.assemble import discretise  # noqa: E402
from shell_deform.building import build_model, object_contacts  # noqa: E402
from shell_deform.model import ShellModel  # noqa: E402
from shell_deform.solve.equilibrium import displaced  # noqa: E402
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions  # noqa: E402
from shell_deform.surface.control_mesh import control_mesh  # noqa: E402
from shell_deform.theory.material import Material  # noqa: E402
from shell_deform.verification.paper_setup import compare  # noqa: E402
from shell_deform.verification.problem import references  # noqa: E402
from shell_deform.verification.spheres import PIN_RADIUS, pinched_sphere  # noqa: E402

Row = tuple[str, str, str]

PEER = Path(__file__).parent / 'peers' / 'kratos_octant.py'
STEPS = np.linspace(0.5, 12.0, 24)
NEWTON_GOALS = {642: 30, 2562: 180, 10242: 1000}


@dataclass(frozen=True)
class Curve:
    """One force-displacement curve: largest force error [-], unknowns, processor time [s]."""

    name: str
    error: float
    unknowns: int
    cpu_seconds: float


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


def kratos_curve(edge: int, whole: bool) -> Curve | None:
    """Kratos under the forces of the independent solution; None where it is not installed."""
    own = reference('reissner_disc2_nu0.5')
    softer = reference('koiter_disc2_nu0.49')(STEPS) / reference('koiter_disc2_nu0.5')(STEPS)
    measure = CubicSpline(np.r_[0.0, STEPS], np.r_[0.0, own(STEPS) * softer])
    python = os.environ.get('PEER_PYTHON', sys.executable)
    answer = subprocess.run(
        [python, str(PEER), str(edge), str(int(whole))],
        input=json.dumps(measure(STEPS).tolist()), capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = [line for line in answer.stdout.splitlines() if line.startswith('{"depth_mm"')]
    if not lines:
        return None
    result = json.loads(lines[0])
    error = np.abs(measure(STEPS) / measure(np.array(result['depth_mm'])) - 1.0).max()
    name = f'{"whole ball" if whole else "octant"}, Kratos thin corotational triangles'
    return Curve(name, float(error), result['unknowns'], result['cpu_seconds'])


def newton_step(subdivisions: int) -> tuple[int, float, float]:
    """Vertices, wall and processor milliseconds (best of 5) of tangent, factorisation, solve."""
    mesh = trimesh.creation.icosphere(subdivisions)
    shell = discretise(
        control_mesh(31.25e-3 * mesh.vertices, mesh.faces), Material(1e6, 0.5), 2.5e-3
    )
    model = ShellModel(shell)
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


def rows(large: bool) -> list[Row]:
    """What was measured, its value, and its goal."""
    found: list[Row] = []
    our_curve(650)
    ours = our_curve(650)
    found.append(('ball 0-12 mm, 24 steps, CPU s', f'{ours.cpu_seconds:.2f}', '3'))
    found.append(('its largest force error, Koiter', f'{100 * ours.error:.2f} %', '0.5 %'))
    for edge, whole, goal in ((24, False, 'information'), (36, False, 'information')):
        peer = kratos_curve(edge, whole)
        if peer is None:
            found.append(('Kratos', 'not installed: requirements/bench.txt', ''))
            break
        label = f'{peer.name}, {peer.unknowns} unknowns'
        found.append((label, f'{peer.cpu_seconds:.2f} s, {100 * peer.error:.2f} %', goal))
        found.append(
            ('  its CPU over our whole ball', f'{peer.cpu_seconds / ours.cpu_seconds:.1f}', '')
        )
    if large:
        peer = kratos_curve(24, True)
        if peer is not None:
            ratio = peer.cpu_seconds / ours.cpu_seconds
            found.append((peer.name, f'{peer.cpu_seconds:.1f} s, {100 * peer.error:.2f} %', ''))
            found.append(('whole ball against whole ball, CPU ratio', f'{ratio:.1f}', '10'))
    for subdivisions in (3, 4, 5) if large else (3, 4):
        vertices, wall, processor = newton_step(subdivisions)
        found.append(
            (
                f'Newton step at {vertices} vertices, ms wall (CPU)',
                f'{wall:.0f} ({processor:.0f})',
                str(NEWTON_GOALS[vertices]),
            )
        )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found.append(('peak memory, MiB', f'{peak:.0f}', 'reported'))
    for row in compare(0.5):
        found.append(
            (
                f'{row.setup}, {row.method}, 0.5 N: depth mm',
                f'{1e3 * row.depth:.4f} in {row.cpu_seconds:.2f} s',
                'comparison',
            )
        )
    return found


def draw(path: Path) -> None:
    """Accuracy against unknowns and against processor time."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullFormatter

    our_curve(200)
    families = {'Loop Kirchhoff-Love, whole ball': [our_curve(n) for n in (200, 320, 650, 1300)]}
    peers = [kratos_curve(edge, False) for edge in (8, 12, 24, 36)]
    families['Kratos thin corotational triangles, octant'] = [p for p in peers if p is not None]
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), sharey=True, layout='constrained')
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
    axes[0].legend()
    figure.suptitle('Pinched ball against the independent solution of the same strain measure')
    figure.savefig(path, dpi=130)


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='The shell solver beside its peers.')
    parser.add_argument('--large', action='store_true', help='10 242 vertices, whole-ball Kratos')
    parser.add_argument('--picture', type=Path, metavar='FILE', help='draw accuracy (PNG)')
    options = parser.parse_args(arguments)
    for what, value, goal in rows(options.large):
        print(f'{what:<64} {value:>28}   goal {goal}')
    if options.picture:
        draw(options.picture)


if __name__ == '__main__':
    main()
