# SPDX-License-Identifier: Apache-2.0
"""
Bit depth by the travelling block, where rig data give none.

Out of the slips the string hangs on the block: the bit goes down by what the block goes down. In the slips it stands,
whatever the block does. What moves within the one reading in which the slips are set or pulled is not known and counts
as nothing, so that the depth drifts by centimetres to a decimetre a stand; a depth of the rig or of a person ends it.
"""

from __future__ import annotations

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS, RIG_VALID

_BIT_DEPTH = RIG_VALID["bit_depth"]
_MOVES = RIG_VALID["block_position"] | RIG_VALID["in_slips"]
_LONGEST = 5.0  # s between two readings; over a longer gap the slips may have been set and pulled
# A block falls at 3 m/s at most; what leaps farther is an encoder that was reset.
_FASTEST, _SLACK = 3.0, 0.5  # m/s, m


class BlockTrack:
    """
    Depth from the last one that rig or person gave on.

    Attributes
    ----------
    depth : float or None
        Bit depth, m, after the last reading; None: it was never given, or the block was lost since.
    """

    def __init__(self) -> None:
        self.depth: float | None = None
        # Stamp, block position and slips of the last reading; None where the depth begins at the next one.
        self._last: tuple[int, float, bool] | None = None
        self._begins = False

    def start(self, bit_depth: float) -> None:
        """Begin at a depth, m, that holds until the block is read next."""
        self.depth, self._last, self._begins = bit_depth, None, True

    def carry(self, samples: Samples) -> Samples:
        """
        Return rig data, `wire.RIG_STATE`, with a bit depth also where block and slips give one; marked valid.

        The data are those of one source, or of one after the other, oldest first; they are not changed in place.
        """
        filled = samples
        for k, row in enumerate(samples):
            valid = int(row["valid"])
            known = valid & _MOVES == _MOVES
            reading = (int(row["stamp_ns"]), float(row["block_position"]), bool(row["in_slips"])) if known else None
            if valid & _BIT_DEPTH:
                self.depth, self._begins = float(row["bit_depth"]), False
            elif reading is not None and self.depth is not None:
                self.depth = self._moved(self.depth, reading)
                if self.depth is not None:
                    filled = samples.copy() if filled is samples else filled
                    filled["bit_depth"][k] = self.depth
                    filled["valid"][k] |= _BIT_DEPTH
            elif not self._begins:
                self.depth = None
            self._last, self._begins = reading, self._begins and reading is None
        return filled

    def _moved(self, depth: float, reading: tuple[int, float, bool]) -> float | None:
        """Depth at a reading from that at the one before; None where what happened between them is not known."""
        if self._begins:
            return depth
        if self._last is None:
            return None
        span, rise = (reading[0] - self._last[0]) / NANOSECONDS, reading[1] - self._last[1]
        if not 0.0 < span <= _LONGEST or abs(rise) > _FASTEST * span + _SLACK:
            return None
        return depth if reading[2] or self._last[2] else depth - rise
