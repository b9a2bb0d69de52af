# SPDX-License-Identifier: Apache-2.0
"""
The surface as a node: connects recorder, survey list, page and rig interfaces with the graph and with each other.

Each part has a module of its own beside this one; this module creates the parts, calls them from two timers, and
connects them with the topics.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
import platform
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mwd_msgs import srv
from mwd_msgs.action import NorthSeek, RotarySurvey
from std_srvs.srv import Trigger

from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.diagnostics import Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.qos import STATE
from mwd_sensors.ros.run_node import run_node
from mwd_surface import __version__
from mwd_surface.bags.recorder.status import RecorderError
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.nodes.advice_server import AdviceServer
from mwd_surface.nodes.clearance_monitor import ClearanceMonitor
from mwd_surface.nodes.control_server import ControlServer
from mwd_surface.nodes.diagnostics_monitor import DiagnosticsMonitor
from mwd_surface.nodes.downlink_server import DownlinkServer
from mwd_surface.nodes.foxglove_bridge import FoxgloveBridge
from mwd_surface.nodes.input_monitor import InputMonitor
from mwd_surface.nodes.link_monitor import LinkMonitor
from mwd_surface.nodes.page_bridge import PageBridge, Services, call_service
from mwd_surface.nodes.plan_server import PlanServer
from mwd_surface.nodes.recording_server import RecordingServer
from mwd_surface.nodes.rig_bridge import RigBridge
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.nodes.slide_recorder import SlideRecorder
from mwd_surface.nodes.static_frames import StaticFrames
from mwd_surface.nodes.stream_decoder import StreamDecoder
from mwd_surface.nodes.supervision_monitor import SupervisionMonitor
from mwd_surface.nodes.survey_list_server import SurveyListServer
from mwd_surface.nodes.topic_router import TopicRouter
from mwd_surface.page.foxglove_server import FoxgloveError
from mwd_surface.rig.interface import InterfaceError
from mwd_surface.ros.alarm_log import AlarmLog
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.parameter_tables import ParameterTables
from mwd_surface.ros.topics import OF_TOOL, OVER_LINK
from mwd_surface.ros.worker import Answer, BackgroundWorker, RequestQueue
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_store import StoreError

_LIVE_PERIOD = 0.05  # s between updates of page and toolface
_LINK_PERIOD = 2.0  # s between attitudes over a link at most
_SLOW_PERIOD = 1.0  # s between updates of everything else


class SurfaceNode(GraphNode[SurfaceSettings]):
    """Everything between the sonde's topics and the people and machines on the rig."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("surface", SurfaceSettings(), **node_options)
        self._closers: list[Callable[[], Any]] = []

    def changeable_at_runtime(self, name: str) -> bool:
        """Well, leg, plan, advisory and rules of the list can change at run time; folders and ports cannot."""
        return name.startswith(("well.", "rules.", "leg.", "plan.", "advisory."))

    def on_settings_changed(self, settings: SurfaceSettings) -> None:
        """Apply changed settings to survey list, plan and page."""

        def apply(job: concurrent.futures.Future[Any]) -> None:
            self._plan.use(job.result())
            self._surveys.change_settings(settings.well, settings.rules, settings.leg, self._plan.plan)
            self._show_well()

        # A disk may take its time; the node meanwhile serves page and rig.
        self._shared.worker.submit(lambda: self._plan.read(settings.plan, settings.well.north_reference), apply)

    def _show_well(self) -> None:
        self._monitor.show_well(self._surveys.surveys.well)
        self._plan.show_plan()
        self._plan.show_offset(self._surveys.definitive())

    # Lifecycle.

    def configure(self) -> None:
        """Lock the folder, load the survey list, open topics, services, page and rig interfaces."""
        try:
            self._create_parts()
        except (RecorderError, StoreError, InterfaceError, FoxgloveError, OSError, ValueError) as error:
            self.cleanup()
            raise RuntimeError(str(error)) from error
        self._open_topics()

    def _create_parts(self) -> None:
        settings = self.settings
        namespace = self.get_namespace().strip("/").replace("/", "_")
        direct = settings.link.source == "direct"
        # Over a link an attitude comes with each second of pressure.
        slow = max(settings.live.estimator_period, _LINK_PERIOD)
        live = LiveState(settings.live if direct else dataclasses.replace(settings.live, estimator_period=slow))
        context = self._shared = SurfaceContext(
            node=self,
            folder=Path(settings.folder).expanduser() / (namespace or "well"),
            live=live,
            alarm_log=AlarmLog(self, live),
            worker=self._closed_on_cleanup(BackgroundWorker()),
            requests=RequestQueue(self._handle_request),
        )
        self._monitor = DiagnosticsMonitor(context)
        self._inputs = InputMonitor(context, link=not direct)
        self._supervision = SupervisionMonitor(context)
        self._plan = PlanServer(live, context.alarm_log)
        self._plan.use(self._plan.read(settings.plan, settings.well.north_reference))
        self._slides = self._closed_on_cleanup(SlideRecorder(context, settings.slides))
        self._surveys = self._closed_on_cleanup(
            SurveyListServer(
                context,
                settings,
                plan=self._plan,
                on_published=self._on_surveys_published,
                slide_sheet=self._slides.stretches,
                on_depth_by_hand=self._inputs.on_depth_by_hand,
            )
        )
        self._clearance = ClearanceMonitor(context, self._plan)
        self._parameter_tables = ParameterTables(self, ("sonde", "estimator") if direct else ("receiver",))
        self._link = LinkMonitor(context, settings.link.source, on_gauge=self._inputs.on_gauge)
        self._recording = self._closed_on_cleanup(
            RecordingServer(context, settings, tables=self._tables, attachments=self._surveys.attachments)
        )
        self._page = self._closed_on_cleanup(PageBridge(context, settings))
        self._page.open()
        self._foxglove = self._closed_on_cleanup(FoxgloveBridge(context, settings.foxglove))
        self._foxglove.open()
        self._control = ControlServer(context, settings.control)
        self._advice = AdviceServer(context)
        self._downlink = DownlinkServer(context, settings.downlink, self._control.authority)
        self._rig = self._closed_on_cleanup(
            RigBridge(context, settings.rig, settings.well.name, self._control.authority, self._inputs.is_simulated)
        )
        self._frames = StaticFrames(context)
        self._decoder = StreamDecoder(
            context,
            on_attitude=self._on_attitude,
            on_rig_state=self._on_rig_state,
            on_sonde=self._on_sonde,
            on_rig_input=self._inputs.on_rig_input,
            rules=settings.rig_sources,
        )

    def _closed_on_cleanup(self, part: Any) -> Any:
        self._closers.append(part.close)
        return part

    def _tables(self) -> Mapping[str, Mapping[str, str]]:
        versions = {
            "version": __version__,
            "node": self.get_fully_qualified_name(),
            "python": platform.python_version(),
        }
        return {"mwd": versions, **self._parameter_tables.tables()}

    def _open_topics(self) -> None:
        alarm_log, monitor = self._shared.alarm_log, self._monitor
        of_graph = (alarm_log, self._surveys, self._recording, self._parameter_tables)
        for part in (*of_graph, self._rig, self._control, self._advice, self._downlink):
            part.open()
        self._frames.open()
        self._decoder.open()
        self._inputs.open(self._decoder.rig_sources)
        direct = self.settings.link.source == "direct"
        handlers = {
            **{topic: buffer.append for topic, buffer in self._decoder.buffers.items()},
            "survey": self._on_survey,
            "survey/revised": self._surveys.on_revision,
            "/diagnostics": monitor.on_diagnostics,
            "heartbeat": self._supervision.on_heartbeat,
            "rig/quill": self._slides.on_quill,
            **self._link.handlers,
            **self._control.handlers,
        }
        self._downlink.share(handlers)
        if not direct:
            handlers |= {over: handlers[topic] for topic, over in OVER_LINK.items()}
        self._router = TopicRouter(
            self._shared,
            record=self._recording.put,
            foxglove=self._foxglove,
            handlers=handlers,
            on_message=self._supervision.message_received,
        )
        self._router.open(self.settings.record.topics, () if direct else OF_TOOL)
        self._survey_client: Any = None
        if direct:
            self._open_requests_to_the_tool()
        self._service_callbacks: Services = {
            "accept_survey": (srv.JudgeSurvey, self._surveys.accept),
            "reject_survey": (srv.JudgeSurvey, self._surveys.reject),
            "acknowledge_alarm": (srv.AcknowledgeAlarm, alarm_log.acknowledge),
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
        # The feedback of an action is a topic, which others than the action's client may subscribe to.
        for action, action_type, callback in (
            ("north_seek", NorthSeek, self._monitor.on_north_seek),
            ("rotary_survey", RotarySurvey, self._monitor.on_rotary_survey),
        ):
            self.add_subscription(action_type.Impl.FeedbackMessage, f"{action}/_action/feedback", callback, STATE)
        self._survey_client = self.add_client(srv.TakeSurvey, "take_survey")

    def activate(self) -> None:
        """Start the recording; publish the survey list."""
        self._recording.activate()
        self._show_well()
        self._surveys.publish()
        self._downlink.activate()

    def deactivate(self) -> None:
        """Mark the values for the rig as not to be used, then finish the recording."""
        self._router.take_streams()
        self._downlink.stop()
        self._rig.send_values(time.monotonic(), active=False)
        self._recording.deactivate()

    def cleanup(self) -> None:
        """Close the parts in the order in which they were created."""
        closers, self._closers = self._closers, []
        for close in closers:
            try:
                close()
            except Exception:  # noqa: BLE001  (a part that cannot close must not keep the others open)
                self.get_logger().error(f"cannot close:\n{traceback.format_exc()}")

    # Messages and requests.

    def _on_surveys_published(self, surveys: SurveyList) -> None:
        self._rig.on_surveys(surveys)
        self._slides.on_surveys(surveys)

    def _on_attitude(self, samples: Samples) -> None:
        self._slides.on_attitude(samples)

    def _on_sonde(self, samples: Samples) -> None:
        self._supervision.on_sonde(samples)
        self._inputs.on_sonde(samples)
        self._surveys.on_sonde(samples)

    def _on_rig_state(self, samples: Samples) -> Samples:
        paired, shown = self._inputs.in_force(samples)
        bit_depth = self._surveys.on_rig_state(paired)
        self._slides.on_rig_state(paired, bit_depth)
        self._downlink.on_rig_state(samples)
        return shown

    def _on_survey(self, data: bytes) -> None:
        # The depth of a survey comes from the rig data received before it.
        self._decoder.decode("rig/state", time.monotonic())
        self._monitor.survey_ended(self._surveys.on_survey(data))

    def _handle_request(self, name: str, arguments: dict[str, Any]) -> Answer | concurrent.futures.Future[Answer]:
        """Carry out a request of page or rig, in the node's thread."""
        if name != "take_survey":
            return call_service(self._service_callbacks, name, arguments)
        if self._survey_client is None:
            return False, "over a link the tool takes a survey by itself whenever the pumps stop; stop them for one"
        if not self._survey_client.service_is_ready():
            return False, "the estimator is not there"
        asked = self._survey_client.call_async(srv.TakeSurvey.Request(**arguments))
        asked.add_done_callback(self._on_survey_answer)
        return True, "asked for a survey; how it goes and ends stands under Survey"

    def _on_survey_answer(self, asked: Any) -> None:
        """Show why a survey that a person asked for was not taken; one that was taken comes as a message."""
        answer = asked.result()
        if not answer.success:
            self._shared.alarm_log.log_event("survey", answer.message, Severity.WARNING)
            self._monitor.survey_ended(answer.message)

    # Timers.

    def _update_live(self) -> None:
        self._shared.requests.run_requests()
        self._shared.worker.run_callbacks()
        self._router.take_streams()
        now = time.monotonic()
        self._rig.update(now)
        self._decoder.decode_all(now)
        self._downlink.update(now)
        self._control.update(now)
        self._page.update(now)
        self._foxglove.update()

    def _update_slow(self) -> None:
        now = time.monotonic()
        self._router.find_missing()
        self._frames.publish(self._decoder.tool_frame, self._surveys.surveys.well.sensor_offset)
        self._page.open()
        self._foxglove.open()
        self._parameter_tables.request()
        self._recording.add_tables(self._parameter_tables.take_new())
        limit = self._parameter_tables.value("estimator", "attitude.vertical_deg")
        self._shared.live.on_vertical_limit(None if limit is None else math.radians(float(limit)))
        self._recording.update(now)
        self._monitor.update(now)
        self._inputs.update(now)
        clocks, depths = self._surveys.depth.clock_difference, self._inputs.table.depth_difference
        self._supervision.update(now, self._recording.status(), clocks, depths)
        self._decoder.update(now)
        self._surveys.retry_save()
        self._surveys.update_projection(now)
        self._clearance.update(self._surveys.surveys, self._surveys.bit_depth)
        self._slides.update(now)
        self._advice.update(
            now,
            self.settings.advisory,
            self._plan.plan,
            self._surveys.surveys,
            self._surveys.bit_depth,
            self._slides.stretches(),
        )
        self._shared.alarm_log.publish(now)
        self._page.update(now, without_clients=True)

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Report on recorder, page, Foxglove, inputs, rig, control, survey list, messages and topics to record."""
        parts = (
            self._recording,
            self._page,
            self._foxglove,
            self._inputs,
            self._rig,
            self._control,
            self._downlink,
            self._surveys,
            self._decoder,
            self._router,
        )
        return [diagnostic for part in parts for diagnostic in part.diagnostics()]


def main(args: Sequence[str] | None = None) -> int:
    """Run the surface node."""
    return run_node(SurfaceNode, args)
