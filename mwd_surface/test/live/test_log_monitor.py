# SPDX-License-Identifier: Apache-2.0
"""Log channels while drilling: whatever comes as a sample, the surface goes on, and refused samples raise an alarm."""

import dataclasses
import math
from types import SimpleNamespace

import pytest
from example_alarms import Alarms

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.log_monitor import LogMonitor
from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.tool_health import HealthLedger

S = 10**9
T0 = 10**18


def message(at_s=50.0, **more):
    sample = LogSample(T0 + round(at_s * S), "gamma", "gAPI", 10.0, 10.0, 80.0, 5.0, sensor_to_bit=10.0)
    return dataclasses.replace(sample, **more).to_message(lambda _, fields: SimpleNamespace(**fields))


@pytest.mark.parametrize("offset", [math.inf, -math.inf, -1e9, 1e9])
def test_a_sensor_that_cannot_be_there_raises_an_alarm_that_ends_and_the_log_goes_on(offset):
    alarms, live, logs = Alarms(), LiveState(), DepthLog()
    monitor = LogMonitor(
        SimpleNamespace(live=live, alarm_log=alarms), SimpleNamespace(logs=logs, health=HealthLedger(), journal=None)
    )
    for at in range(101):
        logs.add_depth(T0 + at * S, 1000.0)
    monitor.on_sample(message(sensor_to_bit=offset))
    monitor.update(1.0)
    (text,) = (alarm.text for alarm in alarms.active().values())
    assert "sensor" in text
    monitor.on_sample(message())
    monitor.update(2.0)
    assert [len(curve.depth) for curve in live.at(2.0).logs] == [1]
    assert alarms.active()
    monitor.update(100.0)
    assert not alarms.active()
