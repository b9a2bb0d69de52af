# SPDX-License-Identifier: Apache-2.0
"""Even grid of pressure that grows at its end and drops its oldest values, and crank angles from pump strokes."""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_surface.receiver.resampling import interpolate
from mwd_surface.receiver.whitening import median

STEPS_PER_TU = 8
# Number of values after a position that the interpolation needs; with fewer values the result would change later.
REACH = 4
# A gauge counts as frozen after this number of equal values in a row: four pulse widths without any noise.
_FROZEN = 8 * STEPS_PER_TU


class Grid:
    """
    Grid of pressure with `STEPS_PER_TU` values per TU, and the strokes of the pumps.

    Parameters
    ----------
    tu_s : float
        Time unit of the tool.
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
        """Position (number of the value since the start) after the last value."""
        return self.first + len(self._values)

    def append(self, values: Array, known: Array) -> None:
        """
        Append values, shape (n,); known: 1 where a value was measured, 0 in a gap.

        A gap is filled with the last known value. Values of a frozen gauge count as a gap.
        """
        filled, known = values.copy(), known.copy()
        last = self._values[-1] if len(self._values) else (values[known > 0.0][0] if np.any(known > 0.0) else 0.0)
        self._same = _fill(filled, known, float(last), self._same)
        self._values = np.concatenate([self._values, filled])
        self._known = np.concatenate([self._known, known])

    def forget(self, before: int) -> None:
        """Drop the values and the strokes before position `before`."""
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
        Return the pressure at even positions between the values of the grid, by interpolation.

        Parameters
        ----------
        position, pace : float
            Position of the first value, and distance from one value to the next, steps.

        Returns
        -------
        ndarray, shape (count,)
            Pressure, Pa.
        ndarray, shape (count,)
            1 where the pressure is known, 0 in a gap.
        """
        out, known = np.empty(count), np.empty(count)
        low = max(int(position) - self.first - 4, 0)
        high = min(int(position + pace * count) - self.first + 5, len(self._values))
        # Copy, so that the result has the same bits wherever the values lie in memory.
        interpolate(self._values[low:high].copy(), position - self.first - low, pace, out)
        _nearest(self._known, self.first, position, pace, known)
        return out, known


@compiled
def _nearest(known: Array, first: int, position: float, pace: float, out: Array) -> None:
    """Fill `out` with the nearest of the values `known` from the position `first` on, 0 beyond; see `Grid.samples`."""
    for k in range(len(out)):
        at = round(position + pace * k) - first
        out[k] = known[at] if 0 <= at < len(known) else 0.0


@compiled
def _fill(values: Array, known: Array, last: float, same: int) -> int:
    """
    Fill gaps with the last known value, and set the known values of a frozen gauge to unknown, in place.

    last: known value before these values; same: number of known values so far that equal the value before them, in a
    row. Return this number after these values.
    """
    for k in range(len(values)):
        if known[k] > 0.0:
            same = same + 1 if abs(values[k] - last) <= 1e-12 * abs(last) else 0
            known[k] = 1.0 if same < _FROZEN else 0.0
            last = values[k]
        else:
            values[k] = last
    return same


# Crank angle of each pump at any time, from counted strokes.


# Longest interval between two strokes of a running pump, in usual intervals; in a longer pause the pump stands or its
# switch has failed. A counter that misses 5 % of the strokes misses two in a row every few minutes, and four in a row
# hardly ever.
_PAUSE = 4.5
_LEAST = 8  # smallest number of strokes to determine the rate of a pump
# Widths of the smoothing of strokes that are tried, 1 sigma, strokes.
_SMOOTHED = (1.0, 2.0, 4.0, 8.0)
# Significance level at which a line is attributed to a pump.
_BY_CHANCE = 0.05


class Strokes:
    """Stroke times of several pumps, from which rates, harmonics and crank angles follow."""

    def __init__(self) -> None:
        self._times: dict[int, Array] = {}

    def add(self, pump: int, time_s: Array) -> None:
        """
        Add strokes of a pump.

        Parameters
        ----------
        pump : int
            Number of the pump.
        time_s : ndarray, shape (n,)
            Times on the clock of the pressure, in any order: a wrong time must not exclude the right ones after it. A
            time that is known already or is not finite is dropped.
        """
        time = np.asarray(time_s, dtype=float)
        self._times[pump] = np.union1d(self._times.get(pump, np.zeros(0)), time[np.isfinite(time)])

    def forget(self, before_s: float) -> None:
        """Drop the strokes before a time, s, except the last of each pump."""
        for pump, time in self._times.items():
            self._times[pump] = time[max(int(np.searchsorted(time, before_s)) - 1, 0) :]

    def rates(self, from_s: float, until_s: float) -> dict[int, float]:
        """Return the strokes per second of each pump between two times, s; pumps with few strokes are left out."""
        rows = {}
        for pump in sorted(self._times):
            time = self._times[pump]
            inside = time[(time >= from_s) & (time <= until_s)]
            if len(inside) >= _LEAST:
                rows[pump] = (len(inside) - 1) / float(inside[-1] - inside[0])
        return rows

    def harmonic(self, line_hz: float, from_s: float, until_s: float) -> tuple[int, int] | None:
        """
        Return the pump whose harmonic is nearest to a line between two times, s, and the harmonic's number, from 1.

        Return None if a random line would often be as near, because harmonics of several pumps lie close together.
        """
        rates = self.rates(from_s, until_s)
        near = [(abs(line_hz - max(round(line_hz / rate), 1) * rate), pump) for pump, rate in rates.items()]
        if not near:
            return None
        apart, pump = min(near)
        # Share of all frequencies whose distance from a harmonic of any pump is at most the distance of this line.
        if 2.0 * apart * sum(1.0 / rate for rate in rates.values()) > _BY_CHANCE:
            return None
        return pump, max(round(line_hz / rates[pump]), 1)

    def angles(self, time_s: Array) -> Array:
        """
        Return the crank angles of the pumps.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Rising times. Strokes after the last time are not used, so the result does not depend on when they
            arrive.

        Returns
        -------
        ndarray, shape (pumps, n)
            Crank angles, rad, one turn per stroke, for the pumps with at least `_LEAST` strokes between the first and
            the last time; NaN where such a pump stands or its strokes are missing.
        """
        rows = []
        for pump in sorted(self._times):
            time = self._times[pump]
            time = time[time <= time_s[-1]]
            inside = time[time >= time_s[0]]
            if len(inside) < _LEAST:
                continue
            usual = median(np.diff(inside))
            # After its last known stroke a pump is assumed to run on for some more intervals.
            known = np.append(time, time[-1] + math.floor(_PAUSE) * usual)
            # A missed stroke leaves an interval of two turns.
            turns = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(known) / usual), 1.0))])
            rows.append(_angle(time_s, _without_jitter(known, turns), turns, _PAUSE * usual))
        return np.array(rows).reshape(-1, len(time_s))


@compiled
def _angle(at: Array, strokes: Array, turns: Array, pause: float) -> Array:
    """
    Return the crank angle, rad, at rising times, s, shape (n,); NaN before the first and after the last stroke.

    strokes, turns, shape (k,): times, s, of the strokes and their turns. The angle is NaN between strokes that are at
    least `pause`, s, apart.
    """
    out = np.full(len(at), np.nan)
    j = 0
    for i in range(len(at)):
        while j < len(strokes) - 2 and strokes[j + 1] <= at[i]:
            j += 1
        gap = strokes[j + 1] - strokes[j]
        if strokes[0] <= at[i] <= strokes[-1] and 0.0 < gap < pause:
            out[i] = 2.0 * math.pi * ((turns[j + 1] - turns[j]) / gap * (at[i] - strokes[j]) + turns[j])
    return out


@compiled
def _local_line(time: Array, turns: Array, sigma: float, smoothed: Array, others: Array) -> None:
    """
    Fill the time of each stroke on a Gaussian-weighted line through the times near it, s.

    turns: number of each stroke. sigma: 1 sigma of the weights, strokes. smoothed: the line includes the stroke itself;
    others: the line is without the stroke.
    """
    reach = math.ceil(2.5 * sigma)
    falls = np.exp(-0.5 * (np.arange(4 * reach) / sigma) ** 2)
    for k in range(len(time)):
        s0 = s1 = s2 = t0 = t1 = 0.0
        for j in range(max(k - reach, 0), min(k + reach + 1, len(time))):
            x, y = turns[j] - turns[k], time[j] - time[k]
            # After missed strokes, a stroke can be so far away that its weight is 0.
            if j != k and abs(x) < len(falls):
                g = falls[int(abs(x))]
                s0 += g
                s1 += g * x
                s2 += g * x * x
                t0 += g * y
                t1 += g * x * y
        # The stroke itself has x = y = 0 and weight 1, so it changes only the sum of the weights, s0.
        others[k] = time[k] + (s2 * t0 - s1 * t1) / max(s0 * s2 - s1 * s1, 1e-12)
        smoothed[k] = time[k] + (s2 * t0 - s1 * t1) / max((s0 + 1.0) * s2 - s1 * s1, 1e-12)


@compiled
def _without_jitter(time: Array, turns: Array) -> Array:
    """
    Return stroke times smoothed by a local line; shape (n,).

    The width of the smoothing is the one that predicts each stroke best from the strokes around it: wide if the
    counter has much jitter, narrow if the pump changes its rate.
    """
    smoothed, others, best, least = np.empty(len(time)), np.empty(len(time)), time.copy(), np.inf
    for sigma in _SMOOTHED:
        _local_line(time, turns, sigma, smoothed, others)
        error = np.median(np.abs(time - others))
        if error < least:
            best[:], least = smoothed, error
    for k in range(1, len(best)):
        best[k] = max(best[k], best[k - 1])
    return best
