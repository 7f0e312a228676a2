# SPDX-License-Identifier: Apache-2.0
"""The answer of a service that answers at once and does no harm when it is asked twice.

DDS finds the two directions of a service one after the other: a server that already hears a
request may not know yet where its answer goes, and the answer is then lost (ros2/rmw_fastrtps
issue 842). A client cannot see that, so a request without an answer is sent again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.patience import Patience

LOST_AFTER_S = 8.0


def answer(client: Any, request: Any, until: Callable[[Callable[[], object]], object]) -> Any:
    """What the service says; `until` spins until its condition holds, or fails."""
    until(client.service_is_ready)
    asked = [client.call_async(request)]
    patience = Patience(LOST_AFTER_S)

    def answered() -> bool:
        nonlocal patience
        if patience.over:
            asked.append(client.call_async(request))
            patience = Patience(LOST_AFTER_S)
        return any(future.done() for future in asked)

    until(answered)
    return next(future for future in asked if future.done()).result()
