"""
The clock of a unit against that of the host: what is added to the unit's stamps.

Each observation bounds the offset from above by the time its message was on the way. The smallest of the last ones is
the best; the offset in force follows it slowly, so that stamps neither jump nor go back.
"""

from __future__ import annotations

import collections

_KEPT = 600  # observations; the host's clock and the unit's drift apart meanwhile by what the offset can follow
_SLEW = 5e-4  # most change of the offset, as a share of the time that passes
_JUMP_NS = 2_000_000_000  # a larger change is another start of the unit or a clock that was set: it is followed at once


class UnitClock:
    """
    Offset from the unit's time to the host's.

    Attributes
    ----------
    offset_ns : int
        In force; 0 before the first observation.
    jumps : int
        Times that the offset changed at once.
    """

    def __init__(self) -> None:
        self.offset_ns = 0
        self.jumps = -1
        self._seen: collections.deque[int] = collections.deque(maxlen=_KEPT)
        self._last_ns = 0

    def observe(self, unit_ns: int, host_ns: int, on_the_way_ns: int = 0) -> None:
        """
        Take that the unit's clock showed `unit_ns` when the host's showed `host_ns`, on_the_way_ns before.

        on_the_way_ns: known delay, such as half of the time of an exchange, ns.
        """
        offset = host_ns - on_the_way_ns - unit_ns
        if self.jumps < 0 or abs(offset - self.offset_ns) > _JUMP_NS:
            self._seen.clear()
            self.jumps += 1
            self.offset_ns = offset
        self._seen.append(offset)
        best = min(self._seen)
        most = int(_SLEW * max(host_ns - self._last_ns, 0)) if self._last_ns else _JUMP_NS
        self.offset_ns += max(-most, min(most, best - self.offset_ns))
        self._last_ns = host_ns
