# SPDX-License-Identifier: Apache-2.0
"""Settings of the tool with the noise that the covariances of its samples state."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from mwd_estimation.attitude import time_alignment_state
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.input_covariance import Noise

# A gyro's stated noise counts as larger from this ratio on: a data sheet states the density, a driver the noise of a
# sample after its own filter (first order, 255 Hz, read at 100 Hz: twice as much).
_LARGER = 3.0
# Accelerometer noise that the bounded filter assumes anyway, m/s^2/sqrt(Hz).
_ACCEL_NOISE = Params().accel_noise


def with_noise(settings: EstimatorSettings, stated: Mapping[str, Noise]) -> tuple[EstimatorSettings, list[str]]:
    """
    Return settings with the noise stated by the covariances of the samples, where it is larger than the tool's.

    Parameters
    ----------
    settings : EstimatorSettings
    stated : mapping
        Noise by vector of the messages, from `input_covariance.NoiseWatch`.

    Returns
    -------
    settings : EstimatorSettings
    notes : list of str
        One sentence for each vector whose stated noise is used; empty if the settings stay the same.
    """
    tool, notes = settings.tool, []
    gyro, accel, mag = (
        stated.get(vector, Noise()) for vector in ("angular_velocity", "linear_acceleration", "magnetic_field")
    )
    gyro_noise, mag_bias = tool.gyro.noise_deg_sqrt_h, tool.magnetometer.bias_nt
    accel_bias = tool.accelerometer.bias_ug
    taken = "more than the tool's: sigma is widened by it"
    # Averaging time of the continuous attitude, s, which is shorter than that of a station.
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
