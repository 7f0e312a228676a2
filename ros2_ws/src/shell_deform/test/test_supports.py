# SPDX-License-Identifier: Apache-2.0
"""What holds a shell, each support shown by what it does."""

import numpy as np
import pytest

from shell_deform.assemble.discretisation import discretise
from shell_deform.contact.loads import line_load
from shell_deform.model import ShellModel
from shell_deform.readout import support_forces
from shell_deform.solve.equilibrium import LoadCase, gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import (
    SupportError,
    clamp,
    free_rigid_modes,
    hold_position,
    hold_slope,
    isostatic_dofs,
    joined,
    rigid_modes,
    symmetry,
    vertex_parameters,
)
from shell_deform.supports.grips import grip
from shell_deform.theory.material import Material
from shell_deform.verification.grid_surface import grid_surface

X, Y, Z = np.eye(3)
LENGTH, WIDTH, THICKNESS = 1.0, 0.1, 0.01
MATERIAL = Material(1e9, 0.0)
BENDING = 1e9 * WIDTH * THICKNESS**3 / 12.0


def strip(length=LENGTH, cells=(12, 2)):
    def flat(s, t):
        return np.stack([length * s, WIDTH * (t - 0.5), 0.0 * s], axis=1)

    grid = grid_surface(flat, cells)
    return grid, discretise(grid.mesh, MATERIAL, THICKNESS)


def loaded(shell, supports, load):
    model = ShellModel(shell, supports=joined(supports))
    state = EquilibriumSolver(model).solve(LoadCase((), np.zeros(0), np.zeros(0), dead_load=load))
    assert state.converged, state.message
    return model, model.surface.limit_positions(state.positions - model.rest), state


def uniform(shell, total):
    values = shell.value_matrix().T @ shell.weights
    return np.outer(values / values.sum(), total)


def test_clamped_edge_gives_the_cantilevers_deflection():
    grid, shell = strip()
    load = line_load(shell.mesh, grid.edge('s1'), 0.1 * Z)
    _, moved, _ = loaded(shell, clamp(shell, grid.edge('s0'), X), load)
    expected = 0.1 * LENGTH**3 / (3.0 * BENDING)
    assert moved[grid.edge('s1'), 2].mean() == pytest.approx(expected, rel=2e-3)


def test_hinged_edges_give_the_simply_supported_beams_deflection():
    grid, shell = strip()
    ends = np.concatenate([grid.edge('s0'), grid.edge('s1')])
    _, moved, _ = loaded(shell, [hold_position(shell, ends, np.eye(3))], uniform(shell, 0.1 * Z))
    expected = 5.0 * 0.1 * LENGTH**3 / (384.0 * BENDING)
    middle = grid.number[1:-1, 1:-1][6]
    assert moved[middle, 2].mean() == pytest.approx(expected, rel=5e-3)


def test_half_a_strip_with_a_symmetric_edge_deflects_like_the_whole():
    whole_grid, whole = strip()
    ends = np.concatenate([whole_grid.edge('s0'), whole_grid.edge('s1')])
    _, moved, _ = loaded(whole, [hold_position(whole, ends, np.eye(3))], uniform(whole, 0.1 * Z))
    grid, half = strip(0.5 * LENGTH, (6, 2))
    supports = [
        hold_position(half, grid.edge('s0'), np.eye(3)),
        *symmetry(half, grid.edge('s1'), X),
    ]
    _, half_moved, _ = loaded(half, supports, uniform(half, 0.05 * Z))
    middle = whole_grid.number[1:-1, 1:-1][6]
    np.testing.assert_allclose(
        half_moved[grid.edge('s1'), 2].mean(), moved[middle, 2].mean(), rtol=2e-3
    )


def test_support_forces_balance_the_load_to_eight_digits():
    grid, shell = strip()
    load = uniform(shell, 0.1 * Z)
    model, _, state = loaded(shell, clamp(shell, grid.edge('s0'), X), load)
    reaction = support_forces(model, state.positions, load)
    np.testing.assert_allclose(reaction.sum(axis=0), -0.1 * Z, atol=1e-8 * 0.1)
    moment = np.cross(state.positions, reaction + load).sum(axis=0)
    assert np.abs(moment).max() < 1e-8 * 0.1 * LENGTH
    springs = -model.supports.force(state.positions - model.rest)
    np.testing.assert_allclose(reaction, springs, atol=1e-3 * np.abs(springs).max())


def test_a_held_point_moves_only_by_the_ratio_of_the_stiffnesses():
    grid, shell = strip()
    _, moved, _ = loaded(
        shell, clamp(shell, grid.edge('s0'), X), line_load(shell.mesh, grid.edge('s1'), 1.0 * X)
    )
    assert np.abs(moved[grid.edge('s0')]).max() < 1e-3 * moved[grid.edge('s1'), 0].mean()


def test_a_grip_moves_the_edge():
    grid, shell = strip()
    supports = clamp(shell, grid.edge('s0'), X)
    pulled = hold_position(shell, grid.edge('s1'), X[None])
    held = grip('end', shell, [pulled], LENGTH * X)
    model = ShellModel(shell, supports=joined(supports), grips=(held,))
    state = EquilibriumSolver(model).solve(gripped(1e-4 * np.eye(6)[:1]))
    moved = model.surface.limit_positions(state.positions - model.rest)
    np.testing.assert_allclose(moved[grid.edge('s1'), 0], 1e-4, rtol=1e-3)
    stretch = 1e9 * WIDTH * THICKNESS * 1e-4 / LENGTH
    assert state.grip_wrench[0, 0] == pytest.approx(stretch, rel=0.05)


def test_springs_enter_the_stiffness_as_they_enter_the_force():
    grid, shell = strip()
    supports = joined(clamp(shell, grid.edge('s0'), X))
    moved = np.random.default_rng(2).normal(size=(len(shell.mesh.vertices), 3))
    matrix = shell.pattern.matrix(supports.stiffness_values(shell))
    force = supports.force(moved)
    np.testing.assert_allclose(
        (matrix @ moved.ravel()).reshape(-1, 3), force, atol=1e-10 * np.abs(force).max()
    )
    assert supports.energy(moved) == pytest.approx(0.5 * np.sum(force * moved))


def test_rigid_modes_are_orthonormal_and_a_hinge_leaves_one():
    points = np.random.default_rng(1).normal(size=(20, 3))
    modes = rigid_modes(points)
    np.testing.assert_allclose(modes.T @ modes, np.eye(6), atol=1e-12)
    grid, shell = strip()
    hinge = hold_position(shell, grid.edge('s0')[[0, -1]], np.eye(3))
    rest = shell.mesh.vertices
    assert free_rigid_modes(rigid_modes(rest), hinge.dense(len(rest))).shape[1] == 1
    slope = hold_slope(shell, grid.edge('s0'), np.tile(X, (3, 1)), np.eye(3))
    both = joined([hinge, slope])
    assert free_rigid_modes(rigid_modes(rest), both.dense(len(rest))).shape[1] == 0


def test_isostatic_dofs_prevent_every_rigid_motion():
    points = np.random.default_rng(1).normal(size=(20, 3))
    modes = rigid_modes(points)
    dofs = isostatic_dofs(modes)
    assert len(set(dofs.tolist())) == 6
    assert abs(np.linalg.det(modes[dofs])) > 1e-6


def test_a_support_off_the_surface_is_refused_by_its_vertex():
    grid, shell = strip()
    outside = grid.number[0, 0]
    with pytest.raises(SupportError, match=f'vertex {outside}'):
        vertex_parameters(shell.mesh.triangles, shell.mesh.active, np.array([outside]))


def test_no_supports_join_to_none():
    assert joined([]) is None
