# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np

from scan_compare.surface_history import StampedSurface, SurfaceHistory

SECOND = 1_000_000_000


def at(stamp_ns: int, depth: float = 0.0) -> StampedSurface:
    return StampedSurface(stamp_ns, np.ones((4, 3)), np.full((4, 3), depth), 'hand_base')


def stamps(history: SurfaceHistory, asked: int) -> int:
    found = history.at(asked)
    assert found is not None
    return found.stamp_ns


def test_the_surface_nearest_in_time_answers() -> None:
    history = SurfaceHistory(10.0)
    for second in range(5):
        history.add(at(second * SECOND))
    assert stamps(history, int(2.4 * SECOND)) == 2 * SECOND
    assert stamps(history, int(2.6 * SECOND)) == 3 * SECOND
    assert stamps(history, 99 * SECOND) == 4 * SECOND


def test_a_scan_without_a_stamp_gets_the_newest() -> None:
    history = SurfaceHistory(10.0)
    history.add(at(3 * SECOND))
    history.add(at(SECOND))
    assert stamps(history, 0) == 3 * SECOND


def test_no_surface_is_no_answer() -> None:
    assert SurfaceHistory(10.0).at(SECOND) is None


def test_a_fast_stream_is_thinned_and_old_surfaces_are_dropped() -> None:
    history = SurfaceHistory(1.0)
    for step in range(500):
        history.add(at(step * 4_000_000))
    assert 40 <= len(history) <= 60
    assert stamps(history, 0) == 499 * 4_000_000


def test_a_surface_sent_again_is_kept_once() -> None:
    history = SurfaceHistory(1.0)
    for stamp in (SECOND, SECOND, 2 * SECOND, SECOND, 2 * SECOND):
        history.add(at(stamp))
    assert len(history) == 2


def test_a_clock_set_back_starts_anew() -> None:
    history = SurfaceHistory(1.0)
    history.add(at(3600 * SECOND))
    history.add(at(SECOND))
    assert stamps(history, 3600 * SECOND) == SECOND


def test_rest_positions_follow_from_displacements() -> None:
    surface = at(SECOND, 0.25)
    assert np.all(surface.rest == 0.75)
    assert surface.max_displacement == np.sqrt(3 * 0.25**2)
