# SPDX-License-Identifier: Apache-2.0
"""Waiting times between attempts of an interface to reach its peer."""

from __future__ import annotations

import dataclasses
import random

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
        high=600.0,
    )
    longest: float = setting(
        30.0,
        "Longest wait between two attempts to connect. Raising it causes less traffic, but a peer that returns is "
        "found later.",
        unit="s",
        low=0.01,
        high=3600.0,
    )

    def wait(self, failures: int) -> float:
        """
        Return the wait before the next attempt, s, after a number of consecutive failures, 1 or more.

        The wait has a random factor, so that several units do not retry at the same time.
        """
        share = random.uniform(0.5, 1.0)  # noqa: S311 (spreads waits; nothing secret)
        return float(min(self.longest, self.first * 2.0 ** min(failures - 1, 30)) * share)
