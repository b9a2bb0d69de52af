# SPDX-License-Identifier: Apache-2.0
"""The clock by which a downlink runs: that of the rig's data, carried on by the steady clock where they are late."""

from __future__ import annotations

import math

_SILENT_S = 2.0


class RigClock:
    """Time of the rig, s; never steps back but where the rig's own does so by more than five seconds."""

    def __init__(self) -> None:
        self._rig = self._steady = -math.inf
        self._given = -math.inf

    def take(self, rig: float, steady: float) -> float:
        """Take a time of the rig that arrived at a steady time, both s; returns the time in force."""
        if rig < self._given - 5.0:
            self._given = -math.inf
        self._rig, self._steady = rig, steady
        self._given = max(self._given, rig)
        return self._given

    def now(self, steady: float, otherwise: float) -> float:
        """Return the time at a steady time, s; otherwise: where the rig has said nothing yet."""
        if math.isinf(self._rig):
            return otherwise
        late = steady - self._steady
        # A rig that is simulated faster than time is ahead of the steady clock: only a silent one is carried on.
        self._given = max(self._given, self._rig + (late if late > _SILENT_S else 0.0))
        return self._given

    def silent(self, steady: float) -> bool:
        """Whether the rig has been silent for two seconds, or has said nothing yet."""
        return steady - self._steady > _SILENT_S
