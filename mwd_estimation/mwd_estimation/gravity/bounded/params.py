# SPDX-License-Identifier: Apache-2.0
"""Settings of the bounded gravity filter, as its kernels take them."""

from __future__ import annotations

from typing import NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY


class Params(NamedTuple):
    """Settings of the bounded filter: first the place and the tool, then the filter's own. All sigmas are 1 sigma."""

    #: Magnitude of local gravity, m/s^2. An error of 0.01 costs nothing in attitude; a state absorbs it.
    gravity: float = STANDARD_GRAVITY
    #: How well that is known, m/s^2: what the accelerometers show beyond it is an error of theirs, which widens sigma.
    #: Not known by default: the spread over the Earth.
    gravity_sigma: float = 0.03
    #: `gyro_range`, `accel_range`: rate, rad/s, and force, m/s^2, at which the sensors clip.
    gyro_range: float = 34.9
    accel_range: float = 156.9
    coning: float = 0.0  #: share of the 1/12 coning term: 1 for mean rates, 0 where the sensor strapdown-integrates
    #: Rates are point samples instead of means over the sampling interval: integrate them by the trapezoid.
    sampled: bool = False
    #: Gyro bias at switch-on, rad/s. Raising it lets the bias settle faster and the start be less certain.
    bias_sigma: float = 0.005
    #: Scale error of the x gyro at switch-on. Raising it widens the start where the speed varies.
    scale_sigma: float = 0.0015
    lever_sigma: float = 0.03  #: distance of the sensor from the point of the tool that moves least, m
    #: Tilt that calibration errors of the accelerometers leave, rad: a floor of sigma. The default is a calibrated
    #: probe's; 0.003 as from the factory.
    calibration_sigma: float = 0.00015
    #: Share of the rate about x that the gyros across it read, at switch-on, with the reserve of the bias. Raising it
    #: lets it settle faster and widens sigma while the tool rotates.
    misalignment_sigma: float = 0.00075
    #: Gyro white noise with reserve, rad/s/sqrt(Hz). Raising it lets more vibration through.
    gyro_noise: float = 0.00071
    #: Gyro noise for each rate across the tool axis: scale and misalignment, which are no states.
    rate_noise: float = 0.0012
    #: Random walk of the gyro bias with reserve, rad/s/sqrt(s). Raising it follows a warming gyro faster.
    bias_walk: float = 0.00013
    accel_noise: float = 0.014  #: Accelerometer white noise with reserve, m/s^2/sqrt(Hz). Raising it smooths more.
    #: Least displacement of the tool by vibration, m. Raising it smooths a quiet tool more.
    displacement: float = 0.0038
    #: Least random walk of the point that the tool vibrates about, m/sqrt(s). Raising it smooths a quiet tool more.
    walk: float = 0.001
    axial_speed: float = 1.0  #: speed along the hole, 1 sigma, m/s: a stand of 28 m is tripped in half a minute
    #: Longest data gap over which the attitude is continued, s; after a longer one the filter starts anew. The sigma of
    #: what the gyros carry over it tells how well: a tool that turned has lost its toolface by then, one that did not
    #: has not.
    max_bridged_gap_s: float = 10.0
