# SPDX-License-Identifier: Apache-2.0
"""Reads messages in a thread of its own, so that loading a chunk makes no message late."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Iterator

from grasp_replay.bag import Message
from grasp_replay.errors import BagError


class ReadAhead:
    """Iterates over `messages` with up to `count` of them or `size` bytes read in advance.

    An error of the source is raised where it would have been; `close` ends the thread.
    """

    def __init__(
        self, messages: Iterable[Message], count: int = 1000, size: int = 32 * 2**20
    ) -> None:
        self._source = messages
        self._count, self._size = count, size
        self._waiting: deque[Message] = deque()
        self._bytes = 0
        self._error: BagError | None = None
        self._ended = False
        self._closed = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._read, name='read-ahead', daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Message]:
        while True:
            with self._change:
                while not self._waiting and not self._ended:
                    self._change.wait()
                if not self._waiting:
                    if self._error is not None:
                        raise self._error
                    return
                message = self._waiting.popleft()
                self._bytes -= len(message.data)
                self._change.notify()
            yield message

    def _read(self) -> None:
        try:
            for message in self._source:
                with self._change:
                    while not self._closed and self._full():
                        self._change.wait()
                    if self._closed:
                        break
                    self._waiting.append(message)
                    self._bytes += len(message.data)
                    self._change.notify()
        except BagError as error:
            self._error = error
        finally:
            with self._change:
                self._ended = True
                self._change.notify()

    def _full(self) -> bool:
        return len(self._waiting) >= self._count or (
            bool(self._waiting) and self._bytes >= self._size
        )

    def close(self) -> None:
        """Stop reading and wait for the thread."""
        with self._change:
            self._closed = True
            self._change.notify()
        self._thread.join()
