# SPDX-License-Identifier: Apache-2.0
"""Monitor of the ROS nodes of a well: their diagnostics, and the progress of a survey."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from mwd_sensors.core.unknown import or_nan
from mwd_sensors.core.wire import OVER
from mwd_surface.live.alarms import Causes, Severity
from mwd_surface.live.supervision import TABLE
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import DiagnosticLevel, NodeDiagnostic, ReferenceFieldState, SurveyProgress
from mwd_surface.surveys.well import Well

_TIMEOUT_S = 2.0  # time without feedback or progress after which the sender counts as silent, s
_SUPERVISED = {row.alarm for row in TABLE}
_WARN, _ERROR = 1, 2  # levels of diagnostic_msgs/DiagnosticStatus
_DIAGNOSTICS_AGE_S = 5.0  # age above which diagnostics are no longer shown, s
_REFERENCE = ("total", "dip", "declination", "convergence", "gravity")


class DiagnosticsMonitor:
    """
    Monitor of the ROS nodes of one well; the parts of the surface node raise the alarms for their own errors.

    Parameters
    ----------
    full_name : str
        Full name of the surface node, with the namespace of the well.
    link : str
        Setting `link.source`: name of the link whose data the surface uses, `best` for the best of all links, `direct`
        if the data come from the tool without a link.
    """

    def __init__(self, context: WellContext, full_name: str, link: str = "direct") -> None:
        #: Reference field that the estimator or receiver reports in its diagnostics.
        self.reference: ReferenceFieldState | None = None
        #: Time of the first report that a simulation or replay has ended, s; None without a report, and again after the
        #: same node reports that it continues.
        self.over_at: float | None = None
        #: Name of the node that has reported the end, without its namespace; empty without a report.
        self.over_by = ""
        self._link = link
        self._own_name, self._namespace = full_name, full_name.rpartition("/")[0] or "/"
        self._clock, self._live, self._alarm_log = context.clock, context.live, context.alarm_log
        self._well = Well()
        self._diagnostics_of: dict[str, tuple[float, list[Any]]] = {}
        self._progress = SurveyProgress()
        self._progress_at = 0.0
        self._action_at = -math.inf
        self._result = ""

    def show_well(self, well: Well) -> None:
        """Show the description of the well, and the reference field of the estimator."""
        self._well = well
        self._live.show(self._clock.now, well=well, reference_given=self.reference)

    def on_diagnostics(self, array: Any) -> None:
        """Accept the diagnostics of a node, diagnostic_msgs/DiagnosticArray; those of other wells are ignored."""
        ours = [s for s in array.status if s.hardware_id == self._namespace]
        if ours:
            node = ours[0].name.partition(":")[0]
            self._diagnostics_of[node] = (self._clock.now, ours)
            self._follow_end(
                node.rpartition("/")[2],
                any((pair.key, pair.value) == OVER for status in ours for pair in status.values),
            )
        for status in ours:
            values = {pair.key: pair.value for pair in status.values}
            if status.name.endswith("estimator: survey") and not self._live.parts.over_link:
                figures = (_number(values.get("elapsed_s")) or 0.0, _number(values.get("remaining_s")) or 0.0)
                # Ignore the diagnostics while an action sends feedback, which is more recent.
                if self._clock.now - self._action_at > _TIMEOUT_S:
                    waits_for = values.get("waits_for", "")
                    self._show_progress(
                        SurveyProgress("remaining_s" in values, status.message, *figures, waits_for=waits_for)
                    )
            elif status.name.endswith(("estimator: reference field", "receiver: reference field")):
                self._on_reference(values, status.message)

    def _follow_end(self, node: str, over: bool) -> None:
        """Store whether a simulation or replay has ended, until the same node reports that it runs again."""
        if over and self.over_at is None:
            self._alarm_log.log_event("scenario", "the run is over; missing samples no longer raise an alarm")
            self.over_at, self.over_by = self._clock.now, node
        elif not over and node == self.over_by:
            self.over_at, self.over_by = None, ""
        if self._live.parts.over != (self.over_at is not None):
            self._live.show(self._clock.now, over=self.over_at is not None)

    def on_north_seek(self, feedback: Any) -> None:
        """Show the progress of a north seek: NorthSeek feedback."""
        progress = feedback.feedback
        state = f"seeking north: {progress.state}"
        if math.isfinite(progress.sigma):
            state += f"; {math.degrees(progress.azimuth):.1f} deg +- {math.degrees(progress.sigma):.1f} so far"
        self._on_feedback(progress, state)

    def on_rotary_survey(self, feedback: Any) -> None:
        """Show the progress of a survey taken while the string rotates: RotarySurvey feedback."""
        progress = feedback.feedback
        self._on_feedback(progress, f"rotary survey: {progress.state}")

    def _on_feedback(self, progress: Any, state: str) -> None:
        self._action_at = self._clock.now
        self._show_progress(SurveyProgress(True, state, progress.elapsed, progress.remaining))

    def survey_ended(self, result: str) -> None:
        """Show that the survey has ended; result is the outcome in words."""
        self._result = result
        self._show_progress(SurveyProgress(state=self._progress.state))

    def _show_progress(self, progress: SurveyProgress) -> None:
        shown = dataclasses.replace(progress, result=self._result)
        if shown.active or shown != self._progress:
            self._progress_at = self._clock.now
            self._progress = shown
            self._live.show(self._progress_at, survey_progress=shown)

    def _on_reference(self, values: dict[str, str], source: str) -> None:
        reference = None
        numbers = {name: or_nan(_number(values[name])) for name in _REFERENCE if name in values}
        if "total" in numbers and all(map(math.isfinite, numbers.values())):
            reference = ReferenceFieldState(**numbers, source=source)
        if reference != self.reference:
            self.reference = reference
            self.show_well(self._well)

    def update(self, now: float) -> None:
        """Raise alarms of faulty nodes and show the diagnostics; called once a second. now: steady time, s."""
        self._alarm_log.set_alarms("node.", self._node_alarms(now))
        if self._progress.active and now - self._progress_at > _TIMEOUT_S + 1.0:
            self._show_progress(SurveyProgress())
        statuses = [
            NodeDiagnostic(s.name, DiagnosticLevel(min(max(_level(s), 0), 3)), s.message, _remedy(s))
            for received_at, found in self._diagnostics_of.values()
            if now - received_at < _DIAGNOSTICS_AGE_S
            for s in found
        ]
        worst_first = tuple(sorted(statuses, key=lambda one: (-one.level, one.name)))
        if worst_first != self._live.parts.diagnostics:
            self._live.show(now, diagnostics=worst_first)

    def _node_alarms(self, now: float) -> Causes:
        """Return alarms for errors of other nodes, and for errors and warnings of sensors, by id."""
        causes: Causes = {}
        for node, (received_at, found) in self._diagnostics_of.items():
            if now - received_at >= _DIAGNOSTICS_AGE_S:
                continue
            for status in found:
                level, what = _level(status), status.name.partition(": ")[2]
                alarming = level == _ERROR or (level == _WARN and what.startswith("sensors"))
                # Errors of this node raise alarms where they occur, except those of the middleware.
                own = node == self._own_name and not what.startswith("middleware")
                if alarming and not own and not self._follows(what) and f"input.{what}" not in _SUPERVISED:
                    severity = Severity.CRITICAL if level == _ERROR else Severity.WARNING
                    causes[f"node.{node.strip('/')}.{what}"] = (severity, status.message, _remedy(status))
        return causes

    def _follows(self, what: str) -> bool:
        """Return whether a diagnostic is the state of a link for which `LinkMonitor` already raises the alarm."""
        kind, _, name = what.partition(" ")
        return kind == "link" and self._link != "direct" and (not name or self._link in ("best", name))


def _number(text: str | None) -> float | None:
    """Return the number in a text; None if the text is not a finite number."""
    try:
        number = float(text or "")
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _level(status: Any) -> int:
    """Return the level of a status as a number; readers of messages give a byte as bytes or as a number."""
    level = status.level
    return int(level[0] if isinstance(level, bytes) else level)


def _remedy(status: Any) -> str:
    return next((pair.value for pair in status.values if pair.key == "remedy"), "")
