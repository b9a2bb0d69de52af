# SPDX-License-Identifier: Apache-2.0
"""Work in threads: slow jobs run in a background thread, requests from other threads run in the node's thread."""

from __future__ import annotations

import concurrent.futures
import queue
from collections.abc import Callable
from functools import partial
from typing import Any

Answer = tuple[bool, str]
"""Whether a request was carried out, and a message."""

_Job = tuple[concurrent.futures.Future[Any], Callable[[Any], None]]
_TIMEOUT_S = 12.0  # longest wait of another thread for the answer of the node, s


class BackgroundWorker:
    """Runner of slow jobs, one at a time in a background thread; their callbacks run in the node's thread."""

    def __init__(self) -> None:
        self._executor = concurrent.futures.ThreadPoolExecutor(1, "surface-worker")
        self._jobs: list[_Job] = []
        self._writing: set[concurrent.futures.Future[Any]] = set()

    def submit(
        self,
        job: Callable[[], Any],
        callback: Callable[[concurrent.futures.Future[Any]], None],
        *,
        writes: bool = False,
    ) -> None:
        """
        Run `job` in the background; then `callback` is called with the future of the job in the node's thread.

        writes: whether the job writes a file that a user requested; `close` waits for such jobs.
        """
        future = self._executor.submit(job)
        self._jobs.append((future, callback))
        if writes:
            self._writing.add(future)
            future.add_done_callback(self._writing.discard)

    def run_callbacks(self) -> None:
        """
        Call the callbacks of finished jobs; called by the node's timer.

        If a callback raises, the remaining callbacks run in the next call, because a client waits for each of them.
        """
        finished: list[_Job] = []
        running: list[_Job] = []
        for entry in self._jobs:
            # Call `done` only once per job, so that a job that finishes in between is not lost.
            (finished if entry[0].done() else running).append(entry)
        self._jobs = running
        while finished:
            job, callback = finished.pop(0)
            try:
                callback(job)
            except Exception:
                self._jobs = [*finished, *self._jobs]
                raise

    def close(self) -> None:
        """Start no further jobs, and wait for jobs that write a file; results of other jobs are dropped."""
        self._executor.shutdown(wait=False, cancel_futures=True)
        concurrent.futures.wait(set(self._writing))


class RequestQueue:
    """
    Requests from the threads of page and rig interfaces, carried out in the node's thread.

    Parameters
    ----------
    handler : callable
        `handler(name, arguments) -> (success, message)`, or a future of it; called by `run_requests`.
    """

    def __init__(self, handler: Callable[[str, dict[str, Any]], Answer | concurrent.futures.Future[Answer]]) -> None:
        self._handler = handler
        self._queue: queue.SimpleQueue[tuple[str, dict[str, Any], concurrent.futures.Future[Answer]]] = (
            queue.SimpleQueue()
        )

    def call(self, name: str, arguments: dict[str, Any]) -> Answer:
        """
        Send a request from another thread; return its answer.

        After `_TIMEOUT_S` without an answer, False and a message are returned; the request may still be carried out.
        """
        answer: concurrent.futures.Future[Answer] = concurrent.futures.Future()
        self._queue.put((name, arguments, answer))
        try:
            return answer.result(_TIMEOUT_S)
        except TimeoutError:
            return False, "the surface node did not answer; try again"

    def run_requests(self) -> None:
        """Carry out the waiting requests; called by the node's timer. If the handler raises, the request fails."""
        while not self._queue.empty():
            name, arguments, answer = self._queue.get()
            try:
                result = self._handler(name, arguments)
            except Exception as error:  # noqa: BLE001  (the caller gets the error; the node continues)
                answer.set_result((False, f"{name} failed inside the node: {error!r}"))
                continue
            if isinstance(result, concurrent.futures.Future):
                result.add_done_callback(partial(_copy_result, answer))
            else:
                answer.set_result(result)


def _copy_result(answer: concurrent.futures.Future[Answer], finished: concurrent.futures.Future[Answer]) -> None:
    error = finished.exception()
    answer.set_result(finished.result() if error is None else (False, f"failed inside the node: {error!r}"))
