# SPDX-License-Identifier: Apache-2.0
"""Write the attitude and gravity messages of the IMU samples in a part of a block."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mwd_estimation.attitude.gyro_azimuth_filter import AzimuthRow, MagneticAzimuth
from mwd_estimation.attitude.sample import Sample
from mwd_estimation.attitude.time_alignment import AttitudeRow
from mwd_estimation.core.sensor_fault import ACCEL, GYRO
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_REJECTED, _NEAR_VERTICAL = int(Status.REJECTED), int(Status.NEAR_VERTICAL)
_DISTURBED, _AIDED = int(Status.MAG_DISTURBED), int(Status.GYRO_AIDED)
_SUSPECT = int(Status.SENSOR_SUSPECT)
# Sensors from which inclination and gravity toolface are computed.
_LEVEL_SENSORS = GYRO | ACCEL


class LastMagnetic:
    """Last magnetic azimuth with its 1 sigma, rad (NaN before the first one), and bits of `Status`."""

    status: int
    azimuth: float
    sigma: float


class OneFieldStretch(NamedTuple):
    """Properties shared by all samples of a stretch (a part of a block with one field model)."""

    start: int  #: index in the block of the first sample of the stretch
    north: int  #: code of the north reference, as in `core.north.North`
    status: int  #: bits of `Status` that are added to every sample
    gyro_only: bool  #: whether only azimuths propagated by the gyros alone are written


LAST_MAGNETIC = dtype_of(LastMagnetic)


@compiled
def write(
    stretch: OneFieldStretch,
    state: Samples,
    samples: Samples,
    plain: Samples,
    azimuth: Samples,
    magnetic: Samples,
    attitude: Samples,
    gravity: Samples,
) -> int:
    """
    Fill the messages of a stretch of n samples; return the number of rejected samples.

    An unknown value is NaN, and so is its sigma. The sigma is pi for values from a suspect sensor, and for azimuth and
    gravity toolface near the vertical.

    Parameters
    ----------
    stretch : OneFieldStretch
    state : ndarray of dtype LAST_MAGNETIC, shape (1,)
        Changed in place.
    samples, plain, azimuth : ndarray, shape (n,)
        Samples, attitude without interference filter and gyros, and gyro-propagated azimuth; dtypes `sample.SAMPLE`,
        `time_alignment.ATTITUDE_ROW` and `gyro_azimuth_filter.AZIMUTH_ROW`.
    magnetic : ndarray of dtype `gyro_azimuth_filter.MAGNETIC_AZIMUTH`, shape (k,)
        Magnetic azimuths measured within the stretch.
    attitude, gravity : ndarray, shape (n,)
        Output, dtypes `wire.ATTITUDE` and `wire.GRAVITY`.
    """
    last: LastMagnetic = state[0]
    rejected, pair = 0, 0
    for i in range(len(samples)):
        while pair < len(magnetic) and magnetic[pair].place - stretch.start <= i:
            _take(last, magnetic[pair])
            pair += 1
        status = _write_attitude(stretch, last, samples[i], plain[i], azimuth[i], attitude[i])
        _write_gravity(samples[i], status, gravity[i])
        rejected += status & _REJECTED != 0
    return rejected


@compiled
def _take(last: LastMagnetic, taken: MagneticAzimuth) -> None:
    variance = taken.sigma_slow * taken.sigma_slow + taken.sigma_held * taken.sigma_held
    variance += taken.sigma_noise * taken.sigma_noise
    variance += taken.sigma_constant * taken.sigma_constant
    last.status, last.azimuth, last.sigma = int(np.int64(taken.status)), taken.azimuth, math.sqrt(variance)


@compiled
def _azimuth(plain: AttitudeRow, azimuth: AzimuthRow, status: int, last: LastMagnetic) -> tuple[bool, float, float]:
    """
    Return whether the azimuth is known, the azimuth, rad, and its sigma, rad; NaN if unknown.

    The last magnetic azimuth is used only if none was propagated, magnetic samples arrive (`plain.azimuth` is known),
    and the field is not disturbed. status: bits of `Status`.
    """
    if math.isfinite(azimuth.azimuth):
        return True, azimuth.azimuth, azimuth.sigma
    # No azimuth is propagated at the start, near the vertical, and without gyros.
    usable = math.isfinite(plain.azimuth + last.azimuth) and status & _DISTURBED == 0
    if azimuth.sigma == math.inf and usable:
        return True, last.azimuth % (2.0 * math.pi), last.sigma
    return False, math.nan, math.nan


@compiled
def _magnetic_toolface(
    plain: AttitudeRow, azimuth: float, sigma: float, down_x: float, near_vertical: bool
) -> tuple[float, float]:
    """
    Return the magnetic toolface and its 1 sigma, rad.

    Near the vertical, or without an azimuth, it is the toolface of `plain`. azimuth, sigma: azimuth and its sigma, rad.
    down_x: x component of the unit vector down.
    """
    if near_vertical or not math.isfinite(azimuth):
        return plain.magnetic_toolface, plain.sigma_magnetic_toolface
    # Add the azimuth minus `plain.azimuth` to the magnetic toolface. If `plain.azimuth` is NaN, compute the magnetic
    # toolface from the azimuth and the gravity toolface.
    if math.isfinite(plain.azimuth):
        toolface = plain.magnetic_toolface + (azimuth - plain.azimuth)
    else:
        side = plain.gravity_toolface
        toolface = azimuth + math.atan2(math.sin(side), math.cos(side) * down_x)
    tau = 2.0 * math.pi
    toolface = toolface - tau if toolface >= tau else (toolface + tau if toolface < 0.0 else toolface)
    return toolface, sigma


@compiled
def _write_attitude(
    stretch: OneFieldStretch,
    last: LastMagnetic,
    sample: Sample,
    plain: AttitudeRow,
    azimuth: AzimuthRow,
    row: Samples,
) -> int:
    """Fill the attitude message of one sample; return its status bits."""
    has_gravity = math.isfinite(plain.inclination)
    # NEAR_VERTICAL follows the inclination limits of the attitude settings, not of the gravity method.
    status = (sample.status & ~_NEAR_VERTICAL) | int(np.int64(plain.status)) | stretch.status
    status |= int(np.int64(azimuth.status)) | (last.status & _DISTURBED)
    near_vertical = status & _NEAR_VERTICAL != 0
    has_azimuth, angle, sigma = _azimuth(plain, azimuth, status, last)
    toolface, sigma_toolface = _magnetic_toolface(plain, angle, sigma, sample.down[0], near_vertical)
    # `turned` is infinite if the toolfaces of a rejected sample are unknown.
    has_turn = sample.turned < math.inf
    has_north = (has_azimuth or (math.isfinite(plain.azimuth) and near_vertical)) and has_turn
    has_high_side = has_gravity and has_turn
    if sample.turned > 0.0:
        sigma_toolface = min(math.hypot(sigma_toolface, sample.turned), math.pi)
    if has_azimuth:
        status |= last.status & ~_DISTURBED
    if stretch.gyro_only and status & _AIDED == 0:
        has_azimuth, has_north, angle = False, False, math.nan
    unsure, unsure_level = sample.suspect != 0, sample.suspect & _LEVEL_SENSORS != 0
    if unsure:
        status |= _SUSPECT
    row["stamp_ns"] = sample.sent_ns
    row["inclination"] = plain.inclination if has_gravity else math.nan
    row["azimuth"] = angle
    row["gravity_toolface"] = plain.gravity_toolface if has_high_side else math.nan
    row["magnetic_toolface"] = toolface if has_north else math.nan
    row["sigma_inclination"] = _sigma(sample.sigma_inclination, has_gravity, unsure_level)
    row["sigma_azimuth"] = _sigma(sigma, has_azimuth, near_vertical or unsure)
    row["sigma_gravity_toolface"] = _sigma(sample.sigma_toolface, has_high_side, near_vertical or unsure_level)
    row["sigma_magnetic_toolface"] = _sigma(sigma_toolface, has_north, unsure)
    row["status"] = status
    row["north"] = stretch.north
    return status


@compiled
def _sigma(sigma: float, known: bool, unsure: bool) -> float:
    """Return the sigma for the message, rad: NaN if not `known`, pi if `unsure` (the value may have any error)."""
    return (math.pi if unsure else sigma) if known else math.nan


@compiled
def _write_gravity(sample: Sample, status: int, row: Samples) -> None:
    """Fill the gravity message of one sample; status: bits of `Status`."""
    down, vector = sample.down, row["gravity"]
    known = math.isfinite(down[0] + down[1] + down[2]) and sample.turned < math.inf
    for i in range(3):
        vector[i] = down[i] if known else math.nan
    row["stamp_ns"] = sample.sent_ns
    row["sigma"] = _sigma(sample.sigma_down, known, sample.suspect & _LEVEL_SENSORS != 0)
    row["non_gravity"] = sample.non_gravity
    row["rotary_speed"] = sample.rotary_speed
    row["status"] = status
