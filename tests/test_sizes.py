# SPDX-License-Identifier: Apache-2.0
"""The check of sizes in `make lint` finds what it is for."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.sizes import violations

LONG = 'def long():\n' + '    x = 1\n' * 80
WIDE = 'def wide(a, b, c, d, e, f, g, h, i):\n    return a\n'
DEEP = 'def deep(a):\n' + '    if a:\n        a += 1\n' * 15 + '    return a\n'
SMALL = 'def small(a, b, c, d, e, f, g, h):\n' + '    if a:\n        a += 1\n' * 14


@pytest.mark.parametrize(
    ('source', 'complaint'),
    [(LONG, '::long: 81 lines'), (WIDE, '(9 > 8)'), (DEEP, '(16 > 15)')],
)
def test_each_kind_of_size_is_found(tmp_path: Path, source: str, complaint: str) -> None:
    (tmp_path / 'src').mkdir()
    (tmp_path / 'src' / 'one.py').write_text(source)
    told = violations(tmp_path, ('src',), {})
    assert len(told) == 1 and complaint in told[0]
    assert violations(tmp_path, ('src',), {told[0].split(': ')[0]: 'a reason'}) == []


def test_what_is_just_small_enough_passes(tmp_path: Path) -> None:
    (tmp_path / 'src').mkdir()
    (tmp_path / 'src' / 'one.py').write_text(SMALL)
    assert violations(tmp_path, ('src',), {}) == []
