# SPDX-License-Identifier: Apache-2.0
"""All problems of theory `thick`: exact solutions, the thin limit, solids under pins."""

from __future__ import annotations

from collections.abc import Iterator

from shell_deform.verification import thick_balls, thick_exact, thick_limit, thick_plates
from shell_deform.verification.problem import Verified


def problems() -> Iterator[Verified]:
    """One group after the other, the quick ones first."""
    yield from thick_exact.problems()
    yield from thick_limit.problems()
    yield from thick_plates.problems()
    yield from thick_balls.problems()
