# SPDX-License-Identifier: Apache-2.0
"""The battery of the sonde: cold and heat shorten its life, duty draws its current, and the tool counts its charge."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_sensors.simulator.battery import BatteryModel, SondeBattery
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.telemetry import tool_limits

BATTERY = SondeBattery(capacity_ah=10.0, used_ah=1.0)


def run(settings, hours, celsius, active, seed=1):
    """Steps of a minute."""
    model = BatteryModel(settings, np.random.default_rng(seed))
    t = 60.0 * np.arange(1, round(60 * hours) + 1)
    full = np.full(len(t), celsius), np.full(len(t), active)
    return model, model.samples(t, np.round(t * 1e9).astype(np.int64), *full, step_s=60.0)


@pytest.mark.parametrize(("celsius", "share"), [(25.0, 1.0), (-20.0, 0.6), (150.0, 0.8), (-60.0, 0.6), (2.5, 0.8)])
def test_a_charge_uses_more_of_the_battery_in_the_cold_and_in_the_heat(celsius, share):
    model, _ = run(BATTERY, 5.0, celsius, active=True)
    assert model.used == pytest.approx(0.1 + 5.0 * 0.4 / (10.0 * share))


def test_the_tool_counts_the_charge_of_its_duty_with_an_error_of_scale_alone():
    for active, ampere in ((True, 0.4), (False, 0.06)):
        _, samples = run(BATTERY, 5.0, 25.0, active=active)
        drawn = samples["consumed_charge"] / 3600.0
        scale = drawn / (1.0 + ampere * np.arange(1, 301) / 60.0)
        assert np.ptp(scale) < 1e-12
        assert scale[0] == pytest.approx(1.0, abs=0.08)
        assert samples["battery_current"].mean() == pytest.approx(ampere, abs=0.002)


def test_the_voltage_is_flat_until_the_charge_is_nearly_used_and_lower_under_load_in_the_cold():
    _, samples = run(dataclasses.replace(BATTERY, used_ah=0.0), 25.0, 25.0, active=True)
    volts = samples["battery_voltage"]
    assert np.ptp(volts[: 60 * 22]) < 0.2
    assert volts[-1] < volts[0] - 8 * 1.5
    cold = run(BATTERY, 1.0, -15.0, active=True)[1]["battery_voltage"].mean()
    idle = run(BATTERY, 1.0, -15.0, active=False)[1]["battery_voltage"].mean()
    assert volts[0] - cold > 1.0
    assert idle > cold + 1.0


def test_a_self_test_fails_from_its_time_on():
    _, samples = run(
        dataclasses.replace(BATTERY, failures=((120.0, "memory"), (240.0, "clock"))), 0.1, 25.0, active=True
    )
    assert samples["failed_self_tests"].tolist() == [0, 8, 8, 24, 24, 24]
    with pytest.raises(ValueError, match="unknown self-test"):
        SondeBattery(failures=((0.0, "motor"),))


@pytest.mark.parametrize("rows", [(), ((25.0, 1.0), (-20.0, 0.6)), ((25.0, 0.0),), ((25.0, float("nan")),)])
def test_a_wrong_table_of_temperatures_is_refused_as_in_a_tool_file(rows):
    for kind in (SondeBattery, tool_limits.BatteryLimits):
        with pytest.raises(ValueError, match="by_temperature"):
            kind(by_temperature=rows)


@pytest.mark.slow
def test_the_state_of_a_run_does_not_depend_on_the_blocks_and_does_not_disturb_the_sensors():
    text = """
name: b
precision: null
schedule:
  - {kind: still, seconds: 3.0, pumps: false}
  - {kind: drill, seconds: 6.0, rpm: 60.0, rop_m_h: 100.0}
"""
    found = []
    for scenario, seconds in ((text + "battery: {}", 0.1), (text + "battery: {}", 2.7), (text, 1.0)):
        parts = list(Sonde(parse(scenario)).blocks(seconds))
        found.append({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    one, other, without = found
    assert one[wire.STATUS_TOPIC].tobytes() == other[wire.STATUS_TOPIC].tobytes()
    assert len(one[wire.STATUS_TOPIC]) == 9
    assert wire.STATUS_TOPIC not in without
    for topic in wire.SONDE_TOPICS:
        assert one[topic].tobytes() == without[topic].tobytes()
