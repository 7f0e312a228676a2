# SPDX-License-Identifier: Apache-2.0
"""Young's modulus learned while the object is squeezed."""

import live_hand
import numpy as np
import pytest

from shell_deform.identify.force_curve import ForceCurve
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.modulus import IGNORANCE, ModulusFilter
from shell_deform.live.tick.sample import FLAG_CONTACT, FLAG_SATURATED
from shell_deform.objects import load_object

ERRORS = ErrorModel(drift=0.1, quantum=0.0, mounting=5e-5)
DEPTHS = np.linspace(4e-4, 6e-3, 15)


@pytest.fixture(scope='module')
def curve():
    return ForceCurve(load_object('tennis_ball'), 1e-3, control_vertices=250)


@pytest.fixture(scope='module')
def pipe(curve):
    return live_hand.pipeline(curve.model(curve.shell_object.young_modulus_pa, 0.0), ERRORS)


def squeeze(pipe, modulus, forces, generator, flags=FLAG_CONTACT):
    """One grasp, its gauges' zeros and moments of touch drawn anew."""
    zero, touch = 0.1 * generator.normal(size=2), 5e-5 * generator.normal(size=2)
    pipe.estimator.forget()
    counted = []
    for i, (depth, force) in enumerate(zip(DEPTHS, forces, strict=True)):
        push = force + zero + 0.1 * generator.normal(size=2)
        travel = depth - touch + 2e-5 * generator.normal(size=2)
        sample = live_hand.opposed(
            push, travel, 0.0325, radius=1e-3, sigma_n=0.1, stamp=i + 1, flags=flags
        )
        pipe.tick(sample)
        pipe.refresh()
        pipe.tick(sample)
        estimator = pipe.estimator
        counted.append(
            modulus.update(
                estimator.adopted.response, estimator.posterior.inputs, estimator.measured
            )
        )
    return counted


@pytest.mark.parametrize('ratio', [0.6, 1.0, 1.5])
def test_a_squeeze_finds_the_true_modulus_from_a_wrong_start(curve, pipe, ratio):
    start = curve.shell_object.young_modulus_pa
    modulus = ModulusFilter(start, ERRORS)
    squeeze(pipe, modulus, curve.force(DEPTHS, ratio * start), np.random.default_rng(1))
    found = modulus.estimate
    assert found.value == pytest.approx(ratio * start, rel=0.04)
    assert abs(found.value - ratio * start) < 2.0 * found.sigma
    assert found.sigma < 0.05 * found.value
    assert found.samples > 5


def test_before_a_squeeze_nothing_is_known():
    found = ModulusFilter(10e6, ERRORS).estimate
    assert found.sigma >= IGNORANCE * 10e6 and found.samples == 0


def test_a_standing_grasp_says_nothing_new(curve, pipe):
    start = curve.shell_object.young_modulus_pa
    modulus = ModulusFilter(start, ERRORS)
    squeeze(pipe, modulus, curve.force(DEPTHS, start), np.random.default_rng(2))
    before = modulus.estimate
    estimator = pipe.estimator
    for _ in range(50):
        assert not modulus.update(
            estimator.adopted.response, estimator.posterior.inputs, estimator.measured
        )
    assert modulus.estimate == before


def test_a_second_grasp_keeps_the_modulus_and_forgets_the_zeros(curve, pipe):
    start = curve.shell_object.young_modulus_pa
    modulus = ModulusFilter(start, ERRORS)
    generator = np.random.default_rng(3)
    forces = curve.force(DEPTHS, 1.2 * start)
    squeeze(pipe, modulus, forces, generator)
    first = modulus.estimate
    modulus.release()
    assert modulus.estimate == first
    squeeze(pipe, modulus, forces, generator)
    assert modulus.estimate.samples > first.samples
    assert modulus.estimate.sigma <= first.sigma * (1.0 + 1e-6) + 0.01 * start
    assert modulus.estimate.value == pytest.approx(1.2 * start, rel=0.04)


def test_saturated_gauges_do_not_count(curve, pipe):
    start = curve.shell_object.young_modulus_pa
    modulus = ModulusFilter(start, ERRORS)
    counted = squeeze(
        pipe, modulus, curve.force(DEPTHS, start), np.random.default_rng(4),
        flags=FLAG_CONTACT | FLAG_SATURATED,
    )  # fmt: skip
    assert not any(counted)


def test_a_wild_sample_is_left_out(curve, pipe):
    start = curve.shell_object.young_modulus_pa
    modulus = ModulusFilter(start, ERRORS)
    squeeze(pipe, modulus, curve.force(DEPTHS, start), np.random.default_rng(5))
    before = modulus.estimate
    estimator = pipe.estimator
    wild = estimator.measured._replace(push=estimator.measured.push + 20.0)
    assert not modulus.update(estimator.adopted.response, estimator.posterior.inputs, wild)
    assert modulus.estimate == before
