# SPDX-License-Identifier: Apache-2.0
"""The sparse factorisation against SuperLU (and CHOLMOD). `python tests/benchmarks/factor.py`.

Closed Loop spheres, springs in the Loop pattern, one thread, the best of several repetitions.
`--large` adds 10 242 vertices. CHOLMOD is measured when cvxopt is installed.
"""

from __future__ import annotations

import os

for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(variable, '1')

import argparse  # noqa: E402
import importlib.util  # noqa: E402
import json  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402
import scipy.sparse.linalg  # noqa: E402

TESTS = Path(__file__).parents[2] / 'ros2_ws/src/shell_deform/test'
sys.path.insert(0, str(TESTS))

from factor_matrices import geodesic_sphere, loop_pattern, shifted, springs  # noqa: E402
from figures import HEADING, show  # noqa: E402

from shell_deform.factor.analysis import analyse, factorise  # noqa: E402

Row = tuple[str, str, str]

# Vertices: analysis, factorisation, one solve [ms].
GOALS = {642: (10, 13, 0.2), 2562: (50, 110, 4), 10242: (200, 870, 22)}

EVERY_KERNEL = """
import importlib, time
began = time.perf_counter()
from shell_deform.compiled.first_use import COMMON, KERNELS
for module in COMMON + KERNELS:
    importlib.import_module(module)
print(time.perf_counter() - began)
"""


def milliseconds(function: Callable[[], Any], repetitions: int) -> float:
    """Shortest of several runs [ms]."""
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def sphere(frequency: int, repetitions: int, peers: bool) -> Iterator[Row]:
    """Figures of a sphere of 10 f^2 + 2 vertices."""
    vertices, triangles = geodesic_sphere(frequency)
    graph = loop_pattern(vertices, triangles)
    free = springs(vertices, graph)
    matrix = shifted(free, 1e-3)
    indefinite = shifted(free, -1e-3)
    count, size = len(vertices), matrix.shape[0]
    analysis_goal, factor_goal, solve_goal = GOALS[count]
    load = np.random.default_rng(1).normal(size=size)
    loads = np.random.default_rng(2).normal(size=(size, 32))
    symbolic = analyse(graph, vertices)
    factor = factorise(symbolic, matrix)
    name = f'{count} vertices'

    def row(what: str, value: float, goal: float | None = None) -> Row:
        return f'{name}: {what}', f'{value:.2f} ms', '' if goal is None else f'<= {goal} ms'

    yield row(
        'analysis', milliseconds(lambda: analyse(graph, vertices), repetitions), analysis_goal
    )
    ours = milliseconds(lambda: factorise(symbolic, matrix), repetitions)
    yield row('factorisation', ours, factor_goal)
    yield row('one solve', milliseconds(lambda: factor.solve(load), repetitions), solve_goal)
    yield row('32 solves at once', milliseconds(lambda: factor.solve(loads), 3))
    yield f'{name}: residual', f'{factor.residual(load, factor.solve(load)):.1e}', '<= 1e-14'
    yield row(
        'factorisation, 6 negative eigenvalues',
        milliseconds(lambda: factorise(symbolic, indefinite), max(2, repetitions // 3)),
    )
    unstable = factorise(symbolic, indefinite)
    yield (
        f'{name}: residual, indefinite, refined',
        f'{unstable.residual(load, unstable.solve(load)):.1e}',
        '<= 1e-12',
    )
    yield f'{name}: negative eigenvalues', str(unstable.inertia.negative), '= 6'
    yield f'{name}: numbers in the factor', f'{symbolic.stored_entries / 1e6:.2f} M', ''
    if peers:
        yield from superlu_peer(name, matrix, symbolic, ours)
        if importlib.util.find_spec('cvxopt') is not None:
            yield from cholmod_peer(name, matrix, symbolic, ours)


def superlu_peer(name: str, matrix: Any, symbolic: Any, ours: float) -> Iterator[Row]:
    """SciPy's splu, symmetric mode, its own order and ours."""
    unknown = (3 * symbolic.order[:, None].astype(int) + np.arange(3)).ravel()
    permuted = matrix[unknown][:, unknown].tocsc()
    for order, values, specification in (
        ('its order', matrix.tocsc(), 'MMD_AT_PLUS_A'),
        ('our order', permuted, 'NATURAL'),
    ):

        def run(values: Any = values, specification: str = specification) -> Any:
            return scipy.sparse.linalg.splu(
                values,
                permc_spec=specification,
                diag_pivot_thresh=0.0,
                options={'SymmetricMode': True},
            )

        theirs = milliseconds(run, 2)
        yield f'{name}: splu, {order}', f'{theirs:.1f} ms', f'{theirs / ours:.1f} times ours'


def cholmod_peer(name: str, matrix: Any, symbolic: Any, ours: float) -> Iterator[Row]:
    """cvxopt's supernodal CHOLMOD in our order, numeric part."""
    from cvxopt import cholmod, spmatrix
    from cvxopt import matrix as dense

    lower = scipy.sparse.coo_array(scipy.sparse.tril(matrix))
    values = spmatrix(lower.data, lower.row.tolist(), lower.col.tolist())
    unknown = (3 * symbolic.order[:, None].astype(int) + np.arange(3)).ravel()
    cholmod.options['supernodal'] = 2
    factor = cholmod.symbolic(values, dense(unknown.tolist()))
    theirs = milliseconds(lambda: cholmod.numeric(values, factor), 4)
    yield f'{name}: CHOLMOD, our order', f'{theirs:.1f} ms', f'{theirs / ours:.2f} times ours'


def starts() -> Iterator[Row]:
    """Wall time until a new process has every kernel of the package."""
    processes = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, 'NUMBA_CACHE_DIR': folder}

        def start() -> float:
            done = subprocess.run(
                [sys.executable, '-c', EVERY_KERNEL],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
                timeout=300,
            )
            return float(done.stdout)

        first = f'first use: every kernel compiled, {processes} processes'
        yield first, f'{start():.1f} s', 'a few seconds'
        later = float(np.median([start() for _ in range(5)]))
        yield 'later start: every kernel loaded, numba and SciPy too', f'{later:.2f} s', '< 1 s'


def rows(large: bool, peers: bool) -> Iterator[Row]:
    """All rows; SuperLU, which needs minutes for it, is left out of the largest sphere."""
    for frequency, repetitions in [(8, 30), (16, 12)] + ([(32, 5)] if large else []):
        yield from sphere(frequency, repetitions, peers and frequency < 32)
    yield from starts()


def main() -> int:
    """Print the rows (what, value, goal)."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--large', action='store_true', help='add 10 242 vertices')
    parser.add_argument('--no-peers', action='store_true', help='leave SuperLU and CHOLMOD out')
    parser.add_argument('--json', action='store_true', help='one JSON document instead')
    arguments = parser.parse_args()
    found = rows(arguments.large, not arguments.no_peers)
    if arguments.json:
        print(json.dumps([dict(zip(HEADING, row, strict=True)) for row in found]))
    else:
        show(found)
    return 0


if __name__ == '__main__':
    sys.exit(main())
