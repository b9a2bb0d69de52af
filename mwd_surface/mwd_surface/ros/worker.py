"""Between the node's own thread and others: slow work done beside it, and requests from outside answered in it."""

from __future__ import annotations

import concurrent.futures
import queue
from collections.abc import Callable
from typing import Any

Answer = tuple[bool, str]
_PATIENCE = 12.0  # s somebody outside waits for the node


class Beside:
    """Slow work, one piece at a time in a thread of its own; what becomes of it is told in the node's thread."""

    def __init__(self) -> None:
        self._worker = concurrent.futures.ThreadPoolExecutor(1, "surface-worker")
        self._jobs: list[tuple[concurrent.futures.Future[Any], Callable[[Any], None]]] = []

    def work(self, job: Callable[[], Any], done: Callable[[concurrent.futures.Future[Any]], None]) -> None:
        """Do `job` beside the node; `done` gets its future in the node's thread."""
        self._jobs.append((self._worker.submit(job), done))

    def finish(self) -> None:
        """Tell of what is done; called by the node again and again."""
        over, waiting = [], []
        for entry in self._jobs:
            # Asked once: one that ends in between must not be lost.
            (over if entry[0].done() else waiting).append(entry)
        self._jobs = waiting
        for job, done in over:
            done(job)

    def close(self) -> None:
        """Begin nothing more."""
        self._worker.shutdown(wait=False, cancel_futures=True)


class Requests:
    """
    Requests of the page's and the rig interfaces' threads, carried out in the node's.

    carry_out : callable
        `carry_out(name, arguments) -> (ok, message)`, or a future of it, called by `answer` in the node's thread.
    """

    def __init__(self, carry_out: Callable[[str, dict[str, Any]], Answer | concurrent.futures.Future[Answer]]) -> None:
        self._carry_out = carry_out
        self._waiting: queue.SimpleQueue[tuple[str, dict[str, Any], concurrent.futures.Future[Answer]]] = (
            queue.SimpleQueue()
        )

    def ask(self, name: str, arguments: dict[str, Any]) -> Answer:
        """Called in any other thread: waits for the node's answer, but not for ever."""
        answer: concurrent.futures.Future[Answer] = concurrent.futures.Future()
        self._waiting.put((name, arguments, answer))
        try:
            return answer.result(_PATIENCE)
        except TimeoutError:
            return False, "the surface node did not answer; try again"

    def answer(self) -> None:
        """Carry out what waits; called by the node again and again."""
        while not self._waiting.empty():
            name, arguments, answer = self._waiting.get()
            try:
                told = self._carry_out(name, arguments)
            except Exception as error:  # noqa: BLE001  (the one who asks must hear of it; the node goes on)
                answer.set_result((False, f"{name} failed inside the node: {error!r}"))
                continue
            if isinstance(told, concurrent.futures.Future):
                told.add_done_callback(lambda late, answer=answer: answer.set_result(late.result()))
            else:
                answer.set_result(told)
