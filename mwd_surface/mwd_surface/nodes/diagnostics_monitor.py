"""How the graph is: what its nodes say of themselves, the survey under way, and who has fallen silent."""

from __future__ import annotations

import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message

from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_state import NodeDiagnostic, ReferenceField
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.surveys.well import Well

_SILENT_AFTER = 2.0  # s
_WARN, _ERROR = DiagnosticStatus.WARN[0], DiagnosticStatus.ERROR[0]
_REPORT_LASTS = 5.0  # s
_REFERENCE = ("total", "dip", "declination", "convergence", "gravity")
_WATCHED = (
    ("imu/data_raw", "sonde", Severity.CRITICAL),
    ("attitude", "estimator", Severity.CRITICAL),
    ("rig/state", "rig data", Severity.WARNING),
)


class HealthDesk:
    """
    Health of one well's graph.

    own : str
        Full name of the node itself: what is wrong with it is told where it happens.

    Attributes
    ----------
    reference : ReferenceField or None
        The reference field the estimator has in force.
    """

    def __init__(self, own: str, namespace: str, live: LiveState, journal: Journal) -> None:
        self.reference: ReferenceField | None = None
        self._own, self._namespace, self._live, self._journal = own, namespace, live, journal
        self._well = Well()
        self._heard: dict[str, float] = {}
        self._findings_of: dict[str, tuple[float, list[Any]]] = {}
        self._progress: tuple[bool, str] = (False, "")
        self._progress_at = 0.0
        self._action_at = -_SILENT_AFTER
        self._result = ""

    def heard(self, topic: str) -> None:
        """A message of a topic came."""
        self._heard[topic] = time.monotonic()

    def show_well(self, well: Well) -> None:
        """Bring the well to the page, with the field in force."""
        self._well = well
        self._live.on_well(well, time.monotonic(), self.reference)

    def on_diagnostics(self, data: bytes) -> None:
        """What a node says of itself, serialised."""
        array = deserialize_message(data, DiagnosticArray)
        ours = [s for s in array.status if s.hardware_id == self._namespace]
        if ours:
            self._findings_of[ours[0].name.partition(":")[0]] = (time.monotonic(), ours)
        for status in ours:
            values = {pair.key: pair.value for pair in status.values}
            if status.name.endswith("estimator: survey"):
                figures = (float(values.get("elapsed_s", 0.0)), float(values.get("remaining_s", 0.0)))
                # While an action tells how far it is, that counts.
                if time.monotonic() - self._action_at > _SILENT_AFTER:
                    self._show_progress("remaining_s" in values, *figures, status.message)
            elif status.name.endswith("estimator: reference field"):
                self._on_reference(values, status.message)

    def on_north_seek(self, feedback: Any) -> None:
        """How far the gyros are with north: NorthSeek feedback."""
        seen = feedback.feedback
        state = f"seeking north: {seen.state}"
        if seen.sigma >= 0.0:
            state += f"; {math.degrees(seen.azimuth):.1f} deg +- {math.degrees(seen.sigma):.1f} so far"
        self._on_action(seen, state)

    def on_rotary_survey(self, feedback: Any) -> None:
        """How far a survey is that is taken while the string rotates: RotarySurvey feedback."""
        seen = feedback.feedback
        self._on_action(seen, f"rotary survey: {seen.state}")

    def _on_action(self, seen: Any, state: str) -> None:
        self._action_at = time.monotonic()
        self._show_progress(True, seen.elapsed, seen.remaining, state)

    def survey_ended(self, result: str) -> None:
        """The survey under way came to an end, in words."""
        self._result = result
        self._show_progress(False)

    def _show_progress(self, active: bool, elapsed: float = 0.0, remaining: float = 0.0, state: str = "") -> None:
        if active or self._progress != (active, self._result):
            self._progress_at = time.monotonic()
            self._progress = (active, self._result)
            self._live.on_survey_progress(active, self._progress_at, elapsed, remaining, state, self._result)

    def _on_reference(self, values: dict[str, str], source: str) -> None:
        reference = None
        if "total" in values:
            numbers = {name: float(values[name]) for name in _REFERENCE if name in values}
            reference = ReferenceField(**numbers, source=source)
        if reference != self.reference:
            self.reference = reference
            self.show_well(self._well)

    def tell(self, now: float) -> None:
        """Watch the inputs, bring the findings to the page; called once a second."""
        causes: dict[str, tuple[int, str, str]] = {}
        for topic, who, severity in _WATCHED:
            if topic in self._heard and now - self._heard[topic] > _SILENT_AFTER:
                age = now - self._heard[topic]
                text = f"no {topic} from the {who}: the last came more than {_SILENT_AFTER:.0f} s ago"
                causes[f"input.{topic}"] = (severity, text, f"is the {who} alive and connected? ({age:.0f} s)")
        self._journal.sync("input.", causes)
        self._journal.sync("node.", self._of_nodes(now))
        if self._progress[0] and now - self._progress_at > _SILENT_AFTER + 1.0:
            self._show_progress(False)
        findings = [
            NodeDiagnostic(s.name, s.level[0], s.message, _remedy(s))
            for heard, found in self._findings_of.values()
            if now - heard < _REPORT_LASTS
            for s in found
        ]
        self._live.on_diagnostics(findings, now)

    def _of_nodes(self, now: float) -> dict[str, tuple[int, str, str]]:
        """What other nodes call an error, and everything about sensors; who is silent is told by `tell` already."""
        causes: dict[str, tuple[int, str, str]] = {}
        for node, (heard, found) in self._findings_of.items():
            if now - heard >= _REPORT_LASTS or node == self._own:
                continue
            for status in found:
                level, what = status.level[0], status.name.partition(": ")[2]
                told = level == _ERROR or (level == _WARN and what.startswith("sensors"))
                if told and what not in {topic for topic, _, _ in _WATCHED}:
                    severity = Severity.CRITICAL if level == _ERROR else Severity.WARNING
                    causes[f"node.{node.strip('/')}.{what}"] = (severity, status.message, _remedy(status))
        return causes


def _remedy(status: Any) -> str:
    return next((pair.value for pair in status.values if pair.key == "remedy"), "")
