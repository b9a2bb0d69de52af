# SPDX-License-Identifier: Apache-2.0
"""Waiting times between attempts of an interface to reach its peer."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class Backoff:
    """Waiting times between attempts: doubled after each failure, up to the longest."""

    first: float = setting(
        1.0,
        "Wait before the second attempt to connect. The wait doubles with each further failure. Each wait is "
        "multiplied by a random factor of 0.5 to 1.",
        unit="s",
        low=0.01,
        high=60.0,
    )
    longest: float = setting(
        30.0,
        "Longest wait between two attempts to connect. Raising it causes less traffic, but a peer that returns is "
        "found later.",
        unit="s",
        low=0.01,
        high=600.0,
    )

    def wait(self, failures: int, chance: float) -> float:
        """
        Return the wait before the next attempt, s.

        failures: number of consecutive failures minus 1. chance: random number, 0 to 1; the wait is multiplied by 0.5 +
        0.5 chance, so that several units do not retry at the same time.
        """
        return float(min(self.longest, self.first * 2.0 ** min(failures, 30)) * (0.5 + 0.5 * chance))
