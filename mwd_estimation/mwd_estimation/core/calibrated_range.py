# SPDX-License-Identifier: Apache-2.0
"""Temperature range in which the tool was calibrated, and the expected errors of its sensors outside this range."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array

# Upper limit of the difference between a temperature and the calibrated range, degC; a thermometer that shows a larger
# difference must be faulty.
_MOST = 100.0


@dataclasses.dataclass(frozen=True)
class CalibratedRange:
    """
    Temperature range of the calibration, and how fast the biases of the sensors grow outside it.

    Calibration brings the bias to zero at all temperatures of the range. Outside the range the bias grows, to first
    order, in proportion to the distance. The slope of a particular unit is unknown; only its usual size is known, which
    is given here as 1 sigma.
    """

    #: `low_c`, `high_c`: lowest and highest temperature of the calibration, degC.
    low_c: float = -273.0
    high_c: float = 1000.0
    #: `accelerometer_mps2_per_c`, `magnetometer_t_per_c`: 1 sigma of the slope of the bias of each axis, m/s^2/degC and
    #: T/degC.
    accelerometer_mps2_per_c: float = 0.0
    magnetometer_t_per_c: float = 0.0

    def beyond(self, celsius: float | None) -> float:
        """Return the distance of a temperature from the range, degC, at most 100; 0 if inside or unknown."""
        if celsius is None or not np.isfinite(celsius):
            return 0.0
        return min(max(self.low_c - celsius, celsius - self.high_c, 0.0), _MOST)

    def variances(self, celsius: float | None) -> tuple[float, float]:
        """Return the variance added to each axis of force and field at a temperature, (m/s^2)^2 and T^2."""
        beyond = self.beyond(celsius)
        return (self.accelerometer_mps2_per_c * beyond) ** 2, (self.magnetometer_t_per_c * beyond) ** 2


class TemperatureWatch:
    """
    Record of the temperatures of the tool, and of those outside the range of the calibration.

    Attributes
    ----------
    last : float or None
        The last temperature, degC; None before the first.
    outside : (float, float) or None
        Lowest and highest temperature outside the range so far, degC; None if there was none.
    """

    def __init__(self, calibrated: CalibratedRange) -> None:
        self._range = calibrated
        self.last: float | None = None
        self.outside: tuple[float, float] | None = None

    def take(self, celsius: Array) -> None:
        """Add temperatures, shape (n,), degC; values that are not finite are ignored."""
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
        """Whether the last temperature is outside the range."""
        return self._range.beyond(self.last) > 0.0
