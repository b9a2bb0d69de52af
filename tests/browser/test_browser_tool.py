# SPDX-License-Identifier: Apache-2.0
"""The tab of the tool: remaining time with its range, what is assumed, doses, self-tests, and an old calibration."""

import dataclasses
import time

import pytest

from browser_page import rig_on, tab, text, wait
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_limits import BatteryLimits, ExposureLimit, ToolLimits, ToolPart
from mwd_surface.logs.tool_health import HealthLedger

pytestmark = pytest.mark.slow(0.1)
S = 10**9
T0 = 1_772_323_200 * S  # 2026-03-01
LIMITS = ToolLimits(
    battery=BatteryLimits(),
    exposures={"temperature": ExposureLimit(((125.0, 10.0),))},
    parts={"gamma": ToolPart("GR-0093", "2025-01-15"), "battery": ToolPart("BT-2211")},
)


def ledger(limits):
    made = HealthLedger(limits)
    for minute in range(1, 541):
        stamp = T0 + 60 * minute * S
        made.add_flow(stamp, pumping=minute % 60 < 40)
        one = LogSample(stamp, "temperature", "degC", 60.0, 60.0, 100.0 + minute % 40, 1.0, source="temperature")
        made.add(one)
        shake = dataclasses.replace(one, channel="v", source="lateral_vibration", unit="m/s^2", value=5.0 + minute % 9)
        made.add(shake)
        made.add(dataclasses.replace(one, channel="b", source="battery_voltage", unit="V", value=28.1, sigma=0.1))
        charge = dataclasses.replace(one, channel="c", source="consumed_charge", unit="C", value=20.0 * minute)
        made.add(charge)
    made.add(dataclasses.replace(one, channel="t", source="failed_self_tests", unit="flags", value=8.0))
    return made


def test_the_tab_of_the_tool_shows_ranges_and_says_what_is_assumed(browser):
    with rig_on(browser) as rig:
        tab(browser, "tool")
        wait(browser, lambda: "Nothing is known" in (text(browser, "#tab-tool") or ""))
        rig.state.show(time.monotonic(), tool_health=ledger(LIMITS).health())
        rig.push()
        wait(browser, lambda: "±" in (text(browser, "#tool-battery") or ""))
        assert "assumed" not in text(browser, "#tool-battery")
        assert "failed: memory" in text(browser, "#tool-run")
        assert "not reported: sensors, magnetometer, detector, clock, battery" in text(browser, "#tool-run")
        assert "GR-0093" in text(browser, "#tool-parts")
        assert "45 days too old" in text(browser, "#tool-parts")
        bars = "return document.querySelectorAll('[data-source=temperature] svg rect').length"
        assert browser.execute_script(bars) >= 2
        rig.state.show(time.monotonic(), tool_health=ledger(None).health())
        rig.push()
        wait(browser, lambda: "assumed" in (text(browser, "#tool-battery") or ""))
        assert "assumed limits" in text(browser, "#tab-tool .exposure")
