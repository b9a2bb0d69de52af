# SPDX-License-Identifier: Apache-2.0
"""The clock of the tool against that of the pressure: where each sample of a transmission lies on the grid."""

from __future__ import annotations

import dataclasses

from mwd_surface.receiver.channel_estimate import SAMPLES_PER_TU
from mwd_surface.receiver.grid import STEPS_PER_TU

# 1 sigma of a tool's clock (0.1 % is the worst), and of its change from stretch to stretch with the temperature.
_CLOCK, _CLOCK_WALK = 5e-4, 3e-5


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
    variance: float = _CLOCK**2

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
            prior, before = _CLOCK**2, 0.0
        else:
            prior, before = self.variance + _CLOCK_WALK**2, self.error
            variance *= overlap
        gain = prior / (prior + variance)
        change = gain * drift - (1.0 - gain) * (self.error - before)
        turned = self.turned(middle, change)
        return dataclasses.replace(turned, variance=prior * (1.0 - gain)), change
