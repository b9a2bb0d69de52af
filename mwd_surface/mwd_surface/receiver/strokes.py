# SPDX-License-Identifier: Apache-2.0
"""Pump strokes of a counter: the crank angle of each pump at any time."""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Array

# A pump whose strokes pause for so many times their usual interval stands, or its switch failed.
_PAUSE = 2.5
_LEAST = 8  # strokes that tell a pump's rate
# Level of significance at which a line is said to be a pump's.
_BY_CHANCE = 0.05


class Strokes:
    """Times of the strokes of some pumps, which grow."""

    def __init__(self) -> None:
        self._times: dict[int, Array] = {}

    def add(self, pump: int, time_s: Array) -> None:
        """
        Take strokes of a pump.

        Parameters
        ----------
        pump : int
            Its number.
        time_s : ndarray, shape (n,)
            On the clock of the pressure, rising. A time that does not rise, or is not finite, is left out.
        """
        before = self._times.get(pump, np.zeros(0))
        time = np.asarray(time_s, dtype=float)
        time = time[np.isfinite(time)]
        last = before[-1] if len(before) else -np.inf
        highest = np.maximum.accumulate(np.concatenate([[last], time]))[:-1]
        self._times[pump] = np.concatenate([before, time[time > highest]])

    def forget(self, before_s: float) -> None:
        """Drop strokes before a time."""
        for pump, time in self._times.items():
            self._times[pump] = time[max(int(np.searchsorted(time, before_s)) - 1, 0) :]

    def rates(self, from_s: float, until_s: float) -> dict[int, float]:
        """Strokes a second of each pump between two times, s; a pump that stands is left out."""
        rows = {}
        for pump in sorted(self._times):
            time = self._times[pump]
            inside = time[(time >= from_s) & (time <= until_s)]
            if len(inside) >= _LEAST:
                rows[pump] = (len(inside) - 1) / float(inside[-1] - inside[0])
        return rows

    def harmonic(self, line_hz: float, from_s: float, until_s: float) -> tuple[int, int] | None:
        """
        Pump whose harmonic is nearest to a line heard between two times, s, and which harmonic, from 1.

        None where some line that no pump makes would often be as near: harmonics of several pumps are close together.
        """
        rates = self.rates(from_s, until_s)
        near = [(abs(line_hz - max(round(line_hz / rate), 1) * rate), pump) for pump, rate in rates.items()]
        if not near:
            return None
        apart, pump = min(near)
        # The share of all frequencies that lie as near to a harmonic of one of the pumps.
        if 2.0 * apart * sum(1.0 / rate for rate in rates.values()) > _BY_CHANCE:
            return None
        return pump, max(round(line_hz / rates[pump]), 1)

    def angles(self, time_s: Array) -> Array:
        """
        Crank angles.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Rising, s. Strokes after the last of them are not used, so that it does not matter when they come.

        Returns
        -------
        ndarray, shape (pumps, n)
            Radians, a whole turn a stroke; nan where a pump stands or is not known.
        """
        rows = []
        for pump in sorted(self._times):
            time = self._times[pump]
            time = time[time <= time_s[-1]]
            inside = time[time >= time_s[0]]
            if len(inside) < _LEAST:
                continue
            usual = float(np.median(np.diff(inside)))
            # Behind the last stroke the pump is taken to run on for one more.
            known = np.append(time, time[-1] + usual)
            angle = 2.0 * np.pi * np.interp(time_s, known, np.arange(len(known)), left=np.nan, right=np.nan)
            at = np.clip(np.searchsorted(known, time_s, side="right"), 1, len(known) - 1)
            rows.append(np.where(known[at] - known[at - 1] < _PAUSE * usual, angle, np.nan))
        return np.array(rows).reshape(-1, len(time_s))
