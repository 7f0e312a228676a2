# SPDX-License-Identifier: Apache-2.0
"""A zero that steps on an emulated hand: adopted where nothing can touch, in doubt, no lock."""

import numpy as np
import pytest

from barrett_hand_bridge.contacts import FLAG_CONTACT
from barrett_hand_bridge.trial import Trial


def tared(seed):
    trial = Trial(seed)
    assert trial.tare() == ''
    return trial


def step(trial, counts):
    for gauge in trial.mechanics.gauges.values():
        gauge._walk += counts


def close_slowly(trial, force_n):
    for finger in (1, 2):
        trial.mechanics.motors[finger].drive(200.0)
    while trial.mechanics.truth(1).force_n < force_n:
        trial.observer.observe(trial.sample(0.005))
    for finger in (1, 2):
        trial.mechanics.motors[finger].stop()


def watch(trial, seconds):
    for _ in range(round(5 * seconds)):
        trial.mechanics.rest(0.2)
        observation = trial.observer.observe(trial.sample(0.0))
    return observation


def force(reading):
    return float(reading.contact.force @ reading.contact.normal)


@pytest.mark.parametrize('seed', [903, 905, 908])
@pytest.mark.parametrize('counts', [1.5, 3.0, -3.0, -8.0])
def test_a_free_hand_is_usable_within_five_seconds_of_a_step(seed, counts):
    trial = tared(seed)
    watch(trial, 2)
    step(trial, counts)
    observation = watch(trial, 5)
    for reading in observation.fingers.values():
        assert not reading.contact.flags & FLAG_CONTACT
        assert abs(force(reading)) < 3 * 0.12
        # Up, a load that came by itself would look the same: the sigma holds the step.
        doubt = max(counts, 0.0)
        assert reading.zero_doubt_counts == pytest.approx(doubt, abs=1.0)
        assert reading.contact.sigma_normal_n > 0.12 * doubt


@pytest.mark.parametrize('counts', [3.0, 8.0])
def test_tare_passes_after_a_step_on_a_free_hand_and_says_its_doubt(counts):
    trial = tared(903)
    watch(trial, 2)
    step(trial, counts)
    watch(trial, 10)
    assert trial.tare() == ''
    assert trial.observer.zeros[1].doubt_counts == pytest.approx(counts, abs=0.6)


def test_opening_the_hand_ends_the_doubt():
    trial = tared(903)
    watch(trial, 2)
    step(trial, 3.0)
    watch(trial, 5)
    trial.mechanics.place({finger: trial.open[finger] - 1500.0 for finger in (1, 2)})
    observation = watch(trial, 5)
    assert observation.fingers[1].zero_doubt_counts == 0.0
    assert abs(force(observation.fingers[1])) < 3 * observation.fingers[1].contact.sigma_normal_n


def test_a_step_while_the_hand_holds_something_heals_after_it_has_opened():
    trial = tared(905)
    close_slowly(trial, 3.0)
    watch(trial, 2)
    step(trial, 3.0)
    assert watch(trial, 5).fingers[1].contact.flags & FLAG_CONTACT
    trial.mechanics.place(trial.open)
    reading = watch(trial, 6).fingers[1]
    assert not reading.contact.flags & FLAG_CONTACT
    assert abs(force(reading)) < 2 * reading.contact.sigma_normal_n


def test_a_light_grasp_is_never_taken_for_a_step():
    trial = tared(908)
    watch(trial, 2)
    close_slowly(trial, 0.8)
    observation = watch(trial, 60)
    for finger in (1, 2):
        reading = observation.fingers[finger]
        assert reading.contact.flags & FLAG_CONTACT
        assert reading.zero_doubt_counts == 0.0
        true = trial.mechanics.truth(finger).force_n
        assert force(reading) == pytest.approx(true, abs=3 * reading.contact.sigma_normal_n)


def test_a_first_tare_under_the_load_of_the_can_is_refused_or_in_doubt():
    for seed in (903, 905, 908):
        trial = Trial(seed)
        trial.mechanics.close_to_force(0.98, (1, 2))
        if trial.tare():
            continue
        reading = watch(trial, 5).fingers[1]
        assert abs(force(reading) - 0.98) < 2 * reading.contact.sigma_normal_n


def test_a_tare_as_the_first_call_takes_the_weight_from_its_own_samples():
    trial = Trial(903)
    trial.observer.forget_zeros()
    trial.observer._weight_nm = dict.fromkeys((1, 2, 3), 0.0)
    trial.tare()
    forces = [
        [force(r) for r in trial.observer.observe(trial.sample()).fingers.values()]
        for _ in range(100)
    ]
    assert np.abs(np.mean(forces, axis=0)).max() < 0.05


def test_the_weight_of_the_taring_pose_is_taken_off_everywhere_else():
    trial = Trial(903)
    trial.mechanics.place({1: 500.0, 2: 500.0})
    assert trial.tare() == ''
    trial.mechanics.place(trial.open)
    forces = [force(trial.observer.observe(trial.sample()).fingers[1]) for _ in range(100)]
    # Between these poses the weight of the link moves the reading by 0.03 N m, 0.5 N.
    assert abs(np.mean(forces)) < 0.15
