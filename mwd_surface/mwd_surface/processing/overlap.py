# SPDX-License-Identifier: Apache-2.0
"""
Stages of a run side by side: one thread fetches ahead of the work, one puts away behind it.

Each stage does one thing at a time and in order, and may be only a few items ahead of the next, so that memory stays
bounded. What goes wrong in a stage is raised where its work is used; nothing is left running when the block ends.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

_DEPTH = 3


@contextlib.contextmanager
def ahead(items: Iterable[T], depth: int = _DEPTH) -> Iterator[Iterator[T]]:
    """
    The items, worked out by a thread at most `depth` items before they are used.

    An exception in `items` is raised where the next item would have been. When the block ends, early or not, the
    thread finishes the item at hand and ends; a generator is closed by it.
    """
    # None: one slot each for what is ready; a pair of (item, failure) marks the end.
    ready: queue.Queue[tuple[T] | BaseException | None] = queue.Queue(depth)
    stop = threading.Event()

    def put(entry: tuple[T] | BaseException | None) -> None:
        while not stop.is_set():
            with contextlib.suppress(queue.Full):
                ready.put(entry, timeout=0.1)
                return

    def fetch() -> None:
        iterator = iter(items)
        try:
            for item in iterator:
                put((item,))
                if stop.is_set():
                    break
            put(None)
        except BaseException as error:  # noqa: BLE001  (raised again where the item is used)
            put(error)
        finally:
            close = getattr(iterator, "close", None)
            if close is not None:
                close()

    def used() -> Iterator[T]:
        while True:
            entry = ready.get()
            if isinstance(entry, BaseException):
                raise entry
            if entry is None:
                return
            yield entry[0]

    thread = threading.Thread(target=fetch, name="ahead", daemon=True)
    thread.start()
    try:
        yield used()
    finally:
        stop.set()
        thread.join()


@contextlib.contextmanager
def behind(work: Callable[[T], None], depth: int = _DEPTH) -> Iterator[Callable[[T], None]]:
    """
    A function that hands an item to a thread, which calls `work` with each in order.

    It waits where `depth` items wait already. An exception of `work` ends the thread, and is raised by the next call
    or at the end of the block. When the block ends well all items have been worked on; when it raises, those that wait
    are dropped.
    """
    waiting: queue.Queue[tuple[T] | None] = queue.Queue(depth)
    drop = threading.Event()
    failures: list[BaseException] = []

    def run() -> None:
        while (entry := waiting.get()) is not None:
            if drop.is_set() or failures:
                continue
            try:
                work(entry[0])
            except BaseException as error:  # noqa: BLE001  (raised again where items are handed over)
                failures.append(error)

    def give(item: T) -> None:
        if failures:
            raise failures[0]
        waiting.put((item,))

    thread = threading.Thread(target=run, name="behind", daemon=True)
    thread.start()
    try:
        yield give
    except BaseException:
        drop.set()
        raise
    finally:
        waiting.put(None)
        thread.join()
    if failures:
        raise failures[0]
