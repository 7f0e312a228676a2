# SPDX-License-Identifier: Apache-2.0
"""Strain measures: derivatives, invariance, and the paper's own formulas."""

import numpy as np
import pytest

from shell_deform.theory import THEORIES, kernels
from shell_deform.theory.reference import reference_points

RANDOM = np.random.default_rng(7)


def random_points(count=6):
    """Reference points with random curvature in random frames, and strongly deformed states."""
    frames = np.linalg.qr(RANDOM.normal(size=(count, 3, 3)))[0]
    frames *= np.linalg.det(frames)[:, None, None]
    second = RANDOM.normal(size=(count, 3, 3))
    rest = np.concatenate([frames[:, :2], second], axis=1)
    q = rest + 0.4 * RANDOM.normal(size=rest.shape)
    return reference_points(rest, np.ones(count)), q


@pytest.mark.parametrize('name', THEORIES)
def test_strain_jacobian_is_the_complex_step_derivative(name):
    reference, q = random_points()
    jac = THEORIES[name].jacobian(q, reference)
    for a in range(5):
        for i in range(3):
            step = q.astype(complex)
            step[:, a, i] += 1e-30j
            numeric = THEORIES[name].strains(step, reference).imag / 1e-30
            np.testing.assert_allclose(jac[:, :, a, i], numeric, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('name', THEORIES)
def test_strain_hessian_is_the_derivative_of_the_jacobian(name):
    reference, q = random_points()
    stress = RANDOM.normal(size=(len(q), 6))
    hessian = THEORIES[name].hessian(q, reference, stress)
    step = 1e-6
    for a in range(5):
        for i in range(3):
            shift = np.zeros_like(q)
            shift[:, a, i] = step
            change = (
                THEORIES[name].jacobian(q + shift, reference)
                - THEORIES[name].jacobian(q - shift, reference)
            ) / (2 * step)
            numeric = np.einsum('pk,pkbj->pbj', stress, change)
            np.testing.assert_allclose(hessian[:, a, i], numeric, rtol=2e-7, atol=2e-7)


@pytest.mark.parametrize('name', THEORIES)
def test_compiled_kernels_equal_their_numpy_twins(name):
    reference, q = random_points()
    theory = THEORIES[name]
    stiff = RANDOM.normal(size=(2, 3, 3))
    stiff = stiff + np.swapaxes(stiff, 1, 2)
    strains, jacobians = theory.strains(q, reference), theory.jacobian(q, reference)
    for p in range(len(q)):
        strain, jac, work = np.empty(6), np.empty((6, 15)), np.empty((6, 3))
        kernels.point_strains(
            theory.code,
            q[p],
            reference.tangents[p],
            reference.second[p],
            reference.curvature[p],
            strain,
            jac,
            work,
        )
        np.testing.assert_allclose(strain, strains[p], rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(jac.reshape(6, 5, 3), jacobians[p], rtol=1e-12, atol=1e-13)
        stress = np.empty(6)
        energy = kernels.point_stress(strain, stiff[0], stiff[1], stress)
        assert energy == pytest.approx(0.5 * strain @ stress)
        hessian = np.zeros((15, 15))
        kernels.add_point_hessian(theory.code, q[p], stress, work, np.empty((7, 3)), hessian)
        expected = theory.hessian(q[p : p + 1], _one(reference, p), stress[None])[0]
        np.testing.assert_allclose(hessian, expected.reshape(15, 15), rtol=1e-11, atol=1e-11)


def _one(reference, p):
    return reference_points(reference.derivatives[p : p + 1], reference.area[p : p + 1])


def rotation(angle, axis=(0.3, -0.5, 0.8)):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    k = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


@pytest.mark.parametrize('angle', [0.02, 1.0, np.pi])
@pytest.mark.parametrize('name', ['koiter', 'paper_restored'])
def test_rigid_rotation_strains_nothing(name, angle):
    reference, _ = random_points()
    turned = reference.derivatives @ rotation(angle)
    assert np.abs(THEORIES[name].strains(turned, reference)).max() < 1e-14 * 50


def test_printed_bending_measure_is_strained_by_rotation_and_the_dropped_terms_are_the_reason():
    reference, _ = random_points()
    turned = reference.derivatives @ rotation(np.pi / 3)
    printed = THEORIES['paper'].strains(turned, reference)
    assert np.abs(printed[:, :3]).max() < 1e-14
    assert np.abs(printed[:, 3:]).max() > 0.1


def test_printed_twist_feels_even_a_small_rotation_about_the_normal_unless_curvatures_are_equal():
    reference, _ = random_points()
    angle = 1e-6
    for p in range(len(reference.area)):
        point = _one(reference, p)
        turned = point.derivatives @ rotation(angle, point.normal[0])
        b_11, b_12, b_22 = point.curvature[0]
        bending = THEORIES['paper'].strains(turned, point)[0, 3:] / angle
        expected = abs(b_11 - b_22)
        assert abs(bending[2]) == pytest.approx(expected, rel=1e-4)
        assert abs(bending[0]) == pytest.approx(abs(b_12), rel=1e-4)


def test_linear_strains_are_the_first_order_part_of_the_papers():
    reference, q = random_points()
    step = 1e-7
    near = reference.derivatives + step * (q - reference.derivatives)
    np.testing.assert_allclose(
        THEORIES['linear'].strains(near, reference) / step,
        THEORIES['paper'].strains(near, reference) / step,
        atol=1e-5,
    )


def test_paper_and_koiter_agree_to_first_order_up_to_membrane_strain_times_curvature():
    reference, q = random_points()
    step = 1e-7
    near = reference.derivatives + step * (q - reference.derivatives)
    koiter = THEORIES['koiter'].strains(near, reference) / step
    paper = THEORIES['paper'].strains(near, reference) / step
    np.testing.assert_allclose(koiter[:, :3], paper[:, :3], atol=1e-5)
    e11, e22, g12 = koiter[:, :3].T
    stretch = (e11 + e22)[:, None] * reference.curvature
    # dropped z-curvature terms: a_i . t_k B_kj - B_ij, to first order
    dq = (near - reference.derivatives) / step
    along = np.einsum('pai,pki->pak', dq[:, :2], reference.tangents)
    b = reference.curvature
    dropped = np.stack(
        [
            along[:, 0, 0] * b[:, 0] + along[:, 0, 1] * b[:, 1],
            along[:, 1, 0] * b[:, 1] + along[:, 1, 1] * b[:, 2],
            along[:, 0, 0] * b[:, 1]
            + along[:, 0, 1] * b[:, 2]
            + along[:, 1, 0] * b[:, 0]
            + along[:, 1, 1] * b[:, 1],
        ],
        axis=1,
    )
    stretch = np.stack([stretch[:, 0], stretch[:, 2], 2 * stretch[:, 1]], axis=1)
    np.testing.assert_allclose(paper[:, 3:], koiter[:, 3:] + stretch - dropped, atol=2e-5)
