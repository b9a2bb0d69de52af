# SPDX-License-Identifier: Apache-2.0
"""Log channels of a well while drilling: accepts samples and shows curves over depth."""

from __future__ import annotations

from typing import Any

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.live.alarms import Severity
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_context import WellContext
from mwd_surface.logs.depth_log import FIRST

_SHOWN = 2000  # number of depth steps of each channel that are shown, the deepest ones
_CLEARED_S = 60.0  # s without another one after which the alarm of refused samples ends
_REMEDY = "compare the tool configuration with the tool, and see that the rig sends its depth"


class LogMonitor:
    """Merges the log samples of a well by the depths of its survey book."""

    def __init__(self, context: WellContext, book: SurveyBook) -> None:
        self._live, self._log = context.live, book.logs
        self._alarm_log = context.alarm_log
        self._shown = 0
        self._refused, self._refused_at = 0, 0.0

    def on_sample(self, message: Any) -> None:
        """Accept a mwd_msgs/LogSample."""
        self._log.add([LogSample.from_message(message)])

    def update(self, now: float) -> None:
        """Place the samples whose depth is known now, and show the curves if they changed."""
        self._log.advance()
        if self._log.version != self._shown:
            self._shown = self._log.version
            self._live.show(now, logs=self._log.curves(FIRST, _SHOWN), newest_logs=self._log.newest())
        self._tell_refused(now)

    def _tell_refused(self, now: float) -> None:
        """Raise an alarm while samples are refused."""
        refused = sum(self._log.unusable.values())
        if refused > self._refused:
            self._refused, self._refused_at = refused, now
            text = f"log samples are left out: {'; '.join(sorted(self._log.unusable))}"
            self._alarm_log.raise_alarm("log.refused", Severity.WARNING, text, _REMEDY)
        elif refused and now - self._refused_at > _CLEARED_S:
            self._alarm_log.clear_alarm("log.refused")
