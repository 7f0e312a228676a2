# SPDX-License-Identifier: Apache-2.0
"""Gradient and tangent of everything that stores energy or pushes, to nine digits.

Pins, pads with a pressure profile, contact torques, line and surface loads are dead: their nodal
forces do not depend on the positions, and the tangent has no part of them. Rigid pads stand in
`test_pads.py`.
"""

import numpy as np
import pytest
import scipy.sparse as sp

from shell_deform.contact.loads import contact_torque, line_load, surface_load
from shell_deform.solve.borders import borders
from shell_deform.solve.equilibrium import LoadCase, forced
from shell_deform.supports import hold_position
from shell_deform.theory import THEORIES
from shell_deform.theory.gas import Gas

STEP = 1e-30


@pytest.fixture(scope='module')
def model(sphere):
    return sphere(1.0, 0.05, subdivisions=1, poisson=0.3)


@pytest.fixture(scope='module')
def bent(model):
    return model.rest + 0.05 * np.random.default_rng(3).normal(size=model.rest.shape)


@pytest.fixture(scope='module')
def direction(model):
    return np.random.default_rng(4).normal(size=model.rest.shape)


def close(ours, theirs):
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())


def strain_energy(shell, law, positions):
    """The energy in complex arithmetic, summed over the quadrature points."""
    q = np.stack([(matrix @ positions) for matrix in row_matrices(shell)], axis=1)
    strain = law.strains(q, shell.reference)
    stretch, bend = strain[:, :3], strain[:, 3:]
    density = np.einsum('pi,pij,pj->p', stretch, shell.membrane, stretch)
    density = density + np.einsum('pi,pij,pj->p', bend, shell.bending, bend)
    return 0.5 * (shell.weights @ density)


def row_matrices(shell):
    size = (len(shell.weights), len(shell.mesh.vertices))
    return [
        sp.csr_matrix((column, shell.row_nodes, shell.row_offsets), shape=size)
        for column in shell.rows.T
    ]


@pytest.mark.parametrize('theory', THEORIES)
def test_gradient_is_the_complex_step_of_the_energy(model, bent, direction, theory):
    moved = bent + 1j * STEP * direction
    expected = strain_energy(model.shell, THEORIES[theory], moved).imag / STEP
    energy, gradient = model.shell.gradient(theory, bent)
    assert energy == pytest.approx(strain_energy(model.shell, THEORIES[theory], bent), rel=1e-12)
    assert np.sum(gradient * direction) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize('theory', THEORIES)
def test_stiffness_is_symmetric_and_the_derivative_of_the_gradient(model, bent, direction, theory):
    """The stress moves by a complex step, the law's jacobian B by extrapolated differences.

    That B is the complex step of the strains is a test of its own (`test_theory.py`).
    """
    shell, law = model.shell, THEORIES[theory]
    matrices = row_matrices(shell)
    q = np.stack([matrix @ bent for matrix in matrices], axis=1)
    dq = np.stack([matrix @ direction for matrix in matrices], axis=1)
    stress = law.strains(q, shell.reference)
    change = law.strains(q + 1j * STEP * dq, shell.reference).imag / STEP
    stress, change = wall(shell, stress), wall(shell, change)
    b = law.jacobian(q, shell.reference)
    db = richardson(lambda s: law.jacobian(q + s * dq, shell.reference))
    force = np.einsum('pk,pkai->pai', change, b) + np.einsum('pk,pkai->pai', stress, db)
    force *= shell.weights[:, None, None]
    expected = sum(m.T @ force[:, d] for d, m in enumerate(matrices)).reshape(-1)
    matrix = shell.pattern.matrix(shell.tangent(theory, bent)[2])
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    close(matrix @ direction.reshape(-1), expected)


def wall(shell, strain):
    return np.concatenate(
        [
            np.einsum('pij,pj->pi', shell.membrane, strain[:, :3]),
            np.einsum('pij,pj->pi', shell.bending, strain[:, 3:]),
        ],
        axis=1,
    )


def richardson(function, step=2e-3, levels=5):
    """Derivative at zero by central differences, extrapolated: about eleven digits."""
    table = [
        (function(step / 2**k) - function(-step / 2**k)) / (2 * step / 2**k) for k in range(levels)
    ]
    for order in range(1, levels):
        table = [
            (4**order * table[k + 1] - table[k]) / (4**order - 1) for k in range(len(table) - 1)
        ]
    return table[0]


def turned_by_half(model, positions, direction):
    """Second derivative of the volume times a direction, exact: its gradient is quadratic."""
    ends = [model.shell.volume(positions + sign * direction)[1] for sign in (0.5, -0.5)]
    return (ends[0] - ends[1]).reshape(-1)


def test_follower_pressure_enters_the_tangent_exactly(sphere, bent, direction):
    plain, blown = (sphere(1.0, 0.05, subdivisions=1, pressure=p) for p in (0.0, 1e3))
    added = blown.tangent(bent).stiffness - plain.tangent(bent).stiffness
    assert abs(added - added.T).max() < 1e-12 * abs(added).max()
    close(added @ direction.reshape(-1), -1e3 * turned_by_half(plain, bent, direction))
    pushed = blown.tangent(bent).gradient - plain.tangent(bent).gradient
    slope = volume_slope(plain, bent, direction)
    assert pushed @ direction.reshape(-1) == pytest.approx(-1e3 * slope, rel=1e-9)


def volume_slope(model, positions, direction):
    """Derivative of the volume, exact: it is a cubic."""
    v = [model.shell.volume(positions + s * direction)[0] for s in (-1.0, -0.5, 0.5, 1.0)]
    return (8.0 * (v[2] - v[1]) - (v[3] - v[0])) / 6.0


def test_sealed_gas_enters_the_tangent_exactly(sphere, bent, direction):
    gas = Gas('sealed', gauge_pressure=500.0)
    plain, filled = sphere(1.0, 0.05, subdivisions=1), sphere(1.0, 0.05, subdivisions=1, gas=gas)
    tangent = filled.tangent(bent)
    volume, row = plain.shell.volume(bent)
    ratio = volume / filled.rest_volume
    slope = gas.pressure(ratio + 1j * STEP).imag / STEP / filled.rest_volume
    moved = float(np.sum(row * direction))
    expected = -gas.pressure(ratio) * turned_by_half(plain, bent, direction)
    expected = expected - slope * moved * row.reshape(-1)
    own = (tangent.stiffness - plain.tangent(bent).stiffness) @ direction.reshape(-1)
    own = own + tangent.gas_stiffness * tangent.gas_row * (tangent.gas_row @ direction.reshape(-1))
    close(own, expected)
    close(
        (tangent.gradient - plain.tangent(bent).gradient), -gas.pressure(ratio) * row.reshape(-1)
    )


def test_supports_enter_the_tangent_exactly(sphere, bent, direction):
    plain = sphere(1.0, 0.05, subdivisions=1)
    held = sphere(
        1.0, 0.05, subdivisions=1,
        supports=hold_position(plain.shell, np.array([0, 5, 9]), np.eye(3)),
    )  # fmt: skip
    own = (held.tangent(bent).stiffness - plain.tangent(bent).stiffness) @ direction.reshape(-1)
    ends = [held.supports.force(bent - held.rest + s * direction) for s in (0.5, -0.5)]
    close(own, (ends[0] - ends[1]).reshape(-1))


@pytest.mark.parametrize('profile', ['uniform', 'hertz', 'cone'])
def test_contacts_with_given_traction_are_dead_loads(model, bent, profile):
    patch = model.contact(np.array([0.0, 0.0, 1.0]), 0.2, profile=profile)
    push = borders(model, forced((patch,), [1.0])).push[:, 0]
    close(push, patch.force_pattern(patch.axis).reshape(-1))
    assert model.tangent(bent).pad_rows is None


def test_torque_line_and_surface_loads_are_dead_loads(model):
    patch = model.contact(np.array([0.0, 0.0, 1.0]), 0.2)
    corners = model.shell.mesh.triangles[0][:2].astype(np.int64)
    load = contact_torque(patch, 0.1)
    load = load + line_load(model.shell.mesh, corners, np.array([1.0, 0.0, 0.0]))
    load = load + surface_load(model.shell, np.array([0.0, 2.0, 0.0]))
    case = LoadCase((), np.zeros(0), np.zeros(0), dead_load=load)
    close(borders(model, case).dead, load.reshape(-1))


def test_the_force_of_linear_theory_is_the_slope_of_its_energy(sphere):
    straight = sphere(1.0, 0.05, subdivisions=1, poisson=0.3, theory='linear', gas=Gas('sealed'))
    random = np.random.default_rng(73).normal(size=(2, *straight.rest.shape))
    at, along = straight.rest + 0.01 * random[0], 0.01 * random[1]
    ahead, behind = (straight.gradient(at + side * along)[0] for side in (1.0, -1.0))
    slope = straight.gradient(at)[1] @ along.reshape(-1)
    assert 0.5 * (ahead - behind) == pytest.approx(slope, rel=1e-9)
