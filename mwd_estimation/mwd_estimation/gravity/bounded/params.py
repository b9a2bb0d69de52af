# SPDX-License-Identifier: Apache-2.0
"""Settings of the bounded gravity filter, as a record for its kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of


class BoundedParams(NamedTuple):
    """Settings of the bounded filter: first place and tool, then the filter itself. All sigmas are 1 sigma."""

    #: Magnitude of local gravity, m/s^2. An error of 0.01 m/s^2 does not affect the attitude, because a state estimates
    #: it.
    gravity: float = STANDARD_GRAVITY
    #: 1 sigma of the local gravity, m/s^2. If the measured gravity differs by more, the accelerometers have larger
    #: errors than stated, and sigma grows. The default is for an unknown place: the spread over the Earth.
    gravity_sigma: float = 0.03
    #: `gyro_range`, `accel_range`: rate, rad/s, and force, m/s^2, at which the sensors clip.
    gyro_range: float = 34.9
    accel_range: float = 156.9
    coning: float = 0.0  #: share of the 1/12 coning term: 1 for mean rates, 0 if the sensor integrates (strapdown)
    #: True if rates are point samples instead of means over the sampling interval; they are integrated by the
    #: trapezoid.
    sampled: bool = False
    #: Gyro bias at switch-on, rad/s: 2.5 times the sigma in the settings of the tool. Raising it makes the bias settle
    #: faster and the start less certain.
    bias_sigma: float = 0.005
    #: Scale error of the x gyro at switch-on. Raising it makes the start less certain if the rotary speed varies.
    scale_sigma: float = 0.0015
    lever_sigma: float = 0.03  #: distance of the sensor from the point of the tool that moves least, m
    #: Bias of each accelerometer, m/s^2. The defaults of bias, scale and misalignment are those of a calibrated probe.
    accel_bias_sigma: float = 0.00098
    accel_scale_sigma: float = 0.0001  #: scale error of each accelerometer
    accel_misalignment_sigma: float = 0.0001  #: misalignment of each accelerometer towards each other axis, rad
    #: Share of the x rate that the cross-axis gyros read at switch-on, inflated like the bias. Raising it makes the
    #: estimate of this share settle faster, and widens sigma while the tool rotates.
    misalignment_sigma: float = 0.00075
    #: Inflated white noise of the gyros, rad/s/sqrt(Hz). Raising it lets more vibration through.
    gyro_noise: float = 0.00071
    #: Gyro noise in proportion to the rate across the tool axis, 1/sqrt(Hz): from scale and misalignment errors that
    #: are not states.
    rate_noise: float = 0.0012
    #: Inflated random walk of the gyro bias, rad/s/sqrt(s). Raising it follows a warming gyro faster.
    bias_walk: float = 0.00013
    accel_noise: float = 0.014  #: Inflated white noise of the accelerometers, m/s^2/sqrt(Hz). Raising it smooths more.
    #: Smallest displacement of the tool by vibration, m. Raising it smooths a quiet tool more.
    displacement: float = 0.0038
    #: Smallest random walk of the point about which the tool vibrates, m/sqrt(s). Raising it smooths a quiet tool more.
    walk: float = 0.001
    axial_speed: float = 1.0  #: speed along the hole, 1 sigma, m/s: a stand of 28 m is tripped in half a minute
    #: Error of the magnetometer across the axis, T: noise, bias and field of the string. Raising it gives the field
    #: less weight where it determines the roll (`field_roll`).
    mag_error: float = 1.2206555615733704e-07
    #: Longest data gap over which the attitude is continued, s; after a longer one the filter restarts. Sigma shows the
    #: quality of the continuation: a rotating tool loses its toolface over such a gap, a resting one does not.
    max_bridged_gap_s: float = 10.0


_RECORD = dtype_of(BoundedParams)


def as_record(params: BoundedParams) -> Samples:
    """
    Return the settings as a record with the same fields, in an array of shape (1,).

    A kernel passes a record to another kernel by reference, but it copies all values of a named tuple at every call.
    """
    return np.array([params], dtype=_RECORD)
