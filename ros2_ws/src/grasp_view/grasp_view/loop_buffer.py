# SPDX-License-Identifier: Apache-2.0
"""What waits to be sent to a browser, filled by one thread and sent by another.

viser wakes the sending tasks from the thread that fills: it goes through those that wait while the
event loop adds and takes away some, which ended the page now and then (`deque mutated during
iteration`). Here the loop alone wakes them; viser asks it to, each time.
"""

from __future__ import annotations

import asyncio
from typing import Any

from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer


class LoopEvent(asyncio.Event):
    """An event whose waiters are woken by the event loop alone."""

    def set(self) -> None:
        """Set it; from another thread that is all, and the loop is to be asked for the rest."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            self._value = True
            return
        # Another thread may have set it already, and woken nobody.
        self._value = False
        super().set()


class LoopBuffer(AsyncMessageBuffer):
    """viser's buffer with such an event."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.message_event = LoopEvent()


def use_loop_buffers() -> None:
    """Let every server and connection from now on have such buffers."""
    _infra.AsyncMessageBuffer = LoopBuffer  # type: ignore[misc]
