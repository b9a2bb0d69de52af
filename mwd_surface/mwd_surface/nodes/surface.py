"""The surface as a node: records everything, keeps survey list and well path, serves driller topics and the page."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import importlib
import math
import queue
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mwd_msgs import msg, srv
from nav_msgs.msg import Path as PathMessage
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from mwd_estimation.nodes.messages import stamp
from mwd_sensors import wire
from mwd_sensors.nodes.graph_node import ERROR, OK, WARN, Finding, GraphNode, Later, run_node
from mwd_sensors.nodes.profiles import EVENT, LATCHED, STATE
from mwd_sensors.settings import setting
from mwd_surface import __version__
from mwd_surface.bags.recorder import Level, Recorder, RecorderError, RecorderSettings, State
from mwd_surface.exports.export import ExportError, export
from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.survey_table import survey_table, table_of
from mwd_surface.nodes import messages
from mwd_surface.nodes.contract import TOPICS, profile_yaml, type_name
from mwd_surface.page.alarms import AlarmBook, Severity
from mwd_surface.page.live_state import LiveSettings, LiveState
from mwd_surface.page.page_server import PageServer, PageSettings
from mwd_surface.rig.rig_interface import InterfaceError
from mwd_surface.rig.rig_port import RigPort, RigSettings
from mwd_surface.rig.rig_survey import AcceptedSurvey, accepted_surveys
from mwd_surface.rig.rig_values import RigValues, rig_values
from mwd_surface.surveys.depth import DepthRules, DepthTrack
from mwd_surface.surveys.plan import Plan, interpolated, offset_from, steering_to
from mwd_surface.surveys.plan_file import PlanError, read_plan
from mwd_surface.surveys.survey_list import Definitive, ListRules, SurveyList
from mwd_surface.surveys.survey_message import survey_of
from mwd_surface.surveys.survey_record import Verdict
from mwd_surface.surveys.survey_store import StoreError, SurveyStore
from mwd_surface.surveys.well import Well

_LIVE_PERIOD = 0.05  # s; how often what arrived is brought to the page and the toolface topic
_RIG_PERIOD = 0.2  # s; how often the rig interfaces are told
_SILENT_AFTER = 2.0  # s
_LAYOUTS = {
    "attitude": wire.ATTITUDE,
    "gravity": wire.GRAVITY,
    "interference": wire.INTERFERENCE,
    "rig/state": wire.RIG_STATE,
    "imu/mag": wire.MAG,
    "imu/temperature": wire.TEMPERATURE,
}
_STOP_WITHIN = 1.3  # s for each step of an end, so that all of it stays below 3 s
_RETRY = 5.0  # s between tries to begin a recording or to serve a page that could not begin
_PLAN_STEP = 10.0  # m between points of the plan as drawn
_FIELD = ("total", "dip", "declination", "convergence", "gravity")
_SEVERITIES = {Level.INFO: Severity.INFO, Level.WARNING: Severity.WARNING, Level.ERROR: Severity.CRITICAL}
_QUEUE = 5000  # messages of one topic that may wait for this node
_COMMAND_TIMEOUT = 5.0  # s a page waits for the node


@dataclasses.dataclass(frozen=True)
class RecordSettings:
    """What is recorded."""

    enabled: bool = setting(True, "Record from activation on", fixed=True)
    name: str = setting("", "Folder name of the recording; empty: made from the time", fixed=True)
    topics: list[str] = setting(
        list(TOPICS), "Topics to record, relative to the well or absolute; unknown ones are recorded once they appear",
        fixed=True,
    )  # fmt: skip


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


@dataclasses.dataclass(frozen=True)
class SurfaceSettings:
    """Parameters of the surface node."""

    folder: str = setting("~/mwd_data", "Where recordings, the survey list and exports are kept", fixed=True)
    serve_page: bool = setting(True, "Serve the live page", fixed=True)
    strict: bool = setting(
        False, "Refuse to start without the page; false: raise an alarm and try its port every 5 s", fixed=True
    )
    well: Well = setting(Well, "The well")
    plan: PlanSettings = setting(PlanSettings, "The planned well path")
    advisory: AdvisorySettings = setting(AdvisorySettings, "Toolface to steer at")
    rules: ListRules = setting(ListRules, "Rules of the survey list")
    depth: DepthRules = setting(DepthRules, "Pairing surveys with depth")
    record: RecordSettings = setting(RecordSettings, "What is recorded")
    recorder: RecorderSettings = setting(RecorderSettings, "How it is recorded")
    page: PageSettings = setting(PageSettings, "The live page")
    live: LiveSettings = setting(LiveSettings, "What the page shows")
    rig: RigSettings = setting(RigSettings, "Rig interfaces")


class SurfaceNode(GraphNode[SurfaceSettings]):
    """Everything between the sonde's topics and the people and machines on the rig."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("surface", SurfaceSettings(), **node_options)
        self._recorder: Recorder | None = None
        self._store: SurveyStore | None = None
        self._page: PageServer | None = None
        self._rig: RigPort | None = None
        self._worker: concurrent.futures.ThreadPoolExecutor | None = None

    def takes_live(self, name: str) -> bool:
        """Well, plan, advice and rules of the list can change while running; folders and ports cannot."""
        return name.startswith(("well.", "rules.", "plan.", "advisory."))

    def settings_changed(self, settings: SurfaceSettings) -> None:
        """Bring the survey list under the new well and rules, the page under the new plan and advice."""
        if self._store is None:
            return
        self._read_plan()
        self._show_advisory()
        try:
            surveys = self._surveys.configured(self._well(), settings.rules)
        except ValueError as error:
            self._raise("surveys.settings", Severity.WARNING, f"the survey list keeps its old settings: {error}", "")
        else:
            self._alarms.clear("surveys.settings", self._now_ns())
            self._keep(surveys)
        self._show_well()

    def _well(self) -> Well:
        """The well as configured, with the vertical section along the plan where nothing else is said."""
        well, asked = self.settings.well, self.settings.plan
        if self._plan is None or not asked.sets_section or well.section_azimuth_deg != 0.0:
            return well
        return dataclasses.replace(well, section_azimuth_deg=math.degrees(self._plan.section_azimuth))

    def _read_plan(self) -> None:
        """Take the plan of the file; one that cannot be used is told, and the page does without."""
        self._plan: Plan | None = None
        file, north = self.settings.plan.file, self.settings.well.north_reference
        if file:
            try:
                plan = _plan_from(Path(file).expanduser(), north)
            except PlanError as error:
                text = f"the plan is not used: {error}"
                self._raise("plan.file", Severity.WARNING, text, "mend the file, then set plan.file again")
                return
            self._plan = plan
            self._note("plan", f"{plan.name}: {len(plan.md)} stations to {plan.md[-1]:.0f} m")
        self._alarms.clear("plan.file", self._now_ns())

    def _show_advisory(self) -> None:
        asked = self.settings.advisory
        wanted = math.radians(asked.toolface_deg) if asked.toolface_deg >= 0.0 else None
        self._live.on_advisory(wanted, math.radians(asked.limit_deg), time.monotonic())

    def _show_well(self) -> None:
        now = time.monotonic()
        self._live.on_well(self._surveys.well, now, self._field)
        self._live.on_plan(interpolated(self._plan, _PLAN_STEP) if self._plan is not None else None, now)
        self._show_offset(self._surveys.definitive(bit_depth=self._bit_depth()))

    def _show_offset(self, path: Definitive) -> None:
        now, plan = time.monotonic(), self._plan
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

    def _bit_depth(self) -> float | None:
        return self._depth.latest[1] if self._depth.latest else None

    # Opening and closing.

    def open(self) -> None:
        """Take the folder, load the survey list, open topics, services and the page."""
        settings = self.settings
        namespace = self.get_namespace().strip("/").replace("/", "_")
        self._folder = Path(settings.folder).expanduser() / (namespace or "well")
        self._alarms = AlarmBook()
        self._live = LiveState(settings.live)
        self._depth = DepthTrack(settings.depth)
        self._commands: queue.SimpleQueue[tuple[str, dict[str, Any], concurrent.futures.Future[tuple[bool, str]]]] = (
            queue.SimpleQueue()
        )
        self._rig_in: queue.SimpleQueue[wire.Samples] = queue.SimpleQueue()
        self._rig_surveys: tuple[AcceptedSurvey, ...] = ()
        self._rig_values: RigValues | None = None
        self._rig_told = 0.0
        self._last_attitude: wire.Samples | None = None
        self._buffers: dict[str, list[bytes]] = {topic: [] for topic in _LAYOUTS}
        self._heard: dict[str, float] = {}
        self._findings_of: dict[str, tuple[float, list[Any]]] = {}
        self._alarms_told = -1
        self._field: dict[str, float | str] | None = None
        self._progress: tuple[bool, str] = (False, "")
        self._progress_at = 0.0
        self._result = ""
        self._page_tried = -_RETRY
        self._unreadable = 0
        self._unsaved = ""
        self._worker = concurrent.futures.ThreadPoolExecutor(1, "surface-worker")
        self._jobs: list[tuple[concurrent.futures.Future[Any], Callable[[Any], None]]] = []
        try:
            self._read_plan()
            self._open_folder()
            self._open_page()
            self._open_rig()
        except (RecorderError, StoreError, InterfaceError, OSError, ValueError) as error:
            self.close()
            raise RuntimeError(str(error)) from error
        self._open_topics()
        self._open_services()

    def _open_folder(self) -> None:
        settings = self.settings
        self._store = SurveyStore(self._folder / "surveys")
        loaded = self._store.load(self._well(), settings.rules)
        self._surveys = loaded.surveys
        for text in loaded.messages:
            self._note("survey list", text, Severity.WARNING)
        self._recorder = Recorder(
            self._folder / "bags",
            settings.recorder,
            tables=lambda: {"mwd": {"version": __version__, "node": self.get_fully_qualified_name()}},
            event_topic=self.resolve_topic_name("recorder/events"),
        )

    def _open_page(self) -> None:
        """Serve the page; where its port is taken, say so and try again later."""
        if not self.settings.serve_page or self._page is not None or time.monotonic() - self._page_tried < _RETRY:
            return
        self._page_tried = time.monotonic()
        page = PageServer(self.settings.page, self._ask_node)
        try:
            page.start()
        except OSError as error:
            if self.settings.strict:
                raise
            self._raise("page.port", Severity.WARNING, f"no live page: {error}", "it is tried every 5 s")
            return
        self._page = page
        self._alarms.clear("page.port", self._now_ns())
        self.get_logger().info(f"page: {page.address}")

    def _open_rig(self) -> None:
        self._rig = RigPort(
            self.settings.rig,
            self._surveys.well.name,
            on_rig_state=self._rig_in.put,
            on_command=self._ask_node,
            folder=self._folder / "opcua",
        )
        for name, why in self._rig.start().items():
            self._note(f"rig {name}", why, Severity.WARNING)

    def _open_topics(self) -> None:
        self._toolface = self.publish_on(msg.Toolface, "toolface", STATE)
        self._accepted = self.publish_on(msg.SurveyRecord, "survey/accepted", EVENT)
        self._list = self.publish_on(msg.SurveyList, "surveys", LATCHED)
        self._trajectory = self.publish_on(msg.Trajectory, "trajectory", LATCHED)
        self._path = self.publish_on(PathMessage, "path", LATCHED)
        self._alarm_list = self.publish_on(msg.AlarmList, "alarms", LATCHED)
        self._rig_state = (
            self.publish_on(msg.RigState, "rig/state", TOPICS["rig/state"][1]) if self.settings.rig.takes_data else None
        )
        self._recorder_status = self.publish_on(msg.RecorderStatus, "recorder", STATE)
        self._handlers: dict[str, Callable[[bytes], None]] = {
            "survey": self._on_survey,
            "/diagnostics": self._on_diagnostics,
        }
        wanted = {self.resolve_topic_name(name): name for name in self.settings.record.topics}
        for name, (kind, profile) in TOPICS.items():
            recorded = wanted.pop(self.resolve_topic_name(name), None) is not None
            if recorded or name in _LAYOUTS or name in self._handlers:
                self._subscribe(name, kind, profile, recorded=recorded)
        self._not_found = set(wanted)
        self._survey_client = self.create_client(srv.TakeSurvey, "take_survey")
        self._made.append(lambda: self.destroy_client(self._survey_client))
        self.every(_LIVE_PERIOD, self._bring_live)
        self.every(1.0, self._each_second)

    def _open_services(self) -> None:
        self.serve(srv.JudgeSurvey, "accept_survey", self._accept_survey)
        self.serve(srv.JudgeSurvey, "reject_survey", self._reject_survey)
        self.serve(srv.SetDepth, "set_depth", self._set_depth)
        self.serve(srv.StartRecording, "start_recording", self._start_recording)
        self.serve(Trigger, "stop_recording", self._stop_recording)
        self.serve(Trigger, "split_recording", self._split_recording)
        self.serve(srv.Export, "export", self._export)
        self.serve(srv.AcknowledgeAlarm, "acknowledge_alarm", self._acknowledge_alarm)

    def start(self) -> None:
        """Begin to record; publish what is known."""
        self._wanted = self.settings.record.enabled
        self._tried = -_RETRY
        self._begin_recording()
        self._show_advisory()
        self._show_well()
        self._publish_surveys()

    def _begin_recording(self) -> None:
        """Begin the recording that is wanted; where it cannot begin, say so and try again later."""
        if self._recorder is None or not self._wanted or time.monotonic() - self._tried < _RETRY:
            return
        self._tried = time.monotonic()
        try:
            self._recorder.start(self.settings.record.name)
        except RecorderError as error:
            self._raise("recording.start", Severity.CRITICAL, str(error), "free the disk; it is tried every 5 s")
            return
        self._wanted = False
        self._alarms.clear("recording.start", self._now_ns())

    def halt(self) -> None:
        """Finish the recording; tell the rig that nothing here may be acted upon."""
        self._tell_rig(time.monotonic(), active=False)
        self._wanted = False
        if self._recorder is not None and self._recorder.status().state != State.STOPPED:
            try:
                self._recorder.stop(_STOP_WITHIN)
            except RecorderError as error:
                self.get_logger().error(f"recording not finished: {error}")

    def close(self) -> None:
        """Give folder and port free."""
        if self._worker is not None:
            self._worker.shutdown(wait=False, cancel_futures=True)
        if self._rig is not None:
            self._rig.stop()
        if self._page is not None:
            self._page.stop()
        if self._recorder is not None:
            self._recorder.close(_STOP_WITHIN)
        if self._store is not None:
            self._store.close()
        self._page = self._recorder = self._store = self._rig = None

    # Messages in.

    def _subscribe(self, name: str, kind: Any, profile: QoSProfile, *, recorded: bool) -> None:
        full, typed, offered = self.resolve_topic_name(name), type_name(kind), profile_yaml(profile)
        buffer, handler = self._buffers.get(name), self._handlers.get(name)

        def arrived(data: bytes) -> None:
            self._heard[name] = time.monotonic()
            if recorded and self._recorder is not None:
                self._recorder.put(full, typed, data, time.time_ns(), qos=offered)
            if buffer is not None:
                buffer.append(data)
            elif handler is not None:
                handler(data)

        # What arrives while this node is busy must not push out what waits: the reader's own queue is deep.
        deep = QoSProfile(depth=_QUEUE, reliability=profile.reliability, durability=profile.durability)
        self.listen(kind, name, arrived, deep, raw=True)

    def _find_missing(self) -> None:
        """Topics told to be recorded that are not of the contract: subscribe when they appear."""
        if not self._not_found:
            return
        for full, types in self.get_topic_names_and_types():
            if full in self._not_found and types:
                package, _, name = types[0].partition("/msg/")
                try:
                    kind = getattr(importlib.import_module(f"{package}.msg"), name)
                except (ImportError, AttributeError):
                    self._note("recorder", f"{full} cannot be recorded: {types[0]} is not installed", Severity.WARNING)
                    self._not_found.discard(full)
                    continue
                publishers = self.get_publishers_info_by_topic(full)
                profile = publishers[0].qos_profile if publishers else STATE
                # Discovery does not carry the history of a profile.
                offered = QoSProfile(depth=100, reliability=profile.reliability, durability=profile.durability)
                self._subscribe(full, kind, offered, recorded=True)
                self._not_found.discard(full)

    def _on_survey(self, data: bytes) -> None:
        survey = survey_of(deserialize_message(data, msg.Survey))
        self._drain_rig()
        reading = self._depth.sensor_depth(survey.stamp_ns, self._surveys.well.sensor_to_bit)
        self._result = f"survey {survey.sequence}: {Verdict(survey.verdict).name.lower()}"
        self._show_progress(False)
        known = {r.survey.uuid for r in self._surveys.records}
        try:
            self._keep(self._surveys.add(survey, reading.measured_depth, reading.depth_age, comment=reading.reason))
        except ValueError as error:
            self._raise("survey.refused", Severity.WARNING, f"survey {survey.sequence} not taken: {error}", "")
            return
        for record in self._surveys.records:
            if record.survey.uuid not in known:
                words = "in use" if record.in_use else "waits for a decision"
                self._note("survey", f"survey {record.survey.sequence} {words}: {'; '.join(record.survey.reasons)}")
                if record.in_use:
                    self._accepted.publish(messages.record_message(record))

    def _on_diagnostics(self, data: bytes) -> None:
        array = deserialize_message(data, DiagnosticArray)
        ours = [s for s in array.status if s.hardware_id == self.get_namespace()]
        if ours:
            node = ours[0].name.partition(":")[0]
            self._findings_of[node] = (time.monotonic(), ours)
        for status in ours:
            if status.name.endswith("estimator: survey"):
                self._on_survey_progress(status)
            elif status.name.endswith("estimator: reference field"):
                self._on_reference(status)

    def _on_survey_progress(self, status: Any) -> None:
        values = {pair.key: pair.value for pair in status.values}
        active = "remaining_s" in values
        figures = (float(values.get("elapsed_s", 0.0)), float(values.get("remaining_s", 0.0)))
        self._show_progress(active, *figures, status.message)

    def _show_progress(self, active: bool, elapsed: float = 0.0, remaining: float = 0.0, state: str = "") -> None:
        if active or self._progress != (active, self._result):
            self._progress_at = time.monotonic()
            self._progress = (active, self._result)
            self._live.on_survey_progress(active, time.monotonic(), elapsed, remaining, state, self._result)

    def _on_reference(self, status: Any) -> None:
        values = {pair.key: pair.value for pair in status.values}
        known = "total" in values
        field: dict[str, float | str] | None = None
        if known:
            field = {name: float(values[name]) for name in _FIELD if name in values} | {"source": status.message}
        if field != self._field:
            self._field = field
            self._live.on_well(self._surveys.well, time.monotonic(), field)

    def _take_buffer(self, topic: str) -> wire.Samples | None:
        waiting = self._buffers[topic]
        if not waiting:
            return None
        taken = list(waiting)
        waiting.clear()
        try:
            rows = np.frombuffer(b"".join(taken), dtype=np.uint8).reshape(len(taken), -1)
            return _LAYOUTS[topic].decode(rows)
        except ValueError as error:
            self._unreadable += len(taken)
            self.get_logger().warning(f"{topic}: {error}", throttle_duration_sec=10.0)
            return None

    def _drain_rig(self) -> None:
        samples = self._take_buffer("rig/state")
        if samples is None:
            return
        for sample in samples:
            if sample["valid"] & msg.RigState.BIT_DEPTH:
                self._depth.update(int(sample["stamp_ns"]), float(sample["bit_depth"]))
        self._live.on_rig_state(samples, time.monotonic())

    def _bring_live(self) -> None:
        self._answer_page()
        self._finish_jobs()
        now = time.monotonic()
        while self._rig_state is not None and not self._rig_in.empty():
            samples = self._rig_in.get()
            # The interface stamps by the wall; the graph by the node's clock.
            samples["stamp_ns"] = self._now_ns()
            self._rig_state.publish(wire.RIG_STATE.encode(samples, wire.RIG_FRAME)[0].tobytes())
        self._drain_rig()
        gravity = self._take_buffer("gravity")
        if gravity is not None:
            self._live.on_gravity(gravity, now)
        attitude = self._take_buffer("attitude")
        if attitude is not None:
            self._live.on_attitude(attitude, now)
            self._last_attitude = attitude[-1:]
            self._publish_toolface()
        for topic, act in (
            ("interference", self._live.on_interference),
            ("imu/temperature", self._live.on_temperature),
            ("imu/mag", self._live.on_magnetic_field),
        ):
            samples = self._take_buffer(topic)
            if samples is not None:
                act(samples, now)
        if self._page is not None and self._page.clients:
            self._page.push(self._live.snapshot(now))
        if now - self._rig_told >= _RIG_PERIOD:
            self._tell_rig(now)

    def _tell_rig(self, now: float, *, active: bool = True) -> None:
        if self._rig is None or not self._rig.enabled:
            return
        self._rig_told = now
        self._rig_values = rig_values(
            self._live.snapshot(now),
            self._rig_surveys,
            self._last_attitude,
            now_ns=self._now_ns(),
            active=active,
            simulated=self.settings.rig.simulated,
            previous=self._rig_values,
        )
        self._rig.publish(self._rig_values)

    def _each_second(self) -> None:
        now, now_ns = time.monotonic(), self._now_ns()
        self._find_missing()
        self._open_page()
        self._begin_recording()
        if self._recorder is not None:
            status = self._recorder.status()
            message = messages.recorder_message(status, stamp(now_ns))
            self._recorder_status.publish(message)
            self._live.on_recorder(message, now)
            self._watch_recorder(status)
        self._watch_inputs(now)
        if self._progress[0] and now - self._progress_at > _SILENT_AFTER + 1.0:
            self._show_progress(False)
        findings = [
            {"name": s.name, "level": s.level, "message": s.message, "remedy": _remedy(s)}
            for heard, found in self._findings_of.values()
            if now - heard < 5.0
            for s in found
        ]
        self._live.on_diagnostics(findings, now)
        if self._unsaved and self._store is not None:
            self._save()
        if self._alarms.version != self._alarms_told:
            self._alarms_told = self._alarms.version
            alarms = msg.AlarmList(alarms=[messages.alarm_message(a) for a in self._alarms.alarms()])
            alarms.header.stamp = stamp(now_ns)
            self._alarm_list.publish(alarms)
            self._live.on_alarms(self._alarms.alarms(), self._alarms.events(), now)
        if self._page is not None:
            self._page.push(self._live.snapshot(now))

    # Watching.

    def _watch_inputs(self, now: float) -> None:
        causes: dict[str, tuple[int, str, str]] = {}
        for topic, who, severity in (
            ("imu/data_raw", "sonde", Severity.CRITICAL),
            ("attitude", "estimator", Severity.CRITICAL),
            ("rig/state", "rig data", Severity.WARNING),
        ):
            if topic in self._heard and now - self._heard[topic] > _SILENT_AFTER:
                age = now - self._heard[topic]
                text = f"no {topic} from the {who}: the last came more than {_SILENT_AFTER:.0f} s ago"
                causes[f"input.{topic}"] = (severity, text, f"is the {who} alive and connected? ({age:.0f} s)"[:60])
        self._alarms.sync("input.", causes, self._now_ns())

    def _watch_recorder(self, status: Any) -> None:
        causes: dict[str, tuple[int, str, str]] = {}
        if status.state in (State.PAUSED_DISK_FULL, State.FAILED):
            causes["recorder.state"] = (Severity.CRITICAL, status.reason, "free the disk; recording resumes by itself")
        if status.dropped:
            text = f"{status.dropped} messages were not recorded"
            causes["recorder.dropped"] = (Severity.WARNING, text, "a faster disk, or fewer topics")
        self._alarms.sync("recorder.", causes, self._now_ns())
        if self._recorder is not None:
            for event in self._recorder.take_events():
                self._note("recorder", event.text, _SEVERITIES[event.level])

    # Lists and topics out.

    def _keep(self, surveys: SurveyList) -> None:
        if surveys is self._surveys:
            return
        self._surveys = surveys
        self._save()
        self._publish_surveys()

    def _save(self) -> None:
        if self._store is None:
            return
        try:
            self._store.save(self._surveys)
            self._unsaved = ""
            self._alarms.clear("surveys.unsaved", self._now_ns())
        except StoreError as error:
            self._unsaved = str(error)
            self._raise("surveys.unsaved", Severity.CRITICAL, str(error), "free the disk; it is tried every second")

    def _publish_surveys(self) -> None:
        now = time.monotonic()
        surveys = self._surveys
        path = surveys.definitive(bit_depth=self._bit_depth())
        self._list.publish(messages.list_message(surveys))
        self._trajectory.publish(messages.trajectory_message(path, surveys.changed_ns))
        prefix = self.get_namespace().strip("/")
        frame = f"{prefix}/local_enu" if prefix else "local_enu"
        self._path.publish(messages.path_message(path, surveys.changed_ns, frame))
        self._rig_surveys = accepted_surveys(surveys)
        if self._rig is not None and self._rig.wants_trajectory:
            self._rig.publish_trajectory(witsml(survey_table(surveys, surveys.changed_ns)))
        self._live.on_records(surveys.records, now)
        self._live.on_trajectory(path, now)
        self._show_offset(path)
        now_ns = self._now_ns()
        self._work(lambda: table_of(surveys, path, now_ns).covariance, lambda job: self._show_ellipses(path, job))

    def _show_ellipses(self, path: Definitive, job: concurrent.futures.Future[Any]) -> None:
        covariance = job.result()
        if covariance is not None:
            measured = np.isfinite(covariance).all(axis=(1, 2))
            self._live.on_trajectory(path, time.monotonic(), covariance[measured])

    def _publish_toolface(self) -> None:
        reading = self._live.toolface_reading
        if reading is None:
            return
        message = msg.Toolface(
            mode=reading.mode,
            angle=reading.angle,
            sigma=reading.sigma,
            rotating=reading.rotating,
            rotary_speed=reading.rotary_speed,
        )
        message.header.stamp = stamp(reading.stamp_ns)
        message.header.frame_id = wire.SONDE_FRAME
        self._toolface.publish(message)

    def _note(self, source: str, text: str, severity: Severity = Severity.INFO) -> None:
        self._alarms.note(source, text, self._now_ns(), severity)
        self.get_logger().info(f"{source}: {text}")

    def _raise(self, alarm_id: str, severity: Severity, text: str, remedy: str) -> None:
        self._alarms.raise_alarm(alarm_id, severity, text, remedy, self._now_ns())
        self.get_logger().error(f"{text}; {remedy}" if remedy else text)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    # Services.

    def _accept_survey(self, request: Any, response: Any) -> Any:
        return self._judge(request, response, "accepted")

    def _reject_survey(self, request: Any, response: Any) -> Any:
        return self._judge(request, response, "rejected")

    def _judge(self, request: Any, response: Any, word: str) -> Any:
        used = {r.survey.uuid for r in self._surveys.records if r.in_use}
        try:
            if word == "accepted":
                surveys = self._surveys.accept(
                    request.sequence,
                    request.operator_name,
                    request.reason,
                    self._now_ns(),
                    measured_depth=request.measured_depth,
                    replace=request.replace,
                )
            else:
                surveys = self._surveys.reject(request.sequence, request.operator_name, request.reason, self._now_ns())
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        self._keep(surveys)
        for record in self._surveys.records:
            if record.in_use and record.survey.uuid not in used:
                self._accepted.publish(messages.record_message(record))
        text = f"survey {request.sequence} {word} by {request.operator_name}"
        self._note("survey", text + (f": {request.reason}" if request.reason else ""))
        response.success, response.message = True, text
        return response

    def _set_depth(self, request: Any, response: Any) -> Any:
        if not request.operator_name.strip():
            response.success, response.message = False, "operator_name: must not be empty: the log says who did it"
            return response
        try:
            self._depth.set_by_hand(self._now_ns(), request.bit_depth)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f"bit depth {request.bit_depth:.2f} m by {request.operator_name}"
        self._note("depth", response.message)
        return response

    def _with_recorder(self, response: Any, act: Callable[[Recorder], Path], word: str) -> Any:
        if self._recorder is None:
            response.success, response.message = False, "there is no recorder"
            return response
        try:
            path = act(self._recorder)
        except RecorderError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"{word} {path}"
        self._note("recorder", response.message)
        if hasattr(response, "path"):
            response.path = str(path)
        return response

    def _start_recording(self, request: Any, response: Any) -> Any:
        return self._with_recorder(response, lambda recorder: recorder.start(request.name), "recording into")

    def _stop_recording(self, _request: Any, response: Any) -> Any:
        return self._with_recorder(response, lambda recorder: recorder.stop(), "finished")

    def _split_recording(self, _request: Any, response: Any) -> Any:
        return self._with_recorder(response, lambda recorder: recorder.split(), "finished")

    def _export(self, request: Any, response: Any) -> Any:
        surveys, now_ns, folder, plan = self._surveys, self._now_ns(), self._folder / "exports", self._plan

        def write() -> Path:
            return export(survey_table(surveys, now_ns, plan=plan), request.format, folder, request.name)

        def written(job: concurrent.futures.Future[Path]) -> None:
            try:
                path = job.result()
            except (ValueError, ExportError) as error:
                response.success, response.message = False, str(error)
            else:
                response.success, response.message, response.path = True, f"written {path}", str(path)
                self._note("export", response.message)
            later.answer(response)

        later = Later()
        self._work(write, written)
        return later

    def _work(self, job: Callable[[], Any], done: Callable[[Any], None]) -> None:
        """Do slow work beside the node; `done` gets its future in the node's thread."""
        if self._worker is not None:
            self._jobs.append((self._worker.submit(job), done))

    def _finish_jobs(self) -> None:
        over = [entry for entry in self._jobs if entry[0].done()]
        self._jobs = [entry for entry in self._jobs if not entry[0].done()]
        for job, done in over:
            done(job)

    def _acknowledge_alarm(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._alarms.acknowledge(request.id, request.operator_name, self._now_ns())
        return response

    # Commands of the page: asked in the server's thread, answered in the node's.

    def _ask_node(self, name: str, arguments: dict[str, Any]) -> tuple[bool, str]:
        answer: concurrent.futures.Future[tuple[bool, str]] = concurrent.futures.Future()
        self._commands.put((name, arguments, answer))
        try:
            return answer.result(_COMMAND_TIMEOUT)
        except TimeoutError:
            return False, "the surface node did not answer; try again"

    def _answer_page(self) -> None:
        while not self._commands.empty():
            name, arguments, answer = self._commands.get()
            answer.set_result(self._carry_out(name, arguments))

    def _carry_out(self, name: str, arguments: dict[str, Any]) -> tuple[bool, str]:
        if name == "take_survey":
            if not self._survey_client.service_is_ready():
                return False, "the estimator is not there"
            self._survey_client.call_async(srv.TakeSurvey.Request(**arguments))
            return True, "asked for a survey; it appears in the table"
        kinds: dict[str, tuple[Any, Callable[[Any, Any], Any]]] = {
            "accept_survey": (srv.JudgeSurvey, self._accept_survey),
            "reject_survey": (srv.JudgeSurvey, self._reject_survey),
            "acknowledge_alarm": (srv.AcknowledgeAlarm, self._acknowledge_alarm),
            "start_recording": (srv.StartRecording, self._start_recording),
            "stop_recording": (Trigger, self._stop_recording),
            "split_recording": (Trigger, self._split_recording),
        }
        kind, act = kinds[name]
        request = kind.Request()
        if kind is srv.JudgeSurvey:
            request.measured_depth = -1.0
        for field, value in arguments.items():
            setattr(request, field, value)
        response = act(request, kind.Response())
        return response.success, response.message

    # Health.

    def findings(self) -> Sequence[Finding]:
        """Recorder, page, survey list, inputs."""
        found = []
        if self._recorder is not None:
            status = self._recorder.status()
            bad = status.state in (State.FAILED, State.PAUSED_DISK_FULL) or status.dropped > 0
            values = (("messages", str(status.messages)), ("dropped", str(status.dropped)))
            found.append(
                Finding(
                    "recorder",
                    ERROR if bad else OK,
                    status.reason or status.state.name.lower(),
                    "free the disk" if bad else "",
                    values,
                )
            )
        if self._page is not None:
            found.append(Finding("page", OK, f"{self._page.address}, {self._page.clients} watching"))
        elif self.settings.serve_page:
            found.append(Finding("page", ERROR, "not served", f"is port {self.settings.page.port} free?"))
        found += self._rig_findings()
        level = ERROR if self._unsaved else OK
        found.append(Finding("survey list", level, self._unsaved or f"{len(self._surveys.records)} surveys"))
        if self._not_found:
            text = f"not there yet: {', '.join(sorted(self._not_found))}"
            found.append(Finding("topics to record", WARN, text, "is the name right, and its publisher running?"))
        if self._unreadable:
            found.append(
                Finding("messages", WARN, f"{self._unreadable} could not be read", "are all nodes of one version?")
            )
        return found

    def _rig_findings(self) -> list[Finding]:
        found = []
        for one in self._rig.status() if self._rig is not None else ():
            values = [
                (
                    f"peer {peer.address}",
                    f"out {peer.sent}, {peer.rate:.2f}/s, in {peer.received}, lost {peer.dropped}",
                )
                for peer in one.peers
            ]
            counts = (
                ("sent", one.sent),
                ("received", one.received),
                ("dropped", one.dropped),
                ("refused", one.refused),
            )
            values += [(name, str(count)) for name, count in (*counts, *one.counts)]
            level = WARN if one.state in ("down", "stopped") else OK
            message = f"{one.state} {one.address}".strip()
            found.append(Finding(f"rig {one.name}", level, message, one.reason, (*values, *one.last)))
        return found


def _plan_from(path: Path, north: str) -> Plan:
    plan = read_plan(path)
    if plan.north and plan.north != north:
        raise PlanError(f"{path}: azimuths from {plan.north} north, those of the well from {north} north")
    return plan


def _remedy(status: Any) -> str:
    return next((pair.value for pair in status.values if pair.key == "remedy"), "")


def main(args: Sequence[str] | None = None) -> int:
    """Run the surface node."""
    return run_node(SurfaceNode, args)
