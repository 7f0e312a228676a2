# SPDX-License-Identifier: Apache-2.0
"""States, sample checks, stamps and poses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_hand import opposed, sample

from shell_deform.live.exchange import MAX_CONTACTS
from shell_deform.live.pose import Pose, PoseError, pose_of, quaternion, rotation_of
from shell_deform.live.tick.estimator import Estimator, Settings
from shell_deform.live.tick.health import Arrival, Figures, Latencies, LossCount, StampWatch
from shell_deform.live.tick.sample import (
    FLAG_CONTACT,
    FLAG_FAULT,
    FLAG_SATURATED,
    FLAG_STALE,
    SampleError,
    check,
    check_served,
    one_row_per_finger,
)
from shell_deform.live.tick.states import LiveState, Watch

PERIOD = 0.01


def fed(watch, count=20, flags=FLAG_CONTACT, start=0.0):
    for i in range(count):
        watch.sample(opposed([1, 1], flags=flags), start + i * PERIOD)
    return start + (count - 1) * PERIOD


def test_there_is_no_hand_before_the_first_sample():
    watch = Watch()
    assert watch.state is LiveState.NO_HAND
    assert watch.look(100.0, True) is LiveState.NO_HAND


@pytest.mark.parametrize(
    ('flags', 'state'),
    [
        (0, LiveState.FREE),
        (FLAG_CONTACT, LiveState.CONTACT),
        (FLAG_CONTACT | FLAG_SATURATED, LiveState.SATURATED),
        (FLAG_SATURATED, LiveState.FREE),
        (FLAG_CONTACT | FLAG_STALE, LiveState.STALE),
        (FLAG_CONTACT | FLAG_STALE | FLAG_FAULT, LiveState.FAULT),
    ],
)
def test_the_flags_of_a_sample_decide_the_state(flags, state):
    watch = Watch()
    fed(watch, flags=flags)
    assert watch.state is state


def test_three_periods_of_silence_are_stale_and_two_are_not():
    watch = Watch(periods=3.0, floor=0.0)
    last = fed(watch)
    assert watch.look(last + 2.5 * PERIOD, True) is LiveState.CONTACT
    assert watch.look(last + 3.5 * PERIOD, True) is LiveState.STALE


def test_a_new_sample_ends_stale_and_the_pause_does_not_count_as_a_period():
    watch = Watch(floor=0.0)
    last = fed(watch)
    watch.look(last + 1.0, True)
    assert watch.sample(opposed([1, 1]), last + 1.0) is LiveState.CONTACT
    assert watch.period == pytest.approx(PERIOD)


def test_a_vanished_publisher_is_no_hand_after_a_second():
    watch = Watch()
    last = fed(watch)
    assert watch.look(last + 0.5, False) is LiveState.STALE
    assert watch.look(last + 1.5, False) is LiveState.NO_HAND


def test_an_unusable_sample_is_a_fault():
    assert Watch().refused(0.0) is LiveState.FAULT


@pytest.mark.parametrize('state', [LiveState.STALE, LiveState.FAULT, LiveState.NO_HAND])
def test_nothing_is_served_when_stale_faulty_or_without_hand(state):
    assert not state.is_served


def test_nan_and_infinity_in_a_touching_row_are_refused_by_name():
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(SampleError, match='finger 2: force'):
            contacts = opposed([1.0, 1.0])
            contacts.force[1, 0] = bad
            check(contacts)


def test_nan_in_a_row_that_does_not_touch_is_of_no_concern():
    contacts = opposed([1.0, np.nan], flags=[FLAG_CONTACT, 0])
    check(contacts)
    assert one_row_per_finger(contacts, 1e-3).finger.tolist() == [1]


def test_a_normal_that_is_no_unit_vector_is_refused():
    with pytest.raises(SampleError, match='length 2'):
        check(sample([[0, 0, 0.03]], [[0, 0, -2.0]], [1.0]))


def test_a_point_in_millimetres_is_refused():
    with pytest.raises(SampleError, match='metres'):
        check(sample([[0, 0, 32.5]], [[0, 0, -1.0]], [1.0]))


@pytest.mark.parametrize(
    ('name', 'value'), [('force', 1e5), ('travel', -1e30), ('travel', 0.5), ('radius', 1e30)]
)
def test_what_no_hand_does_is_refused_by_name(name, value):
    contacts = opposed([1.0, 1.0])
    getattr(contacts, name)[1] = value
    with pytest.raises(SampleError, match=f'finger 2: {name} is'):
        check(contacts)


def test_an_answer_that_is_not_finite_is_not_served():
    packed = np.zeros((4, 8), np.float32)
    check_served(packed)
    packed[2, 3] = np.inf
    with pytest.raises(SampleError, match='not finite'):
        check_served(packed)


def test_an_answer_that_leaves_the_object_is_not_served():
    answer = np.zeros((4, 8), np.float32)
    check_served(answer, 0.02, 0.113)
    with pytest.raises(SampleError, match='by 146 mm, more than the 113 mm'):
        check_served(answer, 0.1456, 0.113)


def test_the_cells_of_one_finger_become_their_resultant():
    cells = sample(
        [[0, 0, 0.03], [0, 2e-3, 0.03], [0, 0, -0.03]],
        [[0, 0, -1.0], [0, 0, -1.0], [0, 0, 1.0]],
        [1.0, 3.0, 4.0],
        fingers=[1, 1, 2],
    )
    merged = one_row_per_finger(cells, 1e-3)
    assert merged.finger.tolist() == [1, 2]
    assert merged.push == pytest.approx([4.0, 4.0])
    assert merged.point[0] == pytest.approx([0, 1.5e-3, 0.03])
    assert merged.radius[0] > cells.radius[0]


def test_missing_radius_becomes_the_default():
    merged = one_row_per_finger(opposed([1, 1], radius=np.nan), 2e-3)
    assert merged.radius == pytest.approx([2e-3, 2e-3])


def arrivals(watch, times, now=None):
    """What a watch says of stamps [s] that arrive at steady times `now` [s], else at their own."""
    return [
        watch.arrived(round(1e9 * stamp), clock)
        for stamp, clock in zip(times, times if now is None else now, strict=True)
    ]


@given(st.lists(st.integers(0, 4), min_size=1, max_size=30))
def test_losses_are_the_gaps_in_the_numbers_of_the_middleware(missing):
    losses, number = LossCount(), 100
    for gap in missing:
        losses.arrived(number)
        number += 1 + gap
    losses.arrived(number)
    losses.settle(publishers=1)
    assert losses.lost == sum(missing)


def test_a_publisher_that_starts_anew_has_lost_nothing():
    losses = LossCount()
    for number in (500, 501, 1, 2, 3):
        losses.arrived(number)
    losses.settle(publishers=1)
    assert losses.lost == 0


def test_losses_of_two_publishers_are_unknown_and_so_are_those_without_numbers():
    several, unnumbered = LossCount(), LossCount()
    for number in (1000, 1, 1001, 2):
        several.arrived(number)
    several.settle(publishers=2)
    unnumbered.arrived(None)
    assert several.lost is None
    assert unnumbered.lost is None


def test_stamps_however_irregular_are_no_losses():
    watch, losses = StampWatch(), LossCount()
    for i, stamp in enumerate([0.0, 0.01, 0.02, 0.2, 0.21, 0.9, 0.901]):
        watch.arrived(round(1e9 * stamp), stamp)
        losses.arrived(i + 1)
    assert losses.lost == 0
    assert watch.samples == 7


def test_the_input_rate_counts_what_came_since_it_was_last_asked():
    figures = Figures()
    figures.arrivals = 20
    figures.input_rate(1.0)
    figures.arrivals += 42
    assert figures.input_rate(3.0) == pytest.approx(21.0)


def test_rows_of_one_finger_that_press_against_each_other_are_refused():
    cells = opposed([5.0, 5.0], fingers=[1, 1])
    with pytest.raises(SampleError, match='finger 1 has 2 rows'):
        one_row_per_finger(cells, 1e-3)


@pytest.mark.parametrize('count', [MAX_CONTACTS + 1, 255])
def test_more_fingers_than_are_solved_for_are_refused_and_none_is_left_out(count):
    estimator = Estimator(np.zeros((4, 3)), np.tile([1.0, 0.0, 0.0], (4, 1)), Settings())
    many = sample(np.zeros((count, 3)), [[1.0, 0.0, 0.0]] * count, np.ones(count))
    with pytest.raises(SampleError, match=f'{count} fingers press at once, at most 8'):
        estimator.tick(many)
    cells = replace(many, finger=many.finger % MAX_CONTACTS)
    assert len(estimator.tick(cells).unknown) == MAX_CONTACTS


def test_samples_that_come_in_bursts_have_the_period_of_their_mean():
    watch, now = Watch(periods=3.0, floor=0.0), 0.0
    for _ in range(200):
        for gap in (0.001, 0.001, 0.098):
            now += gap
            watch.look(now, True)
            watch.sample(opposed([1.0, 1.0]), now)
    assert watch.period == pytest.approx(0.1 / 3.0, rel=0.3)


def test_a_repeated_stamp_is_told_from_a_new_one():
    watch = StampWatch()
    assert arrivals(watch, [1.0, 1.0, 1.01]) == [Arrival.NEXT, Arrival.REPEATED, Arrival.NEXT]
    assert (watch.repeated, watch.samples) == (1, 2)


@given(st.floats(1.001, 1e4), st.floats(1e-3, 0.1), st.integers(2, 30))
def test_a_step_back_of_many_periods_is_a_jump_of_time(back, period, count):
    watch = StampWatch()
    before = [1e5 + i * period for i in range(count)]
    arrivals(watch, before)
    again = before[-1] - back
    assert arrivals(watch, [again], [before[-1] + period]) == [Arrival.JUMPED]
    assert watch.jumps == 1


@given(st.floats(1e-6, 0.9), st.floats(5e-3, 0.1), st.integers(2, 30))
def test_a_step_back_of_a_few_periods_is_a_late_sample_and_time_goes_on(share, period, count):
    watch = StampWatch()
    before = [1e5 + i * period for i in range(count)]
    arrivals(watch, before)
    last = before[-1]
    late = last - share * 10 * period
    times = [late, last + period, last + 2 * period]
    clock = [last + 0.1 * period, last + period, last + 2 * period]
    assert arrivals(watch, times, clock) == [Arrival.LATE, Arrival.NEXT, Arrival.NEXT]
    assert (watch.jumps, watch.late) == (0, 1)


@given(st.floats(1.5, 1e4), st.floats(1e-3, 0.1), st.integers(2, 30))
def test_stamps_that_run_ahead_of_the_steady_clock_are_a_jump(ahead, period, count):
    watch = StampWatch()
    before = [i * period for i in range(count)]
    arrivals(watch, before)
    seek = before[-1] + ahead
    assert arrivals(watch, [seek], [before[-1] + period]) == [Arrival.JUMPED]
    assert watch.jumps == 1
    assert arrivals(watch, [seek + period], [before[-1] + 2 * period]) == [Arrival.NEXT]


@given(st.lists(st.floats(2.0, 1e4), min_size=1, max_size=4), st.floats(1e-3, 0.1))
def test_seeks_forwards_one_sample_after_the_other_are_jumps_and_so_is_the_way_back(seeks, period):
    watch = StampWatch()
    arrivals(watch, [i * period for i in range(10)])
    stamp, now = 9 * period, 9 * period
    for seek in seeks:
        stamp, now = stamp + seek, now + period
        assert arrivals(watch, [stamp], [now]) == [Arrival.JUMPED]
    # whatever was learned meanwhile, a bag that is played again starts anew
    assert arrivals(watch, [period, 2 * period], [now + period, now + 2 * period]) == [
        Arrival.JUMPED,
        Arrival.NEXT,
    ]


def test_a_stream_that_began_with_one_sample_of_another_time_is_still_seen_to_jump():
    watch = StampWatch()
    times = [0.01, 14.01, 14.02, 14.03]
    arrivals(watch, times, [0.0, 0.01, 0.02, 0.03])
    assert arrivals(watch, [0.01, 0.02], [0.04, 0.05]) == [Arrival.JUMPED, Arrival.NEXT]
    assert arrivals(watch, [20.0], [0.06]) == [Arrival.JUMPED]


def test_another_stream_much_slower_and_played_fast_soon_goes_on():
    watch = StampWatch()
    arrivals(watch, [0.01 * i for i in range(30)])
    times = [100.0 + 2.0 * i for i in range(20)]
    slow = arrivals(watch, times, [1.0 + 0.2 * i for i in range(20)])
    assert set(slow[5:]) == {Arrival.NEXT}


@given(st.floats(0.5, 1e4))
def test_a_pause_in_which_both_clocks_go_on_is_no_jump(pause):
    watch = StampWatch()
    times = [0.0, 0.01, 0.02, 0.02 + pause, 0.03 + pause]
    assert set(arrivals(watch, times)) == {Arrival.NEXT}
    assert watch.jumps == 0


@given(pause=st.floats(1.0, 100.0))
def test_a_node_that_catches_up_after_a_pause_sees_no_jump(pause):
    """It takes the samples of the pause at once; they were sent when their stamps say."""
    watch = StampWatch()
    for k in range(20):
        watch.arrived(int(k * PERIOD * 1e9), k * PERIOD)
    later = 20 * PERIOD + pause
    assert watch.arrived(int(later * 1e9), later) is Arrival.NEXT


def test_a_slow_stream_that_is_played_fast_does_not_jump():
    watch = StampWatch()
    stamps = [2.0 * i for i in range(10)]
    assert set(arrivals(watch, stamps, [0.1 * s for s in stamps])) == {Arrival.NEXT}


def test_two_results_for_one_load_case_are_one_refresh():
    figures = Figures()
    for answers in (1, 1, 4, 5, 5):
        figures.refreshed(answers)
    assert figures.refreshes == 3
    assert figures.refresh_rate(2.0) == pytest.approx(1.5)
    assert figures.refresh_rate(3.0) == 0.0


def test_latency_percentiles_are_those_of_the_last_values():
    latencies = Latencies()
    assert latencies.percentile(50) == 0.0
    for value in range(1, 101):
        latencies.add(float(value))
    assert latencies.percentile(50) == pytest.approx(50.5)


vectors = st.tuples(*[st.floats(-3.0, 3.0) for _ in range(3)]).map(np.array)


@given(vectors, vectors)
def test_a_pose_survives_its_numbers(turn, shift):
    pose = Pose(rotation_of(turn), shift)
    again = pose_of(pose.numbers)
    assert again.rotation == pytest.approx(pose.rotation, abs=1e-9)
    assert quaternion(pose.rotation)[3] >= 0.0


@given(vectors, vectors, vectors)
def test_to_and_from_the_object_are_inverse(turn, shift, point):
    pose = Pose(rotation_of(turn), shift)
    assert pose.from_object(pose.to_object(point[None]))[0] == pytest.approx(point, abs=1e-9)


@pytest.mark.parametrize(
    'numbers',
    [
        *([0.0] * 7, [0.0] * 6, [np.nan, 0, 0, 0, 0, 0, 1.0], [0, 0, 0, 0, 0, 0, 2.0]),
        *([0, 0, 0, 1e300, 0, 0, 1e300], [0, 0, 0, 1e-320, 0, 0, 0]),
    ],
)
def test_numbers_that_are_no_pose_are_refused(numbers):
    with pytest.raises(PoseError), np.errstate(over='raise'):
        pose_of(numbers)


def test_what_is_left_of_a_deadline_is_told_and_a_whole_one_after_it():
    watch = Watch(periods=3.0, floor=0.0)
    last = fed(watch)
    assert watch.remaining(last + PERIOD) == pytest.approx(2 * PERIOD)
    assert watch.remaining(last + 50 * PERIOD) == pytest.approx(watch.deadline)
