# SPDX-License-Identifier: Apache-2.0
"""Flow or rotation as a tool takes it: on or off once it has held. The surface judges the rig's flow likewise."""

from __future__ import annotations

import dataclasses

FLOW_HOLD_S = 2.0
"""Time for which the flow usually has to hold before a tool takes it, s."""


@dataclasses.dataclass
class Switch:
    """Flow or rotation: a condition that counts once it has held for a time."""

    hold_ns: int  #: time for which it has to hold
    on: bool = False  #: the condition that counts
    since_ns: int = 0  #: since when it has held, ns; the start of the holding time, not its end
    _candidate_ns: int | None = None

    def update(self, stamp_ns: int, condition: bool) -> bool:
        """Take the condition at a stamp; returns whether the one that counts has changed."""
        if condition == self.on:
            self._candidate_ns = None
            return False
        if self._candidate_ns is None:
            self._candidate_ns = stamp_ns
        if stamp_ns - self._candidate_ns < self.hold_ns:
            return False
        self.on, self.since_ns, self._candidate_ns = condition, self._candidate_ns, None
        return True
