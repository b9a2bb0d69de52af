# SPDX-License-Identifier: Apache-2.0
"""Publishing, saving and logging of a well's results by the surface node."""

from __future__ import annotations

import concurrent.futures
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mwd_msgs import msg

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import make
from mwd_sensors.ros.qos import DEADLINE_STATE, EVENT, LATCHED
from mwd_sensors.ros.time_stamps import header
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.toolface import ToolfaceReading
from mwd_surface.live.well_context import WellOutlet
from mwd_surface.nodes.survey_list_server import SurveyListServer
from mwd_surface.ros.context import BackgroundWorker
from mwd_surface.ros.topics import TOPICS
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.trajectory.advice import Advice
from mwd_surface.trajectory.slide_sheet import DrilledStretch, append_stretch
from mwd_surface.trajectory.well_path import Definitive


class NodeOutlet(WellOutlet):
    """Outlet that publishes, saves and logs the results of a well."""

    alarm_log: AlarmLog  #: alarm log of the same well; set by the code that creates both
    #: Survey list of the node, which publishes the list and the accepted surveys.
    surveys: SurveyListServer | None = None

    def __init__(self, node: GraphNode[Any], worker: BackgroundWorker, slide_file: Path) -> None:
        self._node, self._worker, self._slide_file = node, worker, slide_file
        #: Functions that are called with the survey list after each change.
        self.listeners: list[Callable[[SurveyList], None]] = []
        #: Functions that are called with arriving rig data, if their source is the one in force.
        self.rig_listeners: list[Callable[[Samples], None]] = []
        self.recorder: Callable[[], RecorderStatus] | None = None  #: function that returns the status of the recorder
        self._simulated = False
        self._told = 0

    def open(self) -> None:
        """Create the publishers of toolface, inputs, steering advice, events and alarms."""
        node = self._node
        self._toolface = node.add_publisher(msg.Toolface, "toolface", DEADLINE_STATE)
        self._inputs = node.add_publisher(msg.InputList, "inputs", TOPICS["inputs"][1])
        self._advice = node.add_publisher(msg.SteeringAdvice, "steering/advice", TOPICS["steering/advice"][1])
        self._events = node.add_publisher(msg.Event, "events", EVENT)
        self._alarms = node.add_publisher(msg.AlarmList, "alarms", LATCHED)

    def tell(self, text: str, severity: Severity) -> None:
        """Write an event or an alarm into the log of the process."""
        logger = self._node.get_logger()
        # rclpy allows only one severity for each line of code.
        if severity == Severity.CRITICAL:
            logger.error(text)
        elif severity == Severity.WARNING:
            logger.warning(text)
        else:
            logger.info(text)

    def warn(self, text: str) -> None:
        """Write a warning into the log of the process, at most once in ten seconds."""
        self._node.get_logger().warning(printable(text), throttle_duration_sec=10.0)

    def on_toolface(self, reading: ToolfaceReading, age: float, frame: str) -> None:
        """Publish the toolface."""
        message = reading.to_message(make)
        message.age, message.header.frame_id = age, frame
        self._toolface.publish(message)

    def on_inputs(self, table: InputTable) -> None:
        """Publish the table of inputs."""
        message = table.to_message(make)
        message.header = header(self.alarm_log.now_ns(), self._node.frame(wire.RIG_FRAME))
        self._inputs.publish(message)

    def on_advice(self, advice: Advice) -> None:
        """Publish the steering advice."""
        message = advice.to_message(make)
        now_ns = int(self._node.get_clock().now().nanoseconds)
        message.header = header(advice.stamp_ns or now_ns, self._node.frame(wire.SONDE_FRAME))
        self._advice.publish(message)

    def on_alarms(self, log: AlarmLog, missing: tuple[str, ...], stamp_ns: int) -> None:
        """Publish the events since the last call, then all alarms."""
        for event in log.events_after(self._told):
            self._events.publish(event.to_message(make))
        self._told = log.logged
        alarms = [alarm.to_message(make) for alarm in log.alarms()]
        self._alarms.publish(msg.AlarmList(header=header(stamp_ns), alarms=alarms, not_evaluated=list(missing)))

    def on_stretch(self, stretch: DrilledStretch) -> None:
        """Save a stretch of the slide sheet; raise an alarm if it cannot be saved."""
        try:
            append_stretch(self._slide_file, stretch)
        except OSError as error:
            self.alarm_log.raise_alarm("slides.unsaved", Severity.WARNING, f"slide sheet not saved: {error}")
        else:
            self.alarm_log.clear_alarm("slides.unsaved")

    def on_accepted(self, record: SurveyRecord) -> None:
        """Publish a survey that has been accepted into the path."""
        if self.surveys is not None:
            self.surveys.publish_accepted(record)

    def on_surveys(self, surveys: SurveyList, path: Definitive) -> None:
        """Publish the changed list and its path."""
        if self.surveys is not None:
            self.surveys.publish(surveys, path)
        for listener in self.listeners:
            listener(surveys)

    def on_rig_state(self, samples: Samples) -> None:
        """Pass rig data to the listeners."""
        for listener in self.rig_listeners:
            listener(samples)

    def simulator_seen(self) -> bool:
        """Return whether a simulator was seen since the node was configured; only a simulator publishes the truth."""
        self._simulated = self._simulated or self._node.count_publishers("truth") > 0
        return self._simulated

    def is_simulated(self) -> bool:
        """Return whether the data comes from a simulator or a replay."""
        return self.simulator_seen() or bool(self._node.get_parameter("use_sim_time").value)

    def readings(self) -> dict[str, float]:
        """
        Return readings for `supervision.TABLE`, by their alarm ids.

        The readings are the fill of the recorder's queue, %, and the inverse of the free space on the disk, 1/GB.
        """
        if self.recorder is None:
            return {}
        status = self.recorder()
        return {"queue.recorder": 100.0 * status.queued_bytes / status.queue_limit, **_disk(self._slide_file.parent)}

    def run(self, job: Callable[[], Any], done: Callable[[concurrent.futures.Future[Any]], None]) -> None:
        """Run slow work in another thread; `done` is called in the thread of the node."""
        self._worker.submit(job, done)


def _disk(folder: Path) -> dict[str, float]:
    """
    Return the inverse of the free space on the disk of a folder, 1/GB, as the reading "disk.low".

    Return an empty dict if the free space cannot be read.
    """
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        free = shutil.disk_usage(folder).free
    except OSError:
        return {}
    return {"disk.low": 1e9 / max(free, 1)}
