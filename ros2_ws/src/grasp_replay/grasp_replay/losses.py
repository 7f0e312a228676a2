# SPDX-License-Identifier: Apache-2.0
"""Messages of a topic that were published and never reached the recording."""

from __future__ import annotations

from collections.abc import Iterable

CATCH_UP_S = 0.5
"""What comes later after a standstill was not waiting there [s]."""


class Losses:
    """Counts what one topic lost, from two witnesses.

    The middleware tells what it misses itself, for whatever number of publishers. The numbers
    that a publisher gives its messages show all that did not come, but a message does not say
    whose it is: they count while one publisher is alone. Both see a loss only by what comes
    after it: where this process stood still and a best-effort publisher then fell silent, how
    many were lost is `unknown`.
    """

    def __init__(self) -> None:
        self.unknown = False
        self._caught_up_at = 0.0
        self._publishers: frozenset[bytes] = frozenset()
        self._before = self._told = self._gaps = self._pending = 0
        self._last: int | None = None

    def stood_still(self, now: float) -> None:
        """This process took nothing for a while and goes on at steady time `now` [s]."""
        self.unknown, self._caught_up_at = True, now + CATCH_UP_S

    def arrived(self, number: int | None, now: float) -> None:
        """A message came at `now` with the number that its publisher gave it, None for none."""
        if now > self._caught_up_at:
            self.unknown = False
        if number is not None and self._last is not None and number > self._last + 1:
            self._pending += number - self._last - 1
        self._last = number

    def told(self, count: int) -> None:
        """The middleware says that so many are lost."""
        self._told += count

    def settle(self, publishers: Iterable[bytes]) -> None:
        """Once in a while, with who publishes now: gaps so far count if it was one throughout."""
        now = frozenset(publishers)
        if len(self._publishers) == 1 and now <= self._publishers:
            self._gaps += self._pending
        if now and now != self._publishers:
            self._before = self.lost
            self._told = self._gaps = 0
            self._last, self._publishers = None, now
        self._pending = 0

    @property
    def lost(self) -> int:
        """How many are known to be lost."""
        return self._before + max(self._told, self._gaps)
