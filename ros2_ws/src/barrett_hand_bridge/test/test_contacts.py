# SPDX-License-Identifier: Apache-2.0
"""Contacts: force from torque, first touch, travel, normals, flags."""

import math

import numpy as np
import pytest

from barrett_hand_bridge.contacts import (
    TouchSettings,
    TouchTracker,
    normal_force,
    opposed_normals,
)


def test_force_is_torque_over_arm():
    force = normal_force(0.5, 0.01, 0.05, 0.0)
    assert force.force_n == pytest.approx(10.0)
    assert force.sigma_n == pytest.approx(0.2)


def test_an_uncertain_arm_adds_to_the_sigma_in_proportion_to_the_force():
    assert normal_force(0.5, 0.0, 0.05, 0.001).sigma_n == pytest.approx(0.2)


def test_without_an_arm_nothing_is_known_of_the_force():
    assert normal_force(0.5, 0.01, 0.001, 0.0).sigma_n == math.inf


def test_opposed_normals_point_at_each_other():
    first, second = opposed_normals(np.zeros(3), np.array([0.0, 0.0, 2.0]))
    assert first.tolist() == [0.0, 0.0, 1.0]
    assert second.tolist() == [0.0, 0.0, -1.0]


NORMAL = np.array([1.0, 0.0, 0.0])


def approach(tracker, stiffness=4000.0, step=2e-5, samples=100, noise=0.1, touch=1e-3, seed=0):
    generator = np.random.default_rng(seed)
    for i in range(samples):
        x = i * step
        force = max(stiffness * (x - touch), 0.0) + noise * generator.standard_normal()
        tracker.update(np.array([x, 0.0, 0.0]), force, noise)
    return np.array([(samples - 1) * step, 0.0, 0.0])


def test_travel_counts_from_the_first_touch_not_from_its_detection():
    errors = []
    for seed in range(20):
        tracker = TouchTracker(TouchSettings())
        end = approach(tracker, seed=seed)
        travel, sigma = tracker.travel(end, NORMAL)
        errors.append((travel - 0.98e-3, sigma))
    assert abs(np.mean([error for error, _ in errors])) < 5e-5
    assert all(abs(error) < 3 * sigma + 1e-5 for error, sigma in errors)


def test_noise_alone_is_no_touch():
    tracker = TouchTracker(TouchSettings())
    generator = np.random.default_rng(5)
    touches = [
        tracker.update(np.zeros(3), 0.1 * generator.standard_normal(), 0.1) for _ in range(5000)
    ]
    assert not any(touches)


def test_release_ends_the_touch_and_its_travel():
    tracker = TouchTracker(TouchSettings())
    end = approach(tracker)
    assert tracker.touching
    for _ in range(20):
        tracker.update(end, 0.0, 0.1)
    assert not tracker.touching
    assert tracker.travel(end, NORMAL) == (0.0, 0.0)


def test_a_single_low_reading_does_not_end_the_touch():
    tracker = TouchTracker(TouchSettings())
    end = approach(tracker)
    tracker.update(end, 0.0, 0.1)
    assert tracker.touching


def test_a_touch_begins_above_four_sigma_and_ends_below_two():
    def touches(sigmas, begun):
        tracker = TouchTracker(TouchSettings())
        if begun:
            approach(tracker)
        for _ in range(20):
            tracker.update(np.zeros(3), 0.1 * sigmas, 0.1)
        return tracker.touching

    assert [touches(sigmas, begun=False) for sigmas in (3.9, 4.1)] == [False, True]
    assert [touches(sigmas, begun=True) for sigmas in (1.9, 2.1)] == [False, True]
