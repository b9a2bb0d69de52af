# SPDX-License-Identifier: Apache-2.0
"""
Gate at the input of the estimator: it replaces values that the sensor cannot measure by NaN.

The physical range of a sensor is stated in its data sheet (`settings.tool`). A value within the range is an ordinary
reading. A value between the range and the gate is a reading of a clipped sensor: converters work up to 15 % beyond the
range of the data sheet (an ST LSM6 with a range of 2000 deg/s reads up to 2293 deg/s), and a scale correction adds a
few per cent. The stages treat such a value as clipped at the end of the range. A value beyond the gate is not a
measurement. It becomes NaN, so that the output is the same, bit for bit, as for a missing value, whatever number was
sent.

If a sensor sends another unit of measurement (nT instead of T), all its values are beyond the gate. They are not used
either, but their sizes are kept (`Refused`), so that the health checks can name the unit of measurement.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

# Ratio of the gate to the range. Converters exceed the range by up to 15 %, and a scale correction adds a few per cent.
MARGIN = 1.25
# Widest gates, rad/s, m/s^2, T, for a range that is unknown or set wider: 1900 r/min; 400 g; and 100 times the field of
# a magnetised drill string.
_FASTEST, _STRONGEST_FORCE, _STRONGEST_FIELD = 200.0, 4000.0, 0.01
# Gate of the accelerometers of the precision unit, m/s^2. The settings give no range; none measures more than 60 g.
_STRONGEST_PRECISION = 1000.0
# Gate of temperatures, degC: from cold storage to the hottest wells, with a margin.
_COLDEST, _HOTTEST = -100.0, 400.0
# Factors from SI to the units of measurement that a sensor may send instead: deg/s; nT, which has the largest factor.
_OTHER_RATE, _OTHER_FIELD = math.degrees(1.0), 1e9
# Gate of the flow, m^3/s. No pump moves more mud; in a 5 in pipe it would flow at 100 m/s.
_MOST_FLOW = 1.0
# Numbers of the sensors in `Refused`.
GYRO, ACCEL, MAG, PRECISION_GYRO, PRECISION_ACCEL = range(5)
# Largest number of refused readings kept: three seconds of three streams at 2 kHz.
_MOST_KEPT = 20_000


class Refused:
    """A reading beyond the gate that may be a correct value in another unit of measurement."""

    stamp_ns: int
    sensor: int  #: GYRO, ACCEL, MAG, PRECISION_GYRO or PRECISION_ACCEL
    size: float  #: length of the vector, in the unit in which it was sent


REFUSED = dtype_of(Refused)


class Ranges(NamedTuple):
    """Ends of the measuring ranges in the data sheets, rad/s, m/s^2 and T; inf if unknown."""

    gyro: float = math.inf
    accel: float = math.inf
    mag: float = math.inf
    precision_gyro: float = math.inf


class InputGate:
    """
    The gate of one tool.

    Samples must be in the axes of their own sensor unit, because a range belongs to an axis of a sensor. Each method
    returns the samples themselves if the gate changes no value, otherwise a changed copy. Refused readings that may be
    in another unit of measurement are kept for `take_refused`.

    ranges : Ranges
        Measuring ranges of the sensors.
    """

    def __init__(self, ranges: Ranges) -> None:
        full = (*ranges, math.inf)
        caps = (_FASTEST, _STRONGEST_FORCE, _STRONGEST_FIELD, _FASTEST, _STRONGEST_PRECISION)
        #: Gates of the sensors, rad/s, m/s^2 and T, in the order of the sensor numbers.
        self.limits = tuple(min(MARGIN * end, cap) for end, cap in zip(full, caps, strict=True))
        self._refused = np.zeros(0, dtype=REFUSED)

    def imu(self, samples: Samples) -> Samples:
        """Return samples of the conventional unit (all or some fields of `wire.IMU`), with NaN beyond the gate."""
        samples = self._vector(samples, "angular_velocity", GYRO)
        return self._vector(samples, "linear_acceleration", ACCEL)

    def mag(self, samples: Samples) -> Samples:
        """Return samples of the magnetometer (dtype of `wire.MAG`), with NaN beyond the gate."""
        return self._vector(samples, "magnetic_field", MAG)

    def precision(self, samples: Samples) -> Samples:
        """Return samples of the precision unit (fields of `wire.IMU`), with NaN beyond the gate."""
        samples = self._vector(samples, "angular_velocity", PRECISION_GYRO)
        return self._vector(samples, "linear_acceleration", PRECISION_ACCEL)

    def temperature(self, samples: Samples) -> Samples:
        """Return temperatures (dtype of `wire.TEMPERATURE`), with NaN beyond the gate."""
        celsius = samples["temperature"][:, None]
        if not _count(celsius, _COLDEST, _HOTTEST):
            return samples
        samples = samples.copy()
        _apply(samples["temperature"][:, None], _COLDEST, _HOTTEST)
        return samples

    def take_refused(self) -> Samples:
        """Return and forget the refused readings that may be in another unit of measurement, dtype REFUSED, (k,)."""
        refused, self._refused = self._refused, np.zeros(0, dtype=REFUSED)
        return refused

    def _vector(self, samples: Samples, name: str, sensor: int) -> Samples:
        limit = self.limits[sensor]
        if not _count(samples[name], -limit, limit):
            return samples
        samples = samples.copy()
        sizes = _apply(samples[name], -limit, limit)
        other = {GYRO: _OTHER_RATE, PRECISION_GYRO: _OTHER_RATE, MAG: _OTHER_FIELD}.get(sensor, 0.0)
        readings = sizes <= other * limit
        if readings.any():
            refused = np.zeros(int(readings.sum()), dtype=REFUSED)
            refused["stamp_ns"], refused["sensor"] = samples["stamp_ns"][readings], sensor
            refused["size"] = sizes[readings]
            self._refused = kept(self._refused, refused)
        return samples


def flow(samples: Samples) -> Samples:
    """Return the flow samples (dtype of `wire.TOOL_FLOW`) up to `_MOST_FLOW` in size; the others are dropped."""
    readings: Samples = samples[np.abs(samples["flow"]) <= _MOST_FLOW]
    return readings


def kept(held: Samples, more: Samples) -> Samples:
    """Return the newest `_MOST_KEPT` of the earlier and the new refused readings (dtype REFUSED)."""
    return np.concatenate([held, more])[-_MOST_KEPT:]


@compiled
def sizes_of(refused: Samples, sensor: int, start_ns: int, end_ns: int) -> Array:
    """
    Return the lengths of the refused vectors of a sensor with stamps in [start_ns, end_ns), sorted, shape (k,).

    Lengths are in the unit in which the sensor sent the vectors.
    """
    sizes, k = np.empty(len(refused)), 0
    for one in refused:
        if one.sensor == sensor and start_ns <= one.stamp_ns < end_ns:
            sizes[k] = one.size
            k += 1
    return np.sort(sizes[:k])


@compiled
def _count(values: Array, low: float, high: float) -> int:
    """Return the number of values, shape (n, k), that the gate changes: beyond the gate, NaN, or -0."""
    found = 0
    for i in range(values.shape[0]):
        for c in range(values.shape[1]):
            v = values[i, c]
            found += int(not low <= v <= high) + int(v == 0.0 and math.copysign(1.0, v) < 0.0)
    return found


@compiled
def _apply(values: Array, low: float, high: float) -> NDArray[np.float64]:
    """
    Replace each value, shape (n, k), beyond the gate by NaN and each -0 by 0, in place.

    low, high: limits of the gate. Returns the length of each row that has a value beyond the gate, without its NaN
    components, shape (n,), and NaN for the other rows.
    """
    sizes = np.full(values.shape[0], math.nan)
    for i in range(values.shape[0]):
        size, beyond = 0.0, False
        for c in range(values.shape[1]):
            v = values[i, c]
            if not math.isnan(v):
                size = math.hypot(size, v)
                beyond = beyond or not low <= v <= high
        for c in range(values.shape[1]):
            # Write one bit pattern for NaN and one for zero, because some stages compare bits.
            values[i, c] = values[i, c] + 0.0 if low <= values[i, c] <= high else math.nan
        if beyond:
            sizes[i] = size
    return sizes
