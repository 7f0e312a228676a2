# SPDX-License-Identifier: Apache-2.0
"""What a replay sends and when, decided without ROS and without clocks."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from bag_samples import write_strings
from hypothesis import given
from hypothesis import strategies as st

from grasp_replay.bag import Topic
from grasp_replay.bag_reader import open_bag
from grasp_replay.errors import BagError
from grasp_replay.qos import QosProfile
from grasp_replay.replay_core import (
    Choice,
    Control,
    Pace,
    Tally,
    Verdict,
    check_rate,
    large_topics,
    latched_before,
    parse_remap,
    refusal,
)
from grasp_replay.topic_selection import TopicSelection

SECOND = 1_000_000_000


def _choose(directory: Path, choice: Choice) -> list[int]:
    write_strings(directory, [('/x', (100 + i) * SECOND, str(i)) for i in range(10)])
    with open_bag(directory) as bag:
        return [
            message.log_time // SECOND - 100
            for message in bag.messages(choice.topics(bag), *choice.span(bag))
        ]


def test_the_start_offset_is_counted_from_the_first_message(tmp_path: Path) -> None:
    assert _choose(tmp_path / 'bag', Choice(start_offset=7.0)) == [7, 8, 9]


def test_the_duration_is_counted_from_the_offset_and_includes_its_end(tmp_path: Path) -> None:
    assert _choose(tmp_path / 'bag', Choice(start_offset=2.0, duration=3.0)) == [2, 3, 4, 5]


def test_a_span_ends_a_nanosecond_behind_its_last_message(tmp_path: Path) -> None:
    write_strings(tmp_path / 'bag', [('/x', (100 + i) * SECOND, str(i)) for i in range(10)])
    with open_bag(tmp_path / 'bag') as bag:
        assert Choice().span(bag) == (100 * SECOND, 109 * SECOND + 1)
        assert Choice(start_offset=2.0, duration=3.0).span(bag) == (102 * SECOND, 105 * SECOND + 1)
        assert Choice(until=4.0).span(bag) == (100 * SECOND, 104 * SECOND + 1)


def test_until_is_counted_from_the_first_message(tmp_path: Path) -> None:
    assert _choose(tmp_path / 'bag', Choice(start_offset=2.0, until=3.0)) == [2, 3]


def test_an_offset_behind_the_end_is_refused_with_the_length(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r'nothing between 20\.0 s .* lasts 9\.000 s'):
        _choose(tmp_path / 'bag', Choice(start_offset=20.0))


def test_without_a_choice_hidden_topics_stay_out() -> None:
    selection = TopicSelection(everything=True)
    assert selection.accepts('/hand/contacts')
    assert not selection.accepts('/hand/_internal')


def test_a_named_topic_is_accepted_with_and_without_its_slash() -> None:
    assert TopicSelection(topics=('hand/contacts',)).accepts('/hand/contacts')
    assert not TopicSelection(topics=('hand/contacts',)).accepts('/hand/contacts/more')


def test_a_pattern_must_match_the_whole_name() -> None:
    selection = TopicSelection(regex='/hand/.*')
    assert selection.accepts('/hand/contacts')
    assert not selection.accepts('/left/hand/contacts')


def test_exceptions_win() -> None:
    assert not TopicSelection(topics=('/x',), exclude_topics=('x',)).accepts('/x')
    assert not TopicSelection(everything=True, exclude_regex='/sc.*').accepts('/scan/points')


def test_remapping_renames_what_is_sent() -> None:
    choice = Choice(remap=parse_remap(['hand/contacts:=/left/contacts']))
    assert choice.published_name('/hand/contacts') == '/left/contacts'
    assert choice.published_name('hand/other') == '/hand/other'


@pytest.mark.parametrize('rule', ['a=b', ':=b', 'a:=', ''])
def test_a_malformed_remapping_is_refused(rule: str) -> None:
    with pytest.raises(BagError, match='not of the form old:=new'):
        parse_remap([rule])


def test_service_events_and_foreign_serialisations_are_not_sent() -> None:
    event = Topic('/add/_service_event', 'a/srv/B_Event', 1, 'cdr', '', '', '', '')
    assert 'events of a service' in (refusal(event) or '')
    assert "'json', not cdr" in (refusal(Topic('/x', 'a/msg/B', 1, 'json', '', '', '', '')) or '')
    assert refusal(Topic('/x', 'a/msg/B', 1, 'cdr', '', '', '', '')) is None


@pytest.mark.parametrize('rate', [0.0, -1.0, math.nan, math.inf, 1001.0])
def test_an_impossible_rate_is_refused(rate: float) -> None:
    with pytest.raises(BagError, match='is not in'):
        check_rate(rate)


def test_bag_time_runs_at_the_rate() -> None:
    pace = Pace(0, now=10.0, rate=4.0)
    assert pace.bag_time(12.0) == 8 * SECOND
    assert pace.wait(10 * SECOND, 12.0) == pytest.approx(0.5)


def test_a_change_of_rate_keeps_the_place() -> None:
    pace = Pace(0, now=0.0, rate=1.0)
    pace.set_rate(10.0, now=5.0)
    assert pace.bag_time(5.0) == 5 * SECOND
    assert pace.bag_time(6.0) == 15 * SECOND


def test_a_pause_costs_no_bag_time() -> None:
    pace = Pace(0, now=0.0)
    pace.pause(3.0)
    assert pace.wait(4 * SECOND, 50.0) == math.inf
    pace.resume(100.0)
    assert pace.wait(4 * SECOND, 100.0) == pytest.approx(1.0)


@given(
    st.lists(
        st.tuples(st.sampled_from(['pause', 'resume', 'rate']), st.floats(0.0, 5.0)), max_size=20
    )
)
def test_bag_time_never_runs_backwards(commands: list[tuple[str, float]]) -> None:
    pace, now, last = Pace(0, now=0.0), 0.0, 0
    for command, gap in commands:
        now += gap
        if command == 'pause':
            pace.pause(now)
        elif command == 'resume':
            pace.resume(now)
        else:
            pace.set_rate(0.1 + gap, now)
        assert pace.bag_time(now) >= last
        last = pace.bag_time(now)


def test_a_message_is_sent_when_due_and_its_lateness_told() -> None:
    control = Control(Pace(0, now=0.0))
    assert control.judge(2 * SECOND, 1.5) == (Verdict.WAIT, 0.5)
    assert control.judge(2 * SECOND, 2.25) == (Verdict.SEND, -0.25)


def test_a_step_lets_one_message_pass_and_moves_the_bag_time_there() -> None:
    control = Control(Pace(0, now=0.0, paused=True))
    assert control.step()
    assert control.judge(2 * SECOND, 1.0)[0] is Verdict.SEND
    assert control.judge(3 * SECOND, 1.0) == (Verdict.WAIT, math.inf)
    assert control.pace.bag_time(99.0) == 2 * SECOND


def test_a_step_while_running_is_refused() -> None:
    assert not Control(Pace(0, now=0.0)).step()


def test_stop_wins() -> None:
    control = Control(Pace(0, now=0.0))
    control.stopped = True
    assert control.judge(0, 5.0)[0] is Verdict.STOP


def test_the_tally_counts_sent_late_and_quantiles() -> None:
    tally = Tally(late_after=0.005)
    for index in range(1000):
        tally.add('/a', 0.001 if index < 990 else 0.01)
    tally.add('/b', None)
    assert (tally.total, tally.late) == (1001, 10)
    assert tally.quantile(0.5) == pytest.approx(0.001, rel=0.03)
    assert tally.quantile(0.999) == pytest.approx(0.01, rel=0.03)
    assert tally.report()['topics'] == {'/a': 1000, '/b': 1}


def test_an_empty_tally_reports_zeros() -> None:
    assert Tally(0.005).report()['lateness_p99_s'] == 0.0


LATCHED = QosProfile(depth=1, durability='transient_local')


def _latched_bag(directory: Path, publishers: int) -> Path:
    messages = [('/x' if i % 2 else '/map', i * SECOND, str(i)) for i in range(10)]
    return write_strings(directory, messages, qos={'/map': [LATCHED] * publishers})


@pytest.mark.parametrize(('publishers', 'expected'), [(1, [6]), (3, [2, 4, 6])])
def test_what_is_latched_at_a_place_is_the_last_message_of_each_publisher(
    tmp_path: Path, publishers: int, expected: list[int]
) -> None:
    with open_bag(_latched_bag(tmp_path / 'bag', publishers)) as bag:
        found = latched_before(bag, ['/x', '/map'], 7 * SECOND)
        assert [message.log_time // SECOND for message in found] == expected


def test_nothing_is_latched_before_the_first_message(tmp_path: Path) -> None:
    with open_bag(_latched_bag(tmp_path / 'bag', 1)) as bag:
        assert latched_before(bag, ['/x', '/map'], bag.start) == []


def test_topics_with_large_messages_are_told_apart(tmp_path: Path) -> None:
    messages = [('/small', 0, 'x'), ('/cloud', 1, 'x' * 10**6), ('/small', 2, 'x')]
    with open_bag(write_strings(tmp_path / 'bag', messages)) as bag:
        assert large_topics(bag, ['/small', '/cloud']) == {'/cloud'}


def test_a_topic_that_begins_late_in_a_large_bag_counts_as_large(tmp_path: Path) -> None:
    messages = [('/cloud', i, 'x' * 2**20) for i in range(66)] + [('/late', 100, 'x')]
    with open_bag(write_strings(tmp_path / 'bag', messages)) as bag:
        assert large_topics(bag, ['/late', '/cloud']) == {'/late', '/cloud'}


def test_a_wish_to_jump_goes_before_the_next_message() -> None:
    control = Control(Pace(0, now=0.0))
    control.target = 5 * SECOND
    assert control.judge(0, now=1.0) == (Verdict.SEEK, 0.0)
    assert control.place(now=1.0) == 5 * SECOND
    control.target = None
    assert control.place(now=1.0) == SECOND
