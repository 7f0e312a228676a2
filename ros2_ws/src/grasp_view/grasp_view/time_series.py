# SPDX-License-Identifier: Apache-2.0
"""What is remembered over time: numbers for the plots, whole pictures for the time slider."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np

from .poses import Floats

T = TypeVar('T')


class TimeSeries:
    """Several numbers over one time axis, the last `span` seconds, missing ones as NaN."""

    def __init__(self, names: Sequence[str], span: float, longest: int = 2000) -> None:
        self.names = tuple(names)
        self.span = span
        self._rows: deque[tuple[float, ...]] = deque(maxlen=longest)

    def add(self, time: float, values: Mapping[str, float]) -> None:
        """Append one row at `time` s; a time before the last one starts anew (a replay looped)."""
        if self._rows and time < self._rows[-1][0]:
            self._rows.clear()
        self._rows.append((time, *(float(values.get(name, np.nan)) for name in self.names)))
        while self._rows and time - self._rows[0][0] > self.span:
            self._rows.popleft()

    def __len__(self) -> int:
        return len(self._rows)

    def when(self, name: str, value: float) -> float:
        """Time (s) of the last row whose `name` is nearest to `value`; NaN where none is known."""
        time, values = self.columns((name,), max(len(self._rows), 1))
        off = np.abs(values - value)
        if not np.isfinite(off).any():
            return float('nan')
        return float(time[off <= np.nanmin(off)][-1])

    def columns(self, names: Sequence[str], most: int) -> tuple[Floats, ...]:
        """Time (n,) in s and one array (n,) per name; at most `most` rows, evenly picked."""
        if not self._rows:
            return tuple(np.zeros(0) for _ in range(1 + len(names)))
        table = np.array(self._rows)
        if len(table) > most:
            table = table[np.unique(np.linspace(0, len(table) - 1, most).astype(int))]
        index = [0, *(1 + self.names.index(name) for name in names)]
        return tuple(np.ascontiguousarray(table[:, k]) for k in index)


class History(Generic[T]):
    """The last `span` seconds of pictures, found again by their time."""

    def __init__(self, span: float, most: int) -> None:
        self.span = span
        self._times: deque[float] = deque(maxlen=most)
        self._items: deque[T] = deque(maxlen=most)

    def add(self, time: float, item: T) -> None:
        """Keep `item` of `time` s; a time before the last one starts anew."""
        if self._times and time < self._times[-1]:
            self._times.clear()
            self._items.clear()
        self._times.append(time)
        self._items.append(item)
        while time - self._times[0] > self.span:
            self._times.popleft()
            self._items.popleft()

    def __len__(self) -> int:
        return len(self._times)

    @property
    def ends(self) -> tuple[float, float]:
        """First and last time kept in s; both 0 when empty."""
        return (self._times[0], self._times[-1]) if self._times else (0.0, 0.0)

    def at(self, time: float) -> T | None:
        """The newest item not later than `time`, else the first; None when empty."""
        if not self._times:
            return None
        index = bisect_left(self._times, time)
        if index == len(self._times) or self._times[index] > time:
            index -= 1
        return self._items[max(index, 0)]
