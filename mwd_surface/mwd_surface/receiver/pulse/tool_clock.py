# SPDX-License-Identifier: Apache-2.0
"""The clock of the tool against that of the pressure: where each sample of a transmission lies on the grid."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_surface.receiver.grid import STEPS_PER_TU
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU

# 1 sigma of a tool's clock in order, and of one of twenty that is not; of its change from stretch to stretch with the
# temperature.
_CLOCKS, _SHARES = (5e-4, 5e-3), (0.95, 0.05)
_CLOCK_WALK = 3e-5


@dataclasses.dataclass(frozen=True)
class ToolClock:
    """
    Where samples of a transmission lie.

    Attributes
    ----------
    start : float
        Position of sample 0 on the grid, steps.
    pace : float
        Steps from one sample to the next.
    variance : float
        Of the relative error of the pace.
    """

    start: float
    pace: float = STEPS_PER_TU / SAMPLES_PER_TU
    variance: float = _CLOCKS[0] ** 2

    def at(self, sample: float) -> float:
        """Position of a sample on the grid, steps."""
        return self.start + sample * self.pace

    @property
    def error(self) -> float:
        """Relative error of the tool's clock: 1e-3 sends 0.1 % slower."""
        return self.pace * SAMPLES_PER_TU / STEPS_PER_TU - 1.0

    def turned(self, middle: float, change: float) -> ToolClock:
        """Clock with a pace changed by a share, the sample `middle` staying where it is."""
        return dataclasses.replace(
            self, start=self.start - middle * self.pace * change, pace=self.pace * (1.0 + change)
        )

    def followed(self, timing: tuple[float, float, float], overlap: float | None) -> tuple[ToolClock, float]:
        """
        Clock after a measurement, and the relative change of its pace.

        Parameters
        ----------
        timing : (float, float, float)
            Relative drift of the pulses, its variance, and the sample about which it turns.
        overlap : float or None
            Windows overlap: length of this one over what of it is new. Only that share counts as a measurement. None:
            the window holds all that was heard, so it replaces the measurements before.
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
    """Error of a clock of which one measurement holds all that is known, and its variance: a mixture of two priors."""
    sigmas, shares = np.square(_CLOCKS), np.array(_SHARES)
    total = sigmas + variance
    logs = np.log(shares) - 0.5 * (np.log(total) + measured**2 / total)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    gains = sigmas / total
    mean = float(weights @ gains) * measured
    spread = float(weights @ (gains * measured - mean) ** 2)
    return mean, float(weights @ (gains * variance)) + spread
