# SPDX-License-Identifier: Apache-2.0
"""
Overlapping stages of a run: one thread fetches items ahead of the work, one thread processes results behind it.

Each stage does one thing at a time and in order, and may be only a few items ahead of the next, so that memory stays
bounded. An error in a stage is raised where its result is used; no thread is left running when the block ends.
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
    Yield an iterator of the items, which a thread computes at most `depth` items before they are used.

    An exception in `items` is raised where the next item would have been used. When the block ends, early or not, the
    thread finishes the current item and ends; this closes a generator.
    """
    # Entries are (item,), an exception, or None at the end.
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
        except BaseException as error:  # noqa: BLE001  (raised where the item is used)
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
    Yield a function that passes an item to a thread, which calls `work` with each item in order.

    The function waits while `depth` items wait already. An exception of `work` ends the thread, and is raised by the
    next call or at the end of the block. If the block ends normally all items have been processed; if it raises,
    waiting items are dropped.
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
            except BaseException as error:  # noqa: BLE001  (raised where items are passed on)
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
