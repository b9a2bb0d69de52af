# SPDX-License-Identifier: Apache-2.0
"""Offset wells while drilling: clearance at the bit and ahead along the plan, shown on the page and as alarms."""

from __future__ import annotations

import concurrent.futures

from mwd_sensors.core.foreign_text import without_contents
from mwd_surface.clearance.clearance import ClearanceLevel
from mwd_surface.clearance.well_clearance import WellClearance, offset_wells_of, well_clearance
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.alarms import Severity
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.plan import Plan
from mwd_surface.uncertainty.error_terms import CovarianceUnavailableError

_BIT_STEP = 5.0  # movement of the bit after which the wells are compared again, m
_SEPARATION, _FILE = "clearance.separation", "clearance.wells"
_REMEDIES = {
    ClearanceLevel.STOP: "stop drilling; review the separation with the survey engineer before going on",
    ClearanceLevel.WARNING: "review the separation with the survey engineer; steer away or survey more often",
}


class ClearanceMonitor:
    """Monitor that compares the well with its offset wells in the background when list, plan or bit have changed."""

    def __init__(self, context: WellContext, plan: PlanMonitor) -> None:
        self._clock, self._live, self._alarm_log = context.clock, context.live, context.alarm_log
        self._outlet = context.outlet
        self._plan = plan
        self._compared: tuple[SurveyList, Plan | None, float | None] | None = None
        self._busy = False

    def update(self, surveys: SurveyList, bit_depth: float | None) -> None:
        """
        Start a comparison if the list or plan has changed, or the bit has moved by 5 m; called once a second.

        bit_depth: m, or None. Nothing is started while a comparison runs, or if the list has no surveys.
        """
        plan = self._plan.plan
        if self._busy or not surveys.records or self._is_compared(surveys, plan, bit_depth):
            return
        self._compared = (surveys, plan, bit_depth)
        self._busy = True
        self._outlet.run(lambda: _compare(surveys, plan, bit_depth), self._show)

    def _is_compared(self, surveys: SurveyList, plan: Plan | None, bit_depth: float | None) -> bool:
        if self._compared is None:
            return not surveys.well.offset_wells
        old_surveys, old_plan, old_bit = self._compared
        if surveys is not old_surveys or plan is not old_plan:
            return False
        return bit_depth is None or (old_bit is not None and abs(bit_depth - old_bit) < _BIT_STEP)

    def _show(self, job: concurrent.futures.Future[WellClearance | str | None]) -> None:
        self._busy = False
        near = job.result()
        log = self._alarm_log
        if near is None or isinstance(near, str):
            self._live.show(self._clock.now, clearance=(), clearance_remarks=())
            # A text means that the wells cannot be compared now: keep the alarm, because the wells may still be near.
            if near is None:
                log.clear_alarm(_SEPARATION)
            self._report_file((near,) if near else ())
            return
        ahead = near.ahead()
        self._live.show(self._clock.now, clearance=tuple(ahead), clearance_remarks=tuple(near.remarks))
        # Assumptions are shown on the page. Only a well that was not compared raises an alarm, because it may be near.
        self._report_file(sentences(near.not_compared))
        if near.level == ClearanceLevel.CLEAR:
            if not near.refused:
                log.clear_alarm(_SEPARATION)
            return
        severity = Severity.CRITICAL if near.level == ClearanceLevel.STOP else Severity.WARNING
        beyond = float(ahead[0].md[ahead[0].least]) - near.bit
        place = f"{beyond:.0f} m ahead of the bit" if beyond > 0.0 else "at the bit"
        log.raise_alarm(_SEPARATION, severity, f"{ahead[0].sentence()}; {place}", _REMEDIES[near.level])

    def _report_file(self, missing: tuple[str, ...]) -> None:
        if missing:
            remedy = "correct the file, or the setting that the file names, then set well.offset_wells again"
            self._alarm_log.raise_alarm(_FILE, Severity.WARNING, "; ".join(missing), remedy)
        else:
            self._alarm_log.clear_alarm(_FILE)


def _compare(surveys: SurveyList, plan: Plan | None, bit_depth: float | None) -> WellClearance | str | None:
    """
    Return the clearance of a well to its offset wells; None without offset wells.

    If the wells cannot be compared, the result is a sentence with the reason.
    """
    try:
        try:
            offsets = offset_wells_of(surveys)
        except (ValueError, OSError) as error:
            # Do not quote the file, because the alarm is shown on a page that needs no login.
            return without_contents(surveys.well.offset_wells, error, "`mwd clearance`")
        return None if offsets is None else well_clearance(surveys, offsets, plan, bit_depth, quoting=False)
    except (CovarianceUnavailableError, ValueError) as error:
        return str(error)
