# SPDX-License-Identifier: Apache-2.0
"""Node of a real probe: read its serial line and publish the same sensor topics as the simulated sonde."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from std_srvs.srv import SetBool

from mwd_sensors.core import wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.drivers.polled_line import Master
from mwd_sensors.drivers.readings import LAYOUTS, UnitSample, samples_of
from mwd_sensors.drivers.serial_probe import LineSettings, SerialProbe, polled_frame
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_sensors.ros.discovery import SubscriberDiscovery
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import message_type
from mwd_sensors.ros.run_node import run_node

_PERIOD = 0.002  # time between two reads of the line, s


class ProbeNode(GraphNode[LineSettings]):
    """Publishes the samples of a probe; opens the line when the node becomes active, and reopens a lost line."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("probe", LineSettings(), **node_options)
        self._probe: SerialProbe | None = None
        self._said = ""
        self._received_before = self._faults_before = 0
        self._clips_before: dict[str, int] = {}
        self._bad_before = 0, 0
        self._trouble_before: dict[str, int] = {}

    def configure(self) -> None:
        """Create publishers, service and timer; raise RuntimeError if the frame of a polled line is not valid."""
        try:
            polled_frame(self.settings)
        except (ValueError, OSError) as error:
            raise RuntimeError(f"frame_file: {error}") from error
        self._topics = {
            topic: self.add_publisher(message_type(layout.type_name), topic, qos.STREAM)
            for topic, layout in LAYOUTS.items()
        }
        self.add_service(SetBool, "stream", self._stream)
        self.add_timer(_PERIOD, self._on_timer)

    def activate(self) -> None:
        """Create the connection object; the timer opens the serial line."""
        self._probe = SerialProbe(self.settings)
        self._received_before = self._faults_before = 0
        self._clips_before, self._bad_before, self._trouble_before = {}, (0, 0), {}
        self._discovery = SubscriberDiscovery(time.monotonic(), self.settings.wait_for_listener_s)

    def deactivate(self) -> None:
        """Close the line."""
        if self._probe is not None:
            self._probe.close()

    def _on_timer(self) -> None:
        probe = self._probe
        if probe is None or not self._discovery.complete(self._topics.values(), time.monotonic()):
            return
        readings = probe.poll(self.get_clock().now().nanoseconds)
        if probe.failure != self._said:
            self._said = probe.failure
            if probe.failure:
                self.get_logger().warning(printable(f"{probe.failure}; trying again every second"))
            else:
                self.get_logger().info(printable(f"{self.settings.port} is open"))
        by_topic: dict[str, list[UnitSample]] = {topic: [] for topic in LAYOUTS}
        for one in readings:
            by_topic[one.topic].append(one)
        frame = self.frame(wire.SONDE_FRAME)
        for topic, publisher in self._topics.items():
            if by_topic[topic]:
                samples = samples_of(topic, by_topic[topic], probe.offset_ns)
                publisher.publish_rows(LAYOUTS[topic].encode(samples, frame))

    def _stream(self, request: Any, response: Any) -> Any:
        sent = self._probe is not None and self._probe.stream(request.data)
        response.success = sent
        words = "samples on" if request.data else "samples off"
        response.message = f"sent to the probe: {words}" if sent else "the line is not open or does not accept commands"
        return response

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the state of the line, the clock and the unit (clipped axes, faults)."""
        probe = self._probe
        if probe is None:
            return ()
        return (self._line_diagnostic(probe), self._clock_diagnostic(probe), self._status_diagnostic(probe))

    def _line_diagnostic(self, probe: SerialProbe) -> Diagnostic:
        counters, settings = probe.reader.counters, self.settings
        new, self._received_before = probe.received - self._received_before, probe.received
        values = (
            ("samples", str(probe.received)),
            ("frames", str(counters.frames)),
            ("broken", str(counters.broken)),
            ("lost", str(counters.lost)),
            ("connections", str(probe.connections)),
            ("unit", probe.info),
        )
        if not probe.connected:
            remedy = "check plug, power and the parameter port"
            return Diagnostic("line", ERROR, probe.failure or "not open yet", remedy, values)
        if isinstance(probe.reader, Master):
            return self._polled_diagnostic(probe.reader, new, values)
        if not new:
            remedy = f"check power, the parameters baud ({settings.baud}) and protocol ({settings.protocol})"
            message = "broken frames only" if counters.broken and not counters.frames else "no samples"
            return Diagnostic("line", ERROR, message, remedy, values)
        # Count only the errors since the last call, so that the warning ends when the line is good again.
        before, self._bad_before = self._bad_before, (counters.broken, counters.lost)
        broken, lost = (max(now - then, 0) for now, then in zip(self._bad_before, before, strict=True))
        if broken or lost:
            message = f"{broken} frames broken, {lost} lost in the last second"
            return Diagnostic("line", WARN, message, "check cable, ground and speed", values)
        return Diagnostic("line", OK, f"{new} samples in the last second", values=values)

    def _polled_diagnostic(self, master: Master, new: int, values: tuple[tuple[str, str], ...]) -> Diagnostic:
        """
        Return the state of a polled line: for each kind of error, the number of errors in the last second.

        new : number of samples in the last second.
        values : further values of the entry.
        """
        before, self._trouble_before = self._trouble_before, dict(master.trouble)
        fresh = {words: count - before.get(words, 0) for words, count in master.trouble.items()}
        said = "; ".join(f"{count} times {words}" for words, count in fresh.items() if count > 0)
        if not new:
            return Diagnostic("line", ERROR, said or "no samples", "check address and frame_file", values)
        if said:
            return Diagnostic("line", WARN, said, "check cable, termination and frame_file", values)
        return Diagnostic("line", OK, f"{new} samples in the last second", values=values)

    def _clock_diagnostic(self, probe: SerialProbe) -> Diagnostic:
        if self.settings.clock == "unit":
            return Diagnostic("clock", OK, "stamps are those of the unit")
        if probe.clock_known and not probe.clock.known:
            return Diagnostic("clock", OK, "stamps are those of request and reply")
        if not probe.clock.known:
            message = "the offset of the unit's clock is not known yet; no samples are published until then"
            return Diagnostic("clock", WARN, message, "check that the unit answers `time`")
        values = (("offset", f"{probe.clock.offset_ns * 1e-9:.6f}"), ("jumps", str(probe.clock.jumps)))
        return Diagnostic("clock", OK, "synchronised", values=values)

    def _status_diagnostic(self, probe: SerialProbe) -> Diagnostic:
        clipped = [(f"clipped {axis}", str(count)) for axis, count in probe.clips.items()]
        values = (*clipped, ("faults", str(probe.faults)))
        # Count only faults of the last second, so that the alarm ends when the unit has recovered.
        new, self._faults_before = probe.faults - self._faults_before, probe.faults
        if new:
            return Diagnostic("status", ERROR, "the unit reports a fault", "replace the probe", values)
        clipping = [axis for axis, count in probe.clips.items() if count > self._clips_before.get(axis, 0)]
        self._clips_before = dict(probe.clips)
        if clipping:
            message = f"clipped: {', '.join(clipping)}"
            return Diagnostic("status", WARN, message, "reduce shocks or rotary speed, or fit a wider range", values)
        return Diagnostic("status", OK, "no axis clipped", values=values)


def main(args: Sequence[str] | None = None) -> int:
    """Run the probe node."""
    return run_node(ProbeNode, args)
