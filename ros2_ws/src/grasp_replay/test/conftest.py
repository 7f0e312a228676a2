# SPDX-License-Identifier: Apache-2.0
"""Makes the modules beside the tests importable to them; a node that hears and sends."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def observer(domain_id: int) -> Iterator[Any]:
    """A `replay_observer.Observer` on the domain of the test."""
    # imported here: most tests of this folder need no ROS
    from replay_observer import Observer

    observer = Observer(domain_id)
    yield observer
    observer.close()
