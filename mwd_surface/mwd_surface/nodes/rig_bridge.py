# SPDX-License-Identifier: Apache-2.0
"""Rig interfaces of the node: send the values of the page and the surveys, and receive rig data and requests."""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable
from typing import Any

from mwd_msgs import msg

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.live.alarms import Severity
from mwd_surface.rig.port import RigPort, RigSettings
from mwd_surface.rig.status import FILE_NAME, RigStatus, dated, write_status
from mwd_surface.rig.survey import AcceptedSurvey, accepted_surveys
from mwd_surface.rig.values import RigValues, rig_values
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.topics import TOPICS
from mwd_surface.surveys.survey_list import SurveyList

_VALUES_PERIOD = 0.1  # time between two sets of values sent to the rig interfaces, s
_STATUS_PERIOD = 1.0  # time between two writes of the status file of the rig interfaces, s


class RigBridge:
    """
    All rig interfaces of one well.

    Parameters
    ----------
    context : SurfaceContext
        Node, live state, alarm log and request queue, and the folder for the interfaces' status and certificates.
    authority : ControlAuthority
        Authority for controllers that connect through the interfaces.
    simulated : callable
        Function that returns whether the tool is simulated.

    Raises
    ------
    InterfaceError
        An interface could not start and `rig.strict` is set.
    """

    def __init__(
        self,
        context: SurfaceContext,
        settings: RigSettings,
        well: str,
        authority: ControlAuthority,
        simulated: Callable[[], bool],
    ) -> None:
        self._node, self._settings = context.node, settings
        self._context, self._alarm_log = context, context.alarm_log
        self._rig_data: queue.SimpleQueue[tuple[str, Samples]] = queue.SimpleQueue()
        self._surveys: tuple[AcceptedSurvey, ...] = ()
        self._values: RigValues | None = None
        self._send_at, self._simulated = 0.0, simulated
        self._publisher: Any = None
        self._well, self._status_file = well, context.folder / FILE_NAME
        self._status_written_at, self._status_error = 0.0, ""
        self._port = RigPort(
            settings,
            well,
            on_rig_state=self._on_rig_data,
            on_command=context.requests.call,
            folder=context.folder / "opcua",
            authority=authority,
        )
        for name, error in self._port.start().items():
            self._alarm_log.log_event("rig", f"{name}: {error}", Severity.WARNING)

    def open(self) -> None:
        """Open the topic of the rig's data if an interface can receive rig data."""
        if self._settings.takes_data:
            self._publisher = self._node.add_publisher(msg.RigState, "rig/state", TOPICS["rig/state"][1])

    def close(self) -> None:
        """Stop the interfaces."""
        self._port.stop()
        self._status_file.unlink(missing_ok=True)

    def _on_rig_data(self, source: str, samples: Samples) -> None:
        """Queue rig data, in the thread of an interface; data are dropped while the node is inactive."""
        # Data that waited until activation would be published with the time of activation: an old depth would look new.
        if self._node.active:
            self._rig_data.put((source, samples))

    def on_surveys(self, surveys: SurveyList) -> None:
        """Pass the changed survey list to the interfaces."""
        self._surveys = accepted_surveys(surveys)
        if self._port.wants_trajectory:
            self._port.publish_trajectory(witsml(survey_table(surveys, surveys.changed_ns)))

    def update(self, now: float) -> None:
        """Publish received rig data; send values and write the status file when due. `now` is monotonic time, s."""
        while self._publisher is not None and not self._rig_data.empty():
            source, samples = self._rig_data.get()
            # The interfaces stamp with the wall clock; stamp with the clock of the node for the ROS graph.
            samples["stamp_ns"] = self._context.now_ns()
            self._publisher.publish(wire.RIG_STATE.encode(samples, self._node.frame(source))[0].tobytes())
        if now >= self._send_at:
            # Count the period from the due time, so that a late call does not lower the rate.
            self._send_at = max(self._send_at, now - _VALUES_PERIOD) + _VALUES_PERIOD
            self.send_values()
        if now - self._status_written_at >= _STATUS_PERIOD:
            self._status_written_at = now
            self._write_status(now)

    def send_values(self, *, active: bool = True) -> None:
        """Send the newest values to every interface; active: False marks the values as unusable."""
        if not self._port.enabled:
            return
        self._values = rig_values(
            self._context.state(),
            self._surveys,
            now_ns=self._context.now_ns(),
            active=active,
            simulated=self._simulated(),
            previous=self._values,
        )
        self._port.publish(self._values)

    def _write_status(self, now: float) -> None:
        wall = time.time()
        status = RigStatus(self._well, wall, os.getpid(), dated(self._port.status(), wall - now))
        try:
            write_status(self._status_file, status)
            self._status_error = ""
        except OSError as error:
            self._status_error = f"{error.filename}: {error.strerror}"

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic for each interface, and one if the status file cannot be written."""
        found = []
        if self._status_error:
            found.append(
                Diagnostic(
                    "rig status file",
                    WARN,
                    self._status_error,
                    "free space on the disk; writing is retried every second",
                )
            )
        for one in self._port.status():
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
            found.append(Diagnostic(f"rig {one.name}", level, message, one.reason, (*values, *one.last)))
        return found
