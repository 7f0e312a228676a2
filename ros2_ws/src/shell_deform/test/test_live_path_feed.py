# SPDX-License-Identifier: Apache-2.0
"""Load cases of fingers that carry bodies, handed on to one process and to the next."""

import numpy as np

from shell_deform.live.background.worker_link import empty_request
from shell_deform.live.tick.load_path import MOST_PASSED, LoadPath, PathFeed

STEP = 1e-4


class Process:
    """A background process that answers when it is told to."""

    def __init__(self):
        self.memory = object()
        self.given, self.answered, self.hurried = [], 0, []

    def post(self, request):
        self.given.append(int(request[0]['stamp']))
        self.hurried.append(bool(request[0]['hurried']))
        return len(self.given)

    def answer(self):
        self.answered = len(self.given)


def case(number, contacts=1):
    """The load case that has this number as its stamp: a finger pressed in by so many steps."""
    request = empty_request()
    request['contacts'], request['stamp'] = contacts, number
    touch = request[0]['touch'][0]
    touch['finger'], touch['normal'], touch['along'] = 1, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    touch['point'], touch['travel'] = [number * STEP, 0.0, 0.0], number * STEP
    return request


def solved(feed, process):
    """Let a process answer until nothing is left for it."""
    while not feed.feed(process):
        process.answer()


def followed(*numbers):
    """A path through load cases, and the process that has answered them."""
    feed, process = PathFeed(LoadPath(STEP, 0.01)), Process()
    for number in numbers:
        feed.path.take(case(number))
        solved(feed, process)
    return feed, process


def test_a_process_is_given_each_load_case_when_it_has_answered_the_last():
    feed, process = PathFeed(LoadPath(STEP, 0.01)), Process()
    for number in range(3):
        feed.path.take(case(number))
    assert not feed.feed(process)
    assert not feed.feed(process)
    assert (process.given, process.hurried, feed.behind) == ([0], [True], 3)
    solved(feed, process)
    assert (process.given, process.hurried, feed.behind) == ([0, 1, 2], [True, True, False], 0)


def test_a_process_that_replaces_another_one_goes_through_the_grasp_again():
    feed, _ = followed(0, 1, 2)
    other = Process()
    solved(feed, other)
    assert other.given == [0, 1, 2]


def test_a_process_with_another_mesh_catches_up_while_the_serving_one_goes_on():
    feed, serving = followed(0, 1, 2)
    other = Process()
    assert not feed.caught_up(other)
    feed.path.take(case(3))
    solved(feed, serving)
    while not feed.caught_up(other):
        other.answer()
    assert other.given == serving.given == [0, 1, 2, 3]
    assert other.hurried[-1] is False
    # It takes the place of the first one and is given nothing twice.
    feed.path.take(case(4))
    solved(feed, other)
    assert other.given == [0, 1, 2, 3, 4]
    assert serving.given == [0, 1, 2, 3]


def test_where_all_fingers_have_let_go_the_way_begins_anew():
    feed, serving = followed(0, 1, 2)
    feed.path.take(case(3, contacts=0))
    feed.path.take(case(4))
    solved(feed, serving)
    other = Process()
    solved(feed, other)
    assert other.given == [3, 4]


def test_a_jump_in_time_leaves_nothing_to_go_through():
    feed, serving = followed(0, 1, 2)
    feed.clear()
    other = Process()
    assert feed.feed(other)
    assert other.given == []
    feed.path.take(case(7))
    solved(feed, other)
    assert other.given == [7]
    assert feed.whole


def test_a_very_long_grasp_is_kept_in_part_and_says_so():
    feed, _ = followed(*range(MOST_PASSED + 3))
    assert not feed.whole
    other = Process()
    solved(feed, other)
    assert other.given == list(np.arange(3, MOST_PASSED + 3))
