# SPDX-License-Identifier: Apache-2.0
"""Every row of the supervision table has a reading, and a node that falls silent raises its row's alarm by name."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.core import wire
from mwd_sensors.ros.lifecycle_node import Heartbeat
from mwd_surface.live.supervision import TABLE, SupervisionMonitor
from mwd_surface.live.well_clock import WellClock

NODES = sorted({row.node for row in TABLE if row.alarm.startswith("memory.")})
MACHINE = {"queue.recorder": 0.0, "disk.low": 0.01}


class Alarms:
    """An alarm log that keeps what stands, and the names of all readings that were judged."""

    def __init__(self):
        self.standing = {}

    def set_alarms(self, prefix, causes):
        kept = {key: cause for key, cause in self.standing.items() if not key.startswith(prefix)}
        self.standing = kept | dict(causes)


@pytest.fixture
def watched():
    """A monitor that has heard everything there is, and its alarms."""
    alarms = Alarms()
    live = SimpleNamespace(on_stream=lambda *_: None)
    monitor = SupervisionMonitor(SimpleNamespace(clock=WellClock(10**18), live=live, alarm_log=alarms))
    for row in TABLE:
        if row.alarm.startswith("input."):
            monitor.message_received(row.alarm.removeprefix("input."))
    for node in NODES:
        monitor.on_heartbeat(Heartbeat(f"/well_1/{node}", "/well_1").message("active", b"\0"))
    samples = wire.MAG.empty(1)
    samples["stamp_ns"] = 1
    monitor.on_sonde(samples)
    return monitor, alarms


def test_every_row_has_a_reading(watched, monkeypatch):
    monitor, _ = watched
    judged = {}
    monkeypatch.setattr(monitor._supervision, "judge", lambda readings, _now: judged.update(readings) or {})
    monitor.update(monitor._clock.now, 0.0, 0.0, MACHINE)
    assert {row.alarm for row in TABLE} <= set(judged)


def test_nodes_and_topics_that_fall_silent_are_named_and_forgotten_when_they_are_back(watched):
    monitor, alarms = watched
    monitor.update(monitor._clock.now, 0.0, 0.0, MACHINE)
    assert not [key for key in alarms.standing if key.startswith(("input.", "heartbeat."))]
    monitor.update(monitor._clock.now + 30.0, 0.0, 0.0, MACHINE)
    silent = {row.alarm for row in TABLE if row.alarm.startswith(("input.", "heartbeat."))}
    assert silent <= set(alarms.standing)
    assert "no heartbeat of the receiver" in alarms.standing["heartbeat.receiver"][1]
    for node in NODES:
        monitor.on_heartbeat(Heartbeat(f"/well_1/{node}", "/well_1").message("active", b"\0"))
    monitor.update(monitor._clock.now, 0.0, 0.0, MACHINE)
    assert not [key for key in alarms.standing if key.startswith("heartbeat.")]


def test_what_is_silent_after_the_end_of_a_simulation_raises_no_alarm_and_what_came_again_does(watched):
    monitor, alarms = watched
    monitor.over_at = monitor._clock.now
    monitor.update(monitor._clock.now + 30.0, 0.0, 0.0, MACHINE)
    assert not [key for key in alarms.standing if key.startswith(("input.", "heartbeat."))]
    monitor._clock.now_ns += 10 * 10**9
    monitor.message_received("imu/data_raw")
    monitor.update(monitor._clock.now + 30.0, 0.0, 0.0, MACHINE)
    assert [key for key in alarms.standing if key.startswith(("input.", "heartbeat."))] == ["input.imu/data_raw"]


def test_the_node_that_made_the_data_may_end_at_any_time_after_the_end(watched):
    monitor, alarms = watched
    monitor.over_at, monitor.over_by = monitor._clock.now, "sonde"
    monitor._clock.now_ns += 10 * 10**9
    for node in NODES:
        monitor.on_heartbeat(Heartbeat(f"/well_1/{node}", "/well_1").message("active", b"\0"))
    monitor.update(monitor._clock.now + 30.0, 0.0, 0.0, MACHINE)
    silent = {key for key in alarms.standing if key.startswith("heartbeat.")}
    assert "heartbeat.sonde" not in silent
    assert "heartbeat.receiver" in silent
