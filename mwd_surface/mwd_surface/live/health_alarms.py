# SPDX-License-Identifier: Apache-2.0
"""Alarms about the health of the tool: battery, exposures, self-tests and calibrations, each with its remedy."""

from __future__ import annotations

import math

from mwd_sensors.telemetry.tool_limits import BatteryLimits
from mwd_surface.live.alarms import Causes, Severity
from mwd_surface.logs.tool_health import BatteryHealth, Exposure, ToolHealth

# Used share of the tool's life at which an alarm is raised: the rest is needed to pull the tool out of the hole.
_DOSE_WARNING = 0.8
_EMPTY_H = 3.0  # remaining battery time below which the alarm is critical, h; shorter than a trip out of a deep hole


def health_alarms(health: ToolHealth, battery: BatteryLimits) -> Causes:
    """Return the alarms about a tool by their id: severity, text and remedy."""
    found: Causes = {}
    if health.battery is not None:
        found |= _of_battery(health.battery, battery)
    for one in health.exposures:
        found |= _of_exposure(one)
    if health.failed_tests:
        text = f"self-test failed: {', '.join(health.failed_tests)}"
        remedy = "do not rely on this part; cycle the pumps to repeat the test, and change the tool at the next trip"
        found["tool.self_test"] = (int(Severity.CRITICAL), text, remedy)
    for part in health.parts:
        if part.overdue_days > 0:
            text = f"the calibration of {part.name} {part.serial_number} is {part.overdue_days} days too old"
            remedy = "compare the surveys with another tool or a check shot, and calibrate this part after the run"
            found[f"tool.calibration.{part.name}"] = (int(Severity.WARNING), text, remedy)
    return found


def _of_battery(state: BatteryHealth, battery: BatteryLimits) -> Causes:
    found: Causes = {}
    if state.voltage < battery.least_v:
        text = f"battery voltage {state.voltage:.1f} V is below {battery.least_v:.1f} V"
        remedy = "the tool may stop at any time: take a survey now, and plan the trip to change the battery"
        found["tool.battery.voltage"] = (int(Severity.CRITICAL), text, remedy)
    hours, sigma = state.remaining / 3600.0, state.sigma_remaining / 3600.0
    # Compare the lower end of the range (2 sigma) with the limit. If the time is assumed, compare the time itself:
    # the range of an assumed time is so wide that every battery without data would raise an alarm.
    least = hours if state.assumed else hours - 2.0 * sigma
    if math.isfinite(least) and least < battery.warning_h:
        basis = f"; assumed: {'; '.join(state.assumed)}" if state.assumed else ""
        text = f"the battery lasts for {hours:.0f} h more, give or take {2.0 * sigma:.0f} h{basis}"
        severity = Severity.CRITICAL if hours < _EMPTY_H else Severity.WARNING
        remedy = "plan the trip to change the battery; with idle pumps the battery lasts longer"
        found["tool.battery.remaining"] = (int(severity), text, remedy)
    return found


def _of_exposure(one: Exposure) -> Causes:
    name, basis = one.source.replace("_", " "), " (assumed limit: the tool file states none)" if one.assumed else ""
    found: Causes = {}
    if one.dose >= _DOSE_WARNING:
        severity = Severity.CRITICAL if one.dose >= 1.0 else Severity.WARNING
        text = f"{name} has used {100.0 * one.dose:.0f} % of the tool's life{basis}"
        found[f"tool.dose.{one.source}"] = (
            int(severity),
            text,
            "change the tool at the next trip, and have it inspected",
        )
    if one.newest >= one.limit:
        text = f"{name} {one.newest:.0f} {one.unit} is above the limit of {one.limit:.0f} {one.unit}{basis}"
        remedy = (
            "circulate to cool the tool before drilling on"
            if one.unit == "degC"
            else "change weight on bit, rotary speed or flow until the level falls"
        )
        found[f"tool.level.{one.source}"] = (int(Severity.WARNING), text, remedy)
    return found
