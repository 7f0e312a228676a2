# SPDX-License-Identifier: Apache-2.0
"""The course of a replay on a stage without ROS."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from bag_samples import write_strings

from grasp_replay.bag import Message
from grasp_replay.bag_reader import open_bag
from grasp_replay.errors import BagError
from grasp_replay.lockstep import Lockstep, LockstepRule, parse_rule
from grasp_replay.player import SETTLE_SECONDS, Player
from grasp_replay.qos import QosProfile
from grasp_replay.read_ahead import ReadAhead
from grasp_replay.replay_core import Choice, Control, Pace
from grasp_replay.replay_options import ReplayOptions, parse_options

MILLISECOND = 1_000_000


class FakeStage:
    """Notes what is sent; `on_send` may act as the nodes or the user would."""

    def __init__(self, rate: float = 1000.0, paused: bool = False) -> None:
        self.control = Control(Pace(0, 0.0, rate, paused))
        self.changed = threading.Condition()
        self.log: list[tuple[str, int]] = []
        self.deaf: set[str] = set()
        self.refuse = False
        self.on_send = lambda _message: None
        self.names = {'/x': '/sent/x', '/y': '/sent/y'}

    @property
    def senders(self) -> FakeStage:
        return self

    def unmatched(self) -> set[str]:
        return self.deaf

    def send(self, message: Message) -> bool:
        self.log.append((message.topic, message.log_time // MILLISECOND))
        self.on_send(message)
        return not self.refuse

    def send_clock(self, nanoseconds: int) -> None:
        self.log.append(('clock', nanoseconds // MILLISECOND))

    def unacknowledged(self, seconds: float) -> list[str]:
        return []

    def alive(self) -> bool:
        return True


def _play(tmp_path: Path, stage: FakeStage, lockstep: Lockstep | None = None, **options) -> Player:  # type: ignore[no-untyped-def]
    path = tmp_path / 'bag'
    write_strings(
        path,
        [('/xy'[0] + 'xy'[i % 2], i * 5 * MILLISECOND, str(i)) for i in range(6)],
        qos={'/y': [QosProfile(durability='transient_local')]},
    )
    with open_bag(path) as bag:
        player = Player(stage, bag, ReplayOptions(path, wait=0.0, **options), lockstep)
        player.wait_for_listeners()
        player.run(lambda _share, _note: None)
        player.finish()
    return player


@pytest.mark.parametrize(
    ('wait', 'deaf', 'settles'),
    [(0.0, set(), 0), (0.0, {'/x'}, 0), (1e-9, {'/x'}, 1), (1e-9, {'/x', '/y'}, 0)],
)
def test_who_has_just_come_is_given_a_moment_and_nobody_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wait: float, deaf: set[str], settles: int
) -> None:
    stage, pauses = FakeStage(), []
    stage.deaf = deaf
    write_strings(tmp_path / 'bag', [('/x', 0, 'a'), ('/y', 1, 'b')])
    monkeypatch.setattr('grasp_replay.player.time.sleep', pauses.append)
    with open_bag(tmp_path / 'bag') as bag:
        player = Player(stage, bag, ReplayOptions(tmp_path / 'bag', wait=wait))
        assert player.wait_for_listeners() == sorted(stage.names[name] for name in deaf)
    assert pauses.count(SETTLE_SECONDS) == settles


def test_all_messages_are_sent_in_order(tmp_path: Path) -> None:
    stage = FakeStage()
    player = _play(tmp_path, stage)
    assert stage.log == [('/x', 0), ('/y', 5), ('/x', 10), ('/y', 15), ('/x', 20), ('/y', 25)]
    assert player.tally.total == 6


def test_the_clock_comes_before_the_message_it_stamps(tmp_path: Path) -> None:
    stage = FakeStage(rate=1.0)
    _play(tmp_path, stage, clock=1000.0)
    for index, (topic, time) in enumerate(stage.log):
        if topic != 'clock':
            assert ('clock', time) in stage.log[:index]
    clocks = [time for topic, time in stage.log if topic == 'clock']
    assert clocks == sorted(clocks)


def test_a_loop_begins_again_until_stopped(tmp_path: Path) -> None:
    stage = FakeStage()

    def stop_after_two(_message: Message) -> None:
        stage.control.stopped = len(stage.log) >= 12

    stage.on_send = stop_after_two
    assert _play(tmp_path, stage, loop=True).tally.total == 12
    assert stage.log[:6] == stage.log[6:]


def test_steps_pass_single_messages_while_paused(tmp_path: Path) -> None:
    stage = FakeStage(paused=True)
    stage.control.steps = 2

    def resume_after_two(_message: Message) -> None:
        if len(stage.log) == 2:
            stage.control.pace.resume(0.0)

    stage.on_send = resume_after_two
    assert _play(tmp_path, stage).tally.total == 6


def _seek_once(stage: FakeStage, after: int, to: int) -> None:
    """Ask for the bag time `to` (ms) when `after` messages were sent."""

    def seek(_message: Message) -> None:
        if len(stage.log) == after:
            stage.control.target = to * MILLISECOND

    stage.on_send = seek


def test_a_jump_ahead_leaves_out_what_is_between_but_for_what_is_latched(tmp_path: Path) -> None:
    stage = FakeStage()
    _seek_once(stage, after=1, to=20)
    player = _play(tmp_path, stage)
    assert stage.log == [('/x', 0), ('/y', 15), ('/x', 20), ('/y', 25)]
    assert player.tally.total == 4


def test_a_jump_back_sends_again_what_was_latched_then(tmp_path: Path) -> None:
    stage = FakeStage()
    _seek_once(stage, after=5, to=8)
    _play(tmp_path, stage)
    assert stage.log[5:] == [('/y', 5), ('/x', 10), ('/y', 15), ('/x', 20), ('/y', 25)]


def test_a_jump_after_the_last_message_is_still_made(tmp_path: Path) -> None:
    stage = FakeStage()
    _seek_once(stage, after=6, to=25)
    _play(tmp_path, stage)
    assert stage.log[6:] == [('/y', 15), ('/y', 25)]


def test_a_jump_while_paused_stays_paused_at_the_new_place(tmp_path: Path) -> None:
    stage = FakeStage(paused=True)
    stage.control.target = 10 * MILLISECOND
    stage.control.steps = 1

    def stop_after_the_step(message: Message) -> None:
        stage.control.stopped = message.topic == '/x'

    stage.on_send = stop_after_the_step
    _play(tmp_path, stage)
    assert stage.log == [('/y', 5), ('/x', 10)]
    assert stage.control.pace.paused
    assert stage.control.place(1e6) == 10 * MILLISECOND


def test_the_clock_shows_the_new_place_before_anything_is_sent_there(tmp_path: Path) -> None:
    stage = FakeStage(rate=1.0)
    stage.control.target = 20 * MILLISECOND
    _play(tmp_path, stage, clock=1000.0)
    assert stage.log[:3] == [('clock', 20), ('/y', 15), ('/x', 20)]


def test_an_offset_begins_with_what_is_latched_there(tmp_path: Path) -> None:
    stage = FakeStage()
    _play(tmp_path, stage, choice=Choice(start_offset=0.018))
    assert stage.log == [('/y', 15), ('/x', 20), ('/y', 25)]


def test_a_refused_message_counts_as_lost(tmp_path: Path) -> None:
    stage = FakeStage()
    stage.refuse = True
    player = _play(tmp_path, stage)
    assert (player.tally.total, player.tally.lost) == (0, 6)


def test_a_required_topic_without_listener_is_an_error(tmp_path: Path) -> None:
    stage = FakeStage()
    stage.deaf = {'/x'}
    with pytest.raises(BagError, match='nobody listened to /sent/x within 0 s'):
        _play(tmp_path, stage, wait_for=('/sent/x',))


def test_a_required_topic_that_is_not_sent_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='--wait-for /z is not among the topics sent'):
        _play(tmp_path, FakeStage(), wait_for=('/z',))


def test_lockstep_sends_the_next_message_after_the_answer(tmp_path: Path) -> None:
    lockstep = Lockstep([LockstepRule('/sent/x', ('/answer',))], timeout=5.0)
    stage = FakeStage(rate=1e-3)
    answers: list[threading.Timer] = []

    def answer(message: Message) -> None:
        if message.topic == '/x':
            stage.log.append(('question', 0))
            timer = threading.Timer(
                0.02,
                lambda: (stage.log.append(('answer', 0)), lockstep.answer('/answer', b'', False)),
            )
            timer.start()
            answers.append(timer)

    stage.on_send = answer
    player = _play(tmp_path, stage, lockstep)
    names = [name for name, _ in stage.log]
    assert names == ['/x', 'question', 'answer', '/y'] * 3
    assert player.tally.lost == 0


def test_an_answer_with_another_stamp_is_none() -> None:
    lockstep = Lockstep([LockstepRule('/in', ('/out',))], timeout=0.01)

    def stamped(seconds: int) -> bytes:
        return b'\x00\x01\x00\x00' + seconds.to_bytes(4, 'little') + bytes(4)

    lockstep.ask('/in', stamped(7), True)
    lockstep.answer('/out', stamped(6), True)
    lockstep.wait()
    assert lockstep.unanswered == ['nothing on /out for /in of 7.000 s']
    lockstep.ask('/in', stamped(7), True)
    lockstep.answer('/out', stamped(7), True)
    lockstep.wait()
    assert len(lockstep.unanswered) == 1


def test_lockstep_rules_are_parsed_or_refused() -> None:
    assert parse_rule('hand/contacts:=deformation/linear,/b') == LockstepRule(
        '/hand/contacts', ('/deformation/linear', '/b')
    )
    with pytest.raises(BagError, match='not of the form input:=answer'):
        parse_rule('hand/contacts')


def test_reading_ahead_keeps_the_order_and_the_error(tmp_path: Path) -> None:
    def source():  # type: ignore[no-untyped-def]
        for index in range(5000):
            yield Message('/x', b'', index, index, 0)
        raise BagError('damaged here')

    seen: list[int] = []
    with pytest.raises(BagError, match='damaged here'):
        for message in ReadAhead(source(), count=10):
            seen.append(message.log_time)
    assert seen == list(range(5000))


def test_reading_ahead_holds_a_bounded_number_of_bytes() -> None:
    produced: list[int] = []

    def source():  # type: ignore[no-untyped-def]
        for index in range(100):
            produced.append(index)
            yield Message('/x', bytes(1000), index, index, 0)

    reader = ReadAhead(source(), count=1000, size=5000)
    iterator = iter(reader)
    next(iterator)
    reader.close()
    assert len(produced) <= 8


@pytest.mark.parametrize(
    'arguments',
    [
        ['bag', '--rate', '0'],
        ['bag', '--remap', 'x'],
        ['bag', '--clock', '-1'],
        ['bag', '--regex', '('],
        ['bag', '--start-offset', '-3'],
        ['bag', '--lockstep', 'x'],
        [],
    ],
)
def test_wrong_arguments_end_with_code_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        parse_options(arguments)
    assert exit_info.value.code == 2


def test_options_become_the_choice(tmp_path: Path) -> None:
    options = parse_options(
        ['bag', '--topics', 'a', 'b', '--remap', 'a:=c', '--start-offset', '1.5', '--clock']
    )
    assert options.choice == Choice(
        options.choice.selection, {'/a': '/c'}, start_offset=1.5, duration=None, until=None
    )
    assert options.clock == 40.0
    assert options.choice.selection.topics == ('a', 'b')
