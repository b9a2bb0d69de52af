# SPDX-License-Identifier: Apache-2.0
"""Health of the tool: remaining time against the simulated battery, dose, honesty where the tool file is missing."""

import dataclasses
import datetime
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from consistency import assert_consistent
from mwd_sensors.simulator import battery as simulated
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_limits import BatteryLimits, ExposureLimit, ToolLimits, ToolPart
from mwd_surface.live.alarms import Severity
from mwd_surface.live.log_monitor import health_alarms
from mwd_surface.logs.tool_health import HealthLedger

S = 10**9
T0 = 1_772_323_200 * S  # 2026-03-01
UNITS = {
    "temperature": "degC",
    "battery_voltage": "V",
    "consumed_charge": "C",
    "failed_self_tests": "flags",
    "self_tests": "flags",
}
PACK = BatteryLimits(capacity_ah=10.0, current_sigma=0.05, least_v=22.0)


def sample(source, at_s, value, span=60.0, **more):
    unit = UNITS.get(source, "m/s^2")
    stamp = T0 + round((at_s - 0.5 * span) * S)
    return LogSample(stamp, source, unit, span, span, float(value), 0.1, source=source, **more)


def played(seed, hours, *, counted):
    """Return the forecast after some hours of a duty that repeats, and the true time until the battery was empty, h."""
    rng = np.random.default_rng(seed)
    capacity = PACK.capacity_ah * (1.0 + PACK.capacity_sigma * rng.standard_normal())
    scale = 1.0 + (0.0 if counted else PACK.current_sigma * rng.standard_normal())
    true = simulated.SondeBattery(
        capacity_ah=capacity,
        used_ah=1.0,
        active_a=PACK.active_a * scale,
        idle_a=PACK.idle_a * scale,
        by_temperature=PACK.by_temperature,
    )
    model = simulated.BatteryModel(true, rng)
    ledger = HealthLedger(ToolLimits(battery=dataclasses.replace(PACK, used_ah=1.0)))
    state = None
    for minute in range(1, 6000):
        t, active, celsius = 60.0 * minute, minute % 60 < 40, 90.0
        row = model.samples(np.array([t]), np.array([T0]), np.array([celsius]), np.array([active]), step_s=60.0)[0]
        if model.used >= 1.0:
            return state, minute / 60.0 - hours
        if minute <= 60 * hours:
            ledger.add_flow(T0 + round((t - 59.0) * S), pumping=active)
            ledger.add_flow(T0 + round(t * S), pumping=active)
            ledger.add(sample("temperature", t, celsius))
            if counted:
                ledger.add(sample("consumed_charge", t, row["consumed_charge"]))
            state = ledger.health().battery
    raise AssertionError("the battery never ends")


@pytest.mark.slow(5)
@pytest.mark.parametrize("batteries", [30, pytest.param(60, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("counted", [True, False])
def test_the_remaining_time_is_within_its_sigma_of_the_simulated_battery(counted, batteries):
    errors, sigmas = [], []
    for seed in range(batteries):
        state, true_h = played(seed, 8.0, counted=counted)
        errors.append(state.remaining / 3600.0 - true_h)
        sigmas.append(state.sigma_remaining / 3600.0)
        assert bool(state.assumed) is not counted
    assert_consistent(np.array(errors), np.array(sigmas))
    assert np.mean(sigmas) < 0.25 * 20.0


def test_without_a_tool_file_the_remaining_time_looks_assumed_and_has_a_wide_range():
    ledger = HealthLedger()
    ledger.add(sample("battery_voltage", 60.0, 28.0))
    battery = ledger.health().battery
    assert any("tool file" in text for text in battery.assumed)
    assert battery.sigma_remaining > 0.3 * battery.remaining
    # Nothing tells of a battery: nothing is said of it.
    silent = HealthLedger()
    silent.add(sample("temperature", 60.0, 20.0))
    silent.add_flow(T0, pumping=True)
    assert silent.health().battery is None


def test_cold_and_duty_shorten_the_remaining_time():
    def hours(celsius, pumping):
        ledger = HealthLedger(ToolLimits(battery=PACK))
        for minute in range(1, 61):
            ledger.add_flow(T0 + 60 * minute * S, pumping=pumping)
            ledger.add(sample("temperature", 60.0 * minute, celsius))
        return ledger.health().battery.remaining / 3600.0

    assert hours(25.0, True) == pytest.approx((10.0 - 59.0 / 60.0 * 0.4) / 0.4, rel=0.01)
    assert hours(25.0, False) == pytest.approx(10.0 / 0.06, rel=0.02)
    assert hours(-20.0, True) < 0.65 * hours(25.0, True)


@given(cut=st.sampled_from([1.0, 2.0, 10.0, 60.0, 300.0]), level=st.floats(100.0, 190.0))
def test_the_dose_is_that_of_the_time_however_the_samples_are_cut(cut, level):
    limit = ExposureLimit(((125.0, 100.0), (175.0, 1.0)))
    ledger = HealthLedger(ToolLimits(exposures={"temperature": limit}))
    for k in range(1, round(600.0 / cut) + 1):
        ledger.add(sample("temperature", k * cut, level, span=cut))
        # A sample that comes twice, of two links, counts once.
        ledger.add(sample("temperature", k * cut, level, span=cut))
    (found,) = ledger.health().exposures
    assert found.observed == pytest.approx(600.0)
    assert sum(seconds for _, seconds in found.bins) == pytest.approx(600.0)
    assert found.dose == pytest.approx(600.0 / 3600.0 / limit.allowed_h(level))
    assert (found.dose > 0.0) is (level >= 125.0)


def test_at_a_level_of_the_table_the_tool_lives_as_long_as_the_table_says():
    limit = ExposureLimit(((125.0, 100.0), (175.0, 1.0)))
    assert limit.allowed_h(125.0) == pytest.approx(100.0)
    assert limit.allowed_h(150.0) == pytest.approx(10.0)
    assert limit.allowed_h(400.0) == pytest.approx(1.0)
    assert math.isinf(limit.allowed_h(124.9))


def test_time_without_samples_is_in_no_dose_and_words_hold_for_a_while():
    ledger = HealthLedger()
    for at in (10.0, 70.0, 130.0, 5000.0):
        ledger.add(sample("lateral_vibration", at, 30.0, span=10.0))
    (found,) = ledger.health().exposures
    assert found.observed == pytest.approx(10.0 + 60.0 + 60.0 + 10.0)


def test_each_alarm_has_a_remedy_and_ends_with_its_cause():
    limits = ToolLimits(
        battery=PACK,
        exposures={"temperature": ExposureLimit(((125.0, 1.0),))},
        parts={
            "sensors": ToolPart("S-17", "2025-01-01"),
            "gamma": ToolPart("G-3", "2026-02-01"),
            "pulser": ToolPart("P-1"),
        },
    )
    ledger = HealthLedger(limits)
    for minute in range(1, 60):
        ledger.add(sample("temperature", 60.0 * minute, 130.0))
    ledger.add(sample("consumed_charge", 3600.0, 9.8 * 3600.0))
    ledger.add(sample("battery_voltage", 3600.0, 20.0))
    ledger.add(sample("failed_self_tests", 3600.0, 8.0 + 32.0))
    health = ledger.health()
    found = health_alarms(health, PACK)
    assert set(found) == {
        "tool.battery.voltage",
        "tool.battery.remaining",
        "tool.dose.temperature",
        "tool.level.temperature",
        "tool.self_test",
        "tool.calibration.sensors",
    }
    assert all(remedy for _, _, remedy in found.values())
    assert "memory, battery" in found["tool.self_test"][1]
    assert found["tool.battery.remaining"][0] == Severity.CRITICAL
    assert found["tool.dose.temperature"][0] == Severity.WARNING
    assert health.run_time == pytest.approx(3540.0, abs=61.0)
    # In the same account each cause ends; a dose is used up for good.
    ends = {
        "tool.level.temperature": sample("temperature", 3700.0, 60.0),
        "tool.battery.voltage": sample("battery_voltage", 3700.0, 28.0),
        "tool.self_test": sample("failed_self_tests", 3700.0, 0.0),
        # Another battery.
        "tool.battery.remaining": sample("consumed_charge", 3700.0, 0.0),
    }
    left = set(found)
    for name, one in ends.items():
        ledger.add(one)
        left.remove(name)
        assert set(health_alarms(ledger.health(), PACK)) == left
    assert set(health_alarms(ledger.health(datetime.date(2025, 6, 1)), PACK)) == {"tool.dose.temperature"}


@pytest.mark.parametrize(
    ("samples", "failed", "unreported"),
    [
        ((), None, 6),
        ((("self_tests", 63),), None, 6),
        ((("failed_self_tests", 0),), (), 6),
        ((("failed_self_tests", 2),), ("magnetometer",), 5),
        ((("failed_self_tests", 2), ("failed_self_tests", 0), ("self_tests", 63)), (), 0),
        ((("self_tests", 63), ("failed_self_tests", 0), ("failed_self_tests", 8)), ("memory",), 0),
        ((("self_tests", 0), ("failed_self_tests", 0)), (), 6),
        ((("self_tests", 63), ("self_tests", 3), ("failed_self_tests", 0)), (), 4),
    ],
)
def test_a_self_test_has_the_result_of_its_last_run_and_none_before_it_ran(samples, failed, unreported):
    ledger = HealthLedger()
    for k, (source, value) in enumerate(samples):
        ledger.add(sample(source, 60.0 * k, value))
    health = ledger.health()
    assert health.failed_tests == failed
    assert len(health.unreported_tests) == unreported
    assert ("tool.self_test" in health_alarms(health, PACK)) is bool(failed)


YEARS_S = 2 * 365 * 86400.0


@pytest.mark.parametrize("jump_s", [YEARS_S, -YEARS_S, 86400.0, -7200.0])
@pytest.mark.parametrize("lasting", [False, True])
def test_a_wrong_stamp_or_a_clock_that_jumps_stops_no_account(jump_s, lasting):
    limit = ExposureLimit(((125.0, 100.0), (175.0, 1.0)))
    ledger = HealthLedger(ToolLimits(exposures={"temperature": limit}, battery=PACK))
    ledger.add(sample("temperature", 0.0, 30.0))
    ledger.add(sample("temperature", jump_s, 31.0))
    ledger.add(sample("consumed_charge", jump_s, 1000.0))
    ledger.add_flow(T0 + round(jump_s * S), pumping=False)
    begin = jump_s if lasting else 0.0
    for k in range(1, 2001):
        ledger.add(sample("temperature", begin + 60.0 * k, 180.0))
        ledger.add(sample("consumed_charge", begin + 60.0 * k, 1000.0 + 24.0 * k))
        ledger.add_flow(T0 + round((begin + 60.0 * k) * S), pumping=True)
    health = ledger.health()
    (found,) = health.exposures
    assert found.newest == 180.0
    assert found.dose == pytest.approx(2000.0 / 60.0, rel=0.01)
    assert health.run_time == pytest.approx(2000.0 * 60.0, rel=0.01)
    assert health.pumping == pytest.approx(2000.0 * 60.0, rel=0.01)
    assert health.stamp_ns == T0 + round((begin + 120000.0) * S)
    assert health.battery.current == pytest.approx(0.4, rel=0.01)


def test_samples_of_one_source_with_a_wrong_clock_leave_the_others_as_they_are():
    ledger = HealthLedger()
    for k in range(1, 61):
        ledger.add(sample("lateral_vibration", YEARS_S + 60.0 * k, 30.0))
        ledger.add(sample("temperature", 60.0 * k, 130.0))
    assert [one.observed for one in ledger.health().exposures] == pytest.approx([3600.0, 3600.0])
    assert ledger.health().run_time == pytest.approx(3600.0)


@pytest.mark.parametrize("limits", [None, ToolLimits(), ToolLimits(battery=BatteryLimits(capacity_ah=15.0))])
def test_a_voltage_raises_no_alarm_where_the_tool_file_states_no_limit(limits):
    ledger = HealthLedger(limits)
    for minute in range(1, 61):
        ledger.add(sample("battery_voltage", 60.0 * minute, 14.4))
    assert health_alarms(ledger.health(), ledger.battery) == {}


def test_a_counter_that_falls_counts_another_battery():
    ledger = HealthLedger(ToolLimits(battery=BatteryLimits()))
    for k, value in enumerate((90_000.0, 90_400.0, 0.0, 400.0)):
        ledger.add(sample("consumed_charge", 1000.0 * (k + 1), value))
    battery = ledger.health().battery
    assert battery.used == pytest.approx(400.0)
    assert battery.current == pytest.approx(0.4)
    assert battery.remaining == pytest.approx((26.0 * 3600.0 - 400.0) / 0.4)
    # A used battery, whose counter goes on.
    ledger.add(sample("consumed_charge", 5000.0, 100.0))
    ledger.add(sample("consumed_charge", 6000.0, 500.0))
    assert ledger.health().battery.used == pytest.approx(500.0)


@pytest.mark.parametrize("pumping", [False, True])
def test_a_silence_of_the_rig_is_assumed_idle_and_told(pumping):
    ledger = HealthLedger(ToolLimits(battery=BatteryLimits()))
    for at in range(3600):
        ledger.add_flow(T0 + at * S, pumping=pumping)
    for at in range(3 * 86400, 3 * 86400 + 3600):
        ledger.add_flow(T0 + at * S, pumping=False)
    battery = ledger.health().battery
    active_h = 2.0 if pumping else 0.0
    assert battery.used / 3600.0 == pytest.approx(0.06 * (73.0 - active_h) + 0.4 * active_h, rel=0.001)
    assert any("71.0 h" in text for text in battery.assumed)
    assert ledger.health().pumping == pytest.approx(3600.0 if pumping else 0.0, abs=2.0)
    assert health_alarms(ledger.health(), ledger.battery) == {}


@pytest.mark.parametrize("jump_s", [YEARS_S, 10 * 86400.0, 7200.0])
@pytest.mark.parametrize("count", [1, 50])
def test_wrong_stamps_of_the_rig_draw_no_charge(jump_s, count):
    ledger = HealthLedger(ToolLimits(battery=BatteryLimits()))
    for at in range(3600):
        ledger.add_flow(T0 + at * S, pumping=True)
        if at == 1000:
            for k in range(count):
                ledger.add_flow(T0 + round((jump_s + at + k) * S), pumping=True)
    assert ledger.health().battery.used == pytest.approx(0.4 * 3600.0, rel=0.02)


def test_a_first_sample_in_a_foreign_unit_does_not_decide_the_unit():
    ledger = HealthLedger()
    ledger.add(dataclasses.replace(sample("temperature", 60.0, 266.0), unit="degF"))
    assert ledger.health() == HealthLedger().health()
    ledger.add(sample("temperature", 120.0, 130.0))
    (found,) = ledger.health().exposures
    assert (found.unit, found.largest) == ("degC", 130.0)


def test_wrong_limits_are_refused_by_name():
    for make, words in (
        (lambda: ExposureLimit(((125.0, 1.0), (150.0, 2.0))), "grow"),
        (lambda: ExposureLimit(((125.0, 0.0),)), "above 0"),
        (lambda: BatteryLimits(by_temperature=((25.0, 1.0), (25.0, 0.9))), "rise"),
        (lambda: ToolPart(calibrated="March"), "2026-03-01"),
        (lambda: ToolLimits(exposures={"noise": ExposureLimit(((1.0, 1.0),))}), "noise"),
    ):
        with pytest.raises(ValueError, match=words):
            make()
