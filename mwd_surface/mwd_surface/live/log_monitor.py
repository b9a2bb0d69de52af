# SPDX-License-Identifier: Apache-2.0
"""Log channels of a well while drilling: accept samples, show curves over depth and the health of the tool."""

from __future__ import annotations

import math
from typing import Any

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import RIG_VALID
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_limits import BatteryLimits
from mwd_surface.live.alarms import Causes, Severity
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import LEAST_FLOW
from mwd_surface.logs.depth_log import FIRST
from mwd_surface.logs.recorded_log import DIRECT, of_link
from mwd_surface.logs.tool_health import BatteryHealth, Exposure, ToolHealth

_SHOWN = 2000  # number of deepest depth steps of each channel that are shown
_CLEARED_S = 60.0  # time without a refused sample after which the alarm of refused samples ends
_RETRY_S = 10.0  # time between two attempts to write the journal while the disk refuses it
_REMEDY = "compare the tool configuration with the tool, and see that the rig sends its depth"


class LogMonitor:
    """
    Monitor of the logs of a well: assigns depths to log samples, and updates the account of the tool's health.

    Parameters
    ----------
    source : str
        Name of the link whose samples are used, as in the setting `link.source`.
    """

    def __init__(self, context: WellContext, book: SurveyBook, source: str = DIRECT) -> None:
        self._live, self._book, self._source = context.live, book, source
        self._log, self._alarm_log = book.logs, context.alarm_log
        self._shown_health = -1
        self._shown = 0
        self._refused, self._refused_at = 0, 0.0
        self._retry_at = -math.inf

    def on_sample(self, message: Any) -> None:
        """
        Accept a mwd_msgs/LogSample of the link in use, for curves, tool health and journal.

        Samples of other links, and samples that the log does not accept, are ignored.
        """
        sample = LogSample.from_message(message)
        if of_link(sample, self._source) and self._log.add([sample]):
            self._book.health.add(sample)
            if self._book.journal is not None:
                self._book.journal.add_sample(sample)

    def on_rig_state(self, samples: Samples, depth: float | None) -> None:
        """Accept rig data, `wire.RIG_STATE`, for battery duty and journal; depth: accepted bit depth, m, or None."""
        for sample in samples:
            pumping = is_pumping(sample)
            if pumping is not None:
                self._book.health.add_flow(int(sample["stamp_ns"]), pumping=pumping)
        if len(samples) and self._book.journal is not None:
            last = samples[-1]
            self._book.journal.add_rig(int(last["stamp_ns"]), depth, is_pumping(last))

    def update(self, now: float) -> None:
        """Assign depths to samples whose depth is known now, and show curves and tool health if they changed."""
        self._log.advance()
        if self._log.version != self._shown:
            self._shown = self._log.version
            self._live.show(now, logs=self._log.curves(FIRST, _SHOWN), newest_logs=self._log.newest())
        self._tell_refused(now)
        self._tell_journal(now)
        # Frequent flow data of the rig do not raise the version of the tool's health; their effect is shown with the
        # next log sample.
        if self._book.health.version != self._shown_health:
            self._shown_health = self._book.health.version
            health = self._book.health.health()
            self._live.show(now, tool_health=health)
            self._alarm_log.set_alarms("tool.", health_alarms(health, self._book.health.battery))

    def _tell_journal(self, now: float) -> None:
        """Raise an alarm while the disk refuses the journal, and try again every `_RETRY_S`."""
        journal = self._book.journal
        if journal is None:
            return
        if journal.fault and now >= self._retry_at:
            journal.try_again()
            self._retry_at = now + _RETRY_S
        # The disk may accept a few bytes and still refuse the next line: end the alarm after `_RETRY_S` without fault.
        if journal.fault:
            remedy = "free space on this disk; a restart of the surface node would lose the log samples since the alarm"
            text = f"the log samples cannot be written to the disk: {journal.fault}"
            self._alarm_log.raise_alarm("log.journal", Severity.WARNING, text, remedy)
        elif now >= self._retry_at:
            self._alarm_log.clear_alarm("log.journal")

    def _tell_refused(self, now: float) -> None:
        """Raise an alarm while samples are refused."""
        refused = sum(self._log.unusable.values())
        if refused > self._refused:
            self._refused, self._refused_at = refused, now
            text = f"log samples are left out: {'; '.join(sorted(self._log.unusable))}"
            self._alarm_log.raise_alarm("log.refused", Severity.WARNING, text, _REMEDY)
        elif refused and now - self._refused_at > _CLEARED_S:
            self._alarm_log.clear_alarm("log.refused")


def is_pumping(sample: Any) -> bool | None:
    """Return whether the pumps of the rig are on, from its flow; None if the sample has no valid flow."""
    known = bool(sample["valid"] & RIG_VALID["flow_rate"])
    return float(sample["flow_rate"]) > LEAST_FLOW if known else None


# Alarms about the health of the tool: battery, exposures, self-tests and calibrations, each with its remedy.

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
