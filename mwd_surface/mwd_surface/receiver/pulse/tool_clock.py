# SPDX-License-Identifier: Apache-2.0
"""Clock of the tool relative to that of the pressure: position of each sample of a transmission on the grid."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_surface.receiver.grid import STEPS_PER_TU
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU

# 1 sigma of the relative clock error of a good tool and of a poor one, and the shares of both; 1 sigma of its change
# from stretch to stretch with temperature.
_CLOCKS, _SHARES = (5e-4, 5e-3), (0.95, 0.05)
_CLOCK_WALK = 3e-5


@dataclasses.dataclass(frozen=True)
class ToolClock:
    """
    Positions of the samples of a transmission on the grid.

    Attributes
    ----------
    start : float
        Position of sample 0 on the grid, steps.
    pace : float
        Steps from one sample to the next.
    variance : float
        Variance of the relative error of the pace.
    """

    start: float
    pace: float = STEPS_PER_TU / SAMPLES_PER_TU
    variance: float = _CLOCKS[0] ** 2

    def at(self, sample: float) -> float:
        """Return the position of a sample on the grid, steps."""
        return self.start + sample * self.pace

    @property
    def error(self) -> float:
        """Relative error of the tool's clock; at 1e-3 the tool sends 0.1 % slower."""
        return self.pace * SAMPLES_PER_TU / STEPS_PER_TU - 1.0

    def turned(self, middle: float, change: float) -> ToolClock:
        """Return the clock with its pace changed by a share, keeping the position of the sample `middle`."""
        return dataclasses.replace(
            self, start=self.start - middle * self.pace * change, pace=self.pace * (1.0 + change)
        )

    def followed(self, timing: tuple[float, float, float], overlap: float | None) -> tuple[ToolClock, float]:
        """
        Return the clock after a measurement, and the relative change of its pace.

        Parameters
        ----------
        timing : (float, float, float)
            Relative drift of the pulses, its variance, and the sample about which it is measured.
        overlap : float or None
            Windows overlap: length of this window divided by its new part; only the new part counts as a measurement.
            None: the window holds all data so far, so it replaces earlier measurements.
        """
        drift, variance, middle = timing
        if overlap is None:
            error, left = _from_all(self.error + drift, variance)
        else:
            prior = self.variance + _CLOCK_WALK**2
            gain = prior / (prior + variance * overlap)
            error, left = self.error + gain * drift, prior * (1.0 - gain)
        change = error - self.error
        return dataclasses.replace(self.turned(middle, change), variance=left), change


def _from_all(measured: float, variance: float) -> tuple[float, float]:
    """Return the error of a clock and its variance from a single measurement, with a mixture of two priors."""
    sigmas, shares = np.square(_CLOCKS), np.array(_SHARES)
    total = sigmas + variance
    logs = np.log(shares) - 0.5 * (np.log(total) + measured**2 / total)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    gains = sigmas / total
    mean = float(weights @ gains) * measured
    spread = float(weights @ (gains * measured - mean) ** 2)
    return mean, float(weights @ (gains * variance)) + spread
