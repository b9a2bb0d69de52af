# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a node: one entry for each monitored item, published as diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))


@dataclasses.dataclass(frozen=True)
class Diagnostic:
    """One entry of a node's diagnostics."""

    name: str  #: name of the monitored item; published as ``<node>: <name>``
    level: bytes  #: OK, WARN, ERROR or STALE
    message: str  #: description of the state for the user
    remedy: str = ""  #: advice to the user; published as the value `remedy`
    values: tuple[tuple[str, str], ...] = ()  #: numbers that describe the state, as (name, text)


class CallbackFailures:
    """
    Counter of failed callbacks and unsent messages.

    Its diagnostic entry is an error until `RECENT_S`, s, after the last failure; later the entry has only the counts.
    """

    RECENT_S = 60.0

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._last = 0.0

    def count(self, name: str) -> None:
        """Count one exception of a callback, or one message that was not sent."""
        self._counts[name] = self._counts.get(name, 0) + 1
        self._last = time.monotonic()

    def diagnostics(self) -> list[Diagnostic]:
        """Return one entry with the counts, or an empty list if nothing has failed yet."""
        if not self._counts:
            return []
        counts = tuple((name, str(count)) for name, count in self._counts.items())
        age = time.monotonic() - self._last
        if age < self.RECENT_S:
            message = "a callback failed or a message was not sent"
            return [Diagnostic("failures", ERROR, message, "read the node's log", counts)]
        message = f"the last failure was {age / 60.0:.0f} min ago; see the log"
        return [Diagnostic("failures", OK, message, values=counts)]


def clock_diagnostics(sim_time: bool, now_ns: int) -> list[Diagnostic]:
    """Return a list with a warning if the node uses simulated time and its time, now_ns, is still 0; else []."""
    if not sim_time or now_ns > 0:
        return []
    remedy = "start a publisher of /clock (`mwd replay`), or set use_sim_time to false"
    return [Diagnostic("clock", WARN, "waiting for /clock", remedy)]


def diagnostic_array(node: Node, diagnostics: Sequence[Diagnostic]) -> DiagnosticArray:
    """Return the message with the diagnostics of a node, stamped now; the hardware id is the node's namespace."""
    message = DiagnosticArray()
    message.header.stamp = node.get_clock().now().to_msg()
    for diagnostic in diagnostics:
        values = [KeyValue(key=key, value=value) for key, value in diagnostic.values]
        if diagnostic.remedy:
            values.append(KeyValue(key="remedy", value=diagnostic.remedy))
        message.status.append(
            DiagnosticStatus(
                level=diagnostic.level,
                name=f"{node.get_fully_qualified_name()}: {diagnostic.name}",
                message=diagnostic.message,
                hardware_id=node.get_namespace(),
                values=values,
            )
        )
    return message
