# SPDX-License-Identifier: Apache-2.0
"""
Surface node: connects recorder, survey list, page and rig interfaces with the ROS graph and with each other.

Each part has its own module in this folder. This module creates the parts, calls them from two timers, and connects
them with the topics.
"""

from __future__ import annotations

import concurrent.futures
import json
import math
import platform
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from mwd_msgs import srv
from mwd_msgs.action import NorthSeek, RotarySurvey
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from mwd_sensors.core import frames, wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.output_files import write_whole
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.qos import LATCHED, STATE
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.ros.time_stamps import header
from mwd_surface import __version__
from mwd_surface.bags.recorder.status import RecorderError
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.inputs import InputState
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.live_well import LiveWell, live_settings
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext
from mwd_surface.logs.log_journal import NAME as JOURNAL
from mwd_surface.logs.log_journal import LogJournal
from mwd_surface.logs.recorded_log import FILE as TOOL_FILE
from mwd_surface.logs.recorded_log import TOOL, limits_table, read_limits
from mwd_surface.logs.tool_health import HealthLedger
from mwd_surface.nodes.control_server import ControlServer
from mwd_surface.nodes.downlink_server import DownlinkServer
from mwd_surface.nodes.foxglove_bridge import FoxgloveBridge
from mwd_surface.nodes.page_bridge import PageBridge, Services, call_service
from mwd_surface.nodes.recording_server import RecordingServer
from mwd_surface.nodes.rig_bridge import RigBridge
from mwd_surface.nodes.rod_server import RodServer
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.nodes.survey_list_server import SurveyListServer
from mwd_surface.nodes.topic_router import TopicRouter
from mwd_surface.nodes.well_outlet import NodeOutlet
from mwd_surface.page.foxglove_server import FoxgloveError
from mwd_surface.rig.interface import InterfaceError
from mwd_surface.ros.context import Answer, BackgroundWorker, RequestQueue, SteadyTime, SurfaceContext
from mwd_surface.ros.parameter_tables import ParameterTables
from mwd_surface.ros.topics import OF_TOOL, TOPICS
from mwd_surface.surveys.survey_store import StoreError
from mwd_surface.trajectory.slide_sheet import NAME, SLIDES, read_stretches, stretch_table

_LIVE_PERIOD = 0.05  # time between two updates of page and toolface, s
_SLOW_PERIOD = 1.0  # time between two updates of all other parts, s


class SurfaceNode(GraphNode[SurfaceSettings]):
    """Node between the topics of the sonde and the people and machines on the rig."""

    changeable = ("well.", "rules.", "leg.", "plan.", "advisory.")

    def __init__(self, **node_options: Any) -> None:
        super().__init__("surface", SurfaceSettings(), **node_options)
        self._closers: list[Callable[[], Any]] = []
        # Once a second the page is updated even if no browser is connected.
        self._page_due = True

    def on_settings_changed(self, settings: SurfaceSettings) -> None:
        """Apply changed settings to survey list, plan and page."""

        def apply(job: concurrent.futures.Future[Any]) -> None:
            self._plan.use(job.result())
            self._well.settings = settings
            self._surveys.change_settings(settings.well, settings.rules, settings.leg, self._plan.plan)
            self._show_well()
            self._recording.add_tables(self._parameter_tables.own())

        # Read the plan in the worker: a disk may be slow, and the node continues to serve page and rig.
        self._shared.worker.submit(lambda: self._plan.read(settings.plan, settings.well), apply)

    def _show_well(self) -> None:
        self._well.diagnostics.show_well(self._surveys.surveys.well)
        self._plan.show_plan()
        self._plan.show_offset(self._surveys.definitive())

    # Lifecycle.

    def configure(self) -> None:
        """
        Lock the folder, load the survey list, open topics, services, page and rig interfaces.

        Raises
        ------
        RuntimeError
            A part cannot be created: a file, folder or port cannot be used, or settings contradict each other.
        """
        try:
            self._create_parts()
        except (RecorderError, StoreError, InterfaceError, FoxgloveError, OSError, ValueError) as error:
            raise RuntimeError(str(error)) from error
        self._open_topics()

    def _create_parts(self) -> None:
        settings = self.settings
        namespace = self.get_namespace().strip("/").replace("/", "_")
        folder = Path(settings.folder).expanduser() / (namespace or "well")
        direct = settings.link.source == "direct"
        worker = self._closed_on_cleanup(BackgroundWorker())
        slide_file = folder / "surveys" / NAME
        self._outlet = outlet = NodeOutlet(self, worker, slide_file)
        self._time = SteadyTime()
        clock = WellClock(self._time.now_ns())
        # In a ROS graph with simulated time, alarms get the simulated time.
        now_ns = self._graph_ns if self.get_parameter("use_sim_time").value else lambda: clock.now_ns
        outlet.alarm_log = AlarmLog(now_ns, outlet.tell)
        well_context = WellContext(clock, LiveState(live_settings(settings)), outlet.alarm_log, outlet)
        context = self._shared = SurfaceContext(
            node=self,
            folder=folder,
            well=well_context,
            worker=worker,
            requests=RequestQueue(self._handle_request),
        )
        self._plan = PlanMonitor(well_context)
        self._plan.use(self._plan.read(settings.plan, settings.well))
        self._surveys = outlet.surveys = self._closed_on_cleanup(SurveyListServer(context, settings, plan=self._plan))
        self._rods = RodServer(context, settings.rods, self._surveys)
        earlier, bad = read_stretches(slide_file)
        if bad:
            outlet.alarm_log.log_event("slide sheet", f"{bad} lines of {slide_file} cannot be read", Severity.WARNING)
        self._tool_limits = read_limits(settings.tool_file)
        book = self._surveys
        book.health = HealthLedger(self._tool_limits)
        try:
            write_whole(folder / "surveys" / TOOL_FILE, json.dumps(limits_table(self._tool_limits)))
        except OSError as error:
            text = f"a report of this run will not know the limits of the tool: {TOOL_FILE} cannot be written: {error}"
            outlet.alarm_log.log_event("tool file", text, Severity.WARNING)
        book.journal = self._closed_on_cleanup(LogJournal(folder / "surveys" / JOURNAL))
        book.journal.restore(book.logs, book.health)
        self._well = LiveWell(
            well_context,
            settings,
            _decoded,
            book=self._surveys,
            plan=self._plan,
            full_name=self.get_fully_qualified_name(),
            stretches=earlier,
        )
        self._closers.append(self._well.slides.finish)
        self._surveys.slide_sheet, self._surveys.on_depth_by_hand = (
            self._well.slides.stretches,
            self._well.on_depth_by_hand,
        )
        self._rods.rig_depth = self._well.inputs.depth_of_rig
        self._parameter_tables = ParameterTables(self, ("sonde", "estimator") if direct else ("receiver",))
        self._recording = self._closed_on_cleanup(
            RecordingServer(
                context,
                settings,
                tables=self._tables,
                attachments=self._surveys.attachments,
                on_start=self._on_recording_started,
            )
        )
        outlet.recorder = self._recording.status
        self._page = self._closed_on_cleanup(PageBridge(context, settings))
        self._page.open()
        self._foxglove = self._closed_on_cleanup(FoxgloveBridge(context, settings.foxglove))
        self._foxglove.open()
        self._control = ControlServer(context, settings.control)
        self._downlink = DownlinkServer(context, settings.downlink, self._control.authority)
        self._rig = self._closed_on_cleanup(
            RigBridge(context, settings.rig, settings.well.name, self._control.authority, outlet.simulator_seen)
        )
        outlet.listeners.append(self._rig.on_surveys)
        outlet.rig_listeners.append(self._downlink.on_rig_state)
        self._frames = StaticFrames(context)

    def _graph_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _closed_on_cleanup(self, part: Any) -> Any:
        self._closers.append(part.close)
        return part

    def _on_recording_started(self) -> None:
        """Write the latched messages and the slide sheet into a recording that begins, for the playback."""
        self._router.repeat_latched()
        self._recording.add_tables({SLIDES: stretch_table(self._well.slides.stretches())})

    def _tables(self) -> Mapping[str, Mapping[str, str]]:
        versions = {
            "version": __version__,
            "node": self.get_fully_qualified_name(),
            "python": platform.python_version(),
        }
        return {"mwd": versions, TOOL: limits_table(self._tool_limits), **self._parameter_tables.tables()}

    def _open_topics(self) -> None:
        of_graph = (self._outlet, self._surveys, self._recording, self._parameter_tables)
        for part in (*of_graph, self._rig, self._control, self._downlink):
            part.open()
        self.add_service(srv.AcknowledgeAlarm, "acknowledge_alarm", self._acknowledge)
        self._frames.open()
        direct = self.settings.link.source == "direct"
        self._router = TopicRouter(
            self._shared,
            record=self._recording.put,
            foxglove=self._foxglove,
            handlers={**self._control.handlers, **self._downlink.handlers},
            well=self._well,
            steady=self._time,
        )
        self._router.open(self.settings.record.topics, () if direct else OF_TOOL)
        self._survey_client: Any = None
        if direct:
            self._open_requests_to_the_tool()
        self._service_callbacks: Services = {
            "accept_survey": (srv.JudgeSurvey, self._surveys.accept),
            "reject_survey": (srv.JudgeSurvey, self._surveys.reject),
            "acknowledge_alarm": (srv.AcknowledgeAlarm, self._acknowledge),
            "start_recording": (srv.StartRecording, self._recording.start),
            "stop_recording": (Trigger, self._recording.stop),
            "split_recording": (Trigger, self._recording.split),
            "snapshot_recording": (Trigger, self._recording.snapshot),
            "export": (srv.Export, self._surveys.export),
            "set_depth": (srv.SetDepth, self._surveys.set_depth),
            "judge_control": (srv.JudgeControl, self._control.judge),
            "draft_downlink": (srv.DraftDownlink, self._downlink.draft),
            "decide_downlink": (srv.DecideDownlink, self._downlink.decide),
        }
        self.add_timer(_LIVE_PERIOD, self._update_live)
        self.add_timer(_SLOW_PERIOD, self._update_slow)

    def _open_requests_to_the_tool(self) -> None:
        # The feedback of an action is a topic, to which not only the client of the action may subscribe.
        for action, action_type, callback in (
            ("north_seek", NorthSeek, self._well.diagnostics.on_north_seek),
            ("rotary_survey", RotarySurvey, self._well.diagnostics.on_rotary_survey),
        ):
            self.add_subscription(action_type.Impl.FeedbackMessage, f"{action}/_action/feedback", callback, STATE)
        self._survey_client = self.add_client(srv.TakeSurvey, "take_survey")

    def activate(self) -> None:
        """Start the recording; publish the survey list."""
        self._well.begin(self._time.now_ns())
        self._parameter_tables.refresh()
        self._recording.activate()
        self._show_well()
        self._rods.begin()
        self._surveys.show()
        self._downlink.activate()

    def deactivate(self) -> None:
        """Mark the values for the rig as unusable, then finish the recording."""
        self._router.take_streams()
        self._downlink.stop()
        self._rig.send_values(active=False)
        self._recording.deactivate()

    def cleanup(self) -> None:
        """Close the parts in the order in which they were created."""
        closers, self._closers = self._closers, []
        for close in closers:
            try:
                close()
            except Exception:  # noqa: BLE001  (if one part fails to close, the others must still be closed)
                self.get_logger().error(printable(f"cannot close:\n{traceback.format_exc()}"))

    # Messages and requests.

    def _acknowledge(self, request: Any, response: Any) -> Any:
        """Acknowledge an alarm; return the response (service)."""
        answer = self._shared.alarm_log.acknowledge(request.id, request.operator_name)
        response.success, response.message = answer
        return response

    def _handle_request(self, name: str, arguments: dict[str, Any]) -> Answer | concurrent.futures.Future[Answer]:
        """Carry out a request of page or rig in the node's thread; return success and a message, or their future."""
        if name == "count_rods":
            return self._rods.count(**arguments)
        if name == "use_leg":
            answer: Answer = self._surveys.use_leg(**arguments)
            return answer
        if name != "take_survey":
            return call_service(self._service_callbacks, name, arguments)
        if self._survey_client is None:
            return False, "over a link the tool takes a survey whenever the pumps stop; stop the pumps"
        if not self._survey_client.service_is_ready():
            return False, "the estimator does not run"
        asked = self._survey_client.call_async(srv.TakeSurvey.Request(**arguments))
        asked.add_done_callback(self._on_survey_answer)
        return True, "survey requested; see its progress and result under Survey"

    def _on_survey_answer(self, asked: Any) -> None:
        """Show why a requested survey was not taken; a survey that was taken arrives as a message."""
        answer = asked.result()
        if not answer.success:
            self._shared.alarm_log.log_event("survey", answer.message, Severity.WARNING)
            self._well.diagnostics.survey_ended(answer.message)

    # Timers.

    def _update_live(self) -> None:
        # Messages that arrive from here on wait for the next call, so that no message is late for its interval of time.
        until_ns = self._time.now_ns()
        self._shared.requests.run_requests()
        self._shared.worker.run_callbacks()
        self._router.take_streams()
        self._recording.tell_streams()
        now, before_ns = time.monotonic(), self._well.clock.now_ns
        self._rig.update(now)
        self._well.advance(until_ns)
        # The page gets the state at the end of an interval, so that playback to the same time shows the same state.
        if self._well.clock.now_ns > before_ns:
            self._page.update(without_clients=self._page_due)
            self._page_due = False
        self._downlink.update(now)
        self._control.update(now)
        self._foxglove.update()

    def _update_slow(self) -> None:
        self._router.find_missing()
        self._frames.publish(self._well.decoder.tool_frame, self._surveys.surveys.well.sensor_offset)
        self._page.open()
        self._foxglove.open()
        self._parameter_tables.request()
        self._recording.add_tables(self._parameter_tables.take_new())
        limit = self._parameter_tables.value("estimator", "attitude.vertical_deg")
        self._well.vertical_limit = None if limit is None else math.radians(float(limit))
        self._recording.update()
        self._surveys.retry_save()
        self._rods.update()
        self._page_due = True

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the diagnostics of all parts of the node."""
        parts = (
            self._recording,
            self._page,
            self._foxglove,
            self._rig,
            self._control,
            self._downlink,
            self._surveys,
            self._router,
        )
        found = [diagnostic for part in parts for diagnostic in part.diagnostics()]
        if self._well.decoder.unreadable:
            text = f"{self._well.decoder.unreadable} messages could not be read"
            found.append(Diagnostic("messages", WARN, text, "run all nodes with the same version of this project"))
        return [*found, self._of_inputs()]

    def _of_inputs(self) -> Diagnostic:
        """Return the diagnostic of the inputs: the source of the depth, and the clock of each input."""
        table = self._well.inputs.table
        name = table.depth_source
        found = [f"depth from {name}" if name else "no depth is received"]
        if name and math.isfinite(table.depth_difference):
            found.append(f"{table.depth_difference:.1f} m from another source")
        rows = tuple((row.name, _words(row)) for row in table.inputs)
        level, remedy = (OK, "") if name else (WARN, "connect the rig data, or set the depth by hand")
        return Diagnostic("inputs", level, ", ".join(found), remedy, rows)


def _words(row: InputState) -> str:
    if math.isnan(row.data_age + row.clock_offset):
        return "no data have arrived yet"
    return f"clock {row.clock.name.lower()}, offset {row.clock_offset:+.3f} s, age {row.data_age:.3f} s {row.reason}"


def _decoded(topic: str, data: bytes) -> Any:
    return deserialize_message(data, TOPICS[topic][0])


def main(args: Sequence[str] | None = None) -> int:
    """Run the surface node; return the exit status of the process."""
    return run_node(SurfaceNode, args)


# Static transforms of one well: wellhead and rig floor at the origin of the path, the bit ahead of the sonde.


_NORTH_EAST_DOWN = [float(v) for v in frames.orientation_et(np.eye(3))]


class StaticFrames:
    """Publisher of `/tf_static`, which publishes again when the tool's frame or its distance to the bit changes."""

    def __init__(self, context: SurfaceContext) -> None:
        self._context = context
        self._published: tuple[str, float] | None = None

    def open(self) -> None:
        """Create the publisher of `/tf_static`."""
        self._publisher = self._context.node.add_publisher(TFMessage, "/tf_static", LATCHED)

    def publish(self, tool_frame: str, sensor_to_bit: float) -> None:
        """
        Publish the transforms if they changed.

        tool_frame: frame id of the tool's messages, empty while unknown. sensor_to_bit: distance along the tool, m.
        """
        if self._published == (tool_frame, sensor_to_bit):
            return
        node = self._context.node
        local = node.frame(wire.LOCAL_FRAME)
        wellhead = self._transform(local, node.frame(wire.WELLHEAD_FRAME))
        turned = wellhead.transform.rotation
        turned.x, turned.y, turned.z, turned.w = _NORTH_EAST_DOWN
        floor = node.frame(wire.RIG_FRAME)
        # Rig data from a rig interface of this project have the name of the interface as frame id; this frame equals
        # the rig floor.
        ours = [self._transform(floor, node.frame(name)) for name in (OPCUA, WITS, MODBUS)]
        transforms = [wellhead, self._transform(local, floor), *ours]
        if tool_frame:
            bit = self._transform(tool_frame, node.frame(wire.BIT_FRAME))
            bit.transform.translation.x = sensor_to_bit
            transforms.append(bit)
        self._publisher.publish(TFMessage(transforms=transforms))
        self._published = tool_frame, sensor_to_bit

    def _transform(self, parent: str, child: str) -> TransformStamped:
        return TransformStamped(header=header(self._context.now_ns(), parent), child_frame_id=child)
