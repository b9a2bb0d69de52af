# SPDX-License-Identifier: Apache-2.0
"""The noise that covariances of the samples state, as settings of the tool."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from mwd_estimation.attitude import time_alignment_state
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.input_covariance import Noise

# A gyro's stated noise counts as larger from this ratio: a data sheet means the density, a driver what a sample has
# after a filter of its own (first order, 255 Hz, read at 100 Hz: twice).
_LARGER = 3.0
# The noise of accelerometers that the bounded filter reckons with anyway, m/s^2/sqrt(Hz).
_ACCEL_NOISE = Params().accel_noise


def with_noise(settings: EstimatorSettings, stated: Mapping[str, Noise]) -> tuple[EstimatorSettings, list[str]]:
    """
    Settings with the noise that the covariances of the samples state, where it is larger than the tool's.

    Parameters
    ----------
    settings : EstimatorSettings
    stated : mapping
        By vector of the messages, as `input_covariance.NoiseWatch` finds it.

    Returns
    -------
    settings : EstimatorSettings
    notes : list of str
        One sentence for each vector whose noise is taken; empty where the settings stay the same.
    """
    tool, notes = settings.tool, []
    gyro, accel, mag = (
        stated.get(vector, Noise()) for vector in ("angular_velocity", "linear_acceleration", "magnetic_field")
    )
    gyro_noise, mag_bias = tool.gyro.noise_deg_sqrt_h, tool.magnetometer.bias_nt
    accel_bias = tool.accelerometer.bias_ug
    taken = "more than the tool's: sigma is widened by it"
    # What the continuous attitude averages over, s, which is less than a station does.
    seconds = max(2.0 * time_alignment_state.Params().smoothing_s, accel.period_s, mag.period_s)
    density = math.degrees(gyro.density) * 60.0
    if density > _LARGER * gyro_noise:
        gyro_noise = density
        notes.append(f"the covariance of angular_velocity states {density:.2g} deg/sqrt(h), {taken}")
    if accel.density > _ACCEL_NOISE:
        accel_bias = math.hypot(accel_bias, accel.density / STANDARD_GRAVITY / math.sqrt(seconds) * 1e6)
        notes.append(f"the covariance of linear_acceleration states {accel.sigma:.2g} m/s^2 a sample, {taken}")
    if mag.sigma * 1e9 > mag_bias:
        mag_bias = math.hypot(mag_bias, mag.density * 1e9 / math.sqrt(seconds))
        notes.append(f"the covariance of magnetic_field states {mag.sigma * 1e9:.0f} nT a sample, {taken}")
    if not notes:
        return settings, notes
    tool = dataclasses.replace(
        tool,
        gyro=dataclasses.replace(tool.gyro, noise_deg_sqrt_h=gyro_noise),
        accelerometer=dataclasses.replace(tool.accelerometer, bias_ug=min(accel_bias, 1e5)),
        magnetometer=dataclasses.replace(tool.magnetometer, bias_nt=min(mag_bias, 1e4)),
    )
    return dataclasses.replace(settings, tool=tool), notes
