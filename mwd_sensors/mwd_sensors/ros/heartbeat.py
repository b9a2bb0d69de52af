# SPDX-License-Identifier: Apache-2.0
"""
Heartbeat of a node: its lifecycle state and health, published once a second on the topic `heartbeat` of its well.

It serves readers whose middleware does not report liveliness, and the supervisor, which detects hung callbacks and
growing memory.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

_PAGE = os.sysconf("SC_PAGE_SIZE")


class Heartbeat:
    """Creates the heartbeat messages of one node; `name` is its full name."""

    def __init__(self, name: str, namespace: str) -> None:
        self._name, self._namespace = name, namespace
        self._count = 0
        self._longest_s = 0.0

    @contextlib.contextmanager
    def timed(self) -> Iterator[None]:
        """Measure how long a callback takes."""
        began = time.monotonic()
        try:
            yield
        finally:
            self._longest_s = max(self._longest_s, time.monotonic() - began)

    def message(self, state: str, level: bytes) -> DiagnosticStatus:
        """Return the next heartbeat: state, worst diagnostics level, count, longest callback and memory."""
        self._count += 1
        values = {
            "count": str(self._count),
            "longest_callback_s": f"{self._longest_s:.3f}",
            "memory_mb": f"{_resident_bytes() / 1e6:.1f}",
        }
        self._longest_s = 0.0
        return DiagnosticStatus(
            level=level,
            name=self._name,
            message=state,
            hardware_id=self._namespace,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )


def _resident_bytes() -> int:
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123  (once a second for years: no path object)
        return int(file.read().split()[1]) * _PAGE
