# SPDX-License-Identifier: Apache-2.0
"""Background recovery of earlier recordings in a folder that were left unfinished."""

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
        Folders of bags; finished bags are not changed.
    going_on : callable
        Returns False when recovery must stop.
    report : callable
        Called in this thread with the level and text of an event.

    Attributes
    ----------
    reports : list of RecoveryReport
        Reports on the files recovered so far.
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
        """Wait at most `timeout_s` seconds for the end of the thread."""
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
