# SPDX-License-Identifier: Apache-2.0
"""
Survey list of a well in the surface node: receives surveys and the operator's decisions, and publishes list and path.

The list is stored on disk, and exported to files.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mwd_msgs import msg, srv
from nav_msgs.msg import Path as PathMessage
from rclpy.parameter import Parameter

from mwd_sensors.core import wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.unknown import or_nan
from mwd_sensors.ros.deferred import DeferredResponse, answering
from mwd_sensors.ros.diagnostics import ERROR, OK, Diagnostic
from mwd_sensors.ros.messages import make, unknown
from mwd_sensors.ros.qos import EVENT, LATCHED, STATE
from mwd_sensors.ros.time_stamps import header
from mwd_surface.exports.export import FORMATS, ExportError, export_file
from mwd_surface.exports.report_clearance import clearance_sections
from mwd_surface.exports.survey_table import SurveyTable, survey_table
from mwd_surface.live.alarms import Severity
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.ros import messages
from mwd_surface.ros.context import Answer, SurfaceContext
from mwd_surface.surveys.leg_settings import LegSettings, arranged
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.message_conversion import list_message, trajectory_message
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord, Value
from mwd_surface.surveys.survey_store import StoreError, SurveyStore
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import DrilledStretch
from mwd_surface.trajectory.well_path import Definitive

SAVE_REMEDY = "free space on the disk; writing is retried every second"


class SurveyListServer(SurveyBook):
    """
    Survey list of one well as a part of the surface node: with services, storage on disk, exports and reports.

    Parameters
    ----------
    context : SurfaceContext
        Node, folder, alarm log and worker. The list is stored in the subfolder `surveys`, exported files in `exports`.
    settings : SurfaceSettings
        Settings of the surface, of which only the sections `well`, `rules`, `leg` and `depth` are used.

    Raises
    ------
    StoreError
        The list on disk cannot be used.
    """

    slide_sheet: Callable[[], tuple[DrilledStretch, ...]]  #: function that returns the slide sheet, for reports
    #: Function that is called with a bit depth, m, that a person has set, and the age of the depth, s.
    on_depth_by_hand: Callable[[float, float], None]

    def __init__(self, context: SurfaceContext, settings: SurfaceSettings, *, plan: PlanMonitor) -> None:
        store = SurveyStore(context.folder / "surveys")
        loaded = store.load(settings.well, settings.rules)
        super().__init__(context.well, plan, loaded.surveys, settings.depth)
        self._node, self._folder, self._worker = context.node, context.folder, context.worker
        self._save_error = ""
        self._decided_ns = 0
        self._reporting, self._reported = False, SurveyList()
        self._files: list[tuple[str, str, bytes]] = []
        self._store = store
        for text in loaded.messages:
            self._alarm_log.log_event("survey list", text, Severity.WARNING)
        self.surveys = self._with_leg(self.surveys.along(plan.plan), settings.leg)

    def open(self) -> None:
        """Create the publishers of list, path, accepted surveys and operator events, and the services for surveys."""
        node = self._node
        self._accepted_publisher = node.add_publisher(msg.SurveyRecord, "survey/accepted", EVENT)
        self._event_publisher = node.add_publisher(msg.OperatorEvent, "operator_events", STATE)
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
        """Apply changed settings of well, rules, leg and plan; raise an alarm if they do not fit the list."""
        try:
            surveys = self.surveys.configured(well, rules).along(plan)
        except ValueError as error:
            self._alarm_settings(error)
            return
        self.replace(self._with_leg(surveys, leg))

    def _with_leg(self, surveys: SurveyList, leg: LegSettings) -> SurveyList:
        try:
            surveys = arranged(surveys, leg)
        except ValueError as error:
            self._alarm_settings(error)
        else:
            self._alarm_log.clear_alarm("surveys.settings")
        return surveys

    def use_leg(self, *, leg: str, operator_name: str, kick_off_depth: float | None = None) -> Answer:
        """
        Assign the next surveys to a leg by the operator's decision, and set the parameters of the node accordingly.

        leg: name of an earlier leg, or of a new leg, which leaves the present leg at kick_off_depth, m. Return whether
        this was done, and a message.
        """
        name, earlier = leg.strip(), {one.name for one in self.surveys.legs}
        if not name or (name not in earlier and kick_off_depth is None):
            return False, "a new leg needs a name, and the depth at which it leaves the present one"
        given: dict[str, Any] = {"name": name, "kick_off_depth": kick_off_depth, "parent": ""}
        try:
            arranged(self.surveys, dataclasses.replace(self._node.settings.leg, **given))
        except ValueError as error:
            return False, str(error)
        given["kick_off_depth"] = or_nan(kick_off_depth)
        result = self._node.set_parameters_atomically([Parameter(f"leg.{key}", value=given[key]) for key in given])
        if not result.successful:
            return False, result.reason
        # The node reads the plan again before it applies its parameters; apply the leg now, so that the answer knows
        # whether the list is on disk.
        self.replace(self._with_leg(self.surveys, self._node.settings.leg))
        if name in earlier:
            text = f"the next surveys belong to leg {name}, by {operator_name}"
        else:
            text = f"leg {name} leaves {self.surveys.leg} at {kick_off_depth:.2f} m, by {operator_name}"
        self._alarm_log.log_event("survey list", text)
        return True, answer_with(text, self._save_error)

    def _alarm_settings(self, error: ValueError) -> None:
        self._alarm_log.raise_alarm("surveys.settings", Severity.WARNING, f"survey list: settings not changed: {error}")

    # Services.

    def accept(self, request: Any, response: Any) -> Any:
        """Accept a survey into the path by the operator's decision; return the response (service)."""
        return self._judge(request, response, "accepted")

    def reject(self, request: Any, response: Any) -> Any:
        """Reject a survey from the path by the operator's decision; return the response (service)."""
        return self._judge(request, response, "rejected")

    def _judge(self, request: Any, response: Any, word: str) -> Any:
        found = next((r.survey.uuid for r in self.surveys.records if r.survey.sequence == request.sequence), "")
        response = self._judged(request, response, word)
        accepted = word == "accepted"
        self._tell(
            msg.OperatorEvent.ACCEPT_SURVEY if accepted else msg.OperatorEvent.REJECT_SURVEY,
            request,
            response,
            uuid=found,
            sequence=request.sequence,
            reason=request.reason,
            depth=request.measured_depth if accepted else math.nan,
            replace=request.replace and accepted,
            value=request.value if accepted else 0,
        )
        return response

    def _tell(self, kind: int, request: Any, response: Any, **fields: Any) -> None:
        """Publish a person's request with its outcome, for recordings."""
        event = unknown(msg.OperatorEvent, kind=kind, success=response.success, message=response.message, **fields)
        event.operator_name = request.operator_name
        event.header = header(self._decided_ns)
        self._event_publisher.publish(event)

    @answering
    def _judged(self, request: Any, _response: Any, word: str) -> str:
        used = {r.survey.uuid for r in self.surveys.records if r.in_use}
        self._decided_ns = self._alarm_log.now_ns()
        judge = (request.sequence, request.operator_name, request.reason, self._decided_ns)
        if word == "accepted":
            depth, replace, value = request.measured_depth, request.replace, Value(request.value)
            surveys = self.surveys.accept(*judge, measured_depth=depth, replace=replace, value=value)
        else:
            surveys = self.surveys.reject(*judge)
        self.replace(surveys)
        for record in self.surveys.records:
            if record.in_use and record.survey.uuid not in used:
                self.publish_accepted(record)
        because = f": {request.reason}" if request.reason else ""
        self._alarm_log.log_event("survey", f"survey {request.sequence} {word} by {request.operator_name}{because}")
        return answer_with(f"survey {request.sequence} {word} by {request.operator_name}", self._save_error)

    def set_depth(self, request: Any, response: Any) -> Any:
        """Set the bit depth by hand; return the response, with the reason if the depth is refused (service)."""
        response = self._set_depth(request, response)
        self._tell(msg.OperatorEvent.SET_DEPTH, request, response, depth=request.bit_depth)
        return response

    def restore_depth(self, stamp_ns: int, bit_depth: float, operator_name: str) -> None:
        """
        Restore a bit depth, m, that a person set before the node started, with the time at which it was set, ns.

        Raises
        ------
        ValueError
            The depth is not valid, as in `DepthTrack.set_by_hand`.
        """
        self.set_depth_by_hand(stamp_ns, bit_depth)
        self.on_depth_by_hand(bit_depth, (self._alarm_log.now_ns() - stamp_ns) / wire.NANOSECONDS)
        self._decided_ns = stamp_ns
        request = srv.SetDepth.Request(bit_depth=bit_depth, operator_name=operator_name)
        message = f"bit depth {bit_depth:.2f} m by {operator_name}, set before the node started"
        response = srv.SetDepth.Response(success=True, message=message)
        self._tell(msg.OperatorEvent.SET_DEPTH, request, response, depth=bit_depth)
        self._alarm_log.log_event("depth", message)

    @answering
    def _set_depth(self, request: Any, _response: Any) -> str:
        self._decided_ns = self._alarm_log.now_ns()
        if not request.operator_name.strip():
            raise ValueError("operator_name: must not be empty: it goes into the log")
        self.set_depth_by_hand(self._decided_ns, request.bit_depth)
        self.on_depth_by_hand(request.bit_depth, 0.0)
        message = f"bit depth {request.bit_depth:.2f} m by {request.operator_name}"
        self._alarm_log.log_event("depth", message)
        return message

    def export(self, request: Any, response: Any) -> Any:
        """
        Export the list in one of the formats (service).

        Return a deferred response, which is sent after the file is written.
        """
        table, folder = self._table(), self._folder / "exports"

        def write() -> Path:
            return export_file(table(), request.format, folder, request.name)

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

    def replace(self, surveys: SurveyList) -> None:
        """Replace and save the list; raise ValueError, without a change, if the list cannot be written as a file."""
        if surveys is not self.surveys:
            self._save(surveys)
            super().replace(surveys)

    def _save(self, surveys: SurveyList) -> None:
        try:
            self._store.save(surveys)
        except StoreError as error:
            # Saving is retried every second: raise the alarm only once for an error.
            if str(error) != self._save_error:
                self._alarm_log.raise_alarm("surveys.unsaved", Severity.CRITICAL, str(error), SAVE_REMEDY)
            self._save_error = str(error)
            return
        self._save_error = ""
        self._alarm_log.clear_alarm("surveys.unsaved")

    def retry_save(self) -> None:
        """Try again to save a list that could not be saved; called once a second."""
        if self._save_error:
            self._save(self.surveys)

    def show(self) -> None:
        """Show the survey list and the well path, publish them, and write the report."""
        super().show()
        self._report()

    def publish(self, surveys: SurveyList, path: Definitive) -> None:
        """Publish the survey list, and the well path as mwd_msgs/Trajectory and nav_msgs/Path."""
        wellhead, local = (self._node.frame(name) for name in (wire.WELLHEAD_FRAME, wire.LOCAL_FRAME))
        self._list_publisher.publish(list_message(surveys, wellhead, make))
        self._trajectory_publisher.publish(trajectory_message(path, surveys.changed_ns, wellhead, make))
        self._path_publisher.publish(messages.path_message(path, surveys.changed_ns, local))

    def publish_accepted(self, record: SurveyRecord) -> None:
        """Publish a survey that has been accepted into the path."""
        self._accepted_publisher.publish(record.to_message(make))

    def _table(self) -> Callable[[], SurveyTable]:
        """Return a function that computes the printed table of the current list, in any thread."""
        surveys, bit_depth = self.surveys, self.bit_depth
        made_ns, stretches = self._alarm_log.now_ns(), self.slide_sheet()

        def table() -> SurveyTable:
            sections, _ = clearance_sections(surveys, surveys.plan, bit_depth)
            return survey_table(surveys, made_ns, stretches=stretches, sections=sections)

        return table

    def _report(self) -> None:
        """
        Write the report of the current list in the background.

        If the list changes while a report is being written, one further report is written, of the newest list.
        """
        if self._reporting or self._reported is self.surveys or not self.surveys.records:
            return
        surveys, table = self.surveys, self._table()
        self._reporting = True

        def made(job: concurrent.futures.Future[list[tuple[str, str, bytes]]]) -> None:
            self._reporting = False
            self._files, self._reported = job.result(), surveys
            self._node.get_logger().info(printable(f"report of {len(surveys.records)} surveys made"))
            self._report()

        self._worker.submit(lambda: _files(table(), report=True), made)

    def attachments(self) -> list[tuple[str, str, bytes]]:
        """
        Return name, type and content of files for a recording; an empty list without surveys.

        The files are the surveys as CSV, and the report if it belongs to the current list.
        """
        if not self.surveys.records:
            return []
        # A list that has just changed has no report yet.
        return self._files if self._reported is self.surveys else _files(self._table()(), report=False)

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic with the number of surveys, or with the reason why the list is not saved."""
        text = self._save_error or f"{len(self.surveys.records)} surveys"
        return [Diagnostic("survey list", ERROR if self._save_error else OK, text)]


def answer_with(words: str, unsaved: str) -> str:
    """Return the answer to a change by a person; unsaved: why the change is not on disk yet, empty if it is."""
    return "; ".join([words, f"in force, but not on disk yet: {unsaved}", SAVE_REMEDY] if unsaved else [words])


def _files(table: SurveyTable, *, report: bool) -> list[tuple[str, str, bytes]]:
    """Return name, type and content of the files about a list that a recording stores."""
    found = [
        (f"surveys_{FORMATS[kind].word}.csv", "text/csv", FORMATS[kind].make(table)) for kind in ("csv", "raw_csv")
    ]
    return [*found, ("survey_report.html", "text/html", FORMATS["html"].make(table))] if report else found
