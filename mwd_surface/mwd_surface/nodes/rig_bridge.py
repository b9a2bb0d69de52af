"""The rig interfaces on the graph: what the page shows goes out, rig data and requests come in."""

from __future__ import annotations

import os
import queue
import time
from pathlib import Path
from typing import Any

from mwd_msgs import msg

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.lifecycle_node import OK, WARN, Finding, GraphNode
from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.rig.interface import OnCommand
from mwd_surface.rig.port import RigPort, RigSettings
from mwd_surface.rig.status import FILE_NAME, RigStatus, dated, write_status
from mwd_surface.rig.survey import AcceptedSurvey, accepted_surveys
from mwd_surface.rig.values import RigValues, rig_values
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.ros.topics import TOPICS
from mwd_surface.surveys.survey_list import SurveyList

_PERIOD = 0.2  # s; how often the rig interfaces are told
_STATUS_PERIOD = 1.0  # s; how often their state is written down


class RigDoor:
    """
    All rig interfaces of one well.

    ask : OnCommand
        Where requests of the rig go, called in a thread of an interface.
    folder : Path
        Of the well: for the state of the interfaces, and for certificates.

    Raises
    ------
    InterfaceError
        One could not start and `rig.strict` is set.
    """

    def __init__(
        self,
        node: GraphNode[Any],
        settings: RigSettings,
        well: str,
        folder: Path,
        *,
        live: LiveState,
        journal: Journal,
        ask: OnCommand,
    ) -> None:
        self._node, self._settings, self._live, self._journal = node, settings, live, journal
        self._in: queue.SimpleQueue[Samples] = queue.SimpleQueue()
        self._surveys: tuple[AcceptedSurvey, ...] = ()
        self._values: RigValues | None = None
        self._told = 0.0
        self._state: Any = None
        self._well, self._status_file = well, folder / FILE_NAME
        self._status_at, self._unwritten = 0.0, ""
        self._port = RigPort(settings, well, on_rig_state=self._in.put, on_command=ask, folder=folder / "opcua")
        for name, why in self._port.start().items():
            journal.note(f"rig {name}", why, Severity.WARNING)

    def open(self) -> None:
        """Open the topic on which rig data goes out, where any can come in."""
        if self._settings.takes_data:
            self._state = self._node.publish_on(msg.RigState, "rig/state", TOPICS["rig/state"][1])

    def close(self) -> None:
        """End the interfaces."""
        self._port.stop()
        self._status_file.unlink(missing_ok=True)

    def on_surveys(self, surveys: SurveyList) -> None:
        """The survey list changed."""
        self._surveys = accepted_surveys(surveys)
        if self._port.wants_trajectory:
            self._port.publish_trajectory(witsml(survey_table(surveys, surveys.changed_ns)))

    def pass_on(self, now: float) -> None:
        """Rig data that came in to the graph; what is known to the rig, as often as it wants that."""
        while self._state is not None and not self._in.empty():
            samples = self._in.get()
            # The interface stamps by the wall; the graph by the node's clock.
            samples["stamp_ns"] = self._journal.now_ns()
            self._state.publish(wire.RIG_STATE.encode(samples, wire.RIG_FRAME)[0].tobytes())
        if now - self._told >= _PERIOD:
            self.tell(now)
        if now - self._status_at >= _STATUS_PERIOD:
            self._status_at = now
            self._write_status(now)

    def tell(self, now: float, *, active: bool = True) -> None:
        """The newest values to every interface; active: the node works, they may be acted upon."""
        if not self._port.enabled:
            return
        self._told = now
        self._values = rig_values(
            self._live.at(now),
            self._surveys,
            now_ns=self._journal.now_ns(),
            active=active,
            simulated=self._settings.simulated,
            previous=self._values,
        )
        self._port.publish(self._values)

    def _write_status(self, now: float) -> None:
        wall = time.time()
        status = RigStatus(self._well, wall, os.getpid(), dated(self._port.status(), wall - now))
        try:
            write_status(self._status_file, status)
            self._unwritten = ""
        except OSError as error:
            self._unwritten = f"{error.filename}: {error.strerror}"

    def findings(self) -> list[Finding]:
        """How each interface is."""
        found = []
        if self._unwritten:
            found.append(Finding("rig status file", WARN, self._unwritten, "free the disk; it is tried every second"))
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
            found.append(Finding(f"rig {one.name}", level, message, one.reason, (*values, *one.last)))
        return found
