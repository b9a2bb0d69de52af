# SPDX-License-Identifier: Apache-2.0
"""Debounce of flow or rotation: a new state counts when it has held for a time. Tool and surface use the same rule."""

from __future__ import annotations

import dataclasses

FLOW_HOLD_S = 2.0  #: usual time for which the flow must hold before a tool accepts the change, s


@dataclasses.dataclass
class Switch:
    """Flow or rotation state that changes only after the new condition has held for a time."""

    hold_ns: int  #: time for which a new condition must hold, ns
    on: bool = False  #: the accepted condition
    since_ns: int = 0  #: stamp at which the accepted condition began, before its holding time `hold_ns`
    _candidate_ns: int | None = None

    def update(self, stamp_ns: int, condition: bool) -> bool:
        """Process the condition at a stamp; return whether the accepted condition has changed."""
        if condition == self.on:
            self._candidate_ns = None
            return False
        # A candidate later than this stamp had a wrong stamp: start again.
        if self._candidate_ns is None or stamp_ns < self._candidate_ns:
            self._candidate_ns = stamp_ns
        if stamp_ns - self._candidate_ns < self.hold_ns:
            return False
        self.on, self.since_ns, self._candidate_ns = condition, self._candidate_ns, None
        return True
