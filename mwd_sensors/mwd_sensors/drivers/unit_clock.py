# SPDX-License-Identifier: Apache-2.0
"""
The clock of a unit against that of the host: what is added to the unit's stamps.

Each observation bounds the offset from above by the time its message was on the way. The smallest of the last ones is
the best; the offset in force follows it slowly, so that stamps neither jump nor go back.
"""

from __future__ import annotations

import collections

_KEPT = 600  # observations; the host's clock and the unit's drift apart meanwhile by what the offset can follow
_SLEW = 5e-4  # most change of the offset, as a share of the time that passes
# A change beyond this is a clock that was set, where so many observations agree on it to within this, over so long a
# time: messages that waited in a host that was held up come all at once, or each by another time late.
_STEP_NS, _AGREEING, _ALIKE_NS, _LASTING_NS = 200_000_000, 3, 50_000_000, 2_500_000_000


class UnitClock:
    """
    Offset from the unit's time to the host's.

    Attributes
    ----------
    offset_ns : int
        In force; 0 before it is known.
    jumps : int
        Times that the offset changed at once; -1 before it is known.
    """

    def __init__(self) -> None:
        self.offset_ns = 0
        self.jumps = -1
        self._seen: collections.deque[int] = collections.deque(maxlen=_KEPT)
        # Host's time and offset of observations that are off the offset in force, as long as they agree.
        self._off: list[tuple[int, int]] = []
        self._last_ns = self._unit_ns = 0

    def observe(self, unit_ns: int, host_ns: int, on_the_way_ns: int = 0) -> None:
        """
        Take that the unit's clock showed `unit_ns` when the host's showed `host_ns`, on_the_way_ns before.

        The offset is known once several observations agree on it: a unit that has just been switched on may tell
        another time first, and stamps that jump later cost the estimator all it has found. A unit that starts again is
        followed at once, a clock that was set once several observations agree on it.
        on_the_way_ns: known delay, such as half of the time of an exchange, ns.
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
        """Take an observation that is off; jump where enough of them agree."""
        self._agree(host_ns, offset)
        if len(self._off) >= _AGREEING and abs(host_ns - self._off[0][0]) >= _LASTING_NS:
            self._jump(min(one for _, one in self._off))
        # Not for ever: a message comes each few milliseconds.
        self._off = [self._off[0], *self._off[1:][-_AGREEING:]] if self._off else []

    def _agree(self, host_ns: int, offset: int) -> None:
        """Take an observation, and forget earlier ones that differ from it."""
        self._off = [one for one in self._off if abs(one[1] - offset) <= _ALIKE_NS]
        self._off.append((host_ns, offset))

    def _jump(self, offset: int) -> None:
        self._seen.clear()
        self._off.clear()
        self._seen.append(offset)
        self.jumps += 1
        self.offset_ns = offset
