# SPDX-License-Identifier: Apache-2.0
"""The planned path: read from settings, shown on the page, compared with the surveyed path."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path

from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.nodes.settings import PlanSettings
from mwd_surface.ros.alarm_log import AlarmLog
from mwd_surface.surveys.list_columns import ListFileError
from mwd_surface.surveys.plan import Plan, interpolated, offset_from, steering_to
from mwd_surface.surveys.plan_file import read_plan
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_path import Definitive

_DRAWN_STEP = 10.0  # m between the points of the plan that the page draws


class PlanServer:
    """
    Plan of one well.

    Attributes
    ----------
    plan : Plan or None
        The plan in force.
    """

    def __init__(self, live: LiveState, alarm_log: AlarmLog) -> None:
        self.plan: Plan | None = None
        self._live = live
        self._alarm_log = alarm_log

    @staticmethod
    def read(settings: PlanSettings, north: str) -> Plan | ListFileError | None:
        """Read the plan from its file, in any thread: the plan, why it cannot be used, or None where none is named."""
        try:
            return read_plan(Path(settings.file).expanduser(), north) if settings.file else None
        except ListFileError as error:
            return error

    def use(self, found: Plan | ListFileError | None) -> None:
        """Use what `read` has found; a file that cannot be used raises an alarm, and there is no plan."""
        self.plan = None
        if isinstance(found, ListFileError):
            text = f"the plan is not used: {found}"
            remedy = "correct the file, then set plan.file again"
            self._alarm_log.raise_alarm("plan.file", Severity.WARNING, text, remedy)
            return
        if found is not None:
            self.plan = found
            self._alarm_log.log_event("plan", f"{found.name}: {len(found.md)} stations to {found.md[-1]:.0f} m")
        self._alarm_log.clear_alarm("plan.file")

    def with_section(self, well: Well) -> Well:
        """Set the vertical section of a well along the plan, where no other is configured."""
        if self.plan is None or well.section_azimuth_deg >= 0.0:
            return well
        return dataclasses.replace(well, section_azimuth_deg=math.degrees(self.plan.section_azimuth))

    def show_plan(self) -> None:
        """Show the plan."""
        self._live.on_plan(interpolated(self.plan, _DRAWN_STEP) if self.plan is not None else None, time.monotonic())

    def show_offset(self, path: Definitive) -> None:
        """Show where the end of the path is relative to the plan."""
        now, plan = time.monotonic(), self.plan
        if plan is None or len(path.md) < 2:
            self._live.on_offset(None, now)
            return
        end = path.positions[-1], float(path.inclination[-1]), float(path.azimuth[-1])
        try:
            dogleg: float | None = steering_to(*end, plan.target).dogleg_severity
        except ValueError:
            # The target is reached or behind the bit: no arc leads there.
            dogleg = None
        self._live.on_offset(offset_from(plan, *end), now, dogleg)
