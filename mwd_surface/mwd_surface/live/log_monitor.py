# SPDX-License-Identifier: Apache-2.0
"""Log channels of a well while drilling: accepts samples and shows curves over depth."""

from __future__ import annotations

from typing import Any

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_context import WellContext
from mwd_surface.logs.depth_log import FIRST

_SHOWN = 2000  # number of depth steps of each channel that are shown, the deepest ones


class LogMonitor:
    """Merges the log samples of a well by the depths of its survey book."""

    def __init__(self, context: WellContext, book: SurveyBook) -> None:
        self._live, self._log = context.live, book.logs
        self._shown = 0

    def on_sample(self, message: Any) -> None:
        """Accept a mwd_msgs/LogSample."""
        self._log.add([LogSample.from_message(message)])

    def update(self, now: float) -> None:
        """Place the samples whose depth is known now, and show the curves if they changed."""
        self._log.advance()
        if self._log.version != self._shown:
            self._shown = self._log.version
            self._live.show(now, logs=self._log.curves(FIRST, _SHOWN), newest_logs=self._log.newest())
