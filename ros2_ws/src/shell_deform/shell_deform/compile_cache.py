"""Compile every kernel once, so that no later start waits: `python -m shell_deform.compile_cache`.

It solves a small squeezed ball with sealed gas, offline and as the live node does, which passes
through all of them. Kernels with written signatures compile when they are imported: the
factorisation does so in a process of its own, beside the surface and the theories.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.live.rehearsal import Rehearsal
from shell_deform.live.sample import FLAG_CONTACT, ContactSample
from shell_deform.loads import ContactPatch
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver, NewtonOptions

FACTORISATION = (
    'import shell_deform.solve.factor_multifrontal, shell_deform.solve.nested_dissection'
)


def compile_beside() -> None:
    """Compile the factorisation and, meanwhile here, surface, theories and gas."""
    with subprocess.Popen([sys.executable, '-c', FACTORISATION]):
        ball = with_material(load_object('tennis_ball'), gas_kind='sealed')
        model = build_model(ball, control_vertices=60)
        object_contacts(ball, model)
        model.tangent(model.rest)
        model.gradient(model.rest)


def compile_kernels() -> None:
    """Run every compiled kernel on a small problem."""
    small = with_material(load_object('tennis_ball'), gas_kind='sealed')
    model = build_model(small, control_vertices=200)
    solver = EquilibriumSolver(model, NewtonOptions(stability=True))
    contacts = object_contacts(small, model)
    solver.solve(displaced(contacts, [1e-4] * len(contacts)))
    Rehearsal(model).settle(_touching(contacts, 0.5 * small.thickness_m))


def _touching(contacts: tuple[ContactPatch, ...], half_wall: float) -> ContactSample:
    """A hand that pushes a little at every contact."""
    count = len(contacts)
    inward = np.array([contact.axis for contact in contacts])
    outer = np.array([contact.point for contact in contacts]) - half_wall * inward
    return ContactSample(
        stamp=1,
        finger=np.arange(1, count + 1),
        flags=np.full(count, FLAG_CONTACT),
        point=outer + 1e-4 * inward,
        normal=inward,
        force=0.5 * inward,
        sigma_normal=np.full(count, 0.05),
        sigma_tangential=np.full(count, np.inf),
        radius=np.full(count, 1e-3),
        travel=np.full(count, 1e-4),
        sigma_travel=np.full(count, 1e-5),
    )


def main() -> None:
    """Compile, saying so and how long it took."""
    start = time.perf_counter()
    print('Compiling the shell kernels (first time only) ...', file=sys.stderr)
    compile_beside()
    compile_kernels()
    print(f'... done in {time.perf_counter() - start:.0f} s', file=sys.stderr)


if __name__ == '__main__':
    main()
