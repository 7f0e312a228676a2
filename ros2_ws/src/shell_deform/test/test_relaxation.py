# SPDX-License-Identifier: Apache-2.0
"""Laws of relaxation: what they say, how they are converted, what they refuse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.theory.relaxation import (
    RelaxationError,
    log_law,
    prony,
    step_of,
    unloaded,
)

RATES = st.floats(0.001, 0.1)
DURATIONS = st.just(0.0) | st.floats(1e-6, 50.0)


@settings(max_examples=30, deadline=None)
@given(rate=RATES, first=st.floats(1e-3, 10.0), decades=st.floats(0.5, 5.0))
def test_a_log_law_is_its_terms_within_the_error_that_it_states(rate, first, decades):
    last = first * 10.0**decades
    law = log_law(rate, first, last)
    times = np.geomspace(first, last, 777)
    missed = np.abs(law(times) - (1.0 - rate * np.log10(times / first))).max()
    assert missed <= law.conversion_error * 1.05 + 1e-12
    assert law.conversion_error < 0.005 * rate


def test_the_modulus_is_that_of_the_time_it_is_stated_for():
    assert float(log_law(0.03, 0.1, 1e3, reference=10.0)(10.0)) == pytest.approx(1.0, abs=1e-12)
    law = prony(np.array([0.2]), np.array([5.0]), reference=5.0, last=50.0)
    assert float(law(5.0)) == pytest.approx(1.0, abs=1e-14)
    fallen = (0.8 + 0.2 * np.exp(-2.0)) / (0.8 + 0.2 * np.exp(-1.0))
    assert float(law(10.0)) == pytest.approx(fallen, rel=1e-14)


@settings(max_examples=50, deadline=None)
@given(pieces=st.lists(st.tuples(DURATIONS, st.floats(-1.0, 2.0)), min_size=1, max_size=8))
def test_ramps_of_any_length_add_up_to_their_closed_form(pieces):
    law = prony(np.array([0.3, 0.1]), np.array([0.7, 20.0]))
    memory, now, exact_parts, end = unloaded(law, 0.0), 0.0, [], 0.0
    for duration, value in pieces:
        step = step_of(law, duration)
        relaxed = step.now * value + memory.held(step)
        memory = memory.after(step, np.asarray(value))
        exact_parts.append((end, duration, value - now))
        now, end = value, end + duration
    exact = law.long_term * now
    for share, time in law.terms:
        for start, duration, change in exact_parts:
            since = end - start - duration
            if duration == 0.0:
                exact += share * change * np.exp(-since / time)
            else:
                ramp = -np.expm1(-duration / time) * time / duration
                exact += share * change * ramp * np.exp(-since / time)
    assert float(relaxed) == pytest.approx(float(exact), abs=1e-11)


def test_a_step_that_is_held_falls_as_the_law_says():
    law = log_law(0.05, 0.1, 1e3)
    memory = unloaded(law, np.zeros(3)).after(step_of(law, 0.0), np.array([1.0, -2.0, 3.0]))
    for time in (0.1, 1.0, 30.0, 900.0):
        step = step_of(law, time)
        held = step.now * memory.elastic + memory.held(step)
        np.testing.assert_allclose(held, float(law(time)) * memory.elastic, rtol=1e-13)


def test_what_a_wall_carried_before_stays():
    law = log_law(0.05, 0.1, 1e3)
    memory = unloaded(law, np.array(4.0))
    for time in (0.0, 1.0, 1e5):
        step = step_of(law, time)
        assert float(step.now * 4.0 + memory.held(step)) == pytest.approx(4.0, rel=1e-14)


def test_beyond_its_range_a_law_is_less_and_less_sure():
    law = log_law(0.03, 0.1, 100.0, sigma=0.001)
    assert float(law.sigma_of(100.0, 10.0)) == pytest.approx(0.001, rel=1e-12)
    assert float(law.sigma_of(1e3, 100.0)) > 0.03
    assert float(law.sigma_of(1e4, 100.0)) > 0.06
    assert law.beyond(100.0) == ''
    assert '1000 s is longer than the 100 s' in law.beyond(1000.0)
    longer = law.covering(1e4)
    assert longer.last == 100.0
    assert float(longer(1e4)) == pytest.approx(1.0 - 0.03 * 5.0, abs=1e-4)


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: log_law(-0.01, 0.1, 10.0), 'relaxation that grows'),
        (lambda: log_law(0.03, 10.0, 1.0), 'the times run back: from 10 s to 1 s'),
        (lambda: log_law(0.03, 0.0, 1.0), 'the first must be|the first above 0'),
        (lambda: log_law(0.3, 0.1, 1e4), 'leaves nothing of the modulus'),
        (lambda: log_law(0.03, 1.0, 10.0, reference=0.5), 'outside 1 s to 10 s'),
        (lambda: log_law(float('nan'), 1.0, 10.0), 'relaxation that grows'),
        (lambda: prony(np.array([0.1, -0.1]), np.array([1.0, 2.0])), 'relaxation that grows'),
        (lambda: prony(np.array([0.1, 0.1]), np.array([2.0, 1.0])), 'the times run back'),
        (lambda: prony(np.array([0.1, 0.1]), np.array([1.0])), '2 shares and 1 times'),
        (lambda: prony(np.array([0.6, 0.4]), np.array([1.0, 2.0])), 'leave nothing'),
        (lambda: step_of(log_law(0.03, 0.1, 10.0), -1.0), 'time runs back'),
    ],
)
def test_a_relaxation_that_cannot_be_is_refused(build, message):
    with pytest.raises(RelaxationError, match=message):
        build()
