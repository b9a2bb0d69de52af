# SPDX-License-Identifier: Apache-2.0
"""
Collects what arrives from a well into its typed state.

The methods `on_...` take what arrived, `LiveState.at` returns the state of a moment for the page and the rig. Nothing
here reads a clock: every call takes `now`, s, of one steady clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.control.status import ControlStatus
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.list_files.remark import Remark
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.latest_values import LiveValue
from mwd_surface.live.link_state import LinkStatus
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.streams import LiveStreams
from mwd_surface.live.well_state import (
    AttitudeState,
    NodeDiagnostic,
    ReferenceField,
    SurveyProgress,
    ToolfaceState,
    WellState,
)
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.advice import Advice, AdviceMode
from mwd_surface.trajectory.plan import Offset, Plan
from mwd_surface.trajectory.slide_sheet import Stretch, Yield
from mwd_surface.trajectory.well_path import Definitive


class LiveState(LiveStreams):
    """
    Collector of the state of one well.

    Not thread-safe: all calls belong in one thread. A state that `at` returned does not change and may be read in any.
    """

    def __init__(self, settings: LiveSettings | None = None) -> None:
        super().__init__(settings)
        self._well = Well()
        self._reference: ReferenceField | None = None
        self._survey_reference = ReferenceField()
        self._records: tuple[SurveyRecord, ...] = ()
        self._remarks: tuple[Remark, ...] = ()
        self._path: Definitive | None = None
        self._covariance: Array | None = None
        self._plan: Plan | None = None
        self._offset: Offset | None = None
        self._dogleg_to_target: float | None = None
        self._clearance: tuple[Clearance, ...] = ()
        self._clearance_remarks: tuple[Remark, ...] = ()
        self._stretches: tuple[Stretch, ...] = ()
        self._yields: tuple[Yield, ...] = ()
        self._quill: float | None = None
        self._link: LinkStatus | None = None
        # When the word of each angle of a link was measured: s, and ns on the clock of the gauge.
        self._words: dict[str, tuple[float, int]] = {}
        self._control = ControlStatus()
        self._advice = Advice()
        self._downlink: DownlinkStatus | None = None
        self._inputs = InputTable()
        self._progress = SurveyProgress()
        self._recorder: RecorderStatus | None = None
        self._diagnostics: tuple[NodeDiagnostic, ...] = ()
        self._alarms: tuple[Alarm, ...] = ()
        self._events: tuple[Event, ...] = ()
        self._clock_offset: float | None = None
        self._not_evaluated: tuple[str, ...] = ()
        #: Whether a telemetry link stands between tool and surface; None: not known.
        self.over_link: bool | None = None
        #: Whether somebody described the well; False: its description is assumed.
        self.well_given = True

    def on_quill(self, angle: float, now: float) -> None:
        """Accept the angle of the quill, rad clockwise looking down-hole from the zero of the rig."""
        if math.isfinite(angle):
            self._quill = angle % math.tau
            self._touch("quill", now)

    def on_link(self, link: LinkStatus, now: float) -> None:
        """Accept the state of the link by which the surface hears the tool."""
        self._link = link
        for name in ("inclination", "azimuth", "toolface"):
            age = getattr(link, f"{name}_age")
            # A word that is taken back leaves the value shown as old as it was.
            if math.isfinite(age):
                self._words[name] = (link.at - age, link.stamp_ns - round(age * NANOSECONDS))
        self._touch("link", now)

    def on_control(self, status: ControlStatus, now: float) -> None:
        """Accept the owner of top drive and pumps, and the set-points."""
        self._control = status
        self._touch("control", now)

    def on_advice(self, advice: Advice, now: float) -> None:
        """Accept the advice on the next interval; the dial shows its toolface."""
        self._advice = advice
        self.on_advisory(advice.toolface if advice.mode == AdviceMode.SLIDE else None, advice.limit)
        self._touch("advice", now)

    def on_downlink(self, downlink: DownlinkStatus, now: float) -> None:
        """Accept the state of the command to the tool at hand."""
        self._downlink = downlink
        self._touch("downlink", now)

    def on_inputs(self, inputs: InputTable, now: float) -> None:
        """Accept clocks, ages and the source of depth of all inputs."""
        self._inputs = inputs
        self._touch("inputs", now)

    @property
    def survey_active(self) -> bool:
        """Whether a survey or a north seek is under way."""
        return self._progress.active

    def toolface_age(self, stamp_ns: int) -> float:
        """Age of the word that the toolface at a stamp, ns, was predicted from, s; 0 where no link is between."""
        link = self._link
        if link is None or math.isnan(link.toolface_age):
            return 0.0
        return max(link.toolface_age + (stamp_ns - link.stamp_ns) * 1e-9, 0.0)

    def _attitude(self, now: float) -> AttitudeState:
        """Continuous attitude; over a link each angle was measured when its word was."""
        attitude = self.attitude(now)
        return dataclasses.replace(
            attitude,
            inclination=self._of_word("inclination", attitude.inclination),
            azimuth=self._of_word("azimuth", attitude.azimuth),
        )

    def _toolface(self, now: float) -> ToolfaceState:
        toolface = self.toolface(now)
        if "toolface" not in self._words:
            return toolface
        _, measured_ns = self._words["toolface"]
        return dataclasses.replace(toolface, angle=self._of_word("toolface", toolface.angle), measured_ns=measured_ns)

    def _of_word(self, name: str, value: LiveValue) -> LiveValue:
        """Return a value with the time of the word that it comes from; without a link as it is."""
        if value.value is None or name not in self._words:
            return value
        return dataclasses.replace(value, measured_at=self._words[name][0])

    def on_well(self, well: Well, now: float, reference: ReferenceField | None = None) -> None:
        """Accept the well, and the reference field in force; without one, that of the last survey counts."""
        self._well, self._reference = well, reference
        self._touch("well", now)

    def on_records(self, records: Iterable[SurveyRecord], now: float, remarks: Iterable[Remark] = ()) -> None:
        """Accept all records of the survey list, in order, and its remarks."""
        self._records, self._remarks = tuple(records), tuple(remarks)
        self._touch("records", now)
        last = max(self._records, key=lambda r: r.survey.stamp_ns, default=None)
        if last is not None and last.survey.has_reference:
            self._survey_reference = ReferenceField.of_survey(last.survey)
            self._touch("well", now)

    def on_trajectory(self, path: Definitive, now: float, covariance: Array | None = None) -> None:
        """Accept the well path; covariance, shape (m, 3, 3): of its first m positions, m^2, for the ellipses."""
        self._path, self._covariance = path, covariance
        self._touch("path", now)

    def on_plan(self, plan: Plan | None, now: float) -> None:
        """Accept the planned path, dense enough to draw (`plan.interpolated`); None: there is none."""
        self._plan = plan
        self._touch("plan", now)

    def on_offset(self, offset: Offset | None, now: float, dogleg_to_target: float | None = None) -> None:
        """Accept the offset of the end of the path from the plan; dogleg_to_target: of the arc to the target, rad/m."""
        self._offset, self._dogleg_to_target = offset, dogleg_to_target
        self._touch("offset", now)

    def on_clearance(self, ahead: Sequence[Clearance], now: float, remarks: Iterable[Remark] = ()) -> None:
        """Accept the clearances from the last survey on, the nearest by the rule first, and the remarks about them."""
        self._clearance, self._clearance_remarks = tuple(ahead), tuple(remarks)
        self._touch("clearance", now)

    def on_steering(self, stretches: Sequence[Stretch], yields: Sequence[Yield], now: float) -> None:
        """Accept the slide sheet: stretches and yields, deepest last."""
        if (tuple(stretches), tuple(yields)) != (self._stretches, self._yields):
            self._stretches, self._yields = tuple(stretches), tuple(yields)
            self._touch("steering", now)

    def on_survey_progress(self, progress: SurveyProgress, now: float) -> None:
        """Accept the progress of a survey or north seek, or its end with a result."""
        known = progress.active and progress.elapsed is not None and math.isfinite(progress.elapsed)
        left = progress.active and progress.remaining is not None and math.isfinite(progress.remaining)
        self._progress = dataclasses.replace(
            progress,
            elapsed=progress.elapsed if known else None,
            remaining=progress.remaining if left else None,
        )
        self._touch("survey_progress", now)

    def on_recorder(self, status: RecorderStatus, now: float) -> None:
        """Accept the status of the recorder."""
        self.on_stream("recorder", 1, now)
        self._recorder = status
        self._touch("recorder", now)

    def on_diagnostics(self, diagnostics: Iterable[NodeDiagnostic], now: float) -> None:
        """Accept the diagnostics of all nodes as of now."""
        worst_first = tuple(sorted(diagnostics, key=lambda d: (-d.level, d.name)))
        if worst_first != self._diagnostics:
            self._diagnostics = worst_first
            self._touch("diagnostics", now)

    def on_alarms(
        self,
        alarms: Sequence[Alarm],
        events: Sequence[Event],
        now: float,
        now_ns: int | None = None,
        not_evaluated: tuple[str, ...] = (),
    ) -> None:
        """
        Take alarms and events, newest first (`AlarmBook.alarms`, `.events`).

        now_ns: `now` on their clock. not_evaluated: kinds of alarms that could not be judged, in words.
        """
        self._not_evaluated = not_evaluated
        self._clock_offset = None if now_ns is None else now_ns * 1e-9 - now
        self._alarms, self._events = tuple(alarms), tuple(events)
        self._touch("alarms", now)
        self._touch("events", now)

    def at(self, now: float) -> WellState:
        """Return the state as of `now`."""
        history, trend, depth_log = self.charts(now)
        return WellState(
            now=now,
            attitude=self._attitude(now),
            toolface=self._toolface(now),
            drilling=self.drilling(now),
            rig=self.rig(now),
            streams=self.streams(now),
            well=self._well,
            reference=self._reference or self._survey_reference,
            records=self._records,
            remarks=self._remarks,
            path=self._path,
            covariance=self._covariance,
            plan=self._plan,
            offset=self._offset,
            dogleg_to_target=self._dogleg_to_target,
            clearance=self._clearance,
            clearance_remarks=self._clearance_remarks,
            stretches=self._stretches,
            yields=self._yields,
            quill=self._quill,
            link=self._link,
            control=self._control,
            advice=self._advice,
            downlink=self._downlink,
            inputs=self._inputs,
            survey_progress=self._progress,
            recorder=self._recorder,
            diagnostics=self._diagnostics,
            alarms=self._alarms,
            events=self._events,
            clock_offset=self._clock_offset,
            not_evaluated=self._not_evaluated,
            over_link=self.over_link,
            well_given=self.well_given,
            history=history,
            trend=trend,
            depth_log=depth_log,
            changes=dict(self._changes),
        )
