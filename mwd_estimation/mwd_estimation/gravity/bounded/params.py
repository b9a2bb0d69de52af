# SPDX-License-Identifier: Apache-2.0
"""Settings of the bounded gravity filter, as its kernels take them."""

from __future__ import annotations

from typing import NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY


class Params(NamedTuple):
    """Settings of the bounded filter: first place and tool, then the filter itself. All sigmas are 1 sigma."""

    #: Magnitude of local gravity, m/s^2. An error of 0.01 does not affect the attitude; a state absorbs it.
    gravity: float = STANDARD_GRAVITY
    #: Sigma of that value, m/s^2. A difference shown by the accelerometers beyond it is their own error, which widens
    #: sigma. The default is for an unknown place: the spread over the Earth.
    gravity_sigma: float = 0.03
    #: `gyro_range`, `accel_range`: rate, rad/s, and force, m/s^2, at which the sensors clip.
    gyro_range: float = 34.9
    accel_range: float = 156.9
    coning: float = 0.0  #: share of the 1/12 coning term: 1 for mean rates, 0 if the sensor integrates (strapdown)
    #: True if rates are point samples instead of means over the sampling interval; they are integrated by the
    #: trapezoid.
    sampled: bool = False
    #: Gyro bias at switch-on, rad/s. Raising it makes the bias settle faster and the start less certain.
    bias_sigma: float = 0.005
    #: Scale error of the x gyro at switch-on. Raising it makes the start less certain if the speed varies.
    scale_sigma: float = 0.0015
    lever_sigma: float = 0.03  #: distance of the sensor from the point of the tool that moves least, m
    #: Bias of each accelerometer, m/s^2. The defaults of bias, scale and misalignment are those of a calibrated probe.
    accel_bias_sigma: float = 0.00098
    accel_scale_sigma: float = 0.0001  #: scale error of each accelerometer
    accel_misalignment_sigma: float = 0.0001  #: misalignment of each accelerometer towards each other axis, rad
    #: Share of the x rate that the cross-axis gyros read at switch-on, inflated like the bias. Raising it makes it
    #: settle faster and widens sigma while the tool rotates.
    misalignment_sigma: float = 0.00075
    #: Inflated white noise of the gyros, rad/s/sqrt(Hz). Raising it lets more vibration through.
    gyro_noise: float = 0.00071
    #: Gyro noise per rate across the tool axis: scale and misalignment errors, which are not states.
    rate_noise: float = 0.0012
    #: Inflated random walk of the gyro bias, rad/s/sqrt(s). Raising it follows a warming gyro faster.
    bias_walk: float = 0.00013
    accel_noise: float = 0.014  #: Inflated white noise of the accelerometers, m/s^2/sqrt(Hz). Raising it smooths more.
    #: Least displacement of the tool by vibration, m. Raising it smooths a quiet tool more.
    displacement: float = 0.0038
    #: Least random walk of the point that the tool vibrates about, m/sqrt(s). Raising it smooths a quiet tool more.
    walk: float = 0.001
    axial_speed: float = 1.0  #: speed along the hole, 1 sigma, m/s: a stand of 28 m is tripped in half a minute
    #: Error of the magnetometer across the axis, 1 sigma, T: noise, bias and field of the string. Raising it trusts the
    #: field less where it must show the roll (`field_roll`).
    mag_error: float = 1.2206555615733704e-07
    #: Longest data gap over which the attitude is continued, s; after a longer one the filter restarts. Sigma shows the
    #: quality of the continuation: a rotating tool loses its toolface over such a gap, a resting one does not.
    max_bridged_gap_s: float = 10.0
