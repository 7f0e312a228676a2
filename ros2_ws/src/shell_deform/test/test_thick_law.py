# SPDX-License-Identifier: Apache-2.0
"""The wall law of theory `thick` at one point, against closed forms and its own derivatives."""

import numpy as np
import pytest

from shell_deform.theory.thick_law_kernels import (
    WORK_SHAPE,
    eliminate_thickness,
    solve_thickness,
    wall_stress,
)

THICKNESS = 1.0
CURVED = np.array([0.1, 0.02, 0.05])
FLAT = np.zeros(3)


def moduli(poisson):
    """Shear and bulk modulus for a Young's modulus of 1."""
    return 0.5 / (1.0 + poisson), 1.0 / 3.0 / (1.0 - 2.0 * poisson)


def law(strains, curvature, poisson, push=0.0, tilt=0.0):
    """Energy, stresses (12,), tangent (12, 12), thickness numbers (2,)."""
    work, numbers = np.zeros(WORK_SHAPE), np.zeros(2)
    wall = (THICKNESS, *moduli(poisson), push, tilt)
    assert solve_thickness(strains, curvature, *wall, numbers, work)
    stress, tangent = np.zeros(12), np.zeros((14, 14))
    energy = wall_stress(
        True, True, strains, THICKNESS, push, tilt, numbers, stress, tangent, work
    )
    eliminate_thickness(12, tangent, np.zeros((2, 12)))
    return energy, stress, tangent[:12, :12], numbers


def rest(curvature):
    k = np.array([[curvature[0], curvature[1]], [curvature[1], curvature[2]]])
    kk = k @ k
    return np.array([1, 1, 0, k[0, 0], k[1, 1], k[0, 1], kk[0, 0], kk[1, 1], kk[0, 1], 0, 0])


def strained(rng, size):
    """Metric numbers of a random stretch, bending and shear that some surface has."""
    k = np.array([[CURVED[0], CURVED[1]], [CURVED[1], CURVED[2]]])
    f = np.eye(2) + size * rng.normal(size=(2, 2))
    c = 0.5 * (k @ f + f.T @ k) + size * rng.normal(size=(2, 2))
    c = 0.5 * (c + c.T)
    a = f.T @ f
    e = c @ np.linalg.solve(a, c)
    flat = [(m[0, 0], m[1, 1], m[0, 1]) for m in (a, c, e)]
    return np.concatenate([*flat, size * rng.normal(size=2)])


@pytest.mark.parametrize('poisson', [0.0, 0.3, 0.49, 0.4999])
@pytest.mark.parametrize('curvature', [FLAT, CURVED])
def test_the_undeformed_wall_is_free_of_stress_and_as_thick_as_it_was(poisson, curvature):
    energy, stress, _, numbers = law(rest(curvature), curvature, poisson)
    assert abs(energy) < 1e-15
    # A bulk modulus of 1 667 shows what round-off leaves of J - 1.
    assert np.abs(stress).max() < 1e-11
    assert numbers == pytest.approx([1.0, 0.0], abs=1e-12)


@pytest.mark.parametrize('poisson', [0.0, 0.3, 0.49, 0.4999])
def test_a_flat_wall_at_small_strain_is_the_plate_of_reissner(poisson):
    _, _, tangent, _ = law(rest(FLAT), FLAT, poisson)
    plate = THICKNESS / (1.0 - poisson**2)
    shear = moduli(poisson)[0] * THICKNESS
    # a_ab is twice the strain, c_ab the curvature change; 12 components count once each.
    assert tangent[0, 0] == pytest.approx(plate / 4.0, rel=1e-9)
    assert tangent[0, 1] == pytest.approx(plate * poisson / 4.0, rel=1e-9, abs=1e-12)
    assert tangent[2, 2] == pytest.approx(shear, rel=1e-9)
    assert tangent[3, 3] == pytest.approx(plate / 12.0, rel=1e-9)
    assert tangent[3, 4] == pytest.approx(plate * poisson / 12.0, rel=1e-9, abs=1e-12)
    assert tangent[5, 5] == pytest.approx(4.0 * shear / 12.0, rel=1e-9)
    assert tangent[9, 9] == pytest.approx(5.0 / 6.0 * shear, rel=1e-9)
    assert tangent[10, 10] == pytest.approx(5.0 / 6.0 * shear, rel=1e-9)


@pytest.mark.parametrize('push', [0.0, 0.02])
@pytest.mark.parametrize('poisson', [0.3, 0.49])
def test_stress_and_tangent_are_the_derivatives_of_the_energy(poisson, push):
    rng = np.random.default_rng(5)
    step = 1e-5
    for _ in range(5):
        s, tilt = strained(rng, 0.15), 0.9
        count = 12 if push else 11

        def at(shift, s=s, tilt=tilt):
            return law(s + shift[:11], CURVED, poisson, push, tilt + shift[11])

        _, stress, tangent, _ = at(np.zeros(12))
        for i in range(count):
            unit = np.zeros(12)
            unit[i] = step
            above, below = at(unit), at(-unit)
            assert (above[0] - below[0]) / (2 * step) == pytest.approx(stress[i], abs=1e-8)
            difference = (above[1] - below[1]) / (2 * step)
            assert np.abs(difference - tangent[i])[:count].max() < 1e-6 * np.abs(tangent).max()


@pytest.mark.parametrize('stretch', [0.8, 1.3])
def test_a_wall_stretched_both_ways_thins_as_the_neo_hookean_solid_does(stretch):
    poisson = 0.4999
    s = rest(FLAT)
    s[:2] = stretch**2
    _, stress, _, numbers = law(s, FLAT, poisson)
    shear = moduli(poisson)[0]
    assert numbers[0] == pytest.approx(stretch**-2, rel=1e-3)
    assert numbers[1] == pytest.approx(0.0, abs=1e-9)
    # sigma = G (x^2 - x^-4); s_11 is the derivative by a_11 = x^2 of the energy per rest area.
    expected = 0.5 * shear * THICKNESS * (1.0 - stretch**-6)
    assert stress[0] == pytest.approx(expected, rel=1e-3)


def test_a_pressed_face_gives_way_in_proportion_to_small_pressures():
    heights = [law(rest(FLAT), FLAT, 0.3, push, 1.0)[3] @ [0.5, 0.25] for push in (1e-6, 2e-6)]
    sunk = 0.5 - np.array(heights)
    assert sunk[0] > 0.0
    assert sunk[1] == pytest.approx(2.0 * sunk[0], rel=1e-4)


def test_a_wall_folded_onto_itself_has_no_solution_instead_of_a_wrong_one():
    s = rest(FLAT)
    s[:3] = [1.0, 1.0, 1.5]
    wall, work = (THICKNESS, *moduli(0.3), 0.0, 0.0), np.zeros(WORK_SHAPE)
    assert not solve_thickness(s, FLAT, *wall, np.zeros(2), work)
