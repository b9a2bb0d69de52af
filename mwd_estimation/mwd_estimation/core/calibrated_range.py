# SPDX-License-Identifier: Apache-2.0
"""Temperatures at which the tool was calibrated, and what its sensors may be off beyond them."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array

# A thermometer that reads more than this beyond the range is at fault itself, degC.
_MOST = 100.0


@dataclasses.dataclass(frozen=True)
class CalibratedRange:
    """
    Range of calibration, and growth of the sensors' bias beyond it.

    A bias that calibration has brought to zero at all temperatures of a range departs from it with distance, to first
    order in proportion; the slope of a unit is not known, only its size: it is the 1 sigma.
    """

    #: `low_c`, `high_c`: degC.
    low_c: float = -273.0
    high_c: float = 1000.0
    #: `accelerometer_mps2_per_c`, `magnetometer_t_per_c`: 1 sigma of the slope of the bias of each axis, m/s^2/degC and
    #: T/degC.
    accelerometer_mps2_per_c: float = 0.0
    magnetometer_t_per_c: float = 0.0

    def beyond(self, celsius: float | None) -> float:
        """Distance to the range, degC, at most 100; 0 inside and where the temperature is not known."""
        if celsius is None or not np.isfinite(celsius):
            return 0.0
        return min(max(self.low_c - celsius, celsius - self.high_c, 0.0), _MOST)

    def variances(self, celsius: float | None) -> tuple[float, float]:
        """Variance of each axis of force and field at a temperature, (m/s^2)^2 and T^2."""
        beyond = self.beyond(celsius)
        return (self.accelerometer_mps2_per_c * beyond) ** 2, (self.magnetometer_t_per_c * beyond) ** 2


class TemperatureWatch:
    """
    What temperatures beyond the range came.

    Attributes
    ----------
    last : float or None
        The last temperature, degC; None while there was none.
    outside : (float, float) or None
        Lowest and highest of those beyond the range, degC; None while there was none.
    """

    def __init__(self, calibrated: CalibratedRange) -> None:
        self._range = calibrated
        self.last: float | None = None
        self.outside: tuple[float, float] | None = None

    def take(self, celsius: Array) -> None:
        """Take temperatures, shape (n,), degC; what is not finite is left out."""
        good = celsius[np.isfinite(celsius)]
        if not len(good):
            return
        self.last = float(good[-1])
        beyond = good[(good < self._range.low_c) | (good > self._range.high_c)]
        if len(beyond):
            known = [*beyond.tolist(), *(self.outside or ())]
            self.outside = min(known), max(known)

    @property
    def outside_now(self) -> bool:
        """Whether the last temperature is beyond the range."""
        return self._range.beyond(self.last) > 0.0
