"""Compile every kernel once, so that no later start waits: `python -m shell_deform.compile_cache`.

It solves a small squeezed ball with sealed gas under every theory, which passes through all of
them.
"""

from __future__ import annotations

import sys
import time

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions


def compile_kernels() -> None:
    """Run every compiled kernel on a small problem."""
    small = with_material(load_object('tennis_ball'), gas_kind='sealed')
    model = build_model(small, control_vertices=200)
    solver = EquilibriumSolver(model, NewtonOptions(stability=True))
    contacts = object_contacts(small, model)
    solver.solve(displaced(contacts, [1e-4] * len(contacts)))


def main() -> None:
    """Compile, saying so and how long it took."""
    start = time.perf_counter()
    print('Compiling the shell kernels (first time only) ...', file=sys.stderr)
    compile_kernels()
    print(f'... done in {time.perf_counter() - start:.0f} s', file=sys.stderr)


if __name__ == '__main__':
    main()
