# SPDX-License-Identifier: Apache-2.0
"""Waits of an interface between attempts to reach its peer."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class Backoff:
    """Waits between attempts."""

    first: float = setting(1.0, "wait after the first failure", unit="s", low=0.01, high=60.0, fixed=True)
    longest: float = setting(30.0, "longest wait", unit="s", low=0.01, high=600.0, fixed=True)

    def wait(self, failures: int, chance: float) -> float:
        """Seconds after so many failures in a row; chance, 0 to 1, spreads it by half either way."""
        return float(min(self.longest, self.first * 2.0 ** min(failures, 30)) * (0.5 + chance))
