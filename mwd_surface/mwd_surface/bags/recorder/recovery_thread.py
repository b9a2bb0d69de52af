# SPDX-License-Identifier: Apache-2.0
"""Recovers, in the background, what earlier recordings in a folder left unfinished."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from mwd_surface.bags.mcap import recovery
from mwd_surface.bags.mcap.recovery_report import RecoveryReport
from mwd_surface.bags.recorder.status import Level


class RecoveryThread:
    """
    A thread that recovers bags one after another.

    Parameters
    ----------
    bags : sequence of Path
        Folders of bags; finished ones are left alone.
    going_on : callable
        Returns False when it has to stop.
    report : callable
        Called from the thread with level and text of an event.

    Attributes
    ----------
    reports : list of RecoveryReport
        Of the files recovered so far.
    """

    def __init__(
        self, bags: Sequence[Path], going_on: Callable[[], bool], report: Callable[[Level, str], None]
    ) -> None:
        self.reports: list[RecoveryReport] = []
        self._bags, self._going_on, self._report = bags, going_on, report
        self._thread = threading.Thread(target=self._run, name="recovery", daemon=True)
        if bags:
            self._thread.start()

    def join(self, timeout_s: float) -> None:
        """Wait for its end, at most so long."""
        if self._bags:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        for bag in self._bags:
            try:
                if not self._going_on() or not recovery.is_unfinished(bag):
                    continue
                reports = recovery.recover_bag(bag, self._going_on, thorough=False)
            except InterruptedError:
                return
            except OSError as error:
                self._report(Level.ERROR, f"{bag} could not be recovered: {error}")
                continue
            for report in reports:
                self.reports.append(report)
                if not report.sound:
                    self._report(Level.WARNING, f"recovered in {bag.name}: {report.sentence()}")
