# SPDX-License-Identifier: Apache-2.0
"""Recordings of a well: services to start, stop, split and snapshot, and the recorder's status on a topic."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from mwd_msgs import msg, srv
from std_srvs.srv import Trigger

from mwd_sensors.core import burst, wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros.diagnostics import ERROR, OK, Diagnostic
from mwd_sensors.ros.qos import STATE
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.bags.recorder.recorder import Recorder
from mwd_surface.bags.recorder.status import EventLevel, RecorderError, RecorderState, RecorderStatus
from mwd_surface.live.alarms import Causes, Severity
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.ros import messages
from mwd_surface.ros.context import SurfaceContext

_STOP_TIMEOUT_S = 1.3  # longest duration of a step of stopping a recording, s; all steps together take less than 3 s
_ATTACH_TIMEOUT_S = 0.4  # longest duration of adding one table or file to a recording, s
_RETRY_S = 5.0  # time between two attempts to start a recording, s
_RESUMES = "free space on the disk, or make its folder writable; recording resumes by itself"
_FASTER = "use a faster disk, or record fewer topics"
_SEVERITIES = {
    EventLevel.INFO: Severity.INFO,
    EventLevel.WARNING: Severity.WARNING,
    EventLevel.ERROR: Severity.CRITICAL,
}

# Topics of samples that the estimator uses.
SAMPLES = ("imu/data_raw", "imu/mag", "gyro/data_raw", "imu/temperature")

Attachment = tuple[str, str, bytes]  #: name, media type and content of a file in a recording


class RecordingServer:
    """
    ROS interface for the recordings of one well.

    Parameters
    ----------
    settings : SurfaceSettings
        Settings of the surface, of which only the sections `record` and `recorder` are used.
    tables : callable
        Function that returns named tables of strings, which become metadata of every file.
    attachments : callable
        Function that returns the files that are attached to a recording when it ends.
    on_start : callable
        Function that is called when a recording has begun, before its first message.

    Raises
    ------
    RecorderError
        The folder cannot be written, or another recorder uses it.
    """

    def __init__(
        self,
        context: SurfaceContext,
        settings: SurfaceSettings,
        *,
        tables: Callable[[], Mapping[str, Mapping[str, str]]],
        attachments: Callable[[], Iterable[Attachment]],
        on_start: Callable[[], None],
    ) -> None:
        self._context, self._node, self._settings = context, context.node, settings.record
        self._live, self._alarm_log = context.live, context.alarm_log
        self._attachments, self._on_start = attachments, on_start
        self._wanted = False
        self._tried_at = -_RETRY_S
        # Reason why an enabled recording has not started, and the remedy.
        self._refusal = ("", "")
        self._recorder = Recorder(
            context.folder / "bags",
            settings.recorder,
            tables=tables,
            event_topic=self._node.resolve_topic_name("recorder/events"),
        )
        # Stamp of the first recorded sample, ns, or 0 before it, by the topic for single samples. This topic is the key
        # also for samples that are recorded from a topic with bursts.
        self._first_ns: dict[str, int] = {}
        # Recorded topics of samples without a message so far: relative name, and full name of the topic for single
        # samples.
        self._unheard: dict[str, tuple[str, str]] = {}
        self._heard = False

    def put(self, topic: str, type_name: str, data: bytes, log_ns: int, qos: str = "") -> bool:
        """Record a message; return whether it was accepted. Arguments and result are those of `Recorder.put`."""
        taken = self._recorder.put(topic, type_name, data, log_ns, qos=qos)
        if taken and topic in self._unheard:
            name, single = self._unheard.pop(topic)
            first_ns = _first_stamp(name, data)
            if not self._first_ns[single] and first_ns is not None:
                self._first_ns[single], self._heard = first_ns, True
        return taken

    def tell_streams(self) -> None:
        """Publish the status if a topic of samples has begun to arrive, because the estimator waits for this status."""
        if self._heard:
            self._heard = False
            self._publish_status(self._recorder.status())

    def _publish_status(self, status: RecorderStatus) -> None:
        streams = self._first_ns if status.state == RecorderState.RECORDING else {}
        self._status.publish(messages.recorder_message(status, stamp(self._alarm_log.now_ns()), streams))
        self._live.on_recorder(status, self._context.well_now)

    def open(self) -> None:
        """Create the publisher of the recorder's status, and the services to start, stop, split and snapshot."""
        self._status = self._node.add_publisher(msg.RecorderStatus, "recorder", STATE)
        self._node.add_service(srv.StartRecording, "start_recording", self.start)
        self._node.add_service(Trigger, "stop_recording", self.stop)
        self._node.add_service(Trigger, "split_recording", self.split)
        self._node.add_service(Trigger, "snapshot_recording", self.snapshot)

    def activate(self) -> None:
        """Start to record if recording is enabled."""
        self._wanted = self._settings.enabled
        self._tried_at = -_RETRY_S
        self._start_wanted()

    def _start_wanted(self) -> None:
        """Start a recording if it is enabled and not started; after a failure raise an alarm and try again later."""
        if not self._wanted or time.monotonic() - self._tried_at < _RETRY_S:
            return
        self._tried_at = time.monotonic()
        try:
            self._start(self._settings.name)
        except RecorderError as error:
            self._refusal = str(error), f"{error.remedy}; the start is retried every {_RETRY_S:g} s"
            self._alarm_log.raise_alarm("recording.start", Severity.CRITICAL, *self._refusal)
            return
        self._wanted, self._refusal = False, ("", "")
        self._alarm_log.clear_alarm("recording.start")

    def _start(self, name: str) -> Path:
        """
        Begin a recording, and note its topics of samples for `tell_streams`; return the path of the recording.

        Raises RecorderError if the recording cannot be started.
        """
        path = self._recorder.start(name)
        over_link = self._live.parts.over_link
        resolve = self._node.resolve_topic_name
        recorded = {resolve(topic) for topic in self._settings.topics}
        every = {**{name: name for name in SAMPLES}, **burst.TOPICS}
        self._unheard = {
            resolve(topic): (topic, resolve(single))
            for topic, single in every.items()
            if resolve(topic) in recorded and not over_link
        }
        self._first_ns = {single: 0 for _, single in self._unheard.values()}
        self._on_start()
        return path

    def deactivate(self) -> None:
        """If a recording runs, attach the files to it and finish it; a failure is only logged."""
        self._wanted = False
        if self._recorder.status().state == RecorderState.STOPPED:
            return
        self._attach_files()
        try:
            self._recorder.stop(_STOP_TIMEOUT_S)
        except RecorderError as error:
            self._node.get_logger().error(printable(f"recording not finished: {error}"))

    def _attach_files(self) -> str:
        """
        Attach the files from `attachments` to the recording before the recording ends.

        Return the reason if a file could not be attached; the files after it are then not attached either.
        """
        for name, media_type, data in self._attachments():
            try:
                self._recorder.attach(name, media_type, data, time.time_ns(), _ATTACH_TIMEOUT_S)
            except RecorderError as error:
                text = f"{name} is not in the recording: {error}"
                self._node.get_logger().error(printable(text))
                return text
        return ""

    def add_tables(self, tables: Mapping[str, Mapping[str, str]]) -> None:
        """Add named tables to the metadata of the running recording; later recordings get them at their start."""
        if self._recorder.status().state != RecorderState.RECORDING:
            return
        for name, values in tables.items():
            try:
                self._recorder.add_metadata(name, values, _ATTACH_TIMEOUT_S)
            except RecorderError as error:
                self._alarm_log.log_event("recorder", f"{name} is not in the recording: {error}", Severity.WARNING)

    def close(self) -> None:
        """Close the recorder, which releases the folder of the recordings."""
        self._recorder.close(_STOP_TIMEOUT_S)

    # Services.

    def start(self, request: Any, response: Any) -> Any:
        """Start a recording; return the response, with the path or the reason of the failure (service)."""
        return self._respond(response, lambda: self._start(request.name), "recording into")

    def stop(self, _request: Any, response: Any) -> Any:
        """Stop the recording; return the response, which also says what the recording lacks (service)."""
        missing = "" if self._recorder.status().state == RecorderState.STOPPED else self._attach_files()

        def lacks() -> list[str]:
            ended = self._recorder.last
            if ended is None:
                return [missing]
            lost = f"{ended.dropped} messages were not recorded" if ended.dropped else ""
            paused = f"the recording ended in a pause: {ended.reason}" if ended.reason else ""
            return [missing, lost, paused]

        return self._respond(response, self._recorder.stop, "finished", lacks)

    def split(self, _request: Any, response: Any) -> Any:
        """Continue the recording in a new file; return the response (service)."""

        def lacks() -> list[str]:
            reason = self._recorder.status().reason
            return [f"the recording is paused: {reason}" if reason else ""]

        return self._respond(response, self._recorder.split, "finished", lacks)

    def snapshot(self, _request: Any, response: Any) -> Any:
        """
        Write the last seconds of messages, which are kept in memory, to a separate recording (service).

        Return the response, with the path in its message or the reason of the failure.
        """
        return self._respond(response, self._recorder.snapshot, "written")

    def _respond(
        self, response: Any, action: Callable[[], Path], word: str, lacks: Callable[[], Iterable[str]] = tuple
    ) -> Any:
        """Carry out an action and return the response; lacks: returns what is missing after the action, in words."""
        try:
            path = action()
        except RecorderError as error:
            response.success, response.message = False, str(error)
            return response
        missing = [text for text in lacks() if text]
        response.success, response.message = True, "; ".join([f"{word} {path}", *missing])
        self._alarm_log.log_event("recorder", response.message, Severity.WARNING if missing else Severity.INFO)
        if hasattr(response, "path"):
            response.path = str(path)
        return response

    # Update once a second.

    def update(self) -> None:
        """Publish the recorder's status, raise its alarms, and retry a start that failed."""
        self._start_wanted()
        status = self._recorder.status()
        self._publish_status(status)
        causes: Causes = {}
        if status.state in (RecorderState.PAUSED_DISK_FULL, RecorderState.FAILED):
            causes["recorder.state"] = (Severity.CRITICAL, f"recording paused: {status.reason}", _RESUMES)
        if status.dropped:
            text = f"{status.dropped} messages were not recorded"
            causes["recorder.dropped"] = (Severity.WARNING, text, _FASTER)
        self._alarm_log.set_alarms("recorder.", causes)
        for event in self._recorder.drain_events():
            self._alarm_log.log_event("recorder", event.text, _SEVERITIES[event.level])

    def status(self) -> RecorderStatus:
        """Return the status of the recorder."""
        return self._recorder.status()

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic with the state of the recorder; an error has a remedy."""
        status = self._recorder.status()
        values = (("messages", str(status.messages)), ("dropped", str(status.dropped)))
        text, remedy = status.state.name.lower(), ""
        if self._wanted and self._refusal[0]:
            text, remedy = f"not recording: {self._refusal[0]}", self._refusal[1]
        elif status.state in (RecorderState.FAILED, RecorderState.PAUSED_DISK_FULL):
            text, remedy = f"paused: {status.reason}", _RESUMES
        elif status.dropped:
            text, remedy = f"{status.dropped} messages were not recorded", _FASTER
        return [Diagnostic("recorder", ERROR if remedy else OK, text, remedy, values)]


def _first_stamp(topic: str, data: bytes) -> int | None:
    """
    Return the stamp of the first sample of a message, ns.

    topic: relative name. Return None if the message cannot be read or has no samples.
    """
    try:
        if topic in burst.TOPICS:
            samples = burst.decode(data)
        else:
            samples, _ = wire.decode_messages(wire.SONDE_TOPICS[topic], [data])
    except wire.WireError:
        return None
    return int(samples["stamp_ns"][0]) if len(samples) else None
