# SPDX-License-Identifier: Apache-2.0
"""
Processes that belong together: started, restarted when they crash, ended in order, none left behind.

Each runs in a process group of its own, so that a Ctrl-C on the terminal reaches only the supervisor and a kill reaches
all a process started. One that dies although its supervisor lives is started again after a pause that doubles, and then
slowly for ever, while the others go on; one that ends with status 0 is done. A process asks to die with its supervisor
by `die_with_supervisor`.

The output of each is in its log, which is bounded: the part before is kept once, as .1.log.
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

from mwd_sensors.core.stop_time import STOP_LIMIT, STOP_PATIENCE, StopTime

SUPERVISOR_VARIABLE = "MWD_SUPERVISOR"
REFUSED = 2  # status of a process whose settings are not allowed: starting it again would not help

_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 10.0
_SETTLED = 20.0  # s of life after which a crash counts as the first again
_MOST_CRASHES = 5  # in a row before a process counts as failing
_SLOW_PAUSE = 30.0  # s between attempts to start a failing process
_MARGIN = 2.0  # s; a node that hangs says where and ends itself before it is asked again, in native code too
_PATIENCE, _TERM_PATIENCE = STOP_PATIENCE + _MARGIN, 2.0  # s
_LOOK_PERIOD = 0.05  # s
_MOST_LOG = 20_000_000  # bytes
_PR_SET_PDEATHSIG = 1


@dataclasses.dataclass(frozen=True)
class Order:
    """A process to run: its name, its words, and where its output goes."""

    name: str
    words: Sequence[str]
    log: Path


@dataclasses.dataclass
class _Child:
    order: Order
    process: subprocess.Popen[bytes] | None = None
    born: float = 0.0
    crashes: int = 0
    due: float | None = None
    status: int | None = None
    failure: str = ""


class Supervisor:
    """
    Keeps processes alive until `stop`.

    Parameters
    ----------
    environment : mapping
        Of every process.
    report : callable
        Called with one sentence about each crash and restart.
    clock : callable
        Steady seconds.
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
        Start a process; it is kept alive by `watch`.

        Raises
        ------
        OSError
            There is no such program, or its log cannot be written.
        ValueError
            One of that name runs already.
        """
        if self.runs(order.name):
            raise ValueError(f"{order.name} runs already")
        child = self._children[order.name] = _Child(order)
        self._spawn(child)

    def runs(self, name: str) -> bool:
        """Whether a process of that name is alive now."""
        child = self._children.get(name)
        return child is not None and child.process is not None and child.process.poll() is None

    def pid(self, name: str) -> int | None:
        """Number of the process of that name; None while there is none."""
        child = self._children.get(name)
        return None if child is None or child.process is None else child.process.pid

    def finished(self, name: str) -> bool:
        """Whether it ended by itself, with status 0."""
        return name in self._children and self._children[name].status == 0

    @property
    def failing(self) -> list[str]:
        """A sentence for each process that refused its settings or crashed too often in a row; it is tried slowly."""
        return [child.failure for child in self._children.values() if child.failure]

    def watch(self) -> None:
        """Look after every process; to be called several times a second."""
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
                    # A full disk or too few handles, for the moment; the other processes go on.
                    child.failure, child.due = f"{child.order.name} cannot be started: {error}", now + _SLOW_PAUSE
                    self._report(child.failure)

    def stop(self, groups: Sequence[Sequence[str]], patience: float = _PATIENCE) -> list[str]:
        """
        End processes group by group: those of one at the same time, each group after the one before.

        Each process gets SIGINT, after `patience` seconds SIGTERM, after two more SIGKILL, and so does all it left
        behind; the time that it waits for a processor does not count. Returns the names of those that had to be killed.
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
                    # And what it may have started itself.
                    _signal(child.process, signal.SIGKILL)
                    child.status, child.process = child.process.wait(), None
        return killed

    def kill(self) -> None:
        """End everything at once, without patience."""
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
                env=self._environment,
                start_new_session=True,
            )
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
                self._report(f"{child.failure}; the other nodes go on, it is tried every {_SLOW_PAUSE:g} s")
            return
        pause = min(_FIRST_PAUSE * 2.0 ** (child.crashes - 1), _LONGEST_PAUSE)
        child.due = now + pause
        self._report(f"{name} ended unexpectedly ({in_words(status)}); it is started again in {pause:g} s")


def die_with_supervisor(environment: Mapping[str, str]) -> None:
    """
    Called by a supervised process at its start: SIGTERM reaches it when its supervisor dies, however that dies.

    Linux only; elsewhere, or without a supervisor, nothing happens.
    """
    supervisor = environment.get(SUPERVISOR_VARIABLE, "")
    if not supervisor.isdigit():
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
        if os.getppid() != int(supervisor):
            # It died before the line above.
            os.kill(os.getpid(), signal.SIGTERM)


def _bound(log: Path) -> None:
    """Restart a log once it is full; what a process writes between copying and cutting is lost."""
    # On a full disk the log stays as it is.
    with contextlib.suppress(OSError):
        if log.stat().st_size > _MOST_LOG:
            shutil.copyfile(log, log.with_suffix(".1.log"))
            os.truncate(log, 0)


def last_words(log: Path, most: int = 400) -> str:
    """The last line of a log that says something."""
    try:
        with log.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(file.tell() - 65536, 0))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError as error:
        return f"its log {log} cannot be read ({error.strerror})"
    output = [line.strip() for line in lines if line.strip()]
    return output[-1][-most:] if output else f"no output (log {log})"


def in_words(status: int) -> str:
    """Exit status of a process for people."""
    if status >= 0:
        return f"status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"


def _ask_to_end(processes: Sequence[subprocess.Popen[bytes]], number: signal.Signals, patience: float) -> None:
    """Send a signal to those that live and wait until none does, or patience with each is over."""
    waiting = {process: StopTime(patience, STOP_LIMIT + _MARGIN, process.pid) for process in processes}
    for process in processes:
        process.send_signal(number)
    while waiting := {one: allowed for one, allowed in waiting.items() if one.poll() is None and allowed.left() > 0.0}:
        time.sleep(_LOOK_PERIOD)


def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    # The group has the number of its leader, whose entry may be gone already.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)
