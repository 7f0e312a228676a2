# SPDX-License-Identifier: Apache-2.0
"""Energy, gradient and stiffness over the whole surface."""

import numpy as np
import pytest

from shell_deform.assemble import plain
from shell_deform.theory import THEORIES
from shell_deform.theory.gas import Gas

RANDOM = np.random.default_rng(3)


@pytest.fixture(scope='module')
def shell(sphere):
    return sphere(1.0, 0.05, subdivisions=1, poisson=0.3).shell


@pytest.fixture(scope='module')
def bent(shell):
    return shell.mesh.vertices + 0.05 * RANDOM.normal(size=shell.mesh.vertices.shape)


@pytest.mark.parametrize('theory', THEORIES)
def test_gradient_is_the_derivative_of_the_energy(shell, bent, theory):
    energy, gradient = shell.gradient(theory, bent)
    direction = RANDOM.normal(size=bent.shape)
    step = 1e-5
    numeric = (
        shell.energy(theory, bent + step * direction)
        - shell.energy(theory, bent - step * direction)
    ) / (2 * step)
    assert np.sum(gradient * direction) == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize('theory', THEORIES)
def test_stiffness_is_symmetric_and_the_derivative_of_the_gradient(shell, bent, theory):
    _, _, data = shell.tangent(theory, bent)
    matrix = shell.pattern.matrix(data)
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    direction = RANDOM.normal(size=bent.shape)
    step = 1e-5
    forward = shell.gradient(theory, bent + step * direction)[1]
    backward = shell.gradient(theory, bent - step * direction)[1]
    numeric = ((forward - backward) / (2 * step)).ravel()
    product = matrix @ direction.ravel()
    np.testing.assert_allclose(product, numeric, atol=1e-6 * np.abs(product).max())


@pytest.mark.parametrize('theory', THEORIES)
def test_compiled_assembly_equals_its_numpy_twin(shell, bent, theory):
    energy, gradient, data = shell.tangent(theory, bent)
    twin_energy, twin_gradient, twin_data = plain.shell_tangent(shell, theory, bent)
    assert energy == pytest.approx(twin_energy, rel=1e-12)
    np.testing.assert_allclose(gradient, twin_gradient, atol=1e-11 * np.abs(gradient).max())
    np.testing.assert_allclose(data, twin_data, atol=1e-11 * np.abs(data).max())


@pytest.mark.parametrize('theory', THEORIES)
def test_the_energies_of_the_points_add_up_and_equal_their_numpy_twin(shell, bent, theory):
    energies = shell.point_energies(theory, bent)
    assert energies.sum() == pytest.approx(shell.energy(theory, bent), rel=1e-12)
    twin = plain.point_energies(shell, theory, bent)
    np.testing.assert_allclose(energies, twin, atol=1e-12 * energies.max())


def test_positions_may_be_an_array_that_cannot_be_written(shell, bent):
    fixed = bent.copy()
    fixed.flags.writeable = False
    assert shell.gradient('koiter', fixed)[0] == shell.gradient('koiter', bent)[0]
    assert shell.tangent('koiter', fixed)[0] == shell.tangent('koiter', bent)[0]
    assert shell.volume(fixed)[0] == shell.volume(bent)[0]


def test_volume_and_its_derivatives_equal_their_numpy_twins(shell, bent):
    volume, gradient = shell.volume(bent)
    twin_volume, twin_gradient = plain.volume_gradient(shell, bent)
    assert volume == pytest.approx(twin_volume, rel=1e-13)
    np.testing.assert_allclose(gradient, twin_gradient, atol=1e-13)
    pressed, alone = shell.tangent('koiter', bent, 3.0)[2], shell.tangent('koiter', bent)[2]
    twin = plain.shell_tangent(shell, 'koiter', bent, 3.0)[2]
    np.testing.assert_allclose(pressed, twin, atol=1e-11 * np.abs(twin).max())
    matrix = shell.pattern.matrix(pressed - alone)
    direction = RANDOM.normal(size=bent.shape)
    step = 1e-6
    change = shell.volume(bent + step * direction)[1] - shell.volume(bent - step * direction)[1]
    numeric = -3.0 * change.ravel() / (2 * step)
    np.testing.assert_allclose(matrix @ direction.ravel(), numeric, atol=1e-7)


def test_volume_and_area_of_a_sphere_converge_to_the_exact_ones(sphere):
    errors = []
    for subdivisions in (1, 2, 3):
        shell = sphere(1.0, 0.05, subdivisions=subdivisions).shell
        volume = shell.volume(shell.mesh.vertices)[0]
        errors.append([abs(volume / (4 * np.pi / 3) - 1), abs(shell.area / (4 * np.pi) - 1)])
    assert errors[2][0] < 1e-4 and errors[2][1] < 1e-4
    assert np.all(np.log2(np.array(errors[1]) / np.array(errors[2])) > 3.0)


def test_rigid_motion_costs_koiter_no_energy(sphere):
    model = sphere(31.25e-3, 2.5e-3)
    rest = model.rest
    bent = rest * np.array([1.0, 1.0, 0.9])
    reference = model.shell.energy('koiter', bent)
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    k = np.cross(np.eye(3), axis)
    for angle in np.deg2rad([1.0, 30.0, 90.0, 180.0]):
        turn = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        moved = rest @ turn + np.array([0.1, -0.2, 0.05])
        assert model.shell.energy('koiter', moved) < 1e-20 * reference


def test_sealed_gas_follows_boyles_law_and_gives_a_consistent_gradient(sphere):
    model = sphere(1.0, 0.05, subdivisions=1, gas=Gas('sealed', gauge_pressure=500.0))
    squeezed = model.rest * np.array([1.0, 1.0, 0.9])
    volume = model.shell.volume(squeezed)[0]
    absolute = (101325.0 + 500.0) * model.rest_volume / volume
    assert model.overpressure(volume) == pytest.approx(absolute - 101325.0)
    direction = RANDOM.normal(size=squeezed.shape)
    step = 1e-6
    forward, backward = (model.gradient(squeezed + sign * step * direction)[0] for sign in (1, -1))
    tangent = model.tangent(squeezed)
    numeric = (forward - backward) / (2 * step)
    assert tangent.gradient @ direction.ravel() == pytest.approx(numeric, rel=1e-7)
    forces = [model.gradient(squeezed + sign * step * direction)[1] for sign in (1, -1)]
    product = tangent.stiffness @ direction.ravel()
    product = product + tangent.gas_stiffness * tangent.gas_row * (
        tangent.gas_row @ direction.ravel()
    )
    np.testing.assert_allclose(
        product, (forces[0] - forces[1]) / (2 * step), atol=1e-6 * np.abs(product).max()
    )
