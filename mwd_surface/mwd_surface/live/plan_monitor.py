# SPDX-License-Identifier: Apache-2.0
"""Planned path of a well: read as the settings say, shown on the page, compared with the surveyed path."""

from __future__ import annotations

import math
from pathlib import Path

from mwd_sensors.core.foreign_text import without_contents
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_settings import NODE, asked
from mwd_surface.live.alarms import Severity
from mwd_surface.live.settings import PlanSettings
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import DRAWN_STEP, Plan, interpolated, offset_of_end, straight
from mwd_surface.trajectory.plan_file import in_north, read_plan
from mwd_surface.trajectory.well_path import Definitive


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
