# SPDX-License-Identifier: Apache-2.0
"""Planned path and offset wells while drilling: read, shown on the page, compared with the path of the well."""

from __future__ import annotations

import concurrent.futures
import math
from pathlib import Path

from mwd_sensors.core.foreign_text import without_contents
from mwd_surface.clearance.clearance import ClearanceLevel
from mwd_surface.clearance.offset_wells import WellClearance, offset_wells_of, well_clearance
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_settings import NODE, asked
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.alarms import Severity
from mwd_surface.live.settings import PlanSettings
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import DRAWN_STEP, Plan, in_north, interpolated, offset_of_end, read_plan, straight
from mwd_surface.trajectory.well_path import Definitive
from mwd_surface.uncertainty.error_terms import CovarianceUnavailableError

# Planned path.


class PlanMonitor:
    """Monitor of the plan of one well: reads the plan and shows it on the page."""

    def __init__(self, context: WellContext) -> None:
        self.plan: Plan | None = None  #: the plan in force
        self._clock, self._live, self._alarm_log = context.clock, context.live, context.alarm_log

    @staticmethod
    def read(settings: PlanSettings, well: Well) -> Plan | ListFileError | None:
        """Return the plan of the settings, an error if it cannot be used, or None without a plan; thread-safe."""
        if not settings.file:
            try:
                return _straight(settings, well)
            except ValueError as error:
                return ListFileError(str(error))
        path = Path(settings.file).expanduser()
        try:
            given = settings.given().with_dip(well.angles.points)
        except ValueError as error:
            return ListFileError(f"plan: {error}")
        try:
            plan = read_plan(path, given=given)
        except ListFileError as error:
            # Do not quote the file: the alarm is shown on a page that needs no login.
            return ListFileError(without_contents(path, error, "`mwd path`"))
        try:
            return in_north(plan, path, well.north_reference)
        except ListFileError as error:
            return asked(error, NODE)

    def use(self, found: Plan | ListFileError | None) -> None:
        """Use the result of `read`; an error raises an alarm, and then the well has no plan."""
        self.plan = None
        if isinstance(found, ListFileError):
            text = f"the plan is not used: {found}"
            remedy = (
                "correct the settings of the plan; or correct its file, or confirm it with plan.confirm, then set "
                "plan.file again"
            )
            self._alarm_log.raise_alarm("plan.file", Severity.WARNING, text, remedy)
            return
        if found is not None:
            self.plan = found
            self._alarm_log.log_event("plan", f"{found.name}: {len(found.md)} stations to {found.md[-1]:.0f} m")
        self._alarm_log.clear_alarm("plan.file")

    def show_plan(self) -> None:
        """Show the plan on the page."""
        drawn = None if self.plan is None else interpolated(self.plan, DRAWN_STEP)
        self._live.show(self._clock.now, plan=drawn)

    def show_offset(self, path: Definitive) -> None:
        """Show the offset of the end of the path from the plan on the page."""
        self._live.show(self._clock.now, offset=offset_of_end(self.plan, path))


def _straight(settings: PlanSettings, well: Well) -> Plan | None:
    """
    Return the straight plan that the settings describe; None if the settings describe no straight plan.

    Raises ValueError if the settings contradict each other, or the convention of the well.
    """
    azimuth, angle = settings.opening_azimuth_deg, settings.opening_angle_deg
    if azimuth is None and angle is None:
        return None
    if azimuth is None or angle is None:
        given, missing = ("azimuth", "angle") if angle is None else ("angle", "azimuth")
        raise ValueError(
            f"a straight design needs plan.opening_{missing}_deg too, only plan.opening_{given}_deg is set"
        )
    ends = sorted(math.degrees(well.angles.shown(end)) for end in (0.0, math.pi))
    if not ends[0] <= angle <= ends[1]:
        raise ValueError(
            f"the angle of the design, plan.opening_angle_deg, must be within {ends[0]:.0f} and {ends[1]:.0f} degrees,"
            f" because well.convention is {well.angles.value}; got {angle:g}"
        )
    inclination = min(max(well.angles.inclination(math.radians(angle)), 0.0), math.pi)
    return straight(inclination, math.radians(azimuth), settings.length_m, well.north_reference, "straight design")


# Offset wells: clearance at the bit and ahead along the plan.

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
