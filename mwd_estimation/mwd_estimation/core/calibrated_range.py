# SPDX-License-Identifier: Apache-2.0
"""Temperature range in which the tool was calibrated, and the expected errors of its sensors outside this range."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.constants import STANDARD_GRAVITY

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
    """Record of the temperatures of the tool, and of those outside the range of the calibration."""

    def __init__(self, calibrated: CalibratedRange) -> None:
        self._range = calibrated
        self.last: float | None = None  #: the last temperature, degC; None before the first
        #: Lowest and highest temperature outside the range so far, degC; None if there was none.
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


# Sigmas of the continuous attitude while the tool is outside the temperature range of its calibration.


class HeatedSigmas:
    """
    Increase of the sigmas of attitude rows by the biases that are expected at the temperature of the tool.

    The temperature of a row is the last temperature measured before the row. Without a temperature the sigmas stay
    unchanged.
    """

    def __init__(self, calibrated: CalibratedRange) -> None:
        self._calibrated = calibrated
        self._stamps: Stamps = np.empty(0, dtype=np.int64)
        self._beyond: Array = np.empty(0)
        self._newest_ns = np.iinfo(np.int64).min

    def take(self, stamps: Stamps, celsius: Array) -> None:
        """Add temperatures, degC, shape (n,), with their stamps, ns; values that are not finite are ignored."""
        good = np.isfinite(celsius)
        beyond = [self._calibrated.beyond(value) for value in celsius[good].tolist()]
        joined = np.concatenate([self._stamps, stamps[good]])
        order = np.argsort(joined, kind="stable")
        self._stamps, self._beyond = joined[order], np.concatenate([self._beyond, beyond])[order]

    def widen(self, attitude: Samples, gravity: Samples, reference: Reference | None) -> None:
        """
        Increase the sigmas of rows in place by the bias expected at the temperature of the tool.

        While the tool turns, part of the error averages out. This effect is ignored: the sigmas are then too large.

        Parameters
        ----------
        attitude, gravity : ndarray, shape (n,)
            Rows of the same samples, dtypes `wire.ATTITUDE` and `wire.GRAVITY`.
        reference : Reference or None
            Reference field. Without it the sigmas of azimuth and magnetic toolface stay unchanged, because the
            horizontal field is unknown.
        """
        # A row whose stamp goes back gets the temperature of the newest stamp so far, so that the result does not
        # depend on how the stream is cut into blocks.
        stamps = np.maximum(np.maximum.accumulate(attitude["stamp_ns"]), self._newest_ns)
        self._newest_ns = int(stamps.max(initial=self._newest_ns))
        place = np.searchsorted(self._stamps, stamps, side="right") - 1
        beyond = np.where(place >= 0, self._beyond[place], 0.0) if len(self._stamps) else np.zeros(len(stamps))
        kept = max(int(place.max(initial=0)), 0)
        self._stamps, self._beyond = self._stamps[kept:], self._beyond[kept:]
        if not beyond.any():
            return
        tilt = self._calibrated.accelerometer_mps2_per_c * beyond / STANDARD_GRAVITY
        _widen(attitude, "sigma_inclination", tilt)
        _widen(gravity, "sigma", tilt)
        with np.errstate(divide="ignore", invalid="ignore"):
            _widen(attitude, "sigma_gravity_toolface", tilt / np.abs(np.sin(attitude["inclination"])))
        if reference is not None and reference.total is not None and reference.dip is not None:
            # A tilted tool measures part of the vertical field as horizontal.
            field = self._calibrated.magnetometer_t_per_c * beyond / (reference.total * math.cos(reference.dip))
            azimuth = np.hypot(field, tilt * math.tan(reference.dip))
            _widen(attitude, "sigma_azimuth", azimuth)
            _widen(attitude, "sigma_magnetic_toolface", azimuth)


def _widen(rows: Samples, name: str, sigma: Array) -> None:
    """Add a sigma, rad, shape (n,), in quadrature to the column `name`, up to pi; a NaN in the column stays NaN."""
    rows[name] = np.minimum(np.hypot(rows[name], np.where(np.isnan(sigma), 0.0, sigma)), math.pi)
