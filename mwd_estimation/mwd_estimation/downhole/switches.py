# SPDX-License-Identifier: Apache-2.0
"""What the tool knows of flow and rotation: on or off, with the time at which that changed."""

from __future__ import annotations

import dataclasses

NANOSECONDS = 1_000_000_000


@dataclasses.dataclass
class Switch:
    """A condition that counts once it has held for a time."""

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
