# SPDX-License-Identifier: Apache-2.0
"""Queue, bounded in bytes, between the threads that deliver messages and the thread that writes them."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

OVERHEAD = 128  # memory that a waiting message needs in addition to its payload, bytes
_BATCH = 1000  # largest number of entries in a batch


class QueuedMessage(NamedTuple):
    """A received message that waits to be written."""

    topic: str
    type_name: str
    data: bytes
    #: `log_ns`, `publish_ns`: ns since the epoch.
    log_ns: int
    publish_ns: int
    qos: str = ""  #: offered profiles as YAML

    @property
    def size(self) -> int:
        """Memory that the message uses while it waits, bytes."""
        return len(self.data) + OVERHEAD


@dataclasses.dataclass
class WriterCommand:
    """A request that the writer thread carries out after all messages that were queued before the request."""

    run: Callable[[], Any]
    answer: concurrent.futures.Future[Any] = dataclasses.field(default_factory=concurrent.futures.Future)

    def carry_out(self) -> None:
        """Run the request and set its answer or its exception."""
        try:
            self.answer.set_result(self.run())
        except Exception as error:  # noqa: BLE001  (any error is passed to the caller)
            self.answer.set_exception(error)


class MessageQueue:
    """
    Messages and commands in the order in which they were delivered; no call waits.

    Parameters
    ----------
    limit : int
        Largest number of bytes that may wait.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.waiting_bytes = 0  #: number of bytes that wait now
        self.refused = 0  #: number of messages refused because the queue was full
        self.wake = threading.Event()  #: set when the writer should read the queue
        self._items: deque[QueuedMessage | WriterCommand] = deque()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: QueuedMessage) -> bool:
        """Accept a message and return True; if the queue is full, count the message as refused and return False."""
        with self._lock:
            if self.waiting_bytes + item.size > self.limit:
                self.refused += 1
                return False
            self.waiting_bytes += item.size
            self._items.append(item)
            filling = self.waiting_bytes > self.limit // 4
        if filling:
            self.wake.set()
        return True

    def command(self, run: Callable[[], Any]) -> concurrent.futures.Future[Any]:
        """Accept a command and return the future that will hold its answer."""
        command = WriterCommand(run)
        with self._lock:
            self._items.append(command)
        return command.answer

    def batch(self) -> list[QueuedMessage | WriterCommand]:
        """Remove and return the next entries, at most a thousand."""
        taken: list[QueuedMessage | WriterCommand] = []
        with self._lock:
            while self._items and len(taken) < _BATCH:
                item = self._items.popleft()
                taken.append(item)
                if isinstance(item, QueuedMessage):
                    self.waiting_bytes -= item.size
        return taken

    def cancel(self, error: Exception) -> None:
        """Empty the queue; its commands fail with the error."""
        with self._lock:
            commands = [item for item in self._items if isinstance(item, WriterCommand)]
            self._items.clear()
            self.waiting_bytes = 0
        for command in commands:
            command.answer.set_exception(error)
