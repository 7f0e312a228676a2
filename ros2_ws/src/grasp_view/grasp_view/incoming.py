# SPDX-License-Identifier: Apache-2.0
"""What a browser may say: messages as viser describes them, of numbers that are some.

viser believes what comes: a colour that is none, a slider beyond its end or a camera nowhere would
reach the drawing, and end it. What a page of ours cannot have sent is dropped unread.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import msgspec
import viser
from viser import _messages

LARGEST = 1e9
"""No number from a browser is larger: pixels, units of the scene, bytes of a file."""
ROUNDING = 1e-6
"""By so much of its range a slider may pass its end."""

Handler = Callable[[Any], Awaitable[None]]


class Incoming:
    """Reads what comes from browsers before viser does; `gui` says what its inputs allow."""

    gui: viser.GuiApi | None = None

    def checked(self, handler: Handler) -> Handler:
        """viser's handler of a connection, which receives only what may be."""

        async def handle(connection: Any) -> None:
            receive = connection.recv

            async def receive_checked() -> bytes:
                while not self.may_be(raw := await receive()):
                    pass
                return bytes(raw)

            connection.recv = receive_checked
            await handler(connection)

        return handle

    def may_be(self, raw: Any) -> bool:
        """Whether a frame is a message that the page can have sent."""
        kinds = _messages.Message._subclass_from_type_string()
        try:
            said = msgspec.msgpack.decode(raw)
            message = msgspec.convert(said, kinds[said['type']])
        except (msgspec.MsgspecError, LookupError, TypeError, ValueError, RecursionError):
            return False
        if not all(abs(number) <= LARGEST for number in _numbers(said)):
            return False
        if isinstance(message, _messages.GuiUpdateMessage):
            return self._may_set(message)
        return True

    def _may_set(self, message: _messages.GuiUpdateMessage) -> bool:
        """Whether an input of the page can have been set like this."""
        if set(message.updates) != {'value'} or self.gui is None:
            return False
        handle = self.gui._gui_input_handle_from_uuid.get(message.uuid)
        return handle is not None and _allows(handle, message.updates['value'])


def _allows(handle: Any, value: Any) -> bool:
    """Whether an input can hold a value: one of its options, or a number between its ends."""
    held = handle._impl.value
    options = getattr(handle, 'options', None)
    if options is not None:
        return value in options
    if isinstance(held, bool) or isinstance(value, bool):
        return isinstance(held, bool) and isinstance(value, bool)
    if isinstance(held, int | float):
        low, high = float(handle.min), float(handle.max)
        spare = ROUNDING * (high - low)
        return isinstance(value, int | float) and low - spare <= value <= high + spare
    return type(held) is type(value)


def _numbers(value: Any) -> Iterator[float]:
    """All numbers in what was decoded, one that is none as an infinite one."""
    if isinstance(value, int | float):
        yield value if math.isfinite(value) else math.inf
    elif isinstance(value, dict):
        for inner in value.values():
            yield from _numbers(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _numbers(inner)
