# SPDX-License-Identifier: Apache-2.0
"""The survey list of a well: surveys and the operator's decisions in; list, path and exports out; kept on disk."""

from __future__ import annotations

import concurrent.futures
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mwd_msgs import msg, srv
from nav_msgs.msg import Path as PathMessage
from rclpy.serialization import deserialize_message

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.deferred import DeferredResponse
from mwd_sensors.ros.diagnostics import ERROR, OK, Diagnostic
from mwd_sensors.ros.qos import EVENT, LATCHED
from mwd_surface.exports.export import FORMATS, ExportError, export
from mwd_surface.exports.report_clearance import clearance_sections
from mwd_surface.exports.survey_table import SurveyTable, survey_table, table_of
from mwd_surface.live.alarms import Severity
from mwd_surface.nodes.plan_server import PlanServer
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.ros import messages
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.depth import DepthTrack
from mwd_surface.surveys.leg_settings import LegSettings, arranged
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.message_conversion import survey_of
from mwd_surface.surveys.station_checks import revision_doubt, revision_flags
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord, Verdict
from mwd_surface.surveys.survey_store import StoreError, SurveyStore
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import Stretch
from mwd_surface.trajectory.well_path import Definitive

_BIT_STEP = 0.1  # m; movement of the bit after which its projection is shown again


class SurveyListServer:
    """
    The survey list of one well.

    Parameters
    ----------
    context : SurfaceContext
        Node, folder, live state, alarm log and worker. The list is kept in the subfolder `surveys`, exported files in
        `exports`.
    settings : SurfaceSettings
        Its sections `well`, `rules`, `leg` and `depth` are used.
    plan : PlanServer
        The planned path.
    on_published : callable
        Called with the list whenever it was published.
    slide_sheet : callable
        Returns the slide sheet, for reports.
    on_depth_by_hand : callable
        Called with a bit depth, m, that a person has set.

    Attributes
    ----------
    surveys : SurveyList
        The list in force.
    depth : DepthTrack
        Bit depth over time.

    Raises
    ------
    StoreError
        The list on disk cannot be used.
    """

    def __init__(
        self,
        context: SurfaceContext,
        settings: SurfaceSettings,
        *,
        plan: PlanServer,
        on_published: Callable[[SurveyList], None],
        slide_sheet: Callable[[], tuple[Stretch, ...]],
        on_depth_by_hand: Callable[[float], None],
    ) -> None:
        self.depth = DepthTrack(settings.depth)
        self._node, self._folder, self._live = context.node, context.folder, context.live
        self._alarm_log, self._worker = context.alarm_log, context.worker
        self._plan, self._on_published, self._slide_sheet = plan, on_published, slide_sheet
        self._on_depth_by_hand = on_depth_by_hand
        self._save_error = ""
        self._covariance: Any = None
        self._shown_bit: float | None = None
        self._reporting, self._reported = False, SurveyList()
        self._files: list[tuple[str, str, bytes]] = []
        self._store = SurveyStore(context.folder / "surveys")
        loaded = self._store.load(settings.well, settings.rules)
        self.surveys = loaded.surveys
        for text in loaded.messages:
            self._alarm_log.log_event("survey list", text, Severity.WARNING)
        self.surveys = self._with_leg(self.surveys.along(plan.plan), settings.leg)

    def open(self) -> None:
        """Open topics and services."""
        node = self._node
        self._accepted_publisher = node.add_publisher(msg.SurveyRecord, "survey/accepted", EVENT)
        self._list_publisher = node.add_publisher(msg.SurveyList, "surveys", LATCHED)
        self._trajectory_publisher = node.add_publisher(msg.Trajectory, "trajectory", LATCHED)
        self._path_publisher = node.add_publisher(PathMessage, "path", LATCHED)
        node.add_service(srv.JudgeSurvey, "accept_survey", self.accept)
        node.add_service(srv.JudgeSurvey, "reject_survey", self.reject)
        node.add_service(srv.SetDepth, "set_depth", self.set_depth)
        node.add_service(srv.Export, "export", self.export)

    def close(self) -> None:
        """Release the list's folder."""
        self._store.close()

    def change_settings(self, well: Well, rules: ListRules, leg: LegSettings, plan: Plan | None) -> None:
        """Apply other settings of well, rules, leg and plan; where they do not fit the list, raise an alarm."""
        try:
            surveys = self.surveys.configured(well, rules).along(plan)
        except ValueError as error:
            self._alarm_settings(error)
            return
        self._replace(self._with_leg(surveys, leg))

    def _with_leg(self, surveys: SurveyList, leg: LegSettings) -> SurveyList:
        try:
            surveys = arranged(surveys, leg)
        except ValueError as error:
            self._alarm_settings(error)
        else:
            self._alarm_log.clear_alarm("surveys.settings")
        return surveys

    def _alarm_settings(self, error: ValueError) -> None:
        self._alarm_log.raise_alarm("surveys.settings", Severity.WARNING, f"survey list: settings not changed: {error}")

    def definitive(self) -> Definitive:
        """Compute the well path, projected to the bit where the bit is deeper."""
        return self.surveys.definitive(bit_depth=self.bit_depth)

    @property
    def bit_depth(self) -> float | None:
        """Bit depth, m; None until the rig or an operator has given one."""
        return self.depth.latest[1] if self.depth.latest else None

    # Rig data and surveys.

    def on_rig_state(self, samples: Samples) -> float | None:
        """Take the rig's depths, `wire.RIG_STATE`; returns the last one if it was accepted, m."""
        accepted = False
        for sample in samples:
            known = bool(sample["valid"] & msg.RigState.BIT_DEPTH)
            accepted = known and self.depth.update(int(sample["stamp_ns"]), float(sample["bit_depth"]))
        return self.bit_depth if accepted else None

    def on_sonde(self, samples: Samples) -> None:
        """Take the time of samples of the sonde, to compare its clock with the rig's."""
        if len(samples):
            self.depth.note_sonde(int(samples["stamp_ns"][-1]))

    def on_survey(self, data: bytes) -> str:
        """Add a serialised survey of the estimator to the list; returns the outcome in words."""
        survey = survey_of(deserialize_message(data, msg.Survey))
        at = self.depth.sensor_depth(survey.stamp_ns, self.surveys.well.sensor_offset)
        known = any(r.survey.uuid == survey.uuid for r in self.surveys.records)
        try:
            self._replace(self.surveys.add(survey, at.measured_depth, at.depth_age, comment=at.reason))
        except ValueError as error:
            text = f"survey {survey.sequence} not taken: {error}"
            self._alarm_log.raise_alarm("survey.refused", Severity.WARNING, text)
            return text
        record = next(r for r in self.surveys.records if r.survey.uuid == survey.uuid)
        self._alarm_verdict(record)
        number = f"survey {record.survey.sequence}"
        if known:
            return f"{number} is in the list already"
        words = "in use" if record.in_use else "waits for a decision"
        why = [record.comment, *survey.reasons] if record.comment else survey.reasons
        self._alarm_log.log_event("survey", f"{number} {words}: {'; '.join(why)}")
        if record.in_use:
            self._accepted_publisher.publish(messages.record_message(record))
        return f"{number}: {Verdict(survey.verdict).name.lower()}"

    def on_revision(self, data: bytes) -> None:
        """Keep a serialised revision of the estimator beside the first value; a person decides about it."""
        survey = survey_of(deserialize_message(data, msg.Survey))
        try:
            surveys = self.surveys.revise(survey)
        except ValueError as error:
            self._alarm_log.log_event("survey", f"revision of survey {survey.sequence} not taken: {error}")
            return
        if surveys is self.surveys:
            return
        self._replace(surveys)
        record = next(r for r in self.surveys.records if r.survey.uuid == survey.uuid)
        words = "; ".join(revision_flags(record, self.surveys.north))
        severity = Severity.WARNING if record.in_use and survey.verdict != Verdict.ACCEPT else Severity.INFO
        self._alarm_log.log_event("survey", f"survey {record.survey.sequence}: {words}", severity)

    def _alarm_revisions(self) -> None:
        """Raise an alarm for each survey in use that later ones contradict, until a person has decided about it."""
        remedy = "steer by neither value: take a check shot, then accept the first value or reject it in the list"
        doubts = {r.survey.sequence: revision_doubt(r, self.surveys.north) for r in self.surveys.records}
        causes = {f"survey.revised.{k}": (int(Severity.CRITICAL), text, remedy) for k, text in doubts.items() if text}
        self._alarm_log.set_alarms("survey.revised.", causes)

    def _alarm_assumptions(self, path: Definitive) -> None:
        """Raise an alarm while the coordinates of the path rest on an assumption."""
        remedy = "give the last station of the hole above: leg.tie_on_depth and the rest of leg.tie_on_*"
        causes = {
            f"path.assumed.{one.kind}": (int(Severity.WARNING), f"coordinates are assumed: {one.text}", remedy)
            for one in path.assumptions
        }
        self._alarm_log.set_alarms("path.assumed.", causes)

    def _alarm_verdict(self, record: SurveyRecord) -> None:
        """Raise an alarm while the newest azimuth is not to be relied on: magnetic and gyro readings need a look."""
        if not record.azimuth_doubt:
            self._alarm_log.clear_alarm("survey.azimuth")
            return
        severity = Severity.CRITICAL if record.survey.verdict_azimuth == Verdict.REJECT else Severity.WARNING
        remedy = "act on the reason, or decide about it in the list"
        self._alarm_log.raise_alarm("survey.azimuth", severity, record.azimuth_doubt, remedy)

    # Services.

    def accept(self, request: Any, response: Any) -> Any:
        """Accept a survey into the path by the operator's decision (service)."""
        return self._judge(request, response, "accepted")

    def reject(self, request: Any, response: Any) -> Any:
        """Reject a survey from the path by the operator's decision (service)."""
        return self._judge(request, response, "rejected")

    def _judge(self, request: Any, response: Any, word: str) -> Any:
        used = {r.survey.uuid for r in self.surveys.records if r.in_use}
        judge = (request.sequence, request.operator_name, request.reason, self._alarm_log.now_ns())
        try:
            if word == "accepted":
                depth, replace = request.measured_depth, request.replace
                surveys = self.surveys.accept(*judge, measured_depth=depth, replace=replace)
            else:
                surveys = self.surveys.reject(*judge)
            self._replace(surveys)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        for record in self.surveys.records:
            if record.in_use and record.survey.uuid not in used:
                self._accepted_publisher.publish(messages.record_message(record))
        text = f"survey {request.sequence} {word} by {request.operator_name}"
        self._alarm_log.log_event("survey", text + (f": {request.reason}" if request.reason else ""))
        response.success, response.message = True, text
        return response

    def set_depth(self, request: Any, response: Any) -> Any:
        """Set the bit depth by hand (service)."""
        if not request.operator_name.strip():
            response.success, response.message = False, "operator_name: must not be empty: it goes into the log"
            return response
        try:
            self.depth.set_by_hand(self._alarm_log.now_ns(), request.bit_depth)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        self._on_depth_by_hand(request.bit_depth)
        response.success = True
        response.message = f"bit depth {request.bit_depth:.2f} m by {request.operator_name}"
        self._alarm_log.log_event("depth", response.message)
        return response

    def export(self, request: Any, response: Any) -> Any:
        """Export the list in one of the formats (service); the response is sent when the file is written."""
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
                self._alarm_log.log_event("export", response.message)
            deferred.send(response)

        deferred = DeferredResponse()
        self._worker.submit(write, written, writes=True)
        return deferred

    # Saving, publishing, reports.

    def _replace(self, surveys: SurveyList) -> None:
        if surveys is self.surveys:
            return
        # Saved before it is in force: a list that cannot be written down (ValueError) changes nothing.
        self._save(surveys)
        self.surveys = surveys
        self.publish()

    def _save(self, surveys: SurveyList) -> None:
        try:
            self._store.save(surveys)
        except StoreError as error:
            # Tried every second, and logged once.
            if str(error) != self._save_error:
                remedy = "free the disk; it is tried every second"
                self._alarm_log.raise_alarm("surveys.unsaved", Severity.CRITICAL, str(error), remedy)
            self._save_error = str(error)
            return
        self._save_error = ""
        self._alarm_log.clear_alarm("surveys.unsaved")

    def retry_save(self) -> None:
        """Try again to save a list that could not be saved; called once a second."""
        if self._save_error:
            self._save(self.surveys)

    def publish(self) -> None:
        """Publish list and path, and show them on the page."""
        now, surveys, path = time.monotonic(), self.surveys, self.definitive()
        wellhead, local = (self._node.frame(name) for name in (wire.WELLHEAD_FRAME, wire.LOCAL_FRAME))
        self._alarm_revisions()
        self._alarm_assumptions(path)
        self._list_publisher.publish(messages.list_message(surveys, wellhead))
        self._trajectory_publisher.publish(messages.trajectory_message(path, surveys.changed_ns, wellhead))
        self._path_publisher.publish(messages.path_message(path, surveys.changed_ns, local))
        self._live.on_records(surveys.records, now, surveys.remarks)
        self._covariance, self._shown_bit = None, self.bit_depth
        self._live.on_trajectory(path, now)
        self._plan.show_offset(path)
        self._on_published(surveys)
        now_ns = self._alarm_log.now_ns()
        self._worker.submit(
            lambda: table_of(surveys, path, now_ns).covariance, lambda job: self._show_ellipses(path, job)
        )
        self._report()

    def _table(self) -> Callable[[], SurveyTable]:
        """Return a function that computes the printed table of the present list, in any thread."""
        surveys, bit_depth = self.surveys, self.bit_depth
        made_ns, stretches = self._alarm_log.now_ns(), self._slide_sheet()

        def table() -> SurveyTable:
            sections, _ = clearance_sections(surveys, surveys.plan, bit_depth)
            return survey_table(surveys, made_ns, stretches=stretches, sections=sections)

        return table

    def _report(self) -> None:
        """Make the report of the present list in the background; of changes during that time only the last counts."""
        if self._reporting or self._reported is self.surveys or not self.surveys.records:
            return
        surveys, table = self.surveys, self._table()
        self._reporting = True

        def made(job: concurrent.futures.Future[list[tuple[str, str, bytes]]]) -> None:
            self._reporting = False
            self._files, self._reported = job.result(), surveys
            self._node.get_logger().info(f"report of {len(surveys.records)} surveys made")
            self._report()

        self._worker.submit(lambda: _files(table(), report=True), made)

    def attachments(self) -> list[tuple[str, str, bytes]]:
        """Files for a recording: the surveys as CSV, and the report where it is of the present list."""
        if not self.surveys.records:
            return []
        # A list that has changed a moment ago has no report yet.
        return self._files if self._reported is self.surveys else _files(self._table()(), report=False)

    def _show_ellipses(self, path: Definitive, job: concurrent.futures.Future[Any]) -> None:
        covariance = job.result()
        if covariance is not None:
            measured = np.isfinite(covariance).all(axis=(1, 2))
            self._covariance = covariance[measured]
            self._live.on_trajectory(path, time.monotonic(), self._covariance)

    def update_projection(self, now: float) -> None:
        """Show projection and offset to the plan again when the bit has moved; called once a second. now: s."""
        bit = self.bit_depth
        if bit is None or (self._shown_bit is not None and abs(bit - self._shown_bit) < _BIT_STEP):
            return
        self._shown_bit = bit
        path = self.definitive()
        self._live.on_trajectory(path, now, self._covariance)
        self._plan.show_offset(path)

    def diagnostics(self) -> list[Diagnostic]:
        """State of the list."""
        text = self._save_error or f"{len(self.surveys.records)} surveys"
        return [Diagnostic("survey list", ERROR if self._save_error else OK, text)]


def _files(table: SurveyTable, *, report: bool) -> list[tuple[str, str, bytes]]:
    """Name, type and content of what a recording keeps of a list."""
    found = [
        (f"surveys_{FORMATS[kind].word}.csv", "text/csv", FORMATS[kind].make(table)) for kind in ("csv", "raw_csv")
    ]
    return [*found, ("survey_report.html", "text/html", FORMATS["html"].make(table))] if report else found
