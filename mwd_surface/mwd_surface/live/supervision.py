# SPDX-License-Identifier: Apache-2.0
"""
Table of supervision: for each supervised reading of a node its limit, persistence time, alarm and consequences.

The rules are a table, as in NASA's cFS (applications HS and LC), not code in many places. A reading above its limit for
the persistence time raises the alarm of the row; the alarm clears when the reading has been within the limit for the
same time. A missing reading counts as within the limit.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping
from typing import Any

from mwd_sensors.core.arrays import Samples
from mwd_surface.live.alarms import Causes, Severity
from mwd_surface.live.inputs import DISAGREEMENT
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.depth import CLOCK_LIMIT


@dataclasses.dataclass(frozen=True)
class SupervisionRow:
    """Rule for one supervised reading."""

    alarm: str  #: id of the alarm; also the name of the reading
    #: `node`, `what`: supervised node or input, and text of the alarm, which may contain {value} and {limit}.
    node: str
    what: str
    limit: float  #: largest normal reading, in the unit of the reading
    #: Time for which a reading must be above the limit to raise the alarm, and within it to clear the alarm.
    persistence_s: float
    severity: Severity
    remedy: str  #: advice to the user
    #: `action`, `degraded`: automatic reaction of the graph, and functions that still work; for the reference
    #: documentation.
    action: str
    degraded: str


# Nodes that the surface supervises by their heartbeats -> functions that still work without the node.
_OTHERS = {
    "sonde": "no samples come from the sonde; survey list, path and recording go on",
    "probe": "no samples come from the sonde; survey list, path and recording go on",
    "estimator": "there is no attitude; raw data are recorded, and `mwd process` gives the surveys afterwards",
    "receiver": "nothing is decoded; the pressure is recorded, and `mwd decode` gives the words afterwards",
}
_GONE = "values turn stale and are withheld from the rig"
TABLE = (
    SupervisionRow(
        "input.imu/data_raw",
        "sonde",
        "no data from the sonde for more than {limit:.0f} s",
        2.0,
        0.0,
        Severity.CRITICAL,
        "is the sonde alive and connected?",
        _GONE,
        "survey list, path and recording go on",
    ),
    SupervisionRow(
        "input.attitude",
        "estimator",
        "no attitude from the estimator for more than {limit:.0f} s",
        2.0,
        0.0,
        Severity.CRITICAL,
        "is the estimator alive and connected?",
        _GONE,
        "raw data are recorded; `mwd process` gives the surveys afterwards",
    ),
    SupervisionRow(
        "input.rig/standpipe",
        "pressure gauge",
        "no pressure from the gauge for more than {limit:.0f} s",
        5.0,
        0.0,
        Severity.CRITICAL,
        "is the gauge alive and connected?",
        "values of the link age and are withheld",
        "survey list, path and recording go on",
    ),
    SupervisionRow(
        "input.link/quality",
        "receiver",
        "nothing from the receiver for more than {limit:.0f} s",
        3.0,
        0.0,
        Severity.CRITICAL,
        "is the receiver alive? read its log",
        "its supervisor restarts it if it has ended",
        "the pressure is recorded; `mwd decode` gives the words afterwards",
    ),
    SupervisionRow(
        "input.rig/state",
        "rig data",
        "no rig data for more than {limit:.0f} s",
        2.0,
        0.0,
        Severity.WARNING,
        "is the rig's data source alive and connected?",
        "surveys wait for a depth",
        "attitude and toolface go on; a depth can be set by hand",
    ),
    SupervisionRow(
        "clock.sonde",
        "sonde",
        "the clock of the sonde has stood still for more than {limit:.0f} s",
        3.0,
        2.0,
        Severity.CRITICAL,
        "restart the sonde, or its link",
        "samples that do not advance are not used",
        "the last survey stays; the recording goes on",
    ),
    SupervisionRow(
        "clock.rig",
        "rig data",
        "the clocks of rig and sonde differ by {value:.0f} s",
        CLOCK_LIMIT,
        5.0,
        Severity.WARNING,
        "synchronise both clocks, or set the depth by hand",
        "no depth is paired with surveys",
        "attitude and toolface go on; a depth can be set by hand",
    ),
    SupervisionRow(
        "depth.sources",
        "rig data",
        "the depth of another source differs by {value:.1f} m from the depth in use",
        DISAGREEMENT,
        10.0,
        Severity.WARNING,
        "compare the two sources on the page (System, Inputs); correct one of them, or set the depth by hand",
        "the source of the highest priority is used, or the depth by hand",
        "surveys get the depth in use",
    ),
    *(
        SupervisionRow(
            f"heartbeat.{node}",
            node,
            f"no heartbeat of the {node} for more than {{limit:.0f}} s",
            4.0,
            0.0,
            Severity.WARNING,
            "is the process alive? it may hang: read its log",
            "its supervisor restarts it if it has ended",
            degraded,
        )
        for node, degraded in _OTHERS.items()
    ),
    *(
        SupervisionRow(
            f"callback.{node}",
            node,
            f"a callback of the {node} took {{value:.1f}} s",
            1.0,
            3.0,
            Severity.WARNING,
            "end other programs on this machine; read the node's log",
            "messages wait in bounded queues, the oldest are dropped and counted",
            "everything, but with a delay",
        )
        for node in (*_OTHERS, "surface")
    ),
    *(
        SupervisionRow(
            f"memory.{node}",
            node,
            f"the {node} uses {{value:.0f}} MB of memory, more than {{limit:.0f}} MB",
            2000.0,
            30.0,
            Severity.WARNING,
            "restart the node between two surveys, and report it with its log",
            "none",
            "everything",
        )
        for node in (*_OTHERS, "surface")
    ),
    SupervisionRow(
        "disk.low",
        "surface",
        "less than 1 GB is free on the disk of the recordings",
        1.0,
        10.0,
        Severity.WARNING,
        "free space on the disk, or move old recordings away",
        "recording pauses at recorder.min_free_bytes and resumes by itself",
        "survey list, page and rig interfaces go on",
    ),
    SupervisionRow(
        "queue.recorder",
        "surface",
        "{value:.0f} % of the recorder's queue wait for the disk",
        50.0,
        3.0,
        Severity.WARNING,
        "use a faster disk, or record fewer topics",
        "messages that do not fit into the queue are dropped, counted and recorded as an event",
        "everything continues; only a part of the recording is missing",
    ),
)


class Supervision:
    """
    Evaluation of readings by the limits in `TABLE`.

    prefixes: first parts of all alarm ids, for `AlarmLog.set_alarms`.
    """

    def __init__(self) -> None:
        self.prefixes = sorted({f"{row.alarm.partition('.')[0]}." for row in TABLE})
        self._since: dict[str, float] = {}
        # Text of each raised alarm with the value at that time: a text that changes every second cannot be read.
        self._raised: dict[str, str] = {}

    def judge(self, readings: Mapping[str, float], now: float) -> Causes:
        """Return the alarms in force; readings: by the alarm id of their row; now: steady time, s."""
        causes: Causes = {}
        for row in TABLE:
            value = readings.get(row.alarm)
            beyond = value is not None and value > row.limit
            if beyond == (row.alarm in self._raised):
                self._since.pop(row.alarm, None)
            elif now - self._since.setdefault(row.alarm, now) >= row.persistence_s:
                del self._since[row.alarm]
                if beyond:
                    self._raised[row.alarm] = row.what.format(value=value, limit=row.limit)
                else:
                    del self._raised[row.alarm]
            if row.alarm in self._raised:
                causes[row.alarm] = (row.severity, self._raised[row.alarm], row.remedy)
        return causes


# Readings for the supervision table: silent topics, clocks, heartbeats, disk and queue.

# Time after the end of a simulation or replay in which the last results still arrive, s. A topic or node that is heard
# later is supervised for silence as before.
_TRAILING = 2.0


class SupervisionMonitor:
    """Monitor of the nodes of one well: evaluates the table and raises its alarms."""

    def __init__(self, context: WellContext) -> None:
        self._clock, self._live, self._alarm_log = context.clock, context.live, context.alarm_log
        self._supervision = Supervision()
        #: Topics that are supervised for silence.
        self.topics = frozenset(row.alarm[6:] for row in TABLE if row.alarm.startswith("input."))
        self._received_at: dict[str, float] = {}
        self._figures: dict[str, float] = {}
        self._beat_at: dict[str, float] = {}
        self._stamp_ns = -1
        self._advanced_at = self._sampled_at = 0.0
        self.judged: set[str] = set()  #: rows of the table that had a reading at the last update, by alarm id
        #: Time of the end of the simulation or replay that makes the data, s. Topics and nodes that are silent from
        #: then on raise no alarm (ISA-18.2: suppressed by design).
        self.over_at: float | None = None
        #: Node that has produced these data. The node may exit at any time after the end, so that a missing heartbeat
        #: is not a fault.
        self.over_by = ""

    @property
    def heard(self) -> frozenset[str]:
        """Topics of which at least one message has arrived."""
        return frozenset(self._received_at)

    def message_received(self, topic: str) -> None:
        """Note the time of arrival of a message of a topic."""
        now = self._received_at[topic] = self._clock.now
        if topic == "imu/data_raw":
            # IMU samples show that the sonde sends, even if its magnetometer is silent. They are decoded elsewhere, so
            # count 0 samples.
            self._live.on_stream("sonde", 0, now)

    def on_heartbeat(self, beat: Any) -> None:
        """Accept the heartbeat of a node, diagnostic_msgs/DiagnosticStatus."""
        node = beat.name.rpartition("/")[2]
        self._beat_at[node] = self._clock.now
        for pair in beat.values:
            name = {"longest_callback_s": "callback", "memory_mb": "memory"}.get(pair.key)
            if name is not None:
                self._figures[f"{name}.{node}"] = float(pair.value)

    def on_sonde(self, samples: Samples) -> None:
        """Accept samples with stamps of the sonde's clock."""
        self._sampled_at = self._clock.now
        newest = int(samples["stamp_ns"].max()) if len(samples) else self._stamp_ns
        # A clock that was set back counts as advancing.
        if newest != self._stamp_ns:
            self._stamp_ns, self._advanced_at = newest, self._sampled_at

    def update(
        self,
        now: float,
        clock_difference: float | None,
        depth_difference: float,
        machine: Mapping[str, float],
    ) -> None:
        """
        Raise and clear the alarms of the table; called once a second.

        now: steady time, s.
        clock_difference: difference between the clocks of rig and sonde, s, None if unknown.
        depth_difference: difference between the sources of depth, m, NaN if unknown.
        machine: readings of this computer, by alarm id of their row.
        """
        last = {f"input.{topic}": at for topic, at in self._received_at.items()}
        last |= {f"heartbeat.{node}": at for node, at in self._beat_at.items()}
        expected = -math.inf if self.over_at is None else self.over_at + _TRAILING
        ended = f"heartbeat.{self.over_by}"
        readings = {alarm: now - at for alarm, at in last.items() if at > expected and alarm != ended}
        readings |= self._figures
        readings["clock.sonde"] = self._sampled_at - self._advanced_at
        if clock_difference is not None:
            readings["clock.rig"] = abs(clock_difference)
        if math.isfinite(depth_difference):
            readings["depth.sources"] = depth_difference
        readings |= machine
        self.judged = set(readings)
        causes = self._supervision.judge(readings, now)
        for prefix in self._supervision.prefixes:
            self._alarm_log.set_alarms(prefix, {key: cause for key, cause in causes.items() if key.startswith(prefix)})


# Kinds of alarms that are not evaluated: without their inputs, the absence of an alarm has no meaning.


# Kind of alarms, and the topics of which at least one must have arrived.
_DIRECT = (
    ("samples of the sonde", ("imu/data_raw", "imu/mag", "imu/temperature")),
    ("attitude and surveys", ("attitude",)),
)
_OVER_LINK = (("telemetry link", ("link/quality",)),)
_ALWAYS = (
    ("rig data and depth", ("rig/state",)),
    ("sensors and nodes", ("/diagnostics",)),
    ("heartbeats", ("heartbeat",)),
)
# Rows of supervision whose readings come from the recording computer.
_MACHINE = {"disk.low", "queue.recorder"}


def not_evaluated(heard: Collection[str], judged: Collection[str], *, over_link: bool) -> tuple[str, ...]:
    """
    Return the kinds of alarms that could not be evaluated, in words.

    heard: topics of which a message has arrived. judged: alarm ids of the rows of `TABLE` that had a reading.
    """
    kinds = (*(_OVER_LINK if over_link else _DIRECT), *_ALWAYS)
    missing = [words for words, topics in kinds if not any(topic in heard for topic in topics)]
    if not set(judged) >= _MACHINE:
        missing.append("recording and disk")
    return tuple(missing)
