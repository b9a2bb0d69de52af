# SPDX-License-Identifier: Apache-2.0
"""
Supervision of the processes of a run: start, restart after a crash, and stop in order, without processes left behind.

Each process runs in its own process group, so that a Ctrl-C on the terminal reaches only the supervisor, and a kill
reaches all processes that the process started. A crashed process is restarted after a pause, which doubles with each
crash. After several crashes in a row it is retried slowly without end, while the others continue. A process that ends
with status 0 is not restarted. A process calls `die_with_supervisor` to end together with its supervisor.

The output of each process is written to its log, whose size is limited; the older part is kept in one file, .1.log.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from mwd_sensors.core.process_starts import STARTS_VARIABLE
from mwd_sensors.core.stop_time import STOP_LIMIT, STOP_PATIENCE, StopTime

SUPERVISOR_VARIABLE = "MWD_SUPERVISOR"
REFUSED = 2  # exit status of a process whose settings are invalid: a restart would not help

_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 10.0  # pause from a crash to the restart, s
_SETTLED = 20.0  # run time of a process after which its count of crashes begins again, s
_MOST_CRASHES = 5  # crashes in a row after which a process counts as failing
_SLOW_PAUSE = 30.0  # time between attempts to start a failing process, s
_MARGIN = 2.0  # time in which a node that hangs, even in native code, reports where it hangs and ends itself, s
_PATIENCE, _TERM_PATIENCE = STOP_PATIENCE + _MARGIN, 2.0  # waiting times after SIGINT and after SIGTERM, s
_LOOK_PERIOD = 0.05  # time between checks whether a process has ended, s
_MOST_LOG = 20_000_000  # largest size of a log, bytes
_MOST_WORDS = 400  # largest length of the last line of a log in a message, characters
_PR_SET_PDEATHSIG = 1  # number of this option of prctl (Linux)


@dataclasses.dataclass(frozen=True)
class Order:
    """A process to run: its name, its command line, and the file for its output."""

    name: str
    words: Sequence[str]
    log: Path


@dataclasses.dataclass
class _Child:
    order: Order
    process: subprocess.Popen[bytes] | None = None
    born: float = 0.0
    crashes: int = 0
    starts: int = 0
    due: float | None = None
    status: int | None = None
    failure: str = ""


class Supervisor:
    """
    Supervisor that keeps processes alive until `stop`.

    Parameters
    ----------
    environment : mapping
        Environment variables of every process.
    report : callable
        Called with one sentence about each crash and restart.
    clock : callable
        Monotonic clock, s.
    """

    def __init__(
        self,
        environment: Mapping[str, str],
        report: Callable[[str], None] = lambda _sentence: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._environment = {**environment, SUPERVISOR_VARIABLE: str(os.getpid())}
        self._report = report
        self._clock = clock
        self._children: dict[str, _Child] = {}

    def start(self, order: Order) -> None:
        """
        Start a process, which `watch` then keeps alive.

        Raises
        ------
        OSError
            The program does not exist, or its log cannot be written.
        ValueError
            A process of that name runs already.
        """
        if self.runs(order.name):
            raise ValueError(f"{order.name} runs already")
        child = self._children[order.name] = _Child(order)
        self._spawn(child)

    def runs(self, name: str) -> bool:
        """Return whether the process with this name is alive now."""
        child = self._children.get(name)
        return child is not None and child.process is not None and child.process.poll() is None

    def pid(self, name: str) -> int | None:
        """Return the process id of the process with this name; None while it does not run."""
        child = self._children.get(name)
        return None if child is None or child.process is None else child.process.pid

    def finished(self, name: str) -> bool:
        """Return whether the process ended by itself with status 0."""
        return name in self._children and self._children[name].status == 0

    @property
    def failing(self) -> list[str]:
        """Sentences about the processes that refused their settings or crashed too often; they are retried slowly."""
        return [child.failure for child in self._children.values() if child.failure]

    def watch(self) -> None:
        """Check every process and restart crashed ones; call this several times a second."""
        now = self._clock()
        for child in self._children.values():
            _bound(child.order.log)
            if child.process is not None:
                status = child.process.poll()
                if status is not None:
                    self._ended(child, status, now)
                elif child.failure and now - child.born > _SETTLED:
                    child.failure = ""
                    self._report(f"{child.order.name} has recovered")
            elif child.due is not None and now >= child.due:
                child.due = None
                self._report(f"{child.order.name} is started again")
                try:
                    self._spawn(child)
                except OSError as error:
                    # The disk is full, or there are too few file handles at present; the other processes continue.
                    child.failure, child.due = f"{child.order.name} cannot be started: {error}", now + _SLOW_PAUSE
                    self._report(child.failure)

    def stop(self, groups: Sequence[Sequence[str]], patience: float = _PATIENCE) -> list[str]:
        """
        End the processes group by group, in order; the processes of a group are ended at the same time.

        Each process gets SIGINT, after `patience` seconds SIGTERM, and after two more seconds SIGKILL; its child
        processes are killed too. Time in which a process waits for a CPU does not count. Return the names of the
        processes that had to be killed.
        """
        for child in self._children.values():
            child.due = None
        killed = []
        for group in groups:
            alive = [self._children[name] for name in group if self.runs(name)]
            for number, wait in ((signal.SIGINT, patience), (signal.SIGTERM, _TERM_PATIENCE)):
                _ask_to_end([child.process for child in alive if child.process is not None], number, wait)
            for child in alive:
                if child.process is not None:
                    if child.process.poll() is None:
                        killed.append(child.order.name)
                    # Also kill the processes that the process may have started.
                    _signal(child.process, signal.SIGKILL)
                    child.status, child.process = child.process.wait(), None
        return killed

    def kill(self) -> None:
        """Kill all processes at once."""
        for child in self._children.values():
            child.due = None
            if child.process is not None:
                _signal(child.process, signal.SIGKILL)
                child.process.wait()
                child.process = None

    def _spawn(self, child: _Child) -> None:
        with child.order.log.open("ab") as log:
            child.process = subprocess.Popen(
                list(child.order.words),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**self._environment, STARTS_VARIABLE: str(child.starts)},
                start_new_session=True,
            )
        child.starts += 1
        child.born, child.status = self._clock(), None

    def _ended(self, child: _Child, status: int, now: float) -> None:
        if child.process is not None:
            _signal(child.process, signal.SIGKILL)
        child.process, child.status = None, status
        name = child.order.name
        if status == 0:
            return
        child.crashes = 1 if now - child.born > _SETTLED else child.crashes + 1
        if status == REFUSED or child.crashes > _MOST_CRASHES:
            words = last_words(child.order.log)
            many = f"crashed {child.crashes} times in a row ({in_words(status)})"
            known, child.failure = child.failure, f"{name} {'does not start' if status == REFUSED else many}: {words}"
            child.due = now + _SLOW_PAUSE
            if not known:
                self._report(
                    f"{child.failure}; the other nodes continue; the start of {name} is retried every {_SLOW_PAUSE:g} s"
                )
            return
        pause = min(_FIRST_PAUSE * 2.0 ** (child.crashes - 1), _LONGEST_PAUSE)
        child.due = now + pause
        self._report(f"{name} ended unexpectedly ({in_words(status)}); it is restarted in {pause:g} s")


def die_with_supervisor(environment: Mapping[str, str]) -> None:
    """
    Let this process receive SIGTERM when its supervisor dies in any way; a supervised process calls this at its start.

    Linux only; elsewhere, or without a supervisor, the call has no effect.
    """
    supervisor = environment.get(SUPERVISOR_VARIABLE, "")
    if not supervisor.isdigit():
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
        if os.getppid() != int(supervisor):
            # The supervisor died before the call of prctl, so no signal will come.
            os.kill(os.getpid(), signal.SIGTERM)


def _bound(log: Path) -> None:
    """Rotate a log that is full; lines that the process writes between copying and truncating are lost."""
    # If the disk is full, the log remains unchanged.
    with contextlib.suppress(OSError):
        if log.stat().st_size > _MOST_LOG:
            shutil.copyfile(log, log.with_suffix(".1.log"))
            os.truncate(log, 0)


def last_words(log: Path) -> str:
    """
    Return the last `_MOST_WORDS` characters of the last non-empty line of a log.

    Return a sentence if the log is empty or cannot be read.
    """
    try:
        with log.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(file.tell() - 65536, 0))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError as error:
        return f"its log {log} cannot be read ({error.strerror})"
    output = [line.strip() for line in lines if line.strip()]
    return output[-1][-_MOST_WORDS:] if output else f"no output (log {log})"


def in_words(status: int) -> str:
    """Return the exit status of a process as text."""
    if status >= 0:
        return f"status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"


def _ask_to_end(processes: Sequence[subprocess.Popen[bytes]], number: signal.Signals, patience: float) -> None:
    """
    Send a signal to the processes, and wait until each has ended, at most for `patience` seconds.

    Time in which a process waits for a CPU does not count.
    """
    waiting = {process: StopTime(patience, STOP_LIMIT + _MARGIN, process.pid) for process in processes}
    for process in processes:
        process.send_signal(number)
    while waiting := {one: allowed for one, allowed in waiting.items() if one.poll() is None and allowed.left() > 0.0}:
        time.sleep(_LOOK_PERIOD)


def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    # The id of a process group is the process id of its leader, which may have ended already.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)
