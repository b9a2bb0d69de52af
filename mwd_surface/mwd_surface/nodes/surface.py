"""The surface as a node: subscribes, and connects recorder, survey list, page and rig interfaces with each other."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import importlib
import operator
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mwd_msgs import srv
from mwd_msgs.action import NorthSeek, RotarySurvey
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import setting
from mwd_sensors.ros.lifecycle_node import WARN, Finding, GraphNode, run_node
from mwd_sensors.ros.message_buffer import Inbox
from mwd_sensors.ros.qos import STATE, deep
from mwd_surface import __version__
from mwd_surface.bags.recorder.recorder import RecorderError
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.settings import LiveSettings
from mwd_surface.nodes.diagnostics_monitor import HealthDesk
from mwd_surface.nodes.foxglove_bridge import FoxgloveDoor
from mwd_surface.nodes.page_bridge import PageDoor, Services, called
from mwd_surface.nodes.plan_server import AdvisorySettings, PlanDesk, PlanSettings
from mwd_surface.nodes.recording_server import RecordingDesk, RecordSettings
from mwd_surface.nodes.rig_bridge import RigDoor
from mwd_surface.nodes.slide_recorder import SteeringDesk
from mwd_surface.nodes.stream_decoder import LiveFeed
from mwd_surface.nodes.survey_list_server import SurveyDesk
from mwd_surface.page.foxglove_server import FoxgloveError, FoxgloveSettings
from mwd_surface.page.page_server import PageSettings
from mwd_surface.rig.interface import InterfaceError
from mwd_surface.rig.port import RigSettings
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.ros.parameter_tables import ParameterTables
from mwd_surface.ros.topics import TOPICS, profile_yaml, type_name
from mwd_surface.ros.worker import Answer, Beside, Requests
from mwd_surface.surveys.depth import DepthRules
from mwd_surface.surveys.leg_settings import LegSettings
from mwd_surface.surveys.slide_sheet import SlideRules
from mwd_surface.surveys.survey_list import ListRules, SurveyList
from mwd_surface.surveys.survey_store import StoreError
from mwd_surface.surveys.well import Well

_LIVE_PERIOD = 0.05  # s; how often what arrived is brought to the page and the toolface topic
_RECEIVED = operator.itemgetter(0)


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
    leg: LegSettings = setting(LegSettings, "Tie-on, leg and tool")
    depth: DepthRules = setting(DepthRules, "Pairing surveys with depth")
    slides: SlideRules = setting(SlideRules, "The slide sheet")
    record: RecordSettings = setting(RecordSettings, "What is recorded")
    recorder: RecorderSettings = setting(RecorderSettings, "How it is recorded")
    page: PageSettings = setting(PageSettings, "The live page")
    live: LiveSettings = setting(LiveSettings, "What the page shows")
    foxglove: FoxgloveSettings = setting(FoxgloveSettings, "Live server for Foxglove")
    rig: RigSettings = setting(RigSettings, "Rig interfaces")


class SurfaceNode(GraphNode[SurfaceSettings]):
    """Everything between the sonde's topics and the people and machines on the rig; the work is the desks'."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("surface", SurfaceSettings(), **node_options)
        self._is_open = False
        self._closings: list[Callable[[], Any]] = []

    def takes_live(self, name: str) -> bool:
        """Well, leg, plan, advice and rules of the list can change while running; folders and ports cannot."""
        return name.startswith(("well.", "rules.", "leg.", "plan.", "advisory."))

    def settings_changed(self, settings: SurfaceSettings) -> None:
        """Bring the survey list under the new well and rules, the page under the new plan and advice."""
        if not self._is_open:
            return
        self._plan.read(settings.plan, settings.well.north_reference)
        self._plan.show_advice(settings.advisory)
        self._surveys.configured(self._plan.along_plan(settings.well), settings.rules, settings.leg)
        self._show_well()

    def _show_well(self) -> None:
        self._health.show_well(self._surveys.surveys.well)
        self._plan.show_plan()
        self._plan.show_offset(self._surveys.definitive())

    # Opening and closing.

    def open(self) -> None:
        """Take the folder, load the survey list, open topics, services and the page."""
        try:
            self._open_desks()
        except (RecorderError, StoreError, InterfaceError, FoxgloveError, OSError, ValueError) as error:
            self.close()
            raise RuntimeError(str(error)) from error
        self._open_topics()
        self._is_open = True

    def _open_desks(self) -> None:
        settings = self.settings
        namespace = self.get_namespace().strip("/").replace("/", "_")
        folder = Path(settings.folder).expanduser() / (namespace or "well")
        live = self._live = LiveState(settings.live)
        journal = self._journal = Journal(self, live)
        self._beside = self._closed_at_end(Beside())
        self._requests = Requests(self._carry_out)
        self._health = HealthDesk(self.get_fully_qualified_name(), self.get_namespace(), live, journal)
        self._plan = PlanDesk(live, journal)
        self._plan.read(settings.plan, settings.well.north_reference)
        well = self._plan.along_plan(settings.well)
        self._steering = SteeringDesk(folder / "surveys", settings.slides, live, journal)
        self._closed_at_end(self._steering)
        self._surveys = self._closed_at_end(
            SurveyDesk(
                self, folder, well, settings.rules, settings.leg, settings.depth,
                live=live, journal=journal, plan=self._plan, beside=self._beside,
                changed=self._surveys_changed, stretches=self._steering.stretches,
            )
        )  # fmt: skip
        self._tables_of = ParameterTables(self, ("sonde", "estimator"))
        self._recording = self._closed_at_end(
            RecordingDesk(
                self, folder / "bags", settings.record, settings.recorder,
                live=live, journal=journal, tables=self._tables, enclosed=self._surveys.enclosures,
            )
        )  # fmt: skip
        self._page = self._closed_at_end(
            PageDoor(
                self, settings.page, serve=settings.serve_page, strict=settings.strict,
                live=live, journal=journal, ask=self._requests.ask,
            )
        )  # fmt: skip
        self._page.open()
        self._foxglove = self._closed_at_end(FoxgloveDoor(self, settings.foxglove, journal))
        self._foxglove.open()
        self._rig = self._closed_at_end(
            RigDoor(self, settings.rig, well.name, folder, live=live, journal=journal, ask=self._requests.ask)
        )
        self._feed = LiveFeed(self, live, on_attitude=self._on_attitude, on_rig_state=self._on_rig_state)

    def _closed_at_end(self, part: Any) -> Any:
        self._closings.append(part.close)
        return part

    def _tables(self) -> Mapping[str, Mapping[str, str]]:
        versions = {
            "version": __version__,
            "node": self.get_fully_qualified_name(),
            "python": platform.python_version(),
        }
        return {"mwd": versions, **self._tables_of.tables()}

    def _open_topics(self) -> None:
        for part in (self._journal, self._surveys, self._recording, self._tables_of, self._rig, self._feed):
            part.open()
        self._streams: list[tuple[str, Inbox, Callable[[bytes, int], None]]] = []
        self._handlers: dict[str, Callable[[bytes], None]] = {
            "survey": self._on_survey,
            "/diagnostics": self._health.on_diagnostics,
            "rig/quill": self._steering.on_quill,
        }
        wanted = {self.resolve_topic_name(name): name for name in self.settings.record.topics}
        for name, (kind, profile) in TOPICS.items():
            recorded = wanted.pop(self.resolve_topic_name(name), None) is not None
            if recorded or self._foxglove.put is not None or name in self._feed.buffers or name in self._handlers:
                self._subscribe(name, kind, profile, recorded=recorded)
        # What an action tells its caller on the way is a topic like others, for who knows its name.
        for action, kind, act in (
            ("north_seek", NorthSeek, self._health.on_north_seek),
            ("rotary_survey", RotarySurvey, self._health.on_rotary_survey),
        ):
            self.listen(kind.Impl.FeedbackMessage, f"{action}/_action/feedback", act, STATE)
        self._not_found = set(wanted)
        self._survey_client = self.reach(srv.TakeSurvey, "take_survey")
        self._buttons: Services = {
            "accept_survey": (srv.JudgeSurvey, self._surveys.accept),
            "reject_survey": (srv.JudgeSurvey, self._surveys.reject),
            "acknowledge_alarm": (srv.AcknowledgeAlarm, self._journal.acknowledge),
            "start_recording": (srv.StartRecording, self._recording.start),
            "stop_recording": (Trigger, self._recording.stop),
            "split_recording": (Trigger, self._recording.split),
            "snapshot_recording": (Trigger, self._recording.snapshot),
            "export": (srv.Export, self._surveys.export),
            "set_depth": (srv.SetDepth, self._surveys.set_depth),
        }
        self.every(_LIVE_PERIOD, self._bring_live)
        self.every(1.0, self._each_second)

    def start(self) -> None:
        """Begin to record; publish what is known."""
        self._recording.begin()
        self._plan.show_advice(self.settings.advisory)
        self._show_well()
        self._surveys.publish()

    def halt(self) -> None:
        """Finish the recording; tell the rig that nothing here may be acted upon."""
        self._take_streams()
        self._rig.tell(time.monotonic(), active=False)
        self._recording.halt()

    def close(self) -> None:
        """Give folder and ports free, in the order in which they were taken."""
        self._is_open = False
        closings, self._closings = self._closings, []
        for close in closings:
            close()

    # Messages in.

    def _surveys_changed(self, surveys: SurveyList) -> None:
        self._rig.on_surveys(surveys)
        self._steering.on_surveys(surveys)

    def _on_attitude(self, samples: Samples) -> None:
        self._steering.on_attitude(samples)

    def _on_rig_state(self, samples: Samples) -> None:
        believed = self._surveys.on_rig_state(samples)
        self._steering.on_rig_state(samples, believed)

    def _subscribe(self, name: str, kind: Any, profile: QoSProfile, *, recorded: bool) -> None:
        full, typed, offered = self.resolve_topic_name(name), type_name(kind), profile_yaml(profile)
        take = self._feed.buffers[name].append if name in self._feed.buffers else self._handlers.get(name)
        put = self._recording.put if recorded else None
        self._foxglove.advertise(full, typed)
        show, heard = self._foxglove.put, self._health.heard
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL

        def arrived(data: bytes, received_ns: int) -> None:
            if put is not None:
                put(full, typed, data, received_ns, qos=offered)
            if show is not None:
                show(full, typed, data, received_ns, latched=latched)
            if take is not None:
                take(data)

        def event(data: bytes) -> None:
            # What was received before it is recorded before it.
            self._take_streams()
            heard(name)
            arrived(data, time.time_ns())

        if profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            # Hundreds a second, shown twenty times a second: they wait, instead of waking this node one by one.
            self._streams.append((name, self.collect(kind, name, deep(profile)), arrived))
        else:
            self.listen(kind, name, event, deep(profile), raw=True)

    def _take_streams(self) -> None:
        """Record and show what waits, in the order in which it was received."""
        taken = []
        for name, inbox, arrived in self._streams:
            waiting = inbox.take()
            if waiting:
                self._health.heard(name)
                taken += [(received_ns, arrived, data) for data, received_ns in waiting]
        taken.sort(key=_RECEIVED)
        for received_ns, arrived, data in taken:
            arrived(data, received_ns)

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
                    text = f"{full} cannot be recorded: {types[0]} is not installed"
                    self._journal.note("recorder", text, Severity.WARNING)
                    self._not_found.discard(full)
                    continue
                publishers = self.get_publishers_info_by_topic(full)
                profile = publishers[0].qos_profile if publishers else STATE
                # Discovery does not carry the history of a profile.
                offered = QoSProfile(depth=100, reliability=profile.reliability, durability=profile.durability)
                self._subscribe(full, kind, offered, recorded=True)
                self._not_found.discard(full)

    def _on_survey(self, data: bytes) -> None:
        # The depths that came before it count for it.
        self._feed.bring_one("rig/state", time.monotonic())
        self._health.survey_ended(self._surveys.on_survey(data))

    # Again and again.

    def _bring_live(self) -> None:
        self._requests.answer()
        self._beside.finish()
        self._take_streams()
        now = time.monotonic()
        self._rig.pass_on(now)
        self._feed.bring(now)
        self._page.show(now)

    def _each_second(self) -> None:
        now = time.monotonic()
        self._find_missing()
        self._page.open()
        self._foxglove.open()
        self._tables_of.ask()
        self._recording.keep(self._tables_of.take_fresh())
        self._recording.tell(now)
        self._health.tell(now)
        self._surveys.save_again()
        self._surveys.follow_bit(now)
        self._steering.tell(now)
        self._journal.tell(now)
        self._page.show(now, even_unwatched=True)

    def _carry_out(self, name: str, arguments: dict[str, Any]) -> Answer | concurrent.futures.Future[Answer]:
        """A request of the page or the rig, in this node's thread."""
        if name != "take_survey":
            return called(self._buttons, name, arguments)
        if not self._survey_client.service_is_ready():
            return False, "the estimator is not there"
        self._survey_client.call_async(srv.TakeSurvey.Request(**arguments))
        return True, "asked for a survey; it appears in the table"

    def findings(self) -> Sequence[Finding]:
        """Recorder, page, rig interfaces, survey list, inputs."""
        found: list[Finding] = []
        for part in (self._recording, self._page, self._foxglove, self._rig, self._surveys, self._feed):
            found += part.findings()
        if self._not_found:
            text = f"not there yet: {', '.join(sorted(self._not_found))}"
            found.append(Finding("topics to record", WARN, text, "is the name right, and its publisher running?"))
        return found


def main(args: Sequence[str] | None = None) -> int:
    """Run the surface node."""
    return run_node(SurfaceNode, args)
