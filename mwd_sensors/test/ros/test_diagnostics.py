# SPDX-License-Identifier: Apache-2.0
"""What a node says of exceptions in its callbacks."""

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_sensors.ros import diagnostics
from mwd_sensors.ros.diagnostics import ERROR, OK, CallbackFailures


def test_an_exception_is_an_error_while_it_is_recent_and_a_count_afterwards(monkeypatch):
    now, failures = [100.0], CallbackFailures()
    monkeypatch.setattr(diagnostics.time, "monotonic", lambda: now[0])
    assert failures.diagnostics() == []
    failures.count("rig/state")
    (found,) = failures.diagnostics()
    assert (found.level, found.values) == (ERROR, (("rig/state", "1"),))
    now[0] += 3.0 * CallbackFailures.RECENT_S
    assert [one.level for one in failures.diagnostics()] == [OK]
    failures.count("rig/state")
    (found,) = failures.diagnostics()
    assert (found.level, found.values) == (ERROR, (("rig/state", "2"),))
