# SPDX-License-Identifier: Apache-2.0
"""Theory `thick` beside exact solutions, thick and thin, in short forms of `shell_verify`."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.assemble.discretisation import discretise
from shell_deform.assemble.thick import thick_shell
from shell_deform.building import build_model
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import LoadCase
from shell_deform.supports import clamp, hold_position, joined, symmetry
from shell_deform.theory.material import Material
from shell_deform.verification import thick_exact, thick_limit
from shell_deform.verification.grid_surface import grid_surface
from shell_deform.verification.linear_course import first_order
from shell_deform.verification.thick_exact import (
    arc_moment,
    blown_sphere,
    clamped_plate,
    navier_deflection,
    sphere_pressure,
    supported_plate,
)

X, Y, Z = np.eye(3)


@pytest.mark.parametrize('slenderness', [0.1, 0.2])
def test_a_thick_plate_on_simple_supports_sags_as_the_navier_series_says(slenderness):
    assert abs(supported_plate(slenderness, cells=16).error) < 1e-3


@pytest.mark.parametrize('slenderness', [0.1, 0.2, 0.4])
def test_a_thick_clamped_plate_sags_by_bending_and_shear(slenderness):
    assert abs(clamped_plate(slenderness, cells=32).error) < 1e-3


def test_a_block_bent_to_an_arc_has_rivlins_moment():
    assert thick_exact.bent_block(0.2).passed


def test_a_thick_sphere_carries_the_exact_inner_pressure():
    rows = list(blown_sphere(4.0, 200))
    assert len(rows) == 3
    assert all(row.passed for row in rows)


def test_a_thin_sphere_is_koiters_on_the_same_mesh():
    assert all(row.passed for row in thick_limit.problems(400))


def test_the_exact_plate_tends_to_kirchhoffs():
    material = Material(1e9, 0.3)
    thin = navier_deflection(1.0, 1e-3, material) * material.bending_stiffness(1e-3)
    assert thin == pytest.approx(0.00406235, rel=1e-5)  # Timoshenko, table 8


def test_rivlins_moment_tends_to_the_plates():
    # E / 12 (1 - nu^2) of nu 1/2 is G / 3.
    assert arc_moment(1e-3, 1.0) / 1e-3 == pytest.approx(1.0 / 3.0, rel=1e-5)


def test_the_exact_pressure_tends_to_lames():
    inner, outer, grown = 1.0, 1.3, 1e-6
    expected = 4.0 * grown * (1.0 - (inner / outer) ** 3)
    assert sphere_pressure(inner, outer, 1.0 + grown) == pytest.approx(expected, rel=1e-4)


def cantilever(slenderness, everywhere):
    """Sag over that of bending and shear, of a thick strip clamped at one end."""
    length, width, material = 1.0, 0.2, Material(1e9, 0.0)
    wall = slenderness * length

    def flat(s, t):
        return np.stack([length * s, width * t, 0.0 * s], axis=1)

    grid = grid_surface(flat, (24, 4))
    shell = thick_shell(grid.mesh, material, wall, everywhere=everywhere)
    model = thick_exact.ShellModel(
        shell, 'thick', supports=joined(clamp(shell, grid.edge('s0'), X))
    )
    load = thick_exact.surface_load(shell, Z)
    motion = first_order(model, LoadCase((), np.zeros(0), np.zeros(0), dead_load=load))
    moved = shell.surface.limit_positions(motion[: len(model.rest)])[grid.edge('s1'), 2].mean()
    bent = length**4 / (8.0 * material.bending_stiffness(wall))
    sheared = length**2 / (2.0 * thick_exact.shear_stiffness(material, wall))
    return moved / bent, (bent + sheared) / bent


@pytest.mark.parametrize('slenderness', [0.05, 0.3])
def test_a_clamp_holds_the_director_of_a_wall_that_shears(slenderness):
    ours, exact = cantilever(slenderness, everywhere=True)
    assert ours == pytest.approx(exact, rel=4e-3)


def test_a_clamp_far_from_any_shear_is_that_of_a_thin_wall():
    ours, _ = cantilever(0.05, everywhere=False)
    assert ours == pytest.approx(1.0, rel=4e-3)


def test_supports_follow_the_wall_onto_other_pins_and_theories():
    """Shear unknowns are numbered anew under other pins; what is held stays the same vertices."""
    can = load_object('half_soda_can')
    can = replace(can, supports=(replace(can.supports[0], kind='clamped'), *can.supports[1:]))
    model = build_model(can, 'thick', control_vertices=150)
    near = model.held
    wide = thick_shell(model.shell.mesh, model.shell.material, model.shell.wall, everywhere=True)
    count = len(model.rest)
    assert near.nodes.max() < count
    everywhere = model.supports.on(wide)
    held = everywhere.nodes[everywhere.nodes >= count]
    assert set(wide.sheared[held - count]) <= set(
        model.supports.nodes[model.supports.nodes < count]
    )
    thin = model.with_theory('koiter', shell=discretise(wide.mesh, wide.material, wide.wall))
    assert thin.held.nodes.max() < count


def test_a_plane_of_symmetry_keeps_the_director_in_it():
    """Half a strip between two symmetric planes, loaded: the director does not leave them."""
    length, wall, material = 1.0, 0.2, Material(1e9, 0.3)

    def flat(s, t):
        return np.stack([length * s, length * t, 0.0 * s], axis=1)

    grid = grid_surface(flat, (8, 8))
    shell = thick_shell(grid.mesh, material, wall, everywhere=True)
    parts = [*symmetry(shell, grid.edge('s0'), X), *symmetry(shell, grid.edge('t0'), Y)]
    parts += [hold_position(shell, grid.edge('s1'), Z[None])]
    model = thick_exact.ShellModel(shell, 'thick', supports=joined(parts))
    load = thick_exact.surface_load(shell, Z)
    motion = first_order(model, LoadCase((), np.zeros(0), np.zeros(0), dead_load=load))
    stretch = np.abs(model.held.stretch(motion)).max()
    assert stretch < 1e-3 * np.abs(motion).max()
