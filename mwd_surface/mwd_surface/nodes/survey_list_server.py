"""The survey list on the graph: surveys and people's decisions in, list, path and exports out, kept on disk."""

from __future__ import annotations

import concurrent.futures
import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mwd_msgs import msg, srv
from nav_msgs.msg import Path as PathMessage
from rclpy.serialization import deserialize_message

from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.lifecycle_node import ERROR, OK, Finding, GraphNode, Later
from mwd_sensors.ros.qos import EVENT, LATCHED
from mwd_surface.exports.export import FORMATS, ExportError, export
from mwd_surface.exports.survey_table import SurveyTable, survey_table, table_of
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.nodes.plan_server import PlanDesk
from mwd_surface.ros import messages
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.ros.worker import Beside
from mwd_surface.surveys.azimuth_check import disagreement
from mwd_surface.surveys.depth import DepthRules, DepthTrack
from mwd_surface.surveys.leg_settings import LegSettings, arranged
from mwd_surface.surveys.slide_sheet import Stretch
from mwd_surface.surveys.survey_list import ListRules, SurveyList
from mwd_surface.surveys.survey_message import survey_of
from mwd_surface.surveys.survey_record import Verdict
from mwd_surface.surveys.survey_store import StoreError, SurveyStore
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_path import Definitive

_BIT_STEP = 0.1  # m the bit goes before its projection is drawn anew


class SurveyDesk:
    """
    The survey list of one well.

    Parameters
    ----------
    folder : Path
        Of the well: `surveys` in it keeps the list, `exports` what was exported.
    well : Well
        With its vertical section.
    beside : Beside
        For what takes long.
    changed : callable
        Called with the list whenever it was published.
    stretches : callable
        The slide sheet as it stands, for reports.

    Raises
    ------
    StoreError
        The list on disk cannot be used.

    Attributes
    ----------
    surveys : SurveyList
        The list in force.
    depth : DepthTrack
        Bit depth over time.
    """

    def __init__(
        self,
        node: GraphNode[Any],
        folder: Path,
        well: Well,
        rules: ListRules,
        leg: LegSettings,
        depth: DepthRules,
        *,
        live: LiveState,
        journal: Journal,
        plan: PlanDesk,
        beside: Beside,
        changed: Callable[[SurveyList], None],
        stretches: Callable[[], tuple[Stretch, ...]],
    ) -> None:
        self.depth = DepthTrack(depth)
        self._node, self._folder, self._live = node, folder, live
        self._journal, self._plan, self._beside, self._changed = journal, plan, beside, changed
        self._stretches = stretches
        self._unsaved = ""
        self._covariance: Any = None
        self._shown_bit: float | None = None
        self._reporting, self._reported, self._html = False, SurveyList(), b""
        self._store = SurveyStore(folder / "surveys")
        loaded = self._store.load(well, rules)
        self.surveys = loaded.surveys
        for text in loaded.messages:
            journal.note("survey list", text, Severity.WARNING)
        self.surveys = self._arranged(self.surveys, leg)

    def open(self) -> None:
        """Open topics and services."""
        node = self._node
        self._accepted = node.publish_on(msg.SurveyRecord, "survey/accepted", EVENT)
        self._list = node.publish_on(msg.SurveyList, "surveys", LATCHED)
        self._trajectory = node.publish_on(msg.Trajectory, "trajectory", LATCHED)
        self._path = node.publish_on(PathMessage, "path", LATCHED)
        node.serve(srv.JudgeSurvey, "accept_survey", self.accept)
        node.serve(srv.JudgeSurvey, "reject_survey", self.reject)
        node.serve(srv.SetDepth, "set_depth", self.set_depth)
        node.serve(srv.Export, "export", self.export)

    def close(self) -> None:
        """Give the list's folder free."""
        self._store.close()

    def configured(self, well: Well, rules: ListRules, leg: LegSettings) -> None:
        """Bring the list under another description of the well, other rules and leg; where that cannot be, say so."""
        try:
            surveys = self.surveys.configured(well, rules)
        except ValueError as error:
            self._refused(error)
            return
        self._keep(self._arranged(surveys, leg))

    def _arranged(self, surveys: SurveyList, leg: LegSettings) -> SurveyList:
        try:
            surveys = arranged(surveys, leg)
        except ValueError as error:
            self._refused(error)
        else:
            self._journal.clear("surveys.settings")
        return surveys

    def _refused(self, error: ValueError) -> None:
        text = f"the survey list keeps its old settings: {error}"
        self._journal.alarm("surveys.settings", Severity.WARNING, text)

    def definitive(self) -> Definitive:
        """The path as it is now, projected to the bit where that is deeper."""
        return self.surveys.definitive(bit_depth=self.bit_depth)

    @property
    def bit_depth(self) -> float | None:
        """m; None as long as the rig or a person has said nothing."""
        return self.depth.latest[1] if self.depth.latest else None

    # In.

    def on_rig_state(self, samples: Samples) -> float | None:
        """Depths of the rig, `wire.RIG_STATE`; the last of them where it is believed, m."""
        believed = False
        for sample in samples:
            known = bool(sample["valid"] & msg.RigState.BIT_DEPTH)
            believed = known and self.depth.update(int(sample["stamp_ns"]), float(sample["bit_depth"]))
        return self.bit_depth if believed else None

    def on_survey(self, data: bytes) -> str:
        """A survey of the estimator, serialised; what became of it comes back in words."""
        survey = survey_of(deserialize_message(data, msg.Survey))
        reading = self.depth.sensor_depth(survey.stamp_ns, self.surveys.well.sensor_to_bit)
        known = {r.survey.uuid for r in self.surveys.records}
        apart = disagreement(survey)
        if apart:
            self._journal.alarm(
                "survey.azimuth", Severity.CRITICAL, apart, "steel nearby, or a faulty sensor: look at both"
            )
        else:
            self._journal.clear("survey.azimuth")
        try:
            self._keep(self.surveys.add(survey, reading.measured_depth, reading.depth_age, comment=reading.reason))
        except ValueError as error:
            text = f"survey {survey.sequence} not taken: {error}"
            self._journal.alarm("survey.refused", Severity.WARNING, text)
            return text
        for record in self.surveys.records:
            if record.survey.uuid not in known:
                words = "in use" if record.in_use else "waits for a decision"
                reasons = "; ".join(record.survey.reasons)
                self._journal.note("survey", f"survey {record.survey.sequence} {words}: {reasons}")
                if record.in_use:
                    self._accepted.publish(messages.record_message(record))
                return f"survey {record.survey.sequence}: {Verdict(survey.verdict).name.lower()}"
        return f"survey {survey.sequence} is in the list already"

    # Services.

    def accept(self, request: Any, response: Any) -> Any:
        """Put a survey into the path on a person's word."""
        return self._judge(request, response, "accepted")

    def reject(self, request: Any, response: Any) -> Any:
        """Take a survey out of the path on a person's word."""
        return self._judge(request, response, "rejected")

    def _judge(self, request: Any, response: Any, word: str) -> Any:
        used = {r.survey.uuid for r in self.surveys.records if r.in_use}
        judge = (request.sequence, request.operator_name, request.reason, self._journal.now_ns())
        try:
            if word == "accepted":
                depth, replace = request.measured_depth, request.replace
                surveys = self.surveys.accept(*judge, measured_depth=depth, replace=replace)
            else:
                surveys = self.surveys.reject(*judge)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        self._keep(surveys)
        for record in self.surveys.records:
            if record.in_use and record.survey.uuid not in used:
                self._accepted.publish(messages.record_message(record))
        text = f"survey {request.sequence} {word} by {request.operator_name}"
        self._journal.note("survey", text + (f": {request.reason}" if request.reason else ""))
        response.success, response.message = True, text
        return response

    def set_depth(self, request: Any, response: Any) -> Any:
        """Bit depth by hand."""
        if not request.operator_name.strip():
            response.success, response.message = False, "operator_name: must not be empty: the log says who did it"
            return response
        try:
            self.depth.set_by_hand(self._journal.now_ns(), request.bit_depth)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f"bit depth {request.bit_depth:.2f} m by {request.operator_name}"
        self._journal.note("depth", response.message)
        return response

    def export(self, request: Any, response: Any) -> Any:
        """Write the list in one of the formats; answered when it is written."""
        table, folder = self._table(), self._folder / "exports"

        def write() -> Path:
            return export(table(), request.format, folder, request.name)

        def written(job: concurrent.futures.Future[Path]) -> None:
            try:
                path = job.result()
            except (ValueError, ExportError) as error:
                response.success, response.message = False, str(error)
            else:
                response.success, response.message, response.path = True, f"written {path}", str(path)
                self._journal.note("export", response.message)
            later.answer(response)

        later = Later()
        self._beside.work(write, written)
        return later

    # Out.

    def _keep(self, surveys: SurveyList) -> None:
        if surveys is self.surveys:
            return
        self.surveys = surveys
        self._save()
        self.publish()

    def _save(self) -> None:
        try:
            self._store.save(self.surveys)
        except StoreError as error:
            self._unsaved = str(error)
            self._journal.alarm(
                "surveys.unsaved", Severity.CRITICAL, str(error), "free the disk; it is tried every second"
            )
            return
        self._unsaved = ""
        self._journal.clear("surveys.unsaved")

    def save_again(self) -> None:
        """Try again what could not be saved; called once a second."""
        if self._unsaved:
            self._save()

    def publish(self) -> None:
        """List and path to the graph and the page."""
        now, surveys, path = time.monotonic(), self.surveys, self.definitive()
        self._list.publish(messages.list_message(surveys))
        self._trajectory.publish(messages.trajectory_message(path, surveys.changed_ns))
        prefix = self._node.get_namespace().strip("/")
        frame = f"{prefix}/local_enu" if prefix else "local_enu"
        self._path.publish(messages.path_message(path, surveys.changed_ns, frame))
        self._live.on_records(surveys.records, now)
        self._covariance, self._shown_bit = None, self.bit_depth
        self._live.on_trajectory(path, now)
        self._plan.show_offset(path)
        self._changed(surveys)
        now_ns = self._journal.now_ns()
        self._beside.work(
            lambda: table_of(surveys, path, now_ns).covariance, lambda job: self._show_ellipses(path, job)
        )

        self._report()

    def _table(self) -> Callable[[], SurveyTable]:
        """What works out the printed table of the list as it is now, wherever it is called."""
        return functools.partial(
            survey_table, self.surveys, self._journal.now_ns(), plan=self._plan.plan, stretches=self._stretches()
        )

    def _report(self) -> None:
        """Make the report of the list as it is, beside the node; of many changes in a row only the last matters."""
        if self._reporting or self._reported is self.surveys or not self.surveys.records:
            return
        surveys, table = self.surveys, self._table()
        self._reporting = True

        def made(job: concurrent.futures.Future[bytes]) -> None:
            self._reporting = False
            self._html, self._reported = job.result(), surveys
            self._node.get_logger().info(f"report of {len(surveys.records)} surveys made")
            self._report()

        self._beside.work(lambda: FORMATS["html"].make(table()), made)

    def enclosures(self) -> list[tuple[str, str, bytes]]:
        """The surveys as files for a recording: lists as they are now, and the report where it is of this list."""
        if not self.surveys.records:
            return []
        table = self._table()()
        found = [
            (f"surveys_{FORMATS[kind].word}.csv", "text/csv", FORMATS[kind].make(table)) for kind in ("csv", "raw_csv")
        ]
        if self._reported is self.surveys:
            found.append(("survey_report.html", "text/html", self._html))
        return found

    def _show_ellipses(self, path: Definitive, job: concurrent.futures.Future[Any]) -> None:
        covariance = job.result()
        if covariance is not None:
            measured = np.isfinite(covariance).all(axis=(1, 2))
            self._covariance = covariance[measured]
            self._live.on_trajectory(path, time.monotonic(), self._covariance)

    def follow_bit(self, now: float) -> None:
        """Bring the page's projection, and the offset to the plan, after the bit; called once a second."""
        bit = self.bit_depth
        if bit is None or (self._shown_bit is not None and abs(bit - self._shown_bit) < _BIT_STEP):
            return
        self._shown_bit = bit
        path = self.definitive()
        self._live.on_trajectory(path, now, self._covariance)
        self._plan.show_offset(path)

    def findings(self) -> list[Finding]:
        """How the list is."""
        text = self._unsaved or f"{len(self.surveys.records)} surveys"
        return [Finding("survey list", ERROR if self._unsaved else OK, text)]
