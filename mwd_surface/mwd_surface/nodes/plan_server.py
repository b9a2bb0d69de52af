"""The planned path and the advice to the driller: read from settings, shown on the page, compared with the path."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path

from mwd_sensors.core.settings import setting
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.surveys.plan import Plan, interpolated, offset_from, steering_to
from mwd_surface.surveys.plan_file import PlanError, read_plan
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_path import Definitive

_STEP = 10.0  # m between points of the plan as drawn


@dataclasses.dataclass(frozen=True)
class PlanSettings:
    """The planned well path."""

    file: str = setting("", "Planned path, CSV or WITSML 1.4.1.1; read again at any change of parameters; empty: none")
    sets_section: bool = setting(True, "Where well.section_azimuth_deg is 0, the plan gives the vertical section")


@dataclasses.dataclass(frozen=True)
class AdvisorySettings:
    """What the driller is asked to steer at."""

    toolface_deg: float = setting(-1.0, "Toolface wanted; below 0: no advice", unit="deg", low=-1.0, high=360.0)
    limit_deg: float = setting(15.0, "What it may be off", unit="deg", low=1.0, high=180.0)


class PlanDesk:
    """
    Plan and advice of one well.

    Attributes
    ----------
    plan : Plan or None
        The one in force.
    """

    def __init__(self, live: LiveState, journal: Journal) -> None:
        self.plan: Plan | None = None
        self._live = live
        self._journal = journal
        self._asked = PlanSettings()

    def read(self, asked: PlanSettings, north: str) -> None:
        """Take the plan of the file; one that cannot be used is told, and the page does without."""
        self._asked, self.plan = asked, None
        if asked.file:
            try:
                plan = _plan_from(Path(asked.file).expanduser(), north)
            except PlanError as error:
                text = f"the plan is not used: {error}"
                self._journal.alarm("plan.file", Severity.WARNING, text, "mend the file, then set plan.file again")
                return
            self.plan = plan
            self._journal.note("plan", f"{plan.name}: {len(plan.md)} stations to {plan.md[-1]:.0f} m")
        self._journal.clear("plan.file")

    def along_plan(self, well: Well) -> Well:
        """The well as configured, with the vertical section along the plan where nothing else is said."""
        if self.plan is None or not self._asked.sets_section or well.section_azimuth_deg != 0.0:
            return well
        return dataclasses.replace(well, section_azimuth_deg=math.degrees(self.plan.section_azimuth))

    def show_advice(self, asked: AdvisorySettings) -> None:
        """Bring the wanted toolface to the page."""
        wanted = math.radians(asked.toolface_deg) if asked.toolface_deg >= 0.0 else None
        self._live.on_advisory(wanted, math.radians(asked.limit_deg))

    def show_plan(self) -> None:
        """Bring the plan to the page."""
        self._live.on_plan(interpolated(self.plan, _STEP) if self.plan is not None else None, time.monotonic())

    def show_offset(self, path: Definitive) -> None:
        """Bring to the page where the end of the path is from the plan."""
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


def _plan_from(path: Path, north: str) -> Plan:
    plan = read_plan(path)
    if plan.north and plan.north != north:
        raise PlanError(f"{path}: azimuths from {plan.north} north, those of the well from {north} north")
    return plan
