# SPDX-License-Identifier: Apache-2.0
"""Clock of a downlink: the time of the rig's data, continued by the steady clock when they are late."""

from __future__ import annotations

import math

_SILENT_S = 2.0


class RigClock:
    """Time of the rig, s; it steps back only if the rig's own time does so by more than five seconds."""

    def __init__(self) -> None:
        self._rig = self._steady = -math.inf
        self._given = -math.inf

    def take(self, rig: float, steady: float) -> float:
        """Add a time of the rig that arrived at a steady time, both s; return the time in force."""
        if rig < self._given - 5.0:
            self._given = -math.inf
        self._rig, self._steady = rig, steady
        self._given = max(self._given, rig)
        return self._given

    def now(self, steady: float, otherwise: float) -> float:
        """Return the time at a steady time, s; otherwise: the value to return before any data of the rig."""
        if math.isinf(self._rig):
            return otherwise
        late = steady - self._steady
        # A rig simulated faster than real time runs ahead of the steady clock, so continue the time only if data are
        # late.
        self._given = max(self._given, self._rig + (late if late > _SILENT_S else 0.0))
        return self._given

    def silent(self, steady: float) -> bool:
        """Return whether no data of the rig came for two seconds, or none at all yet."""
        return steady - self._steady > _SILENT_S
