"""The recorder on the graph: what is recorded, when it begins and ends, and what it says of itself."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from mwd_msgs import msg, srv
from std_srvs.srv import Trigger

from mwd_sensors.core.settings import setting
from mwd_sensors.ros.lifecycle_node import ERROR, OK, Finding, GraphNode
from mwd_sensors.ros.qos import STATE
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.bags.recorder.recorder import Recorder, RecorderError
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.status import Level, RecorderState
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.ros import messages
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.ros.topics import TOPICS

_STOP_WITHIN = 1.3  # s for each step of an end, so that all of it stays below 3 s
_ENCLOSE_WITHIN = 0.4  # s for each table or file that goes into a recording beside its messages
_RETRY = 5.0  # s between tries to begin a recording that could not begin
_SEVERITIES = {Level.INFO: Severity.INFO, Level.WARNING: Severity.WARNING, Level.ERROR: Severity.CRITICAL}

Enclosure = tuple[str, str, bytes]


@dataclasses.dataclass(frozen=True)
class RecordSettings:
    """What is recorded."""

    enabled: bool = setting(True, "Record from activation on", fixed=True)
    name: str = setting("", "Folder name of the recording; empty: made from the time", fixed=True)
    topics: list[str] = setting(
        list(TOPICS), "Topics to record, relative to the well or absolute; unknown ones are recorded once they appear",
        fixed=True,
    )  # fmt: skip


class RecordingDesk:
    """
    The recordings of one well.

    tables : callable
        Returns named tables of strings that go into every file as metadata.
    enclosed : callable
        Returns files, each a name, media type and bytes, that go into a recording when it ends.

    Raises
    ------
    RecorderError
        The folder cannot be written, or another recorder uses it.
    """

    def __init__(
        self,
        node: GraphNode[Any],
        folder: Path,
        asked: RecordSettings,
        settings: RecorderSettings,
        *,
        live: LiveState,
        journal: Journal,
        tables: Callable[[], Mapping[str, Mapping[str, str]]],
        enclosed: Callable[[], Iterable[Enclosure]],
    ) -> None:
        self._node, self._asked, self._live, self._journal = node, asked, live, journal
        self._enclosed = enclosed
        self._wanted = False
        self._tried = -_RETRY
        self._recorder = Recorder(
            folder, settings, tables=tables, event_topic=node.resolve_topic_name("recorder/events")
        )
        self.put = self._recorder.put

    def open(self) -> None:
        """Open topic and services."""
        self._status = self._node.publish_on(msg.RecorderStatus, "recorder", STATE)
        self._node.serve(srv.StartRecording, "start_recording", self.start)
        self._node.serve(Trigger, "stop_recording", self.stop)
        self._node.serve(Trigger, "split_recording", self.split)
        self._node.serve(Trigger, "snapshot_recording", self.snapshot)

    def begin(self) -> None:
        """Record from now on, if that is wanted."""
        self._wanted = self._asked.enabled
        self._tried = -_RETRY
        self._begin()

    def _begin(self) -> None:
        """Begin the recording that is wanted; where it cannot begin, say so and try again later."""
        if not self._wanted or time.monotonic() - self._tried < _RETRY:
            return
        self._tried = time.monotonic()
        try:
            self._recorder.start(self._asked.name)
        except RecorderError as error:
            self._journal.alarm(
                "recording.start", Severity.CRITICAL, str(error), "free the disk; it is tried every 5 s"
            )
            return
        self._wanted = False
        self._journal.clear("recording.start")

    def halt(self) -> None:
        """Finish the recording."""
        self._wanted = False
        if self._recorder.status().state == RecorderState.STOPPED:
            return
        self._enclose()
        try:
            self._recorder.stop(_STOP_WITHIN)
        except RecorderError as error:
            self._node.get_logger().error(f"recording not finished: {error}")

    def _enclose(self) -> None:
        """Put the surveys as they are now into the recording that ends."""
        for name, media_type, data in self._enclosed():
            try:
                self._recorder.attach(name, media_type, data, time.time_ns(), _ENCLOSE_WITHIN)
            except RecorderError as error:
                self._node.get_logger().error(f"{name} is not in the recording: {error}")
                return

    def keep(self, tables: Mapping[str, Mapping[str, str]]) -> None:
        """Put tables into the recording at hand; one that begins later has them from the start."""
        if self._recorder.status().state != RecorderState.RECORDING:
            return
        for name, values in tables.items():
            try:
                self._recorder.add_metadata(name, values, _ENCLOSE_WITHIN)
            except RecorderError as error:
                self._journal.note("recorder", f"{name} is not in the recording: {error}", Severity.WARNING)

    def close(self) -> None:
        """Give the folder free."""
        self._recorder.close(_STOP_WITHIN)

    # Services.

    def start(self, request: Any, response: Any) -> Any:
        """Begin a recording."""
        return self._done(response, lambda: self._recorder.start(request.name), "recording into")

    def stop(self, _request: Any, response: Any) -> Any:
        """End the recording."""
        if self._recorder.status().state == RecorderState.RECORDING:
            self._enclose()
        return self._done(response, self._recorder.stop, "finished")

    def split(self, _request: Any, response: Any) -> Any:
        """Go on in a new file."""
        return self._done(response, self._recorder.split, "finished")

    def snapshot(self, _request: Any, response: Any) -> Any:
        """Write the last seconds kept in memory into a recording of their own."""
        return self._done(response, self._recorder.snapshot, "written")

    def _done(self, response: Any, act: Callable[[], Path], word: str) -> Any:
        try:
            path = act()
        except RecorderError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"{word} {path}"
        self._journal.note("recorder", response.message)
        if hasattr(response, "path"):
            response.path = str(path)
        return response

    # Once a second.

    def tell(self, now: float) -> None:
        """Publish and watch the recorder's state; begin what could not begin."""
        self._begin()
        status = self._recorder.status()
        self._status.publish(messages.recorder_message(status, stamp(self._journal.now_ns())))
        self._live.on_recorder(status, now)
        causes: dict[str, tuple[int, str, str]] = {}
        if status.state in (RecorderState.PAUSED_DISK_FULL, RecorderState.FAILED):
            causes["recorder.state"] = (Severity.CRITICAL, status.reason, "free the disk; recording resumes by itself")
        if status.dropped:
            text = f"{status.dropped} messages were not recorded"
            causes["recorder.dropped"] = (Severity.WARNING, text, "a faster disk, or fewer topics")
        self._journal.sync("recorder.", causes)
        for event in self._recorder.take_events():
            self._journal.note("recorder", event.text, _SEVERITIES[event.level])

    def findings(self) -> list[Finding]:
        """How the recorder is."""
        status = self._recorder.status()
        bad = status.state in (RecorderState.FAILED, RecorderState.PAUSED_DISK_FULL) or status.dropped > 0
        text = status.reason or status.state.name.lower()
        values = (("messages", str(status.messages)), ("dropped", str(status.dropped)))
        return [Finding("recorder", ERROR if bad else OK, text, "free the disk" if bad else "", values)]
