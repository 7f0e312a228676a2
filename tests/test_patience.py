# SPDX-License-Identifier: Apache-2.0
"""The patience of the tests themselves: a hang is told, a starved machine is not a hang."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests import patience
from tests.patience import Patience


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, float]:
    now = {'wall': 100.0, 'starved': 5.0}
    monkeypatch.setattr(patience.time, 'monotonic', lambda: now['wall'])
    monkeypatch.setattr(patience, 'starved_s', lambda: now['starved'])
    return now


def test_on_an_idle_machine_patience_ends_after_its_seconds(clock: dict[str, float]) -> None:
    waiting = Patience(10.0)
    clock['wall'] += 9.9
    assert not waiting.over
    clock['wall'] += 0.2
    assert waiting.over


def test_time_in_which_others_took_the_processor_does_not_count(clock: dict[str, float]) -> None:
    waiting = Patience(10.0)
    clock['wall'] += 100.0
    clock['starved'] += 95.0
    assert not waiting.over
    clock['wall'] += 5.1
    assert waiting.over


def test_without_the_kernels_count_patience_is_four_times_as_long(
    clock: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patience, 'starved_s', lambda: None)
    waiting = Patience(10.0)
    clock['wall'] += 39.0
    assert not waiting.over
    clock['wall'] += 2.0
    assert waiting.over


def test_the_kernels_count_is_read_in_seconds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pressure = tmp_path / 'cpu'
    pressure.write_text('some avg10=1.00 avg60=1.00 avg300=1.00 total=2500000\nfull total=0\n')
    monkeypatch.setattr(patience, 'PRESSURE', pressure)
    assert patience.starved_s() == pytest.approx(2.5)
    monkeypatch.setattr(patience, 'PRESSURE', tmp_path / 'none')
    assert patience.starved_s() is None
