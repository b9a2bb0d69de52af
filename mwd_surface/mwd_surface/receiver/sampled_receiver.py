# SPDX-License-Identifier: Apache-2.0
"""Common base of receivers of sampled signals: resample onto an even grid, then decode up to the end of the grid."""

from __future__ import annotations

import abc

from mwd_sensors.core.arrays import Array
from mwd_surface.receiver.grid import STEPS_PER_TU, Grid
from mwd_surface.receiver.resampling import Resampler
from mwd_surface.receiver.words import Reception

_PIECE = 4096


class SampledReceiver(abc.ABC):
    """
    Base of receivers of pressure or voltage.

    Parameters
    ----------
    step_s : float
        Step of the grid.
    """

    def __init__(self, step_s: float) -> None:
        self._grid, self._resampler = Grid(STEPS_PER_TU * step_s), Resampler(step_s)

    def push(self, time_s: Array, value: Array) -> Reception:
        """
        Add samples; return the words and frames that they complete.

        Parameters
        ----------
        time_s, value : ndarray, shape (n,)
            Rising times and pressures, Pa, or voltages, V.

        Raises
        ------
        ValueError
            The samples are too far apart for the tool's signal.
        """
        return self._take(*self._resampler.push(time_s, value))

    def strokes(self, pump: int, time_s: Array) -> None:
        """
        Add the counted strokes of a pump, which serve to remove pump noise and to name lines on a carrier.

        Words do not depend on strokes later than their pressure. To get reproducible words, add the strokes up to a
        time before the pressure of that time, as `decode` does.

        Parameters
        ----------
        pump : int
            Number of the pump.
        time_s : ndarray, shape (n,)
            Rising times, on the clock of the pressure.
        """
        self._grid.strokes.add(pump, time_s)

    def _take(self, values: Array, known: Array) -> Reception:
        """
        Add values of the grid; return the words and frames that they complete. known, shape (n,): 0 in a gap.

        Raises ValueError at the first values if the samples are too far apart.
        """
        done = Reception()
        if len(values) == 0:
            return done
        if self._grid.end == 0:
            self._grid.origin_s = self._resampler.origin or 0.0
            self._check(self._resampler.spacing)
        # Work in pieces to limit memory; the steps depend on positions only, not on the pieces.
        for start in range(0, len(values), _PIECE):
            self._grid.append(values[start : start + _PIECE], known[start : start + _PIECE])
            self._advance(done)
        return done

    @abc.abstractmethod
    def _check(self, spacing_s: float) -> None:
        """Raise ValueError if the samples are too far apart."""

    @abc.abstractmethod
    def _advance(self, done: Reception) -> None:
        """Run all steps for which the samples have arrived, and add their words and frames to `done`."""
