# SPDX-License-Identifier: Apache-2.0
"""Surveys while the string moves: averages over some seconds, of which the least noisy one is kept."""

from __future__ import annotations

import math

from mwd_estimation.downhole.readings import Reading, Readings
from mwd_sensors.telemetry import meanings

_OF_SURVEY = {
    meanings.CONTINUOUS_INCLINATION: (meanings.INCLINATION, meanings.SIGMA_INCLINATION),
    meanings.CONTINUOUS_AZIMUTH: (meanings.AZIMUTH, meanings.SIGMA_AZIMUTH),
}


class ContinuousSurvey:
    """Averages of inclination and azimuth over windows of equal length, `window_ns`."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._begin: int | None = None
        self._sums: dict[str, list[float]] = {}
        self._least = math.inf
        self._best: Readings = {}

    def take(self, stamp_ns: int, readings: Readings) -> None:
        """Add the readings of one sample."""
        if self._begin is None:
            self._begin = stamp_ns
        elif stamp_ns - self._begin >= self._window_ns:
            self._close(stamp_ns)
        for quantity in _OF_SURVEY:
            if quantity in readings:
                one = readings[quantity]
                sums = self._sums.setdefault(quantity, [0.0] * 4)
                for k, more in enumerate((math.sin(one.value), math.cos(one.value), one.sigma, 1.0)):
                    sums[k] += more

    def best(self) -> Readings:
        """Return the readings of the least noisy window since the last call of `forget`; empty if there was none."""
        return dict(self._best)

    def forget(self) -> None:
        """Forget the best window, because it has been sent."""
        self._least, self._best = math.inf, {}

    def _close(self, stamp_ns: int) -> None:
        begin, sums = self._begin or stamp_ns, self._sums
        self._begin, self._sums = stamp_ns, {}
        if set(sums) != set(_OF_SURVEY):
            return
        found: Readings = {}
        noise = 0.0
        middle = (begin + stamp_ns) // 2
        for quantity, (value, sigma) in _OF_SURVEY.items():
            sin, cos, sigmas, count = sums[quantity]
            # Circular standard deviation (N. I. Fisher, Statistical Analysis of Circular Data, 1993, 2.3.1).
            length = min(math.hypot(sin, cos) / count, 1.0)
            spread = math.sqrt(max(-2.0 * math.log(max(length, 1e-12)), 0.0))
            stated = math.hypot(sigmas / count, spread / math.sqrt(count))
            found[value] = Reading(math.atan2(sin, cos) % math.tau, stated, middle)
            found[sigma] = Reading(stated, math.nan, middle)
            noise += stated
        if noise < self._least:
            self._least, self._best = noise, found
