# SPDX-License-Identifier: Apache-2.0
"""What a recording has lost: numbers of one publisher, what the middleware tells of several."""

from __future__ import annotations

from collections.abc import Iterable

from grasp_replay.losses import Losses

ONE, OTHER = b'one', b'other'


def _taken(losses: Losses, numbers: Iterable[int | None]) -> None:
    for number in numbers:
        losses.arrived(number, 0.0)


def test_gaps_of_a_single_publisher_are_losses() -> None:
    losses = Losses()
    losses.settle([ONE])
    _taken(losses, [5, 6, 9, 10, 20])
    losses.settle([ONE])
    assert losses.lost == 11


def test_what_the_middleware_tells_of_the_same_gap_is_not_counted_twice() -> None:
    losses = Losses()
    losses.settle([ONE])
    losses.told(2)
    _taken(losses, [1, 4])
    losses.settle([ONE])
    assert losses.lost == 2


def test_numbers_of_several_publishers_say_nothing() -> None:
    losses = Losses()
    losses.settle([ONE])
    _taken(losses, [1, 2])
    _taken(losses, [900, 3, 901])
    losses.settle([ONE, OTHER])
    _taken(losses, [4, 1000])
    losses.told(3)
    losses.settle([ONE, OTHER])
    assert losses.lost == 3


def test_a_publisher_that_takes_over_begins_with_a_number_of_its_own() -> None:
    losses = Losses()
    losses.settle([ONE])
    _taken(losses, [1, 2, 5])
    losses.settle([])
    _taken(losses, [700])
    losses.settle([OTHER])
    _taken(losses, [701, 703])
    losses.settle([OTHER])
    assert losses.lost == 3


def test_a_publisher_that_has_gone_at_the_end_still_counts() -> None:
    losses = Losses()
    losses.settle([ONE])
    _taken(losses, [1, 3])
    losses.settle([])
    assert losses.lost == 1


def test_without_numbers_only_what_is_told_counts() -> None:
    losses = Losses()
    losses.settle([ONE])
    _taken(losses, [None])
    losses.told(1)
    _taken(losses, [None])
    losses.settle([ONE])
    assert losses.lost == 1


def test_after_a_standstill_the_loss_is_unknown_until_the_publisher_is_heard_again() -> None:
    losses = Losses()
    losses.arrived(1, 9.0)
    losses.stood_still(10.0)
    # This one may have waited in the queue.
    losses.arrived(2, 10.1)
    assert losses.unknown
    losses.arrived(500, 11.0)
    assert not losses.unknown
