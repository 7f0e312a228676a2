# SPDX-License-Identifier: Apache-2.0
"""The reference problems in their short forms, and how fast the answers converge."""

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import sphere_mesh
from numpy.polynomial.legendre import Legendre

from shell_deform.assemble.discretisation import discretise
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import LoadCase, forced
from shell_deform.surface.control_mesh import control_mesh, moved
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import quadrature_basis
from shell_deform.theory.material import Material
from shell_deform.verification import closed_forms, linear_course, snap, spheres, sze
from shell_deform.verification.problem import Verified

from surface_shapes import torus  # isort: skip


def test_scordelis_lo_roof_reaches_the_kirchhoff_love_limit_on_sixteen_cells():
    assert abs(linear_course.scordelis_lo(16).error) < 1e-3


def test_whole_pinched_cylinder_converges_from_below_faster_than_third_order():
    limit = linear_course.references()['linear_obstacle_course']['pinched_cylinder']['value_KL']
    short = [1.0 - linear_course.pinched_cylinder(cells).value / limit for cells in (12, 16)]
    assert 0.0 < short[1] < short[0] * (12 / 16) ** 3


def test_whole_hinged_roof_converges_from_below_and_the_quarter_from_above():
    # edges of symmetry are a little soft, so that a part of a surface is too
    def moved_by(model, load, force):
        case = linear_course.unheld(forced((load,), [force]))
        return float(load.centre @ linear_course.first_order(model, case) @ load.axis)

    whole = [moved_by(*snap.whole_roof(12.7, cells), 1.0) for cells in (16, 24)]
    quarter = []
    for cells in (8, 12):
        model, case = snap.roof(12.7, cells)
        quarter.append(moved_by(model, case.contacts[0], 0.25))
    assert whole[0] < whole[1] < quarter[1] < quarter[0]
    assert quarter[1] - whole[1] > 3.0 * (whole[1] - whole[0])


def test_hinged_roof_carries_the_published_loads_but_for_the_shear_dent():
    depths = snap.THICK_ROOF[:, 1]
    forces = snap.loads_at(*snap.whole_roof(12.7, 16), depths)
    missed = forces / snap.LARGEST_LOAD / snap.THICK_ROOF[:, 0] - 1.0
    # too stiff at first, where a dent under the force counts; not at the limit, where it does not
    assert 0.015 < missed[0] < 0.025 and abs(missed[-1]) < 0.01
    sheared = snap.with_shear_dent(depths, forces, 12.7) / snap.LARGEST_LOAD
    np.testing.assert_allclose(sheared, snap.THICK_ROOF[:, 0], rtol=0.01)


def test_pinched_hemisphere_converges_to_the_published_value():
    coarse, fine = (abs(linear_course.pinched_hemisphere(s).error) for s in (3, 4))
    assert fine < 0.035 and fine < 0.5 * coarse


def test_cantilever_under_end_shear_follows_every_tabulated_load():
    rows = list(sze.cantilever_shear((16, 2)).rows())
    assert len(rows) == 40
    assert all(row.passed for row in rows)


def test_hemisphere_with_a_hole_follows_its_first_loads_with_two_thousand_unknowns():
    curve = sze.hemisphere(loads=2)
    rows = [row for row in curve.rows() if np.isfinite(row.value)]
    assert 3 * curve.vertices <= 2000
    assert len(rows) == 4
    assert all(row.passed for row in rows)


def test_clamped_circular_plates_have_the_exact_deflections():
    assert all(abs(row.error) < 0.01 for row in closed_forms.clamped_plate(12))


def test_slit_tube_carries_the_torque_of_a_thin_open_section():
    assert abs(closed_forms.slit_tube((32, 12)).error) < 0.01


@pytest.mark.parametrize('turn', ['twist', 'bend'])
def test_tube_turned_far_keeps_its_section_but_linear_theory_swells_it(turn):
    ours, linear = (closed_forms.turned_tube(theory, turn) for theory in ('koiter', 'linear'))
    assert abs(ours.error) < 0.01
    assert linear.error > 0.1


def test_pulled_cylinder_misses_only_the_shear_dent_under_the_force():
    curve = sze.pullout((24, 18))
    assert all(row.passed for row in curve.rows(sze.SNAP, unscored_column='W_A'))
    load = curve.fraction
    stiffened = load >= 0.6
    missing = (curve.published[:, 0] - curve.ours[:, 0])[stiffened]
    per_load = missing / load[stiffened]
    assert np.ptp(per_load) < 0.15 * per_load.mean()
    dent = sze.shear_dent(40000.0, 10.5e6, 0.3125, 0.094)
    assert 1.0 < per_load.mean() / dent < 3.0


@pytest.mark.parametrize('case', ['koiter_disc2_nu0.5', 'paper_disc2_nu0.5'])
def test_mission_sphere_follows_the_independent_solution(case):
    rows = list(spheres.mission_sphere(case, rows=3))
    assert len(rows) == 4
    assert all(row.passed for row in rows)


def test_pressurised_sphere_has_the_closed_form_slope():
    assert spheres.pressurised_sphere(2.0).passed


def test_closed_form_of_the_pressurised_slope_joins_reissner_and_the_membrane():
    assert spheres.pressurised_slope_ratio(1e-9) == pytest.approx(1.0, abs=1e-6)
    assert spheres.pressurised_slope_ratio(1.0) == pytest.approx(np.pi / 2)
    near = [spheres.pressurised_slope_ratio(1.0 + step) for step in (-1e-6, 1e-6)]
    assert near[0] == pytest.approx(near[1], rel=1e-5)


def test_an_error_is_signed_and_relative_and_a_row_without_goal_only_informs():
    row = Verified('problem', 'force', -2.0, 'source', -1.9, 10, 0.1, goal=0.04)
    assert row.error == pytest.approx(0.05)
    assert not row.passed
    assert Verified('problem', 'force', 1.0, 'source', 2.0, 10, 0.1).passed


def work_of(mesh, thickness, traction):
    """Work [J] of a smooth dead traction (p, 3) on the linear response of a closed shell."""
    shell = discretise(mesh, Material(1e6, 0.3), thickness)
    values = shell.value_matrix()
    load = values.T @ (shell.weights[:, None] * traction(values @ mesh.vertices))
    case = LoadCase((), np.zeros(0), np.zeros(0), dead_load=load)
    return float(np.sum(load * linear_course.first_order(ShellModel(shell), case)))


def passing_through(mesh, points):
    """The mesh moved so that its limit surface passes through `points` at its vertices."""
    surface = LimitSurface(mesh)
    control = mesh.vertices
    for _ in range(40):
        control = control + points - surface.limit_positions(control)
    return moved(mesh, control)


def test_energy_converges_with_the_fourth_power_of_the_edge_on_regular_meshes():
    def lifted(points):
        angle = np.arctan2(points[:, 1], points[:, 0])
        return np.outer(np.cos(2.0 * angle), [0.0, 0.0, 1.0])

    works = []
    for rows in (12, 18, 24, 36):
        mesh = torus(3 * rows, rows)
        works.append(work_of(passing_through(mesh, mesh.vertices), 0.2, lifted))
    error = np.abs(np.array(works[:3]) / works[3] - 1.0)
    rates = np.log(error[:-1] / error[1:]) / np.log([18 / 12, 24 / 18])
    assert np.all(rates > 4.0)


def test_energy_converges_at_least_quadratically_with_irregular_vertices_that_stay():
    def fourth_harmonic(points):
        normal = points / np.linalg.norm(points, axis=1)[:, None]
        return Legendre.basis(4)(normal[:, 2])[:, None] * normal

    works = [work_of(sphere_mesh(1.0, level), 0.05, fourth_harmonic) for level in (1, 2, 3, 4)]
    steps = np.abs(np.diff(works))
    assert np.all(np.log2(steps[:-1] / steps[1:]) > 2.0)


def irregular_patch(seed=5):
    """A flat hexagonal net with its inner points shaken: the planar patch."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(7.0), np.arange(7.0), indexing='ij')
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    inside = (points[:, :2] > 0.5).all(axis=1) & (points[:, :2] < 5.5).all(axis=1)
    points[inside, :2] += rng.uniform(-0.2, 0.2, size=(int(inside.sum()), 2))
    number = np.arange(49).reshape(7, 7)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    flip = rng.random(36) < 0.5
    one = np.where(flip[:, None], np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    two = np.where(flip[:, None], np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    return control_mesh(points, np.concatenate([one, two]))


@pytest.mark.parametrize('theory', ['koiter', 'paper', 'linear'])
def test_uniform_stretch_of_a_random_irregular_mesh_is_exact(theory):
    mesh = irregular_patch()
    shell = discretise(mesh, Material(1e6, 0.3), 0.1)
    stretch = np.array([[1.0 + 1e-3, 4e-4, 0.0], [2e-4, 1.0 - 5e-4, 0.0], [0.0, 0.0, 1.0]])
    energy = shell.energy(theory, mesh.vertices @ stretch)
    gradient = stretch.T
    if theory == 'linear':
        strain = 0.5 * (gradient + gradient.T) - np.eye(3)
    else:
        strain = 0.5 * (gradient.T @ gradient - np.eye(3))
    e = np.array([strain[0, 0], strain[1, 1], 2.0 * strain[0, 1]])
    exact = 0.5 * 0.1 * shell.area * e @ Material(1e6, 0.3).plane_stress @ e
    assert energy == pytest.approx(exact, rel=1e-9)


def parabola_energy_error(mesh, control):
    """Bending energy of control points over that of the parabola z = x^2 / (2 R), less one."""
    shell = discretise(mesh, Material(1e6, 0.0), 0.1)
    exact = 0.5 * 1e6 * 0.1**3 / 12.0 / BEND_RADIUS**2 * shell.area
    return shell.energy('koiter', control) / exact - 1.0


BEND_RADIUS = 1e5


def test_control_points_on_a_parabola_bend_an_irregular_net_by_a_fifth_too_little():
    # Subdivision reproduces a parabola on a regular net only: at vertices of other valence or
    # shaken places the limit surface of control points on one is flatter.
    mesh = irregular_patch()
    bent = mesh.vertices.copy()
    bent[:, 2] = 0.5 * bent[:, 0] ** 2 / BEND_RADIUS
    assert parabola_energy_error(mesh, bent) == pytest.approx(-0.187, abs=0.01)


def test_the_patch_test_of_bending_is_not_passed_on_an_irregular_net():
    # The limit surface as near to the parabola as the net allows: what is left is the net's own.
    # Loop surfaces of arbitrary connectivity hold all linear, not all quadratic, functions (the
    # curvature at extraordinary vertices is not reproduced): the bending patch test of a shaken
    # net with vertices of valence 4 to 8 misses by 7 % of the energy.
    mesh = irregular_patch()
    basis = quadrature_basis(mesh, 12)
    offsets = basis.node_offsets
    nodes = np.concatenate([basis.nodes[offsets[e] : offsets[e + 1]] for e in basis.element])
    size = (len(basis.parameters), len(mesh.vertices))
    rows = sp.csr_matrix((basis.values, nodes, basis.row_offsets), shape=size).toarray()
    height = 0.5 * (rows @ mesh.vertices[:, 0]) ** 2 / BEND_RADIUS
    bent = mesh.vertices.copy()
    bent[:, 2] = np.linalg.lstsq(rows, height, rcond=None)[0]
    assert np.abs(rows @ bent[:, 2] - height).max() < 3e-3 * height.max()
    assert parabola_energy_error(mesh, bent) == pytest.approx(-0.0705, abs=0.01)


def test_a_path_that_falls_back_is_read_on_its_last_rising_branch():
    path = np.array([[0.0, 0.0], [2.0, 1.0], [1.0, 2.0], [3.0, 4.0]])
    found = sze._at_loads(path, np.array([0.5, 1.5, 2.5, 3.5]))
    assert found[:3, 0] == pytest.approx([0.25, 2.5, 3.5])
    assert np.isnan(found[3, 0])
