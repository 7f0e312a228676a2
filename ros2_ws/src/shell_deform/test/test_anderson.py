# SPDX-License-Identifier: Apache-2.0
"""Anderson acceleration: what it finds, and what it keeps."""

import numpy as np
import pytest

from shell_deform.solve.anderson import AndersonMixing


@pytest.fixture
def tangents():
    """A stiffness that differs from the tangent at hand in three directions."""
    random = np.random.default_rng(3)
    tangent = np.diag(random.uniform(1.0, 100.0, 40))
    aside = random.normal(size=(40, 3))
    return tangent + aside @ np.diag([50.0, 200.0, 400.0]) @ aside.T, tangent


def chord(stiffness, tangent, load):
    return lambda x: np.linalg.solve(tangent, load - stiffness @ x)


def test_a_tangent_that_is_wrong_in_three_directions_needs_four_steps_where_plain_chords_diverge(
    tangents,
):
    stiffness, tangent = tangents
    load = np.ones(40)
    step = chord(stiffness, tangent, load)
    truth = np.linalg.solve(stiffness, load)
    plain = np.zeros(40)
    for _ in range(5):
        plain = plain + step(plain)
    mixing, x = AndersonMixing(40), np.zeros(40)
    for _ in range(5):
        x = mixing.next(x, step(x))
    assert np.linalg.norm(plain - truth) > 100.0 * np.linalg.norm(truth)
    np.testing.assert_allclose(x, truth, atol=1e-7 * np.abs(truth).max())


def test_the_first_step_is_the_plain_one():
    mixing = AndersonMixing(2)
    assert mixing.next(np.array([1.0, 2.0]), np.array([0.5, -1.0])).tolist() == [1.5, 1.0]


def test_a_condition_that_all_iterates_fulfil_stays_fulfilled(tangents):
    stiffness, tangent = tangents
    step = chord(stiffness, tangent, np.ones(40))
    row = np.random.default_rng(5).normal(size=40)
    mixing, x = AndersonMixing(40), np.zeros(40)
    for _ in range(4):
        moved = step(x)
        # like a prescribed displacement: every step closes what is still missing
        moved += row * (2.0 - row @ (x + moved)) / (row @ row)
        x = mixing.next(x, moved)
        assert row @ x == pytest.approx(2.0)


def test_what_was_forgotten_does_not_count():
    mixing = AndersonMixing(1)
    mixing.next(np.array([0.0]), np.array([1.0]))
    mixing.forget()
    assert mixing.next(np.array([5.0]), np.array([0.25])) == 5.25


def test_only_the_measured_numbers_tell_how_long_a_step_is():
    mixing = AndersonMixing(1)
    mixing.next(np.array([0.0, 0.0]), np.array([1.0, 1e6]))
    found = mixing.next(np.array([1.0, 1e6]), np.array([0.5, 1e6]))
    # the first number halves its step each time: it ends at 2
    assert found[0] == pytest.approx(2.0)
