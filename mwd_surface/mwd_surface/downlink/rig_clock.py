# SPDX-License-Identifier: Apache-2.0
"""Clock of a downlink: the time of the rig's data, continued by the steady clock when the data are late."""

from __future__ import annotations

import math

_SILENT_S = 2.0  # time without data after which the rig is silent, s


class RigClock:
    """Time of the rig's data, s; it goes back only if a new time is more than five seconds earlier."""

    def __init__(self) -> None:
        self._rig = self._steady = -math.inf
        self._given = -math.inf

    def take(self, rig: float, steady: float) -> float:
        """
        Add a time of the rig that arrived at a steady time, both s; return the time in force, s.

        The time in force is the latest time of the rig so far. If the rig's time is 5 s or more before it, the clock
        begins again with the rig's time.
        """
        if rig < self._given - 5.0:
            self._given = -math.inf
        self._rig, self._steady = rig, steady
        self._given = max(self._given, rig)
        return self._given

    def now(self, steady: float, otherwise: float) -> float:
        """Return the time of the rig at a steady time, s; otherwise: value to return before the first data."""
        if math.isinf(self._rig):
            return otherwise
        late = steady - self._steady
        # Continue the time by the steady clock only if data are late, because the time of a rig that is simulated
        # faster than real time runs ahead of the steady clock.
        self._given = max(self._given, self._rig + (late if late > _SILENT_S else 0.0))
        return self._given

    def silent(self, steady: float) -> bool:
        """Return whether the rig has sent no data in the last two seconds; steady: steady time, s."""
        return steady - self._steady > _SILENT_S
