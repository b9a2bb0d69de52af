# SPDX-License-Identifier: Apache-2.0
"""Even grid of pressure values that grows at its end and drops its oldest values."""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.receiver.resampling import interpolate
from mwd_surface.receiver.strokes import Strokes

STEPS_PER_TU = 8
# Values after the last one wanted that the interpolation needs; without them a later call would give other results.
REACH = 4
# A gauge counts as frozen after this number of equal values in a row: four pulse widths without any noise.
_FROZEN = 8 * STEPS_PER_TU


class Grid:
    """
    Grid of pressure with `STEPS_PER_TU` values per TU, and the strokes of the pumps.

    Parameters
    ----------
    tu_s : float
        Time unit of the tool, s.
    """

    def __init__(self, tu_s: float) -> None:
        self.step_s = tu_s / STEPS_PER_TU
        self.origin_s = 0.0
        self.first = 0
        self.strokes = Strokes()
        self._values = np.zeros(0)
        self._known = np.zeros(0)
        self._same = 0

    @property
    def end(self) -> int:
        """Position after the last value."""
        return self.first + len(self._values)

    def append(self, values: Array, known: Array) -> None:
        """Append values; a gap is filled with the last known value. A gauge that is frozen counts as a gap."""
        filled, known = values.copy(), known.copy()
        last = self._values[-1] if len(self._values) else (values[known > 0.0][0] if np.any(known > 0.0) else 0.0)
        for k in range(len(filled)):
            if known[k] > 0.0:
                self._same = self._same + 1 if abs(filled[k] - last) <= 1e-12 * abs(last) else 0
                known[k] = float(self._same < _FROZEN)
                last = filled[k]
            else:
                filled[k] = last
        self._values = np.concatenate([self._values, filled])
        self._known = np.concatenate([self._known, known])

    def forget(self, before: int) -> None:
        """Drop the values before a position."""
        drop = min(max(before - self.first, 0), len(self._values))
        self._values, self._known = self._values[drop:], self._known[drop:]
        self.first += drop
        self.strokes.forget(self.seconds(self.first))

    def seconds(self, position: float) -> float:
        """Return the time of a position, s, on the clock of the pressure."""
        return self.origin_s + position * self.step_s

    def angles(self, position: float, pace: float, count: int) -> Array:
        """Return the crank angles of the pumps with counters, rad, shape (pumps, count); arguments as in `samples`."""
        at: Array = self.origin_s + (position + pace * np.arange(count, dtype=np.float64)) * self.step_s
        return self.strokes.angles(at)

    def samples(self, position: float, pace: float, count: int) -> tuple[Array, Array]:
        """
        Interpolate values between those of the grid.

        Parameters
        ----------
        position, pace : float
            Position of the first value, and distance from one value to the next, steps.
        count : int

        Returns
        -------
        ndarray, shape (count,)
            Pressure, Pa.
        ndarray, shape (count,)
            1 where the pressure is known, 0 in a gap.
        """
        out = np.empty(count)
        low = max(int(position) - self.first - 4, 0)
        high = min(int(position + pace * count) - self.first + 5, len(self._values))
        # Copy, so that the result has the same bits wherever the values lie in memory.
        interpolate(self._values[low:high].copy(), position - self.first - low, pace, out)
        nearest = np.rint(position + pace * np.arange(count)).astype(np.int64) - self.first
        inside = (nearest >= 0) & (nearest < len(self._known))
        known = np.where(inside, self._known[np.clip(nearest, 0, max(len(self._known) - 1, 0))], 0.0)
        return out, known
