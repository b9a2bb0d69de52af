# SPDX-License-Identifier: Apache-2.0
"""
Clock of a unit compared with the host's clock: the offset to add to the unit's stamps.

Each observation gives an offset that is too large by the time its message was on the way. The smallest recent offset is
therefore the best. The offset in force follows it slowly, so that stamps neither jump nor go back.
"""

from __future__ import annotations

import collections

_KEPT = 600  # observations kept; the drift of the two clocks within that time must be small enough to follow
_SLEW = 5e-4  # largest change of the offset per elapsed time
# A change above _STEP_NS means that a clock was set, but only if this many observations agree on it within _ALIKE_NS
# over at least _LASTING_NS. Otherwise messages were delayed in a busy host: they arrive all at once or with varying
# delay.
_STEP_NS, _AGREEING, _ALIKE_NS, _LASTING_NS = 200_000_000, 3, 50_000_000, 2_500_000_000


class UnitClock:
    """
    Offset from the unit's time to the host's.

    Attributes
    ----------
    offset_ns : int
        Offset in force, ns; 0 before it is known.
    jumps : int
        Number of times that the offset changed at once; -1 before it is known.
    """

    def __init__(self) -> None:
        self.offset_ns = 0
        self.jumps = -1
        self._seen: collections.deque[int] = collections.deque(maxlen=_KEPT)
        # Host time and offset of recent observations that differ from the offset in force but agree with each other.
        self._off: list[tuple[int, int]] = []
        self._last_ns = self._unit_ns = 0

    def observe(self, unit_ns: int, host_ns: int, on_the_way_ns: int = 0) -> None:
        """
        Record that the unit's clock showed `unit_ns` at the host time `host_ns` minus on_the_way_ns.

        The offset is known once several observations agree on it: a unit that was just switched on may report a wrong
        time at first, and stamps that jump later would make the estimator lose its state. If the unit restarts, the
        offset follows at once. If a clock was set, it follows when several observations agree.

        on_the_way_ns is a known delay, such as half of the time of an exchange, ns.
        """
        offset = host_ns - on_the_way_ns - unit_ns
        known, restarted = self.jumps >= 0, unit_ns < self._unit_ns - _STEP_NS
        self._unit_ns = unit_ns
        if not known:
            self._agree(host_ns, offset)
            if len(self._off) < _AGREEING:
                return
            self._jump(min(one for _, one in self._off))
        elif restarted:
            self._jump(offset)
        elif abs(offset - self.offset_ns) > _STEP_NS:
            self._doubt(host_ns, offset)
        else:
            self._off.clear()
            self._seen.append(offset)
        best = min(self._seen)
        most = int(_SLEW * max(host_ns - self._last_ns, 0)) if self._last_ns else _STEP_NS
        self.offset_ns += max(-most, min(most, best - self.offset_ns))
        self._last_ns = host_ns

    def _doubt(self, host_ns: int, offset: int) -> None:
        """Record an observation that differs from the offset in force; jump if enough of them agree."""
        self._agree(host_ns, offset)
        if len(self._off) >= _AGREEING and abs(host_ns - self._off[0][0]) >= _LASTING_NS:
            self._jump(min(one for _, one in self._off))
        # Limit the list, because a message arrives every few milliseconds.
        self._off = [self._off[0], *self._off[1:][-_AGREEING:]] if self._off else []

    def _agree(self, host_ns: int, offset: int) -> None:
        """Record an observation and forget earlier ones that differ from it."""
        self._off = [one for one in self._off if abs(one[1] - offset) <= _ALIKE_NS]
        self._off.append((host_ns, offset))

    def _jump(self, offset: int) -> None:
        self._seen.clear()
        self._off.clear()
        self._seen.append(offset)
        self.jumps += 1
        self.offset_ns = offset
