# SPDX-License-Identifier: Apache-2.0
"""A grasp of ten minutes on a ball that relaxes, seen through an 8-bit gauge that drifts."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest

from shell_deform.building import build_model, object_contacts
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.hold import LATER_S, ForceMemory, Softening, softening
from shell_deform.live.tick.modulus import ModulusFilter
from shell_deform.objects import load_object
from shell_deform.objects.shell_object import Contact
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.first_touch import first_touch
from shell_deform.solve.hold import TimedSolver
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.relaxation import log_law

DEPTH, RAMP, END = 5e-3, 2.0, 600.0
TIMES = np.concatenate([np.linspace(0.2, RAMP, 10), RAMP + np.geomspace(0.2, END - RAMP, 14)])
COUNT = 0.2
"""A count of the gauge [N]."""
DRIFT = 0.1
"""Counts per root minute."""


def law_of(rate):
    return log_law(rate, 0.1, 1000.0, reference=1.0, sigma=0.1 * rate)


def ball():
    contacts = tuple(Contact((x, 0.0, 0.0), 1e-3, 'pin') for x in (0.0325, -0.0325))
    return replace(load_object('tennis_ball'), contacts=contacts)


@pytest.fixture(scope='module')
def model():
    return build_model(ball(), 'koiter', 250, refine_radius=1e-3)


def true_forces(model, law):
    """Of both pins at `TIMES`, by the full history of the wall: air inside, travel prescribed."""
    contacts = object_contacts(ball(), model)
    solver = EquilibriumSolver(model)
    start, touch = first_touch(solver, contacts)
    timed = TimedSolver(solver, law, displaced(contacts, touch), start)
    now, forces = 0.0, []
    for time in TIMES:
        case = displaced(contacts, touch + DEPTH * min(time / RAMP, 1.0))
        state = timed.to(case, time - now)
        assert state.converged
        forces.append(state.force)
        now = time
    return np.array(forces)


def gauged(forces, generator):
    """Through gauges that drift, with a noise of half a count, in whole counts."""
    steps = np.sqrt(np.diff(TIMES, prepend=0.0) / 60.0)[:, None]
    drift = np.cumsum(DRIFT * steps * generator.normal(size=forces.shape), axis=0)
    counts = forces / COUNT + drift + 0.5 * generator.normal(size=forces.shape)
    return COUNT * np.round(counts)


@pytest.fixture(scope='module', params=[0.01, 0.08])
def held(request, model):
    law = law_of(request.param)
    return law, true_forces(model, law)


def served(model, law, forces, drive, memory=True):
    """Largest error of the served depth in the hold [m], largest contradiction, the modulus."""
    errors = ErrorModel(drive=drive, drift=0.05, quantum=COUNT)
    pipe = live_hand.pipeline(model, errors)
    pipe.estimator.hold = ForceMemory(law) if memory else None
    modulus = ModulusFilter(model_young(), errors)
    worst, strained = 0.0, 0.0
    for time, push in zip(TIMES, forces, strict=True):
        depth = DEPTH * min(time / RAMP, 1.0)
        sample = live_hand.opposed(
            push, [depth, depth], radius=1e-3, sigma_n=0.1, stamp=int(1e9 * time)
        )
        pipe.tick(sample)
        pipe.refresh()
        answer = pipe.tick(sample)
        estimator = pipe.estimator
        modulus.update(estimator.adopted.response, estimator.posterior.inputs, estimator.measured)
        if time >= RAMP:
            worst = max(worst, float(np.abs(answer.displacement.mean() - DEPTH)))
            strained = max(strained, answer.contradiction)
    return worst, strained, modulus.estimate.value


def model_young():
    return load_object('tennis_ball').young_modulus_pa


@pytest.mark.parametrize('drive', ['force', 'fused'])
def test_ten_minutes_of_relaxation_move_the_served_depth_by_less_than_a_tenth(model, held, drive):
    law, forces = held
    depth, _, young = served(model, law, forces, drive)
    assert depth < 1e-4
    assert young == pytest.approx(model_young(), rel=0.02)


def test_a_gauge_of_eight_bits_that_drifts_leaves_it_within_a_tenth(model, held):
    law, forces = held
    read = gauged(forces, np.random.default_rng(11))
    depth, strained, young = served(model, law, read, 'fused')
    assert depth < 1e-4
    assert strained < 3.0
    assert young == pytest.approx(model_young(), rel=0.02)


def test_without_the_law_the_same_forces_are_millimetres_too_shallow(model, held):
    law, forces = held
    depth, _, _ = served(model, law, forces, 'force', memory=False)
    assert depth > (1.0e-3 if law.per_decade == 0.08 else 1e-4)


def _sample(time, push):
    return live_hand.opposed([push, push], [1e-3, 1e-3], stamp=int(1e9 * time), sigma_n=0.05)


def test_the_force_of_later_is_that_of_the_law():
    memory = ForceMemory(law_of(0.03))
    law = memory.law
    for time in (0.0, 1.0, 60.0):
        push = 10.0 * float(law(time))
        elastic = memory.elastic(_sample(1.0 + time, push))
        np.testing.assert_allclose(elastic.push, 10.0, rtol=1e-12)
    later = memory.later()
    assert later[:, 0].tolist() == [1.0, 2.0] * len(LATER_S)
    for row in later:
        assert row[2] == pytest.approx(10.0 * float(law(60.0 + row[1])), rel=1e-6)
    assert (np.diff(later[::2, 3]) > 0.0).all()
    assert later[-1, 3] > 10.0 * 0.03 * 0.5  # an hour is beyond the thousand seconds known


def test_softening_is_that_of_the_energy_along_a_power_of_the_dent():
    """F = c d^n: e goes with d^((n + 1) / 2), whatever the stiffness at rest is."""
    n, c, d = 0.6, 3.0, 0.2
    force, energy = c * d**n, c * d ** (n + 1.0) / (n + 1.0)
    compliance = d / (n * force)
    found = softening(np.array([force]), np.array([[compliance]]), np.array([[0.04]]), energy)
    deeper = c * (1.5 * d) ** n
    strain = force / found.share, deeper / found.at(deeper)
    assert strain[1] / strain[0] == pytest.approx(1.5 ** (0.5 * (n + 1.0)), rel=1e-9)
    assert Softening().at(7.0) == 1.0
    assert (
        softening(np.array([force]), np.array([[compliance]]), np.array([[0.04]]), 0.0).share
        == 1.0
    )


def test_the_same_stamp_is_answered_anew_where_more_is_known_of_the_wall():
    memory = ForceMemory(law_of(0.08))
    memory.elastic(_sample(1.0, 3.0))
    first = memory.elastic(_sample(2.0, 5.0))
    memory.take(Softening(5.0, 0.8, -0.5))
    again = memory.elastic(_sample(2.0, 5.0))
    assert again is not first and memory.elastic(_sample(2.0, 5.0)) is again
    assert (np.abs(again.push - first.push) > 1e-3).all()


def test_a_law_in_the_logarithm_of_time_goes_on_beyond_its_range():
    law = log_law(0.03, 0.01, 100.0)
    for time in (600.0, 3600.0, 9e4):
        assert float(ForceMemory(law).law(time)) == pytest.approx(
            1.0 - 0.03 * np.log10(time / 0.01), abs=1e-4
        )
    assert ForceMemory(law).law.last == law.last


def test_a_finger_that_drops_out_for_a_sample_is_still_in_its_grasp():
    law = law_of(0.08)
    memory = ForceMemory(law)
    for time in (0.0, 1.0, 60.0):
        memory.elastic(_sample(1.0 + time, 10.0 * float(law(time))))
    gone = _sample(61.01, 0.0)
    memory.elastic(gone.rows(np.array([False, True])))
    found = memory.elastic(_sample(61.02, 10.0 * float(law(60.02))))
    np.testing.assert_allclose(found.push, 10.0, rtol=0.05)


def test_a_finger_that_comes_back_begins_another_hold():
    memory = ForceMemory(law_of(0.03))
    memory.elastic(_sample(1.0, 5.0))
    memory.elastic(_sample(31.0, 5.0))
    assert memory.oldest == pytest.approx(30.0)
    memory.elastic(_sample(32.0, 0.0).rows(np.array([False, False])))
    assert memory.oldest == 0.0
    memory.elastic(_sample(40.0, 5.0))
    assert memory.oldest == 0.0


def test_the_same_stamp_is_answered_alike_and_a_late_one_changes_nothing():
    law = law_of(0.03)
    memory = ForceMemory(law)
    memory.elastic(_sample(1.0, 5.0))
    first = memory.elastic(_sample(2.0, 5.0))
    assert memory.elastic(_sample(2.0, 5.0)) is first
    before = memory.later()
    memory.elastic(_sample(1.5, 50.0))
    assert np.array_equal(memory.later(), before)


def test_a_held_sample_costs_a_fraction_of_a_refresh(model):
    import time

    law = law_of(0.03)
    memory = ForceMemory(law)
    began = time.process_time()
    for i in range(500):
        memory.elastic(_sample(1.0 + 0.01 * i, 5.0))
    assert (time.process_time() - began) / 500 < 1e-3
