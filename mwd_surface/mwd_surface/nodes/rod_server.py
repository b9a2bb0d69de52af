# SPDX-License-Identifier: Apache-2.0
"""Depth by counting rods: the operator enters each rod, the tally gives the bit depth, and a log stores the tally."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mwd_msgs import srv

from mwd_surface.live.alarms import Severity
from mwd_surface.live.well_state import RodCount
from mwd_surface.nodes.survey_list_server import SAVE_REMEDY, SurveyListServer, answer_with
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.rods import CORRECT, RodLog, RodSettings, RodTally, disagreement

Answer = tuple[bool, str]
NAME = "rods.csv"
_REMEDY = "count the rods in the hole, and correct the tally by their number"


class RodServer:
    """
    Rod tally of one well: count of the rods in the hole, from which the bit depth follows.

    Parameters
    ----------
    surveys : SurveyListServer
        Survey list, where the bit depth of the tally is set like a depth by hand, so that recordings have this depth.
    """

    rig_depth: Callable[[], float | None]

    def __init__(self, context: SurfaceContext, settings: RodSettings, surveys: SurveyListServer) -> None:
        self._context, self._settings, self._surveys = context, settings, surveys
        self._log = RodLog(context.folder / "surveys" / NAME)
        self.tally = RodTally(settings.first_m)
        #: Function that returns the bit depth from the rig, m, even while a depth by hand is in force; None if the rig
        #: sends no depth.
        self.rig_depth = lambda: None
        self._agreed = True  # whether tally and rig agreed, or the rig sent no depth, at the last change or later
        self._unsaved = ""  # reason why changes of the tally are not on disk; empty if they are
        self._taken = 0  # number of surveys in the list at the last change
        self._read()
        self.show()

    def _read(self) -> None:
        """Read the tally from its log; raise an alarm if the log, or lines of it, cannot be read."""
        try:
            self.tally, bad = self._log.read(self._settings.first_m)
        except OSError as error:
            text = f"the log of rods {self._log.path} could not be read: {error.strerror}"
        else:
            text = f"{bad} lines of {self._log.path} cannot be read" if bad else ""
        if text:
            self._context.alarm_log.raise_alarm("rods.log", Severity.WARNING, text, _REMEDY)

    def begin(self) -> None:
        """
        Set the bit depth after the last change of the tally, with the time of that change, if no depth is known.

        Nothing is done if depth is not counted by rods. A depth that is refused raises an alarm.
        """
        if self._settings.length_m is None or not self.tally.changes or self._surveys.depth.latest is not None:
            return
        last, log = self.tally.changes[-1], self._context.alarm_log
        try:
            self._surveys.restore_depth(min(last.stamp_ns, log.now_ns()), self.tally.bit_depth, last.operator)
        except ValueError as error:
            log.raise_alarm("rods.log", Severity.WARNING, f"the depth by rods is not used: {error}", _REMEDY)

    def count(
        self,
        *,
        operator_name: str,
        change: int | None = None,
        count: int | None = None,
        length: float | None = None,
        reason: str = "",
    ) -> Answer:
        """
        Change the tally, and set the bit depth.

        change: 1 adds a rod that has been drilled down, -1 removes the last rod. count: number of rods in the hole,
        counted by a person. length: length of added rods if it differs from `rods.length_m`, m. Return whether the
        change was made, and a message.
        """
        usual = self._settings.length_m
        if usual is None:
            return False, "the depth is not counted by rods: set rods.length_m to the length of a rod"
        if (change is None) == (count is None) or change not in (None, 1, -1):
            return False, "give either change, 1 or -1, or count, the number of rods in the hole"
        now, rod = self._context.alarm_log.now_ns(), usual if length is None else length
        try:
            if count is not None:
                tally = self.tally.correct(now, count, rod, operator_name, reason)
            elif change == 1:
                tally = self.tally.add(now, rod, operator_name, reason)
            else:
                tally = self.tally.remove(now, operator_name, reason)
        except ValueError as error:
            return False, str(error)
        request = srv.SetDepth.Request(bit_depth=tally.bit_depth, operator_name=operator_name)
        response: Any = self._surveys.set_depth(request, srv.SetDepth.Response())
        if not response.success:
            return False, response.message
        missed = self._without_survey()
        before, self.tally = self.tally, tally
        self._write()
        self.show()
        self._compare(usual, changed=True)
        words = f"{len(tally.lengths)} rods in the hole, bit depth {tally.bit_depth:.2f} m"
        log = self._context.alarm_log
        if count is not None:
            because = reason
            text = (
                f"tally corrected from {len(before.lengths)} to {len(tally.lengths)} rods, {operator_name}: {because}"
            )
            log.log_event("rods", text, Severity.WARNING)
        else:
            log.log_event("rods", f"rods counted by {operator_name}: {words}")
        if change == 1 and missed:
            log.log_event("rods", missed, Severity.WARNING)
        return True, answer_with(words, self._unsaved)

    def show(self) -> None:
        """Show the tally on the page; does nothing if depth is not counted by rods."""
        length = self._settings.length_m
        if length is not None:
            known = RodCount(len(self.tally.lengths), self.tally.bit_depth, length)
            self._context.well.live.show(self._context.well.clock.now, rods=known)

    def update(self) -> None:
        """Compare the tally with the rig, and write changes that could not be written before; called once a second."""
        if self._settings.length_m is not None:
            self._write()
            self._compare(self._settings.length_m, changed=False)

    def _compare(self, length: float, *, changed: bool) -> None:
        """
        Raise an alarm while the bit depth of the tally differs from the bit depth of the rig.

        When a rod is added or removed, both depths must agree within half a rod. Until the next change the bit moves by
        up to one rod down or up, so the limit is then one and a half rods if both agreed at the last change.
        """
        rig = self.rig_depth()
        near = rig is None or not disagreement(self.tally, rig, length)
        self._agreed = near or (self._agreed and not changed)
        apart = "" if rig is None else disagreement(self.tally, rig, length, 1.5 if self._agreed else 0.5)
        causes = {"rods.apart": (int(Severity.WARNING), apart, _REMEDY)} if apart else {}
        self._context.alarm_log.set_alarms("rods.apart", causes)

    def _without_survey(self) -> str:
        """Return a warning if no survey was taken since the last rod change; empty otherwise, and without rods."""
        rods, taken = len(self.tally.lengths), len(self._surveys.surveys.records)
        known, self._taken = self._taken, taken
        if not rods or taken > known:
            return ""
        return (
            f"no survey since rod {rods} was added: stop pumps and rotation at each rod change until a survey is taken"
        )

    def _write(self) -> None:
        """Append the changes that are not in the log yet; if the disk is full, raise an alarm and continue."""
        log, tally = self._context.alarm_log, self.tally
        if self._log.holds(tally):
            return
        try:
            self._log.keep(tally)
        except OSError as error:
            self._unsaved = f"the log of rods {self._log.path} could not be written: {error.strerror}"
            log.raise_alarm("rods.unsaved", Severity.WARNING, self._unsaved, SAVE_REMEDY)
            return
        self._unsaved = ""
        log.clear_alarm("rods.unsaved")
        if tally.changes and tally.changes[-1].action == CORRECT:
            log.clear_alarm("rods.log")
